"""Small rotation algebra on whole arrays of postures.

Arrays end in the number of postures N: a rotation is `(3, 3, N)`, a vector `(3, N)`. With N last, every product is a few
long multiplications, which numpy does about ten times faster than one small matrix product per posture.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

# Below this squared angle the series of sin(a)/a and its relatives are exact to machine precision with five terms.
_SMALL_ANGLE_SQUARED = 0.01


def multiply(A: Array, B: Array) -> Array:
    """Matrix product A B of rotations `(3, 3, N)`; either may be a constant `(3, 3, 1)`."""
    return A[:, 0, None] * B[None, 0] + A[:, 1, None] * B[None, 1] + A[:, 2, None] * B[None, 2]


def rotate(R: Array, v: Array) -> Array:
    """R v for `R (3, 3, N)` and `v (3, N)` or `(3, 1)`."""
    return R[:, 0] * v[0] + R[:, 1] * v[1] + R[:, 2] * v[2]


def rotate_fixed(R: Array, v: Array) -> Array:
    """R v for `R (3, 3, N)` and one vector `(3,)`; components that are zero cost nothing (dimensions of arms have many)."""
    out: Array | None = None
    for component, column in zip(v.tolist(), R.transpose(1, 0, 2), strict=True):
        if component:
            part = column if component == 1.0 else column * component
            out = part if out is None else out + part
    return np.zeros((3, R.shape[2])) if out is None else out


def rotate_back(R: Array, v: Array) -> Array:
    """R^T v, the components of `v` in the frame that R describes."""
    return R[0] * v[0] + R[1] * v[1] + R[2] * v[2]


def cross(a: Array, b: Array) -> Array:
    """Vector product of `(3, N)` arrays (numpy.cross moves axes about and is slower)."""
    # One array that is filled: stacking three costs more than computing them where N is small.
    x = a[1] * b[2] - a[2] * b[1]
    out = np.empty((3, *x.shape))
    out[0] = x
    out[1] = a[2] * b[0] - a[0] * b[2]
    out[2] = a[0] * b[1] - a[1] * b[0]
    return out


def _coefficients(r: Array) -> tuple[Array, Array, Array]:
    """sin(a)/a, (1 - cos a)/a^2 and (a - sin a)/a^3 of rotation vectors `r (3, N)` with a = |r|."""
    s = r[0] * r[0] + r[1] * r[1] + r[2] * r[2]
    if s.size == 0 or s.max() < _SMALL_ANGLE_SQUARED:
        a = 1 + s * (-1 / 6 + s * (1 / 120 + s * (-1 / 5040 + s / 362880)))
        b = 1 / 2 + s * (-1 / 24 + s * (1 / 720 + s * (-1 / 40320 + s / 3628800)))
        c = 1 / 6 + s * (-1 / 120 + s * (1 / 5040 + s * (-1 / 362880 + s / 39916800)))
        return a, b, c
    angle = np.sqrt(s)
    safe = np.where(s < _SMALL_ANGLE_SQUARED, 1.0, s)
    root = np.sqrt(safe)
    small = np.minimum(s, _SMALL_ANGLE_SQUARED)
    a = np.sinc(angle / np.pi)
    b = 0.5 * np.sinc(angle / (2 * np.pi)) ** 2
    c_series = 1 / 6 + small * (-1 / 120 + small * (1 / 5040 - small / 362880))
    c = np.where(s < _SMALL_ANGLE_SQUARED, c_series, (1 - np.sin(root) / root) / safe)
    return a, b, c


def exponential(r: Array) -> Array:
    """Rotation `(3, 3, N)` of rotation vectors `r (3, N)` (Rodrigues)."""
    a, b, _ = _coefficients(r)
    x, y, z = r
    bx, by, bz = b * x, b * y, b * z
    ax, ay, az = a * x, a * y, a * z
    bxy, bxz, byz = bx * y, bx * z, by * z
    bxx, byy, bzz = bx * x, by * y, bz * z
    R = np.empty((3, 3, r.shape[1]))
    R[0, 0], R[0, 1], R[0, 2] = 1 - byy - bzz, bxy - az, bxz + ay
    R[1, 0], R[1, 1], R[1, 2] = bxy + az, 1 - bxx - bzz, byz - ax
    R[2, 0], R[2, 1], R[2, 2] = bxz - ay, byz + ax, 1 - bxx - byy
    return R


def rotation_of_vector(r: Array) -> Array:
    """The rotation `(3, 3)` of one rotation vector `(3,)`: Rodrigues in plain numbers, which is quicker for a single one."""
    x, y, z = r.tolist()
    s = x * x + y * y + z * z
    if s < _SMALL_ANGLE_SQUARED:
        a = 1 + s * (-1 / 6 + s * (1 / 120 + s * (-1 / 5040 + s / 362880)))
        b = 1 / 2 + s * (-1 / 24 + s * (1 / 720 + s * (-1 / 40320 + s / 3628800)))
    else:
        angle = math.sqrt(s)
        a, b = math.sin(angle) / angle, 2 * (math.sin(angle / 2) / angle) ** 2
    c = 1 - b * s
    return np.array(
        [
            [c + b * x * x, b * x * y - a * z, b * x * z + a * y],
            [b * x * y + a * z, c + b * y * y, b * y * z - a * x],
            [b * x * z - a * y, b * y * z + a * x, c + b * z * z],
        ]
    )


def conjugate_moment(r: Array, m: Array) -> Array:
    """Generalised force of a rotation vector `r (3, N)` under a moment `m (3, N)`: J_l(r)^T m.

    J_l is the left Jacobian, omega = J_l(r) dr/dt. With this force the elastic law derives from an energy, so K - H is
    symmetric for dead forces. J_l = I + b [r] + c [r]^2, b = (1 - cos a)/a^2, c = (a - sin a)/a^3.
    """
    _, b, c = _coefficients(r)
    rm = cross(r, m)
    return m - b * rm + c * cross(r, rm)


def logarithm(R: Array) -> Array:
    """Rotation vectors `(3, N)` of rotations `(3, 3, N)`; exact for small angles, valid up to (not at) half a turn."""
    v = 0.5 * np.stack([R[2, 1] - R[1, 2], R[0, 2] - R[2, 0], R[1, 0] - R[0, 1]])
    sine = np.sqrt(v[0] ** 2 + v[1] ** 2 + v[2] ** 2)
    angle = np.arctan2(sine, 0.5 * (R[0, 0] + R[1, 1] + R[2, 2] - 1))
    return v * np.where(sine > 1e-12, angle / np.where(sine > 1e-12, sine, 1.0), 1.0)


def rotation_of_axis(axis: Array, angle: Array) -> Array:
    """Rotations `(3, 3, N)` by `angle (N,)` about one constant unit axis `(3,)`."""
    K = np.array([[0.0, -axis[2], axis[1]], [axis[2], 0.0, -axis[0]], [-axis[1], axis[0], 0.0]])
    outer = np.outer(axis, axis)
    c, s = np.cos(angle), np.sin(angle)
    return outer[:, :, None] + (np.eye(3) - outer)[:, :, None] * c + K[:, :, None] * s


def turned(R: Array, axis: Array, angle: Array) -> Array:
    """R Rot(axis, angle) for `R (3, 3, N)`; about an axis of the frame only two columns change, which is half the work."""
    own = int(np.abs(axis).argmax())
    if abs(axis[own]) != 1.0:
        return multiply(R, rotation_of_axis(axis, angle))
    c, s = np.cos(angle), np.sin(angle) * axis[own]
    a, b = (own + 1) % 3, (own + 2) % 3
    out = np.empty((3, 3, angle.size))
    out[:, own] = R[:, own]
    np.add(R[:, a] * c, R[:, b] * s, out=out[:, a])
    np.subtract(R[:, b] * c, R[:, a] * s, out=out[:, b])
    return out


def rpy_rotation(rpy_rad: Array | tuple[float, float, float]) -> Array:
    """One rotation `(3, 3)` from roll, pitch, yaw: Rz(yaw) Ry(pitch) Rx(roll)."""
    roll, pitch, yaw = rpy_rad
    axes = np.eye(3)
    Rx, Ry, Rz = (rotation_of_axis(axes[i], np.array([a]))[:, :, 0] for i, a in enumerate((roll, pitch, yaw)))
    return Rz @ Ry @ Rx
