"""Rotation algebra against scipy and against virtual work."""

import numpy as np
import pytest
from drake_judge import left_jacobian
from scipy.spatial.transform import Rotation

from drake_stiffness.rotations import (
    conjugate_moment,
    cross,
    exponential,
    logarithm,
    multiply,
    rotate,
    rotate_back,
    rotate_fixed,
    rotation_of_axis,
    rpy_rotation,
)

# Small arrays (series), large ones, and both in one call.
SIZES = {"small": 1e-3, "medium": 0.09, "large": 2.5}


def vectors(size: float, number: int = 40) -> np.ndarray:
    return np.random.default_rng(3).normal(size=(3, number)) * size / 2


def edge() -> np.ndarray:
    """Just below the angle where the series is left for the closed forms."""
    r = vectors(1.0)
    return 0.0999 * r / np.linalg.norm(r, axis=0)


def mixed() -> np.ndarray:
    return np.concatenate([vectors(s) for s in (1e-9, 1e-3, 0.19, 0.21, 2.0)], axis=1)


@pytest.mark.parametrize("r", [*(vectors(s) for s in SIZES.values()), edge(), mixed()], ids=[*SIZES, "edge", "mixed"])
def test_the_exponential_is_scipys_and_the_logarithm_undoes_it(r):
    R = exponential(r)
    assert np.abs(R - Rotation.from_rotvec(r.T).as_matrix().transpose(1, 2, 0)).max() < 1e-14
    inside = np.linalg.norm(r, axis=0) < 3.0
    assert np.abs(logarithm(R)[:, inside] - r[:, inside]).max() < 1e-12


@pytest.mark.parametrize("r", [*(vectors(s) for s in SIZES.values()), edge(), mixed()], ids=[*SIZES, "edge", "mixed"])
def test_the_conjugate_moment_does_the_virtual_work_of_the_moment(r):
    m = np.random.default_rng(4).normal(size=r.shape)
    expected = np.einsum("nij,in->jn", left_jacobian(r.T), m)
    assert np.abs(conjugate_moment(r, m) - expected).max() < 1e-10


def test_products_are_matrix_products():
    rng = np.random.default_rng(0)
    A, B, v = rng.normal(size=(3, 3, 5)), rng.normal(size=(3, 3, 1)), rng.normal(size=(3, 5))
    for i in range(5):
        assert np.allclose(multiply(A, B)[:, :, i], A[:, :, i] @ B[:, :, 0], atol=1e-15)
        assert np.allclose(rotate(A, v)[:, i], A[:, :, i] @ v[:, i], atol=1e-15)
        assert np.allclose(rotate_back(A, v)[:, i], A[:, :, i].T @ v[:, i], atol=1e-15)
    assert np.allclose(cross(v, A[0]), np.cross(v.T, A[0].T).T)


def test_a_turn_about_an_axis_and_roll_pitch_yaw_are_scipys():
    axis, angle = np.array([0.6, 0.0, 0.8]), np.array([0.3, -2.0])
    expected = Rotation.from_rotvec(angle[:, None] * axis).as_matrix().transpose(1, 2, 0)
    assert np.allclose(rotation_of_axis(axis, angle), expected, atol=1e-15)
    assert np.allclose(
        rpy_rotation((0.1, 0.2, 0.3)), Rotation.from_euler("ZYX", [0.3, 0.2, 0.1]).as_matrix(), atol=1e-15
    )


@pytest.mark.parametrize("v", [[0.3, -0.2, 0.7], [0.0, 1.0, 0.0], [0.0, 0.0, -1.0], [0.0, 0.0, 0.0]])
def test_one_vector_is_turned_as_many_are(v):
    R, v = exponential(vectors(2.5)), np.array(v)
    np.testing.assert_array_equal(rotate_fixed(R, v), rotate(R, v[:, None]))
