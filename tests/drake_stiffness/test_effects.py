"""Each built-in effect against a small computation that does not know it."""

import re
from dataclasses import replace

import numpy as np
import pytest
from drake_judge import Judge
from scipy.spatial.transform import Rotation
from synthetic import heavier, plan, points_of, reshaped_track
from three_arms import random_springs

from drake_stiffness.assembly import campaign_effects, link_spring, make_model, spring_effects
from drake_stiffness.campaign import CampaignFile
from drake_stiffness.effects import effect_kinds, make_effect
from drake_stiffness.effects.compliance import BaseCompliance, LinkCompliance
from drake_stiffness.effects.geometry import geometry_components
from drake_stiffness.errors import InputError
from drake_stiffness.simulation import simulate_readings
from drake_stiffness.springs import TEMPLATES

LOADS = [(0, 0, -2500.0, 100, 40, -30), (2000, 3500.0, 0)]


def model_with(cell, arm, k_joint, k_link, effect=None, x=()):
    """All springs of the cell with these compliances, and one more effect."""
    springs = spring_effects(cell, arm)
    values = [np.array([k]) for k in k_joint]
    values += [e.template.values(k) for e, k in zip(springs[len(k_joint) :], k_link, strict=True)]
    effects = [*springs, effect] if effect is not None else springs
    return make_model(cell, arm, effects, np.concatenate([*values, np.asarray(x, dtype=float)]))


def positions(model, cases):
    names, number = np.array(list(model.points)), cases.number
    p = simulate_readings(model, cases, np.repeat(np.arange(number), names.size), np.tile(names, number)).p
    return p.reshape(3, number, names.size).transpose(2, 0, 1)


@pytest.fixture
def world(arms, cells, judges):
    arm, cell, rng = arms["track"], cells["track"], np.random.default_rng(0)
    k_joint, k_link = random_springs(arm, rng)
    return arm, cell, judges["track"], k_joint, k_link, plan(arm, cell, 2, rng, LOADS)


@pytest.mark.parametrize(("joint", "offset"), [("track", 0.013), ("shoulder", -0.02), ("elbow", 0.03), ("spin", 0.05)])
def test_a_zero_offset_is_commanding_q_plus_d(world, joint, offset):
    arm, cell, judge, k_joint, k_link, cases = world
    effect = make_effect("joint_zero_offset", joint, {"prismatic": joint == "track"})
    assert effect.parameters[0].unit == ("m" if joint == "track" else "rad")
    q = cases.q.copy()
    q[arm.joint_names.index(joint)] += offset
    expected = judge.positions(replace(cases, q=q), points_of(cell), k_joint, k_link)
    found = positions(model_with(cell, arm, k_joint, k_link, effect, [offset]), cases)
    assert np.abs(found - expected).max() < 1e-9


@pytest.mark.parametrize("joint", ["track", "turn", "elbow", "spin"])
def test_a_geometric_error_is_a_robot_description_with_the_joint_moved(world, tmp_path, joint):
    arm, cell, _, k_joint, k_link, cases = world
    x = np.array([0.004, -0.003, 0.002, 0.01, -0.02, 0.015])
    judge = Judge(reshaped_track(tmp_path, joint, x))
    expected = judge.positions(cases, points_of(cell), k_joint, k_link)
    found = positions(model_with(cell, arm, k_joint, k_link, make_effect("link_geometry", joint), x), cases)
    assert np.abs(found - expected).max() < 1e-9
    few = make_effect("link_geometry", joint, {"components": ["dz", "rx"]})
    part = np.array([0, 0, 0.002, 0.01, 0, 0])
    expected = Judge(reshaped_track(tmp_path, joint, part)).positions(cases, points_of(cell), k_joint, k_link)
    found = positions(model_with(cell, arm, k_joint, k_link, few, [0.002, 0.01]), cases)
    assert np.abs(found - expected).max() < 1e-9


