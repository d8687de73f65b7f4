"""What gears do beyond a linear spring: backlash, and coupling between neighbouring joints."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import TYPE_CHECKING

import numpy as np

from drake_stiffness.effects.compliance import ROTATION_SCALE, expect
from drake_stiffness.effects.effect import Carried, Cases, Effect, Parameter
from drake_stiffness.rotations import Array

if TYPE_CHECKING:
    from drake_stiffness.arm import Arm


class JointEffect(Effect):
    """An effect in one joint: `where` is the joint's name."""

    station = "spring"

    def __init__(self, where: str, prismatic: bool = False) -> None:
        super().__init__(where)
        self.prismatic = prismatic

    def settings(self) -> dict[str, object]:
        return {"prismatic": True} if self.prismatic else {}

    @property
    def deflection_unit(self) -> str:
        return "m" if self.prismatic else "rad"

    @property
    def load_unit(self) -> str:
        return "N" if self.prismatic else "N m"

    def number(self, arm: Arm) -> int:
        """Which of the arm's joints it is."""
        return arm.joint_names.index(self.where)

    def check(self, arm: Arm, points: Mapping[str, object]) -> None:
        expect(self, self.where, arm.joint_names, "joint")

    @classmethod
    def candidates(cls, arm: Arm, points: Mapping[str, object]) -> Iterator[Effect]:
        for name, prismatic in zip(arm.joint_names, arm.prismatic, strict=True):
            yield cls(name, prismatic=bool(prismatic))


class JointBacklash(JointEffect):
    """Lost motion: the joint rests on the side that its torque pushes to, theta = sgn(tau) b / 2.

    Needs torques of both signs about one posture: in displacements only a change of sign against weight shows. `b` is the
    full width. Within `smooth` of zero torque the sign is a ramp: there a real joint floats, and the equilibrium stays smooth.
    """

    kind = "joint_backlash"
    needs = ("load",)

    def __init__(self, where: str, prismatic: bool = False, smooth: float = 5.0) -> None:
        super().__init__(where, prismatic)
        self.smooth = smooth

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        return (Parameter("width", self.deflection_unit, 1e-4, lower=0.0),)

    def settings(self) -> dict[str, object]:
        return {**super().settings(), "smooth": self.smooth}

    def deflection(self, arm: Arm, carried: Carried, cases: Cases, x: Array) -> dict[int, Array]:
        i = self.number(arm)
        return {i: 0.5 * x[0] * np.clip(carried.tau_joint[i] / self.smooth, -1.0, 1.0)}


class JointCoupling(Effect):
    """Torque in one joint turns its neighbour: theta_i = k tau_j and theta_j = k tau_i; `where` is "joint_5+joint_6"."""

    kind = "joint_coupling"
    station = "spring"
    needs = ("load",)

    def __init__(self, where: str, unit: str = "rad/(N m)", scale: float = ROTATION_SCALE) -> None:
        super().__init__(where)
        self.unit, self.scale = unit, scale

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        return (Parameter("k", self.unit, self.scale),)

    def settings(self) -> dict[str, object]:
        return {"unit": self.unit, "scale": self.scale}

    def check(self, arm: Arm, points: Mapping[str, object]) -> None:
        expect(self, self.where, _neighbours(arm), "pair of neighbouring joints")

    @classmethod
    def candidates(cls, arm: Arm, points: Mapping[str, object]) -> Iterator[Effect]:
        for i, pair in enumerate(_neighbours(arm)):
            slides = int(arm.prismatic[i]) + int(arm.prismatic[i + 1])
            unit = ("rad/(N m)", "rad/N", "m/N")[slides]
            yield cls(pair, unit, ROTATION_SCALE * arm.length_m**slides)

    def deflection(self, arm: Arm, carried: Carried, cases: Cases, x: Array) -> dict[int, Array]:
        i = _neighbours(arm).index(self.where)
        return {i: x[0] * carried.tau_joint[i + 1], i + 1: x[0] * carried.tau_joint[i]}


def _neighbours(arm: Arm) -> tuple[str, ...]:
    return tuple(f"{a}+{b}" for a, b in zip(arm.joint_names, arm.joint_names[1:], strict=False))
