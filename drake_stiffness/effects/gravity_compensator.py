"""The gravity compensator: a spring across a joint, from the link before it to the link after it (seed section 5).

Looked at along the joint, in a plane normal to its axis:

                         B  pin on the link after the joint
                        /
               s      / L      angle of the lever from x, in the joint's positive sense: q + lever_deg
        . - - - - - O          O is the joint; x points from behind the joint forward, y up
    A - - - - - - '            A = O - (a_x, a_y) is the pin on the link before the joint
         a = (a_x, a_y)

x is any direction normal to the axis. The joint's positive sense turns x towards **minus** y: so it is for joint 2 of a KUKA
arm, where x is forward, y up, and a positive angle lowers the arm. With phi = q + lever_deg + atan2(a_y, a_x), the angle
from a to the lever,

    s^2 = a^2 + L^2 + 2 a L cos(phi).

`lever_deg` is where the lever points when the joint stands at zero; the formulas of the source paper have it at zero. A
spring that carries an arm needs A, O, B nearly in line, B on the side of A, when the arm stands upright (phi = 180 deg).

Two unknowns, chosen so that everything is linear in them (the fit then needs no start, and no compensator is the point
zero, which a spring compliance could never reach):

- `spring`  K_c >= 0, N/m;
- `preload` P = K_c s0, N: by how much the pull stays below K_c s. s0 = P / K_c is the free length, in m; with K_c near zero
  it means nothing, and P still does (a gas spring that pushes with a constant force has K_c = 0). See `free_length`.

The seed's pair is k_c = 1 / K_c and s0: k_c = 0.144 um/N and s0 = 458 mm are K_c = 6.94e6 N/m and P = 3.18e6 N.

Variants:

- `spring`: a real spring. It pulls with K_c s - P, and turns the link after the joint by
      M = a L sin(phi) (K_c - P / s) = K_c a L (1 - s0/s) sin(phi)
  at the loaded angle q + theta: it shifts the posture by weight, and the joint feels stiffer by K_c a L eta, with
      eta = -dM/dq / (K_c a L) = (s0/s) (a L sin^2(phi) / s^2 + cos(phi)) - cos(phi).
  M follows from the energy K_c (s - s0)^2 / 2; with the opposite sign, which is also found in print, it is the torque on
  the link before the joint.
- `stiffness`: what the seed fitted. No torque of its own; the joint's stiffness is K_joint + K_c a L eta(q).
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import TYPE_CHECKING, Literal, get_args

import numpy as np

from drake_stiffness.effects.compliance import expect
from drake_stiffness.effects.effect import Effect, Parameter
from drake_stiffness.errors import InputError
from drake_stiffness.point_spring import PointSpring
from drake_stiffness.rotations import Array

if TYPE_CHECKING:
    from drake_stiffness.arm import Arm

Variant = Literal["spring", "stiffness"]

# A spring that balances a 270 kg arm has about 1e5 N/m; one that stands for the stiffness of a joint is ten times stiffer.
_SPRING_SCALE = {"spring": 1e5, "stiffness": 1e6}
_LENGTH_SCALE = 0.5
# No spring is so many times stiffer; a bound far beyond all others would be the end of a cone solver's digits.
_STIFFEST = 1e3

# What a search tries: joints that carry an arm, anchors of about this share of the arm's length, levers and angles against it.
_CARRIES, _UPRIGHT = 3, 0.7
_ANCHOR, _LEVERS, _LEVER_STEP_DEG = 0.25, (0.15, 0.3, 0.6), 15


class GravityCompensator(Effect):
    """A spring across a revolute joint; see the head of this file for its geometry and variants.

    Parameters
    ----------
    where : str
        The joint.
    anchor_m : (a_x, a_y)
        From the pin on the link before the joint to the joint's axis, in the plane normal to the axis, m.
    lever_m : float
        L, from the axis to the pin on the link after the joint, m.
    lever_deg : float
        Where that lever points when the joint stands at zero.
    variant : 'spring' or 'stiffness'
    """

    kind = "gravity_compensator"
    station = "spring"
    needs = ("angles",)

    def __init__(
        self,
        where: str,
        anchor_m: Sequence[float],
        lever_m: float,
        lever_deg: float = 0.0,
        variant: Variant = "spring",
    ) -> None:
        super().__init__(where)
        numbers = [*_numbers(where, "anchor_m", anchor_m), *_numbers(where, "lever_m", [lever_m])]
        if len(numbers) != 3 or np.linalg.norm(numbers[:2]) <= 0.0 or numbers[2] <= 0.0:
            raise InputError(
                f"{self.kind} at '{where}': found anchor_m: {anchor_m!r}, lever_m: {lever_m!r}; expected two numbers, not both zero, "
                "and one positive number, in metres."
            )
        if variant not in get_args(Variant):
            raise InputError(f"{self.kind} at '{where}': found variant: {variant!r}; expected spring or stiffness.")
        self.anchor_m, self.lever_m, self.variant = (numbers[0], numbers[1]), numbers[2], variant
        self.lever_deg = _numbers(where, "lever_deg", [lever_deg])[0]

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        scale = _SPRING_SCALE[self.variant]
        return (
            Parameter("spring", "N/m", scale, lower=0.0, upper=_STIFFEST * scale),
            Parameter("preload", "N", scale * _LENGTH_SCALE),
        )

    def settings(self) -> dict[str, object]:
        return {
            "anchor_m": list(self.anchor_m),
            "lever_m": self.lever_m,
            "lever_deg": self.lever_deg,
            "variant": self.variant,
        }

    @property
    def conventional(self) -> tuple[str, ...]:
        return ("spring", "preload")

    def derived(self, x: Array) -> dict[str, tuple[float, str]]:
        """Whatever the scale of the geometry, and whichever end is the farther one: K_c a L, P sqrt(a L), and the longer lever over the shorter.

        The torque is the same with a and L exchanged, and with both times c, K_c over c^2 and P over c.
        """
        a = float(np.hypot(*self.anchor_m))
        levers = a * self.lever_m
        return {
            "spring_times_levers": (float(x[0]) * levers, "N m"),
            "preload_times_root_of_levers": (float(x[1]) * float(np.sqrt(levers)), "N m"),
            "longer_over_shorter_lever": (max(a, self.lever_m) / min(a, self.lever_m), "1"),
        }

    def check(self, arm: Arm, points: Mapping[str, object]) -> None:
        expect(self, self.where, arm.joint_names, "joint")
        if arm.prismatic[arm.joint_names.index(self.where)]:
            raise InputError(
                f"{self.kind} at '{self.where}': this joint slides; a compensator acts across a revolute one."
            )

    @classmethod
    def candidates(cls, arm: Arm, points: Mapping[str, object]) -> Iterator[Effect]:
        """On the first joints, where they are not vertical; attachment points unknown: lever angles and lengths on a grid.

        The shape of the torque depends on L / a and on the angle alone; how large both are goes into the spring.
        """
        from drake_stiffness.arm import forward

        up = arm.gravity / max(float(np.linalg.norm(arm.gravity)), 1e-12)
        axes = forward(arm, np.zeros((arm.num_joints, 1))).axis
        for i, name in enumerate(arm.joint_names[:_CARRIES]):
            if arm.prismatic[i] or abs(float(axes[i][:, 0] @ up)) > _UPRIGHT:
                continue
            for share in _LEVERS:
                for angle in range(0, 360, _LEVER_STEP_DEG):
                    yield cls(name, (_ANCHOR * arm.length_m, 0.0), share * _ANCHOR * arm.length_m, float(angle))

    def neighbours(self, step: float) -> Iterator[Effect]:
        for turn in (_LEVER_STEP_DEG * step, -_LEVER_STEP_DEG * step):
            yield GravityCompensator(self.where, self.anchor_m, self.lever_m, self.lever_deg + turn, self.variant)
        for factor in (1 + step, 1 / (1 + step)):
            yield GravityCompensator(self.where, self.anchor_m, self.lever_m * factor, self.lever_deg, self.variant)

    def length(self, q: Array) -> tuple[Array, Array]:
        """Angle phi (rad) from the anchor to the lever, and length s (m) of the spring, at joint angles `q (N,)`."""
        phi = q + np.radians(self.lever_deg) + np.arctan2(self.anchor_m[1], self.anchor_m[0])
        a, L = np.hypot(*self.anchor_m), self.lever_m
        return phi, np.sqrt(np.maximum(a * a + L * L + 2 * a * L * np.cos(phi), 1e-12))

    def moment(self, q: Array, x: Array) -> Array:
        """M = a L sin(phi) (K_c - P / s): what a real spring turns the link after the joint by, N m."""
        phi, s = self.length(q)
        return np.asarray(np.hypot(*self.anchor_m) * self.lever_m * np.sin(phi) * (x[0] - x[1] / s))

    def stiffening(self, q: Array, x: Array) -> Array:
        """K_c a L eta(q) = -dM/dq, N m/rad, written with P = K_c s0."""
        phi, s = self.length(q)
        aL = np.hypot(*self.anchor_m) * self.lever_m
        return np.asarray(aL * (x[1] / s * (aL * np.sin(phi) ** 2 / s**2 + np.cos(phi)) - x[0] * np.cos(phi)))

    def torque(self, arm: Arm, q: Array, theta: Array, x: Array) -> dict[int, Array]:
        i = arm.joint_names.index(self.where)
        if self.variant == "spring":
            return {i: self.moment(q[i] + theta[i], x)}
        # (K + K_c a L eta) theta = tau is a spring K that also carries -K_c a L eta theta.
        return {i: -self.stiffening(q[i], x) * theta[i]}

    def point_spring(self, axis: Array, x: Array) -> PointSpring:
        """The real spring of variant `spring` between its two pins A and B.

        Which way x points in the plane normal to the unit `axis (3,)` makes no difference to the torque. It is the frame's x for a
        joint about y, its y for one about z, its z for one about x, made normal to the axis.

        Parameters
        ----------
        axis : (3,)
            Of the joint in its frames, of unit length (`Arm.axis_F`).
        x : (2,)
            (K_c, P), both positive.
        """
        near = np.eye(3)[(int(np.argmax(np.abs(axis))) + 2) % 3]
        forward = near - (near @ axis) * axis
        forward /= np.linalg.norm(forward)
        sense = np.cross(axis, forward)  # where the positive sense turns x to: minus y
        angle = np.radians(self.lever_deg)
        A = -(self.anchor_m[0] * forward - self.anchor_m[1] * sense)
        B = self.lever_m * (np.cos(angle) * forward + np.sin(angle) * sense)
        return PointSpring(self.where, A, B, float(x[0]), float(x[1] / x[0]))


def free_length(x: Array, covariance: Array) -> tuple[float, float]:
    """Free length s0 = P / K_c of a fitted compensator and its standard deviation to first order, m.

    Parameters
    ----------
    x : (2,)
        (K_c, P).
    covariance : (2, 2)
        Of the two, SI.
    """
    gradient = np.array([-x[1] / x[0] ** 2, 1 / x[0]])
    return float(x[1] / x[0]), float(np.sqrt(gradient @ covariance @ gradient))


def _numbers(where: str, key: str, values: Sequence[float]) -> list[float]:
    """Finite numbers, or an InputError that names the key."""
    try:
        numbers = [float(value) for value in values]
    except (TypeError, ValueError):
        numbers = [np.nan]
    if not np.isfinite(numbers).all():
        raise InputError(
            f"gravity_compensator at '{where}': found {key}: {values!r}; expected finite numbers (metres, degrees)."
        )
    return numbers