def test_the_motion_of_the_joint_itself_is_no_geometric_error(arms):
    assert geometry_components(arms["track"], 2) == ("dx", "dy", "dz", "rx", "rz")  # shoulder turns about y
    assert geometry_components(arms["kr270"], 0) == ("dx", "dy", "dz", "rx", "ry")
    slide = replace(arms["track"], axis_F=np.array([[0, 0, -1.0], *arms["track"].axis_F[1:]]))
    assert geometry_components(slide, 0) == ("dx", "dy", "rx", "ry", "rz")
    assert len(geometry_components(arms["track"], 1)) == 6  # an axis along no frame axis


def test_a_payload_error_is_a_heavier_tool(world):
    arm, cell, _, k_joint, k_link, cases = world
    x = np.array([12.0, 1.5, -0.8, 2.0])
    expected = Judge(heavier(cell, x)).positions(cases, points_of(cell), k_joint, k_link)
    found = positions(model_with(cell, arm, k_joint, k_link, make_effect("payload", "tool"), x), cases)
    assert np.abs(found - expected).max() < 1e-9
    assert np.abs(found - positions(model_with(cell, arm, k_joint, k_link), cases)).max() > 1e-5


def test_a_payload_without_mass_weighs_nothing(world):
    arm = replace(world[0], tool_mass_kg=5.0)
    bare = make_effect("payload", "tool").on_arm(arm, np.array([-5.0, 0, 0, 0]))
    assert bare.tool_mass_kg == 0.0


def test_a_tracker_reads_positions_in_its_own_frame(world):
    arm, cell, judge, k_joint, k_link, cases = world
    x = np.array([3.0, -1.0, 0.5, 0.4, 1.9, -0.7])
    p = judge.positions(cases, points_of(cell), k_joint, k_link)
    R = Rotation.from_rotvec(x[3:]).as_matrix()
    expected = np.einsum("ba,pbn->pan", R, p - x[:3, None])
    found = positions(model_with(cell, arm, k_joint, k_link, make_effect("tracker_frame", "tracker"), x), cases)
    assert np.abs(found - expected).max() < 1e-9


def test_a_reflector_offset_is_that_point_elsewhere_on_the_flange_and_no_other(world):
    arm, cell, judge, k_joint, k_link, cases = world
    x = np.array([0.002, -0.004, 0.01])
    points = points_of(cell)
    points[1] += x
    expected = judge.positions(cases, points, k_joint, k_link)
    found = positions(model_with(cell, arm, k_joint, k_link, make_effect("reflector_offset", "B"), x), cases)
    assert np.abs(found - expected).max() < 1e-9


def test_a_reflector_sits_on_the_flange_whatever_frame_reads_it_and_in_whatever_order(world):
    arm, cell, judge, k_joint, k_link, cases = world
    r, frame = np.array([0.02, -0.04, 0.1]), np.array([3.0, -1.0, 0.5, 0.4, 1.9, -0.7])
    points = points_of(cell)
    points[0] += r
    R = Rotation.from_rotvec(frame[3:]).as_matrix()
    p = judge.positions(cases, points, k_joint, k_link)
    expected = np.einsum("ba,pbn->pan", R, p - frame[:3, None])
    model = model_with(cell, arm, k_joint, k_link)
    for kinds in (["reflector_offset", "tracker_frame"], ["tracker_frame", "reflector_offset"]):
        extra = [make_effect(k, "A" if k.startswith("refl") else "tracker") for k in kinds]
        x = np.concatenate([model.x, *(r if k.startswith("refl") else frame for k in kinds)])
        found = positions(make_model(cell, arm, [*model.effects, *extra], x), cases)
        assert np.abs(found - expected).max() < 1e-9, kinds


