"""How a dialect says an orientation: Euler angles of four makers, quaternions, rotation vectors, or a tool axis alone.

A convention turns the numbers of a pose into rotations and back. The way back stays near the numbers the program had, so
that a corrected program reads as "the same numbers, slightly changed". Conventions of the makers as in REFERENCE 7, held
against RoboDK's in the tests.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from toolpaths.orientation import SAME_ROTATION, abc_from_rotation, rotation_from_abc

Floats = NDArray[np.float64]


class Convention(Protocol):
    """What the orientation words of a dialect mean.

    A convention with `axis_only` says where the tool's axis points, not how the tool is turned about it; its `rotation`
    is any rotation that carries z onto that axis, and only the third column of `R` is read on the way back.
    """

    @property
    def name(self) -> str:
        """For messages."""

    @property
    def words(self) -> tuple[str, ...]:
        """Names of the K words."""

    @property
    def axis_only(self) -> bool:
        """Whether the turn about the tool's axis is left open."""

    @property
    def degrees(self) -> float:
        """How far one unit of a word turns, degrees, at most; for the worth of a printed digit."""

    def rotation(self, values: Floats) -> Floats:
        """Rotations (N, 3, 3) of values (N, K)."""

    def near(self, R: Floats, values: Floats) -> Floats:
        """Values (N, K) of rotations (N, 3, 3), as near to given values as can be; those very values where R is theirs."""


@dataclass(frozen=True)
class EulerAngles:
    """Three angles in degrees, ``R = Rz Ry Rx`` (KUKA, Fanuc) or ``R = Rx Ry Rz`` (Staubli).

    Attributes
    ----------
    name, words
    first_is_x : bool
        Whether the first word turns about x (Fanuc W, P, R and Staubli) or about z (KUKA A, B, C).
    x_outermost : bool
        ``Rx Ry Rz`` instead of ``Rz Ry Rx``.
    """

    name: str
    words: tuple[str, ...]
    first_is_x: bool = False
    x_outermost: bool = False
    axis_only: bool = False
    degrees: float = 1.0

    def rotation(self, values: Floats) -> Floats:
        """See `Convention`."""
        R = rotation_from_abc(self._abc(values))
        return R.transpose(0, 2, 1) if self.x_outermost else R

    def near(self, R: Floats, values: Floats) -> Floats:
        """See `Convention`; both Euler branches and whole turns are considered."""
        R = R.transpose(0, 2, 1) if self.x_outermost else R
        return self._abc(abc_from_rotation(R, self._abc(values)))

    def _abc(self, values: Floats) -> Floats:
        # Rx(a) Ry(b) Rz(c) is the transpose of Rz(-c) Ry(-b) Rx(-a). The map is its own inverse.
        abc = values[:, ::-1] if self.first_is_x else values
        return -abc if self.x_outermost else abc


