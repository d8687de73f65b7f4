"""Displacements and Cartesian stiffness: (6) against (7), against Drake, and what is infinite."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from synthetic import plan, points_of
from three_arms import random_postures, random_springs

from drake_stiffness.assembly import make_model, spring_effects
from drake_stiffness.errors import UntrustworthyError
from drake_stiffness.simulation import (
    cartesian_compliance,
    cartesian_stiffness,
    cartesian_stiffness_saddle,
    simulate_displacement,
)
from drake_stiffness.structure import Structure

TIP = np.array([0.1, 0.02, 0.3])


def test_stiffness_by_eq_6_is_stiffness_by_eq_7(arms, arm_name):
    arm, rng = arms[arm_name], np.random.default_rng(0)
    structure = Structure(arm, *random_springs(arm, rng))
    q = random_postures(arm, 10, rng).T
    direct, saddle = cartesian_stiffness(structure, q, TIP), cartesian_stiffness_saddle(structure, q, TIP)
    size = np.sqrt(np.einsum("nii->ni", direct))
    assert (np.abs(direct - saddle) / (size[:, :, None] * size[:, None, :])).max() < 1e-9
    assert np.linalg.eigvalsh(direct / (size[:, :, None] * size[:, None, :])).min() > 0


def test_cartesian_compliance_is_drakes_jacobian_around_the_springs(arms, judges, arm_name):
    arm, judge, rng = arms[arm_name], judges[arm_name], np.random.default_rng(1)
    k_joint, k_link = random_springs(arm, rng)
    q = random_postures(arm, 4, rng)
    C = cartesian_compliance(Structure(arm, k_joint, k_link), q.T, TIP)
    for i in range(4):
        judge.pose(q[:, i], np.zeros(arm.num_joints), [None] * len(k_link))
        J = judge.jacobian(TIP)[[3, 4, 5, 0, 1, 2]]
        expected = np.zeros((6, 6))
        for spring, k in zip(judge.e.joint_springs, k_joint, strict=True):
            column = J[:, [spring.velocity_start()]]
            expected += k * column @ column.T
        for spring, k in zip(judge.e.link_springs, k_link, strict=True):
            block = J[:, spring.velocity_start() + np.array([3, 4, 5, 0, 1, 2])]
            expected += block @ k @ block.T
        assert np.abs(C[i] - expected).max() < 1e-12 * np.abs(expected).max()


def test_a_stiffness_that_is_infinite_somewhere_is_refused(arms):
    arm = arms["kr270"]
    structure = Structure(arm, np.array([1e-6] * 5 + [0.0]), (None,) * 7)
    with pytest.raises(UntrustworthyError, match="infinite"):
        cartesian_stiffness(structure, random_postures(arm, 3, np.random.default_rng(2)).T, TIP)


def test_displacement_and_rotation_are_loaded_minus_under_weight_alone(arms, cells, judges):
    arm, cell, judge, rng = arms["track"], cells["track"], judges["track"], np.random.default_rng(3)
    k_joint, k_link = random_springs(arm, rng)
    model = make_model(cell, arm, spring_effects(cell, arm))
    values = [np.array([k]) for k in k_joint]
    values += [e.template.values(k) for e, k in zip(model.effects[7:], k_link, strict=True)]
    model = model.with_x(np.concatenate(values))
    cases = plan(arm, cell, 3, rng, [(0, 0, -2500.0, 50, 20, -30)])
    names, number = np.array(list(model.points)), cases.number
    found = simulate_displacement(model, cases, np.repeat(np.arange(number), 3), np.tile(names, number))
    points = points_of(cell)
    for i in range(number):
        ends = [
            judge.equilibrium(cases.q[:, i], w, cases.p_ELoad, k_joint, k_link)[0]
            for w in (cases.wrench[:, i], np.zeros(6))
        ]
        p1, p0 = (points @ X[:3, :3].T + X[:3, 3] for X in ends)
        turn = Rotation.from_matrix(ends[0][:3, :3] @ ends[1][:3, :3].T).as_rotvec()
        for place in range(3):
            assert np.abs(found.dp[:, 3 * i + place] - (p1 - p0)[place]).max() < 1e-9
            assert np.abs(found.phi[:, 3 * i + place] - turn).max() < 1e-9