def test_a_compliant_base_alone_turns_the_arm_about_the_first_joints_frame(arms, cells):
    arm, cell = arms["kr270"], cells["kr270"]
    k = 2e-10  # so stiff that second order is nothing
    effect = BaseCompliance("base", "beam", "z", 1.0, "base_link")
    x = np.zeros(8)
    x[effect.template.names.index("k44")] = k
    cases = plan(arm, cell, 3, np.random.default_rng(1), [(0, 2000.0, 500.0)])
    from drake_stiffness.arm import forward

    rigid = forward(replace(arm, tool_mass_kg=0.0), cases.q)
    weightless = replace(arm, gravity=np.zeros(3))
    model = make_model(cell, weightless, [effect], x)
    found = positions(model, cases)
    place = arm.p_PF[0]
    for i in range(cases.number):
        load = rigid.p_E[:, i] + rigid.R_E[:, :, i] @ cases.p_ELoad
        moment = np.cross(load - place, cases.wrench[:3, i])
        for n, point in enumerate(points_of(cell)):
            p = rigid.p_E[:, i] + rigid.R_E[:, :, i] @ point
            expected = k * moment[0] * np.cross([1, 0, 0], p - place)
            assert np.abs(found[n, :, i] - p - expected).max() < 1e-5 * 3e-6


def test_the_place_of_an_effect_must_exist(arms, cells):
    arm, cell = arms["kr270"], cells["kr270"]
    wrong = {
        "joint_compliance": "joint_9", "joint_zero_offset": "tool", "link_geometry": "link_1", "link_compliance": "joint_1",
        "base_compliance": "base_link", "payload": "flange", "tracker_frame": "world", "reflector_offset": "P9",
        "gravity_compensator": "link_2", "joint_backlash": "tool", "joint_hysteresis": "joint_7", "joint_hardening": "base",
        "joint_mesh_stiffness": "link_3", "joint_periodic_error": "axis_1", "joint_coupling": "joint_4+joint_6",
        "force_sensor_bias": "tool", "force_sensor_misalignment": "sensor", "scale": "force", "tracker_drift": "world",
    }  # fmt: skip
    assert set(wrong) == set(effect_kinds())
    geometry = {"gravity_compensator": {"anchor_m": [0.7, 0.1], "lever_m": 0.2}}
    for kind, where in wrong.items():
        with pytest.raises(InputError, match=re.escape(f"{kind} at '{where}'")):
            make_model(cell, arm, [make_effect(kind, where, geometry.get(kind))])
    with pytest.raises(InputError, match="base_compliance"):
        make_model(cell, arm, [LinkCompliance("base_link")])


def test_unknown_kinds_and_settings_are_refused():
    with pytest.raises(InputError, match=r"'joint_magic'.*joint_compliance"):
        make_effect("joint_magic", "joint_1")
    with pytest.raises(InputError, match="settings"):
        make_effect("payload", "tool", {"colour": "red"})


def test_an_effect_can_be_made_again_from_its_kind_place_and_settings(arms, cells):
    arm, cell = arms["track"], cells["track"]
    file = CampaignFile(
        cell="c", measurements="m", noise={"position_sigma_mm": 1}, tracker_frame="unknown", reference_points="unknown",
        estimate=("joint_zero_offsets", "link_geometry"),
    )  # fmt: skip
    every = spring_effects(cell, arm) + campaign_effects(file, cell, arm) + [make_effect("payload", "tool")]
    every += [link_spring(arm, "boom" if "boom" in arm.link_names else "upper", t, "y") for t in TEMPLATES]
    for effect in every:
        again = make_effect(effect.kind, effect.where, effect.settings())
        assert type(again) is type(effect)
        assert again.names == effect.names
        assert again.parameters == effect.parameters
    assert sum(len(e.parameters) for e in campaign_effects(file, cell, arm) if e.station == "reading") == 6 + 3 * 3


def test_names_are_what_the_files_promise(arms, cells):
    arm, cell = arms["kr270"], cells["kr270"]
    names = make_model(cell, arm, spring_effects(cell, arm)).names
    assert names[:6] == tuple(f"joint_{i}" for i in range(1, 7))
    assert "link_2.k26" in names or "link_2.k62" in names or "link_2.k35" in names
    assert sum(name.startswith("base_link.k") for name in names) == 8
    assert len(names) == 62
