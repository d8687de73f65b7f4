"""Rotation matrices for whole arrays of angles. Radians; a trailing (3, 3) is a matrix that turns columns."""

from __future__ import annotations

import numpy as np

from .beams import Array


def about_axis(axis: Array, angle: Array) -> Array:
    """Rodrigues: R = I + sin(a) [u]x + (1 - cos(a)) [u]x^2 for one unit axis (3,) and angles (N,) -> (N, 3, 3)."""
    cross = skew(axis)
    sine, versine = np.sin(angle)[:, None, None], (2.0 * np.sin(0.5 * angle) ** 2)[:, None, None]
    return np.eye(3) + sine * cross + versine * (cross @ cross)


def skew(v: Array) -> Array:
    """Cross-product matrices, (..., 3) -> (..., 3, 3)."""
    out = np.zeros((*v.shape, 3))
    out[..., 0, 1], out[..., 0, 2], out[..., 1, 2] = -v[..., 2], v[..., 1], -v[..., 0]
    return out - np.swapaxes(out, -1, -2)


def from_zyx(angles: Array) -> Array:
    """R = Rz(a) Ry(b) Rx(c) of angles (..., 3) in the order (a, b, c), KUKA's A, B, C -> (..., 3, 3)."""
    a, b, c = np.moveaxis(np.asarray(angles, dtype=float), -1, 0)
    ca, sa, cb, sb, cc, sc = np.cos(a), np.sin(a), np.cos(b), np.sin(b), np.cos(c), np.sin(c)
    rows = (
        np.stack([ca * cb, ca * sb * sc - sa * cc, ca * sb * cc + sa * sc], -1),
        np.stack([sa * cb, sa * sb * sc + ca * cc, sa * sb * cc - ca * sc], -1),
        np.stack([-sb, cb * sc, cb * cc], -1),
    )
    return np.stack(rows, -2)


def to_zyx(r: Array) -> Array:
    """(a, b, c) of R = Rz(a) Ry(b) Rx(c), |b| <= pi/2; (..., 3, 3) -> (..., 3)."""
    b = np.arctan2(-r[..., 2, 0], np.hypot(r[..., 0, 0], r[..., 1, 0]))
    return np.stack([np.arctan2(r[..., 1, 0], r[..., 0, 0]), b, np.arctan2(r[..., 2, 1], r[..., 2, 2])], -1)


def from_rpy_deg(rpy_deg: Array) -> Array:
    """R = Rz(yaw) Ry(pitch) Rx(roll) of (roll, pitch, yaw) in degrees, the URDF convention."""
    return from_zyx(np.deg2rad(np.asarray(rpy_deg, dtype=float))[..., ::-1])


def rotation_vector(r: Array) -> Array:
    """Rotation vectors of matrices that turn by less than pi, (N, 3, 3) -> (N, 3)."""
    twice_sine = np.stack([r[:, 2, 1] - r[:, 1, 2], r[:, 0, 2] - r[:, 2, 0], r[:, 1, 0] - r[:, 0, 1]], -1)
    sine = 0.5 * np.linalg.norm(twice_sine, axis=-1)
    angle = np.arctan2(sine, 0.5 * (np.trace(r, axis1=1, axis2=2) - 1.0))
    # For tiny angles angle / sin(angle) -> 1.
    ratio = np.where(sine > 1e-12, angle / np.where(sine > 1e-12, sine, 1.0), 1.0)
    return 0.5 * twice_sine * ratio[:, None]
