"""The spring of the plants: what it does is what its energy says."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from plants.compensator import PinSpring
from plants.deformation import Deformation
from plants.segmented_arm import SegmentedArm

KR270 = Path(__file__).parents[2] / "examples" / "kr270"
SPRING = PinSpring(1, np.array([-0.68593, 0.02, -0.1203]), np.array([0.01, 0.03, 0.18472]), 1.5e5, 0.458)


@pytest.fixture(scope="module")
def arm() -> SegmentedArm:
    return SegmentedArm.from_files(KR270 / "kr270.urdf", KR270 / "true_arm.yaml")


def pins_energy(arm: SegmentedArm, q: np.ndarray, theta: Deformation) -> np.ndarray:
    """Energy of the spring on the deformed arm, from where its two ends are."""
    (_, a, _), (_, b, _) = SPRING.pull(arm.shape(q, theta), arm.segments, arm.chain)
    return np.asarray(0.5 * SPRING.stiffness * (np.linalg.norm(b - a, axis=1) - SPRING.free_length) ** 2)


def test_what_the_springs_of_the_arm_carry_more_is_the_loss_of_energy_over_every_coordinate(arm: SegmentedArm) -> None:
    rng, q = np.random.default_rng(0), np.array([[0.3, -1.1, 1.2, 0.4, 0.7, 0.2]])
    links, pieces = arm.segments.masses.shape
    theta = Deformation(rng.normal(0, 1e-3, (links, pieces, 1, 6)), rng.normal(0, 1e-3, (6, 1)))
    loads = [
        a.generalized_forces(a.shape(q, theta), np.zeros((1, 6)), np.zeros(3), a.gravity)
        for a in (arm, replace(arm, compensator=SPRING))
    ]
    more = Deformation(loads[1].elements - loads[0].elements, loads[1].joints - loads[0].joints)
    h = 1e-6

    def slope(**part: np.ndarray) -> float:
        ends = [
            pins_energy(arm, q, replace(theta, **{k: getattr(theta, k) + s * v for k, v in part.items()}))[0]
            for s in (1, -1)
        ]
        return float(ends[0] - ends[1]) / (2 * h)

    for index in np.ndindex(links, pieces, 1, 6):
        step = np.zeros_like(theta.elements)
        step[index] = h
        assert more.elements[index] == pytest.approx(-slope(elements=step), rel=1e-5, abs=1e-2)
    for j in range(6):
        assert more.joints[j, 0] == pytest.approx(-slope(joints=h * np.eye(6)[:, [j]]), rel=1e-5, abs=1e-2)
    assert np.abs(more.elements[1]).max() > 1e4  # it passes through the beam of the link before the joint ...
    assert np.abs(more.elements[[0, 3, 4, 5, 6]]).max() < 1e-9  # ... and nowhere beyond the two links
    assert np.flatnonzero(np.abs(more.joints[:, 0]) > 1e-9).tolist() == [1]


def test_at_the_joint_the_second_derivative_of_the_energy_is_minus_the_slope_of_the_torque(arm: SegmentedArm) -> None:
    q, h = np.linspace(-2.4, -0.1, 9), 1e-4
    torque = [-(SPRING.energy(arm.chain, q + d + h) - SPRING.energy(arm.chain, q + d - h)) / (2 * h) for d in (h, -h)]
    expected = -(torque[0] - torque[1]) / (2 * h)
    assert SPRING.stiffness_about_joint(arm.chain, q) == pytest.approx(expected, rel=1e-4)


def test_a_stiffening_spring_does_not_pull_but_joint_2_gives_way_less(arm: SegmentedArm) -> None:
    q = np.array([[0.3, -1.1, 1.2, 0.4, 0.7, 0.2]])
    stiff = replace(arm, stiffening=replace(SPRING, stiffness=5e6))
    extra = stiff.stiffening.stiffness_about_joint(arm.chain, q[:, 1])[0]
    assert extra > 1e5
    _, theta = stiff.equilibrium(q)
    loads = arm.generalized_forces(arm.shape(q, theta), np.zeros((1, 6)), np.zeros(3), arm.gravity)
    assert theta.joints[1, 0] == pytest.approx(loads.joints[1, 0] / (1 / arm.joint_compliance[1] + extra), rel=1e-9)
    assert theta.joints[2, 0] == pytest.approx(loads.joints[2, 0] * arm.joint_compliance[2], rel=1e-9)
