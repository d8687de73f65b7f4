"""Jacobians and torques of the arm against differences, a textbook formula and Drake."""

import numpy as np
import pytest
from three_arms import random_postures, random_wrench

from drake_stiffness.arm import Arm, chain_jacobian, forward, torques

POINT = np.array([0.12, -0.07, 0.21])


def moved(arm, q, dof, h, point):
    """Flange pose with one coordinate of all springs moved by h: position of the point, rotation."""
    n = arm.num_joints
    joint, link = np.zeros((n, q.shape[1])), [np.zeros((6, q.shape[1])) for _ in range(n + 1)]
    if dof < n:
        joint[dof] = h
    else:
        link[(dof - n) // 6][(dof - n) % 6] = h
    poses = forward(arm, q, joint, link)
    return poses.points(point)[0], poses.R_E


def test_the_jacobian_is_the_central_difference_of_the_pose(arms, arm_name):
    arm, h = arms[arm_name], 1e-6
    q = random_postures(arm, 12, np.random.default_rng(0))
    J, names = chain_jacobian(arm, q.T, POINT)
    assert J.shape == (12, 6, len(names)) == (12, 6, arm.num_joints + 6 * len(arm.link_names))
    for dof in range(len(names)):
        (p1, R1), (p0, R0) = (moved(arm, q, dof, s * h, POINT) for s in (1, -1))
        turn = np.einsum("ijn,kjn->ikn", R1, R0)
        spin = np.array([turn[2, 1] - turn[1, 2], turn[0, 2] - turn[2, 0], turn[1, 0] - turn[0, 1]]) / 2
        difference = np.concatenate([p1 - p0, spin]) / (2 * h)
        assert np.abs(J[:, :, dof].T - difference).max() < 1e-7, names[dof]


def test_the_jacobian_is_drakes_on_the_plant_with_virtual_joints(arms, judges, arm_name):
    arm, judge = arms[arm_name], judges[arm_name]
    q = random_postures(arm, 6, np.random.default_rng(1))
    J, names = chain_jacobian(arm, q.T, POINT)
    rigid = [None] * len(arm.link_names)
    for i in range(q.shape[1]):
        judge.pose(q[:, i], np.zeros(arm.num_joints), rigid)
        drake = judge.jacobian(POINT)[[3, 4, 5, 0, 1, 2]]
        own = [joint.velocity_start() for joint in judge.e.joint_springs]
        for spring in judge.e.link_springs:
            start = spring.velocity_start()
            own += [start + c for c in (3, 4, 5, 0, 1, 2)]
        assert np.abs(J[i] - drake[:, own]).max() < 1e-12
    assert names[arm.num_joints :][:6] == [f"{arm.link_names[0]}.{c}" for c in ("dx", "dy", "dz", "rx", "ry", "rz")]


def test_the_torques_of_many_postures_at_once_are_drakes_weight_included(arms, cells, judges, arm_name):
    arm, judge, rng = arms[arm_name], judges[arm_name], np.random.default_rng(2)
    q, wrench = random_postures(arm, 6, rng), random_wrench(6, rng)
    load = np.array(cells[arm_name].load_point_m)
    joint = 0.01 * rng.normal(size=q.shape)
    link = [0.02 * rng.normal(size=(6, 6)) for _ in arm.link_names]
    tau_joint, tau_link = torques(arm, forward(arm, q, joint, link), wrench, load, link, [True] * len(link))
    for i in range(6):
        mine = [theta[:, i] for theta in link]
        judge.pose(q[:, i], joint[:, i], mine)
        drake_joint, drake_link = judge.torques(wrench[:, i], load, mine)
        assert np.abs(tau_joint[:, i] - drake_joint).max() < 1e-7
        assert np.abs(np.array([t[:, i] for t in tau_link]) - drake_link).max() < 1e-7


def test_leaving_links_out_leaves_their_columns_out(arms):
    arm = arms["kr270"]
    q = random_postures(arm, 2, np.random.default_rng(3)).T
    wanted = [False, True, False, False, False, False, True]
    J, names = chain_jacobian(arm, q, POINT, wanted)
    everything, all_names = chain_jacobian(arm, q, POINT)
    assert {name.split(".")[0] for name in names[6:]} == {"link_1", "link_6"}
    assert np.array_equal(J, everything[:, :, [all_names.index(name) for name in names]])


def test_every_posture_of_an_array_is_evaluated_for_itself(arms, arm_name):
    arm = arms[arm_name]
    q = random_postures(arm, 5, np.random.default_rng(4))
    together = forward(arm, q)
    for i in range(5):
        alone = forward(arm, q[:, [i]])
        assert np.allclose(together.p_E[:, i], alone.p_E[:, 0], atol=1e-15)
        assert np.allclose(together.R_E[:, :, i], alone.R_E[:, :, 0], atol=1e-15)


def test_the_constants_survive_as_plain_numbers_with_unlimited_joints_as_null(arms):
    from dataclasses import replace

    arm = replace(arms["track"], upper=np.array([np.inf] * 7))
    content = arm.to_dict()
    content["upper"] = [None] * 7
    again = Arm.from_dict(content)
    assert again.joint_names == arm.joint_names
    assert again.prismatic == (True, *[False] * 6)
    for name in ("R_PF", "p_PF", "axis_F", "lower", "upper", "mass_kg", "p_MCom", "p_ETool", "gravity"):
        assert np.array_equal(getattr(again, name), getattr(arm, name)), name
    assert again.tool_mass_kg == pytest.approx(31.0)
