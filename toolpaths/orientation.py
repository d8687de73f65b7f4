"""Orientations as robot programs write them, and as rotation matrices.

KUKA programs give the orientation of the tool in the base frame as three angles A, B, C in degrees, with
``R = Rz(A) Ry(B) Rx(C)``. The way back is not unique: a rewriter must return the triple that a reader of the program
would call "the same numbers, slightly changed", so every conversion from a rotation takes the triple it should be near.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]

# Below this cosine of B the angles A and C turn about the same line. The noise of a rotation matrix (1e-16) divided by
# it is the error of A and C just above the limit (1e-6 rad, harmless: it cancels in the rotation); the limit itself
# bounds the error of the rotation just below it.
GIMBAL_LOCK_COSINE = 1e-10

# Rotations closer than this, element by element, are the same one; the original triple is then returned untouched.
SAME_ROTATION = 1e-15


def rotation_from_abc(abc_deg: Floats) -> Floats:
    """Rotation matrices ``Rz(A) Ry(B) Rx(C)`` of KUKA angles.

    Parameters
    ----------
    abc_deg
        (N, 3) angles A, B, C, degrees.

    Returns
    -------
    (N, 3, 3) rotation matrices.
    """
    a, b, c = np.radians(np.asarray(abc_deg, dtype=float)).T
    sa, ca, sb, cb, sc, cc = np.sin(a), np.cos(a), np.sin(b), np.cos(b), np.sin(c), np.cos(c)
    rows = [
        [ca * cb, ca * sb * sc - sa * cc, ca * sb * cc + sa * sc],
        [sa * cb, sa * sb * sc + ca * cc, sa * sb * cc - ca * sc],
        [-sb, cb * sc, cb * cc],
    ]
    return np.moveaxis(np.array(rows), -1, 0)


def abc_from_rotation(R: Floats, near_deg: Floats) -> Floats:
    """KUKA angles of rotations, on the Euler branch nearest to given angles.

    Both solutions (B and 180 - B) and whole turns added to each angle are considered; the one with the smallest sum of
    squared differences from `near_deg` wins. At B = +-90 degrees, where only A -+ C is determined, A is kept and C
    carries the change. Where the rotation is that of `near_deg`, those very numbers come back.

    Parameters
    ----------
    R
        (N, 3, 3) rotation matrices.
    near_deg
        (N, 3) angles A, B, C to stay near, degrees. Not restricted to one turn.

    Returns
    -------
    (N, 3) angles, degrees; ``rotation_from_abc`` of them is `R` (to 1e-10 rad at gimbal lock, else to rounding).
    """
    R = np.asarray(R, dtype=float)
    near = np.asarray(near_deg, dtype=float)
    cos_b = np.hypot(R[:, 0, 0], R[:, 1, 0])
    first = np.degrees(
        np.stack(
            [
                np.arctan2(R[:, 1, 0], R[:, 0, 0]),
                np.arctan2(-R[:, 2, 0], cos_b),
                np.arctan2(R[:, 2, 1], R[:, 2, 2]),
            ],
            axis=1,
        )
    )
    second = np.stack([first[:, 0] + 180.0, 180.0 - first[:, 1], first[:, 2] + 180.0], axis=1)
    first, second = _nearest_turn(first, near), _nearest_turn(second, near)
    second_wins = np.sum((second - near) ** 2, axis=1) < np.sum((first - near) ** 2, axis=1)
    angles = np.where(second_wins[:, None], second, first)

    locked = cos_b < GIMBAL_LOCK_COSINE
    if locked.any():
        angles[locked] = _with_a_kept(R[locked], near[locked])
    same = np.abs(R - rotation_from_abc(near)).max(axis=(1, 2), initial=0.0) <= SAME_ROTATION
    return np.where(same[:, None], near, angles)


def _nearest_turn(angles_deg: Floats, near_deg: Floats) -> Floats:
    """Add whole turns to each angle so that it comes within half a turn of `near_deg`."""
    return angles_deg + 360.0 * np.round((near_deg - angles_deg) / 360.0)


def _with_a_kept(R: Floats, near_deg: Floats) -> Floats:
    """Angles at gimbal lock: A as it was, B and C read from ``Rz(A)^T R = Ry(B) Rx(C)``."""
    a = np.radians(near_deg[:, 0])
    sa, ca = np.sin(a), np.cos(a)
    b = np.arctan2(-R[:, 2, 0], ca * R[:, 0, 0] + sa * R[:, 1, 0])
    c = np.arctan2(sa * R[:, 0, 2] - ca * R[:, 1, 2], ca * R[:, 1, 1] - sa * R[:, 0, 1])
    return _nearest_turn(np.stack([near_deg[:, 0], np.degrees(b), np.degrees(c)], axis=1), near_deg)
