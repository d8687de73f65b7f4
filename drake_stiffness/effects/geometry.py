"""Errors of the arm itself: where the joints' zeros lie, how the links are shaped, what the flange really carries."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from drake_stiffness.effects.compliance import expect
from drake_stiffness.effects.effect import Effect, Parameter
from drake_stiffness.rotations import Array, rotation_of_vector
from drake_stiffness.springs import COMPONENTS

if TYPE_CHECKING:
    from drake_stiffness.arm import Arm


class JointZeroOffset(Effect):
    """The joint stands at q_i + d_i when q_i is commanded.

    It enters as a constant pose before the joint, Rot(axis, d) or Trans(axis d), which is the same motion.
    """

    kind = "joint_zero_offset"
    station = "arm"
    needs = ("positions",)

    def __init__(self, where: str, prismatic: bool = False) -> None:
        super().__init__(where)
        self.prismatic = prismatic

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        return (Parameter("offset", "m" if self.prismatic else "rad", 1e-3),)

    def settings(self) -> dict[str, object]:
        return {"prismatic": self.prismatic}

    def check(self, arm: Arm, points: Mapping[str, object]) -> None:
        expect(self, self.where, arm.joint_names, "joint")

    @classmethod
    def candidates(cls, arm: Arm, points: Mapping[str, object]) -> Iterator[Effect]:
        for name, prismatic in zip(arm.joint_names, arm.prismatic, strict=True):
            yield cls(name, bool(prismatic))

    def on_arm(self, arm: Arm, x: Array) -> Arm:
        i = arm.joint_names.index(self.where)
        motion = arm.axis_F[i] * x[0]
        zero = np.zeros(3)
        return _moved(arm, i, *((motion, zero) if arm.prismatic[i] else (zero, motion)), before_spring=False)


class LinkGeometry(Effect):
    """A constant pose error of a joint's parent-side frame in the link before it: (dx, dy, dz, rx, ry, rz) in its own axes.

    The component that is the joint's own motion is left out: that is a zero offset.
    """

    kind = "link_geometry"
    station = "arm"
    needs = ("positions",)

    def __init__(self, where: str, components: tuple[str, ...] | list[str] = COMPONENTS) -> None:
        super().__init__(where)
        self.components = tuple(components)

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        return tuple(Parameter(c, "m" if c.startswith("d") else "rad", 1e-3) for c in self.components)

    def settings(self) -> dict[str, object]:
        return {"components": list(self.components)}

    def check(self, arm: Arm, points: Mapping[str, object]) -> None:
        expect(self, self.where, arm.joint_names, "joint")

    @classmethod
    def candidates(cls, arm: Arm, points: Mapping[str, object]) -> Iterator[Effect]:
        for i, name in enumerate(arm.joint_names):
            yield cls(name, geometry_components(arm, i))

    def on_arm(self, arm: Arm, x: Array) -> Arm:
        error = np.zeros(6)
        error[[COMPONENTS.index(c) for c in self.components]] = x
        return _moved(arm, arm.joint_names.index(self.where), error[:3], error[3:], before_spring=True)


def geometry_components(arm: Arm, joint: int) -> tuple[str, ...]:
    """The six components less the joint's own motion, if that is along one of the frame's axes."""
    axis = np.abs(arm.axis_F[joint])
    own = None
    if axis.max() > 1 - 1e-9:
        own = COMPONENTS[int(axis.argmax()) + (0 if arm.prismatic[joint] else 3)]
    return tuple(c for c in COMPONENTS if c != own)


def _moved(arm: Arm, joint: int, d: Array, r: Array, *, before_spring: bool) -> Arm:
    """The arm with the pose error (d, r) of a joint's parent-side frame F_i, in the axes of F_i.

    A geometric error moves the frame together with the link spring that stands in it. A zero offset comes after that
    spring, with the joint: it turns the axes of everything beyond, which is a change of the constants *after* the joint.
    """
    R = rotation_of_vector(r)
    if before_spring:
        R_PF, p_PF = arm.R_PF.copy(), arm.p_PF.copy()
        p_PF[joint] = p_PF[joint] + R_PF[joint] @ d
        R_PF[joint] = R_PF[joint] @ R
        return replace(arm, R_PF=R_PF, p_PF=p_PF)
    # Offset and joint motion commute (same axis), so M_i may be moved instead of F_i: constants of link i change.
    R_PF, p_PF, p_MCom = arm.R_PF.copy(), arm.p_PF.copy(), arm.p_MCom.copy()
    k = joint + 1
    R_PF[k] = R @ R_PF[k]
    p_PF[k] = d + R @ p_PF[k]
    p_MCom[k] = d + R @ p_MCom[k]
    return replace(arm, R_PF=R_PF, p_PF=p_PF, p_MCom=p_MCom)


class Payload(Effect):
    """Mass on the flange beyond what the cell states, and its first moments about the stated centre of mass."""

    kind = "payload"
    station = "arm"
    needs = ("positions",)

    def __init__(self, where: str = "tool") -> None:
        super().__init__(where)

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        moments = tuple(Parameter(f"moment_{c}", "kg m", 1.0) for c in "xyz")
        return (Parameter("mass", "kg", 10.0), *moments)

    def check(self, arm: Arm, points: Mapping[str, object]) -> None:
        expect(self, self.where, ("tool",), "place")

    @classmethod
    def candidates(cls, arm: Arm, points: Mapping[str, object]) -> Iterator[Effect]:
        yield cls()

    def on_arm(self, arm: Arm, x: Array) -> Arm:
        # mass * centre is what weight feels; where the total mass vanishes the moment alone has no place to act.
        mass = arm.tool_mass_kg + x[0]
        moment = mass * arm.p_ETool + x[1:]
        if abs(mass) < 1e-12:
            return replace(arm, tool_mass_kg=0.0)
        return replace(arm, tool_mass_kg=mass, p_ETool=moment / mass)
