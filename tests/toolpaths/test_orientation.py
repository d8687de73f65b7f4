"""Orientations: KUKA angles to rotations and back, on the branch nearest to the original."""

import time

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from toolpaths.orientation import abc_from_rotation, rotation_from_abc

angle = st.floats(-400, 400, allow_nan=False)


def elementary(axis, deg):
    c, s = np.cos(np.radians(deg)), np.sin(np.radians(deg))
    i, j = [(1, 2), (2, 0), (0, 1)][axis]
    R = np.eye(3)
    R[i, i] = R[j, j] = c
    R[i, j], R[j, i] = -s, s
    return R


@given(angle, angle, angle)
def test_abc_is_rz_ry_rx(a, b, c):
    expected = elementary(2, a) @ elementary(1, b) @ elementary(0, c)
    np.testing.assert_allclose(rotation_from_abc(np.array([[a, b, c]]))[0], expected, atol=1e-14)


@given(angle, angle, angle)
def test_the_original_rotation_gives_the_original_angles(a, b, c):
    abc = np.array([[a, b, c]])
    np.testing.assert_allclose(abc_from_rotation(rotation_from_abc(abc), abc), abc, rtol=0, atol=1e-12)


@given(angle, angle, angle, st.tuples(*[st.floats(-0.01, 0.01)] * 3))
def test_a_small_turn_is_reproduced(a, b, c, turn):
    abc = np.array([[a, b, c]])
    R = rotation_from_abc(abc) @ rotation_from_abc(np.array([turn]))
    np.testing.assert_allclose(rotation_from_abc(abc_from_rotation(R, abc)), R, atol=2e-10)


@given(angle, st.floats(-80, 80), st.booleans(), angle)
def test_a_small_turn_changes_the_angles_little(a, b, over_the_pole, c):
    abc = np.array([[a, 180.0 - b if over_the_pole else b, c]])
    R = rotation_from_abc(abc) @ rotation_from_abc(np.full((1, 3), 0.01))
    assert np.abs(abc_from_rotation(R, abc) - abc).max() < 0.2


@pytest.mark.parametrize(
    "near", [[179.999, 0.0, -179.999], [539.0, 10.0, 20.0], [-180.0, 0.0, 180.0], [10.0, 170.0, 5.0]]
)
def test_whole_turns_and_the_branch_stay_those_of_the_original(near):
    near = np.array([near])
    turned = near + 0.004
    np.testing.assert_allclose(abc_from_rotation(rotation_from_abc(turned), near), turned, atol=1e-9)


@pytest.mark.parametrize("b", [90.0, -90.0])
def test_at_gimbal_lock_one_angle_carries_the_change(b):
    near = np.array([[30.0, b, 20.0]])
    R = elementary(2, 0.5) @ rotation_from_abc(near)
    found = abc_from_rotation(R, near)
    np.testing.assert_allclose(found[0], [30.0, b, 20.0 - np.sign(b) * 0.5], atol=1e-9)
    np.testing.assert_allclose(rotation_from_abc(found), R, atol=1e-14)


def test_no_pose_is_no_error():
    assert abc_from_rotation(np.zeros((0, 3, 3)), np.zeros((0, 3))).shape == (0, 3)


def test_a_hundred_thousand_moves_go_at_once():
    abc = np.random.default_rng(0).uniform(-180, 180, (100_000, 3))
    start = time.process_time()
    np.testing.assert_allclose(abc_from_rotation(rotation_from_abc(abc), abc), abc, atol=1e-12)
    assert time.process_time() - start < 5.0  # a loop over moves would need far more
