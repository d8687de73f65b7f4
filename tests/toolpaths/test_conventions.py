"""What orientation words mean: against scipy's rotations, and back to the same numbers."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from toolpaths.conventions import (
    FANUC,
    KUKA,
    QUATERNION,
    ROTATION_VECTOR,
    STAUBLI,
    TOOL_AXIS,
    Convention,
    rotation_onto,
)

RNG = np.random.default_rng(3)
ANGLES = RNG.uniform(-170, 170, (60, 3))
VALUES = {
    KUKA: ANGLES,
    FANUC: ANGLES,
    STAUBLI: ANGLES,
    QUATERNION: RNG.normal(size=(60, 4)),
    ROTATION_VECTOR: RNG.uniform(-5, 5, (60, 3)),
    TOOL_AXIS: RNG.normal(size=(60, 3)),
}


@pytest.mark.parametrize(
    ("convention", "order"), [(FANUC, "xyz"), (STAUBLI, "XYZ")], ids=["Fanuc: fixed x y z", "Staubli: moving x y z"]
)
def test_angles_of_makers_are_the_rotations_of_their_manuals(convention: Convention, order: str) -> None:
    expected = Rotation.from_euler(order, ANGLES, degrees=True).as_matrix()
    np.testing.assert_allclose(convention.rotation(ANGLES), expected, atol=1e-14)


def test_kuka_turns_about_z_first() -> None:
    expected = Rotation.from_euler("ZYX", ANGLES, degrees=True).as_matrix()
    np.testing.assert_allclose(KUKA.rotation(ANGLES), expected, atol=1e-14)


@pytest.mark.parametrize("convention", list(VALUES), ids=lambda c: c.name)
def test_the_numbers_of_the_program_come_back_untouched_where_nothing_turns(convention: Convention) -> None:
    values = VALUES[convention]
    np.testing.assert_array_equal(convention.near(convention.rotation(values), values), values)


@pytest.mark.parametrize("convention", list(VALUES), ids=lambda c: c.name)
def test_a_small_turn_is_written_exactly_and_near(convention: Convention) -> None:
    values = VALUES[convention]
    R = Rotation.from_rotvec(RNG.normal(size=(60, 3)) * 1e-4).as_matrix() @ convention.rotation(values)
    found = convention.near(R, values)
    seen = convention.rotation(found)
    columns = [2] if convention.axis_only else [0, 1, 2]
    np.testing.assert_allclose(seen[:, :, columns], R[:, :, columns], atol=1e-14)


def test_an_axis_that_points_the_other_way_is_half_a_turn() -> None:
    axes = np.array([[0.0, 0.0, -1.0], [0.0, 0.0, 1.0], [1e-9, 0.0, -1.0], [0.6, 0.0, -0.8]])
    axes /= np.linalg.norm(axes, axis=1, keepdims=True)
    R = rotation_onto(axes)
    np.testing.assert_allclose(R[:, :, 2], axes, atol=1e-6)
    np.testing.assert_allclose(np.linalg.det(R), 1.0, atol=1e-6)


def test_a_quaternion_is_read_renormalised_and_keeps_its_sign() -> None:
    values = np.array([[-0.7071, 0.0, 0.7071, 0.0]])
    R = QUATERNION.rotation(values)
    np.testing.assert_allclose(R[0] @ R[0].T, np.eye(3), atol=1e-15)
    turned = QUATERNION.near(Rotation.from_rotvec([[0, 0, 1e-3]]).as_matrix() @ R, values)
    assert turned[0, 0] < 0
