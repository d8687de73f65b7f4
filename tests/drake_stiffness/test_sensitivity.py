"""Columns of the observation matrix against Drake's Jacobians, textbook derivatives and differences of whole simulations."""

import numpy as np
import pytest
from drake_judge import Judge
from synthetic import heavier, plan, points_of, reshaped_track

from drake_stiffness.arm import forward
from drake_stiffness.assembly import make_model, spring_effects
from drake_stiffness.effects import make_effect
from drake_stiffness.sensitivity import sensitivity

LOADS = [(0, 0, -2500.0, 100, -50, 80), (1500, 3500.0, 0)]


def readings(model, cases):
    number, names = cases.number, np.array(list(model.points))
    return np.repeat(np.arange(number), names.size), np.tile(names, number)


def test_columns_of_springs_are_J_omega_J_transposed_W_with_drakes_J_and_weight(arms, cells, judges, arm_name):
    arm, cell, judge = arms[arm_name], cells[arm_name], judges[arm_name]
    model = make_model(cell, arm, spring_effects(cell, arm))
    cases = plan(arm, cell, 2, np.random.default_rng(0), LOADS)
    case, point = readings(model, cases)
    columns = sensitivity(model, cases, case, point) / model.scales
    order = np.array([3, 4, 5, 0, 1, 2])
    for m in range(case.size):
        i = case[m]
        rest = [None] * len(arm.link_names)
        judge.pose(cases.q[:, i], np.zeros(arm.num_joints), rest)
        tau_joint, tau_link = judge.torques(cases.wrench[:, i], cases.p_ELoad, rest)
        J = judge.jacobian(model.points[point[m]])[order]
        for effect, own in zip(model.effects, model.slices, strict=True):
            place, number = effect.site(arm)
            if place == "joint":
                expected = (J[:, judge.e.joint_springs[number].velocity_start()] * tau_joint[number])[:, None]
            else:
                block = J[:, judge.e.link_springs[number].velocity_start() + order]
                tau = tau_link[number]
                parts = []
                for a, b in effect.template.entries:
                    part = block[:, a] * tau[b]
                    if a != b:
                        part = part + block[:, b] * tau[a]
                    parts.append(part)
                expected = np.array(parts).T
            assert np.abs(columns[m][:, own] - expected).max() < 1e-7 + 1e-10 * np.abs(expected).max()


def test_columns_of_frames_reflectors_and_zero_offsets_of_a_rigid_arm_are_the_textbooks(arms, cells):
    arm, cell = arms["track"], cells["track"]
    effects = [make_effect("tracker_frame", "tracker"), make_effect("reflector_offset", "B")]
    effects += [
        make_effect("joint_zero_offset", name, {"prismatic": p})
        for name, p in zip(arm.joint_names, arm.prismatic, strict=True)
    ]
    model = make_model(cell, arm, effects)
    cases = plan(arm, cell, 4, np.random.default_rng(1), LOADS)
    case, point = readings(model, cases)
    found = sensitivity(model, cases, case, point) / model.scales
    poses = forward(arm, cases.q)
    places = dict(zip(model.points, points_of(cell), strict=True))
    for m in range(case.size):
        i = case[m]
        p = poses.p_E[:, i] + poses.R_E[:, :, i] @ places[point[m]]
        assert np.allclose(found[m, :3, 0:3], -np.eye(3), atol=1e-9)
        # turning the tracker by r moves what it reads by -r x p
        assert np.allclose(found[m, :3, 3:6], np.cross(p, np.eye(3)).T, atol=1e-8)
        assert np.allclose(found[m, 3:, 3:6], -np.eye(3), atol=1e-8)
        seen = poses.R_E[:, :, i] if point[m] == "B" else np.zeros((3, 3))
        assert np.allclose(found[m, :3, 6:9], seen, atol=1e-9)
        for k in range(7):
            axis = np.broadcast_to(poses.axis[k], (3, cases.number))[:, i]
            joint = np.broadcast_to(poses.p_J[k], (3, cases.number))[:, i]
            moves = axis if k == 0 else np.cross(axis, p - joint)
            assert np.allclose(found[m, :3, 9 + k], moves, atol=1e-8)
            assert np.allclose(found[m, 3:, 9 + k], 0 if k == 0 else axis, atol=1e-8)


def test_columns_of_springs_turn_with_the_trackers_frame(arms, cells):
    from scipy.spatial.transform import Rotation

    arm, cell = arms["kr270"], cells["kr270"]
    springs = spring_effects(cell, arm)
    plain = make_model(cell, arm, springs)
    framed = make_model(cell, arm, [*springs, make_effect("tracker_frame", "tracker")])
    r = np.array([0.3, -0.8, 1.1])
    framed = framed.with_x(np.concatenate([plain.x, [1.0, 2.0, 3.0], r]))
    cases = plan(arm, cell, 2, np.random.default_rng(2), LOADS)
    case, point = readings(plain, cases)
    into = Rotation.from_rotvec(r).as_matrix().T
    expected = sensitivity(plain, cases, case, point)
    found = sensitivity(framed, cases, case, point)[:, :, : plain.x.size]
    for rows in (slice(0, 3), slice(3, 6)):
        turned = np.einsum("ab,mbn->man", into, expected[:, rows])
        assert np.abs(found[:, rows] - turned).max() < 1e-9 * np.abs(expected).max()


@pytest.mark.parametrize("kind", ["payload", "link_geometry"])
def test_columns_of_errors_of_the_arm_are_differences_of_drake_plants_built_with_them(arms, cells, tmp_path, kind):
    arm, cell = arms["track"], cells["track"]
    effect = make_effect(kind, "tool" if kind == "payload" else "elbow")
    springs = [e for e in spring_effects(cell, arm) if e.kind == "joint_compliance"]
    k_joint = np.where(arm.prismatic, 1e-8, 4e-7)
    model = make_model(cell, arm, [*springs, effect], np.concatenate([k_joint, np.zeros(len(effect.parameters))]))
    cases = plan(arm, cell, 1, np.random.default_rng(3), LOADS)
    case, point = readings(model, cases)
    found = sensitivity(model, cases, case, point)[:, :3, 7:] / model.scales[7:]
    for k in range(found.shape[2]):
        h, ends = (0.1 if kind == "payload" else 1e-4), []
        for s in (h, -h):
            x = s * np.eye(found.shape[2])[k]
            other = heavier(cell, x) if kind == "payload" else reshaped_track(tmp_path, "elbow", x)
            ends.append(Judge(other).positions(cases, points_of(cell), k_joint))
        slope = ((ends[0] - ends[1]) / (2 * h)).transpose(2, 0, 1).reshape(-1, 3)
        assert np.abs(found[:, :, k] - slope).max() < 1e-6 * max(np.abs(slope).max(), 1e-5), k


def test_positions_alone_are_the_same_columns_behind_an_instrument(arms, cells):
    arm, cell = arms["track"], cells["track"]
    effects = [make_effect("tracker_frame", "tracker"), make_effect("tracker_drift", "tracker")]
    model = make_model(cell, arm, [*spring_effects(cell, arm), *effects])
    x = model.x.copy()
    x[model.slices[-2]] = [1e-3, -2e-3, 5e-4, 0.2, -0.1, 0.3]
    model = model.with_x(x)
    cases = plan(arm, cell, 2, np.random.default_rng(2), LOADS)
    case, point = readings(model, cases)
    whole = sensitivity(model, cases, case, point)
    assert np.array_equal(sensitivity(model, cases, case, point, turns=False), whole[:, :3])