@dataclass(frozen=True)
class Quaternion:
    """Unit quaternion w, x, y, z (ABB RAPID); read renormalised, because programs print it rounded."""

    name: str = "quaternion"
    words: tuple[str, ...] = ("Q1", "Q2", "Q3", "Q4")
    axis_only: bool = False
    degrees: float = float(np.degrees(2.0))

    def rotation(self, values: Floats) -> Floats:
        """See `Convention`; NaN for a quaternion of length zero."""
        with np.errstate(invalid="ignore", divide="ignore"):
            w, x, y, z = (values / np.linalg.norm(values, axis=1, keepdims=True)).T
        rows = [
            [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
            [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
            [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
        ]
        return np.moveaxis(np.array(rows), -1, 0)

    def near(self, R: Floats, values: Floats) -> Floats:
        """See `Convention`; of q and -q the nearer one."""
        from scipy.spatial.transform import Rotation

        found = Rotation.from_matrix(R).as_quat()[:, [3, 0, 1, 2]]
        found = np.where((found * values).sum(axis=1, keepdims=True) < 0, -found, found)
        return _unless_same(R, self.rotation(values), values, found)


@dataclass(frozen=True)
class RotationVector:
    """Axis times angle in radians (Universal Robots)."""

    name: str = "rotation vector"
    words: tuple[str, ...] = ("RX", "RY", "RZ")
    axis_only: bool = False
    degrees: float = float(np.degrees(1.0))

    def rotation(self, values: Floats) -> Floats:
        """See `Convention`."""
        from scipy.spatial.transform import Rotation

        known: NDArray[np.bool_] = np.asarray(np.isfinite(values).all(axis=1))
        R: Floats = Rotation.from_rotvec(np.where(known[:, None], values, 0.0)).as_matrix()
        R[~known] = np.nan
        return R

    def near(self, R: Floats, values: Floats) -> Floats:
        """See `Convention`; the turn and the sense of the axis that come nearest."""
        from scipy.spatial.transform import Rotation

        found = Rotation.from_matrix(R).as_rotvec()
        angle = np.linalg.norm(found, axis=1, keepdims=True)
        length = np.linalg.norm(values, axis=1, keepdims=True)
        # With no turn at all any axis will do: the one the program had.
        axis = np.where(angle > 0, found / np.where(angle > 0, angle, 1.0), values / np.where(length > 0, length, 1.0))
        turns = np.round(((values * axis).sum(axis=1, keepdims=True) - angle) / (2 * np.pi))
        return _unless_same(R, self.rotation(values), values, axis * (angle + 2 * np.pi * turns))


@dataclass(frozen=True)
class ToolAxis:
    """Direction i, j, k from the tool's tip to the spindle (APT, CLDATA); read renormalised."""

    name: str = "tool axis"
    words: tuple[str, ...] = ("I", "J", "K")
    axis_only: bool = True
    degrees: float = float(np.degrees(1.0))

    def rotation(self, values: Floats) -> Floats:
        """See `Convention`."""
        with np.errstate(invalid="ignore", divide="ignore"):
            return rotation_onto(values / np.linalg.norm(values, axis=1, keepdims=True))

    def near(self, R: Floats, values: Floats) -> Floats:
        """See `Convention`."""
        return _unless_same_axis(R, self.rotation(values), values, R[:, :, 2])


@dataclass(frozen=True)
class FixedAxis:
    """No orientation words: the tool's axis is the z of the program's frame throughout (three-axis milling)."""

    name: str = "fixed axis"
    words: tuple[str, ...] = ()
    axis_only: bool = True
    degrees: float = 0.0

    def rotation(self, values: Floats) -> Floats:
        """See `Convention`."""
        return np.broadcast_to(np.eye(3), (len(values), 3, 3)).copy()

    def near(self, R: Floats, values: Floats) -> Floats:
        """See `Convention`."""
        return values


def rotation_onto(axis: Floats) -> Floats:
    """Rotations (N, 3, 3) that carry z onto unit axes (N, 3) by the least turn (half a turn about x where it is -z)."""
    x, y, z = axis.T
    opposite: NDArray[np.bool_] = np.asarray(z < -1 + 1e-12)
    c = 1 / np.where(opposite, 1.0, 1 + z)
    R = np.moveaxis(np.array([[1 - x * x * c, -x * y * c, x], [-x * y * c, 1 - y * y * c, y], [-x, -y, z]]), -1, 0)
    R[opposite] = np.diag([1.0, -1.0, -1.0])
    return R


def _unless_same(R: Floats, R_before: Floats, before: Floats, found: Floats) -> Floats:
    """The numbers of before where the rotation is the one it was."""
    same = np.abs(R - R_before).max(axis=(1, 2), initial=0.0) <= 4 * SAME_ROTATION
    return np.where(same[:, None], before, found)


def _unless_same_axis(R: Floats, R_before: Floats, before: Floats, found: Floats) -> Floats:
    same = np.abs(R[:, :, 2] - R_before[:, :, 2]).max(axis=1, initial=0.0) <= 4 * SAME_ROTATION
    return np.where(same[:, None], before, found)


KUKA = EulerAngles("KUKA A, B, C", ("A", "B", "C"))
FANUC = EulerAngles("Fanuc W, P, R", ("W", "P", "R"), first_is_x=True)
STAUBLI = EulerAngles("Staubli rx, ry, rz", ("RX", "RY", "RZ"), first_is_x=True, x_outermost=True)
QUATERNION, ROTATION_VECTOR, TOOL_AXIS, FIXED_AXIS = Quaternion(), RotationVector(), ToolAxis(), FixedAxis()
