"""Linear springs: joints, links and the base. theta = k tau on the whole torque or wrench carried (seed eqs. 4, 8)."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Mapping
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from drake_stiffness.effects.effect import Effect, Parameter
from drake_stiffness.errors import InputError
from drake_stiffness.rotations import Array
from drake_stiffness.springs import SpringTemplate, Template, spring_template

if TYPE_CHECKING:
    from drake_stiffness.arm import Arm

# A typical rotational compliance of an industrial arm, rad/(N m); translations follow with the square of a length.
ROTATION_SCALE = 1e-6


class Spring(Effect):
    """A linear spring with a constant compliance matrix: its observation columns are J omega J^T W (seed eq. 23)."""

    station = "spring"

    @abstractmethod
    def matrix(self, x: Array) -> Array:
        """The compliance matrix, (1, 1) or (6, 6), SI."""

    @property
    @abstractmethod
    def basis(self) -> Array:
        """d matrix / d unknown, (unknowns, m, m)."""

    @abstractmethod
    def site(self, arm: Arm) -> tuple[str, int]:
        """('joint', number) or ('link', number)."""

    def compliance(self, arm: Arm, x: Array, joint: Array, link: dict[int, Array]) -> None:
        place, number = self.site(arm)
        if place == "joint":
            joint[number] += self.matrix(x)[0, 0]
        else:
            link[number] = link.get(number, np.zeros((6, 6))) + self.matrix(x)


class JointCompliance(Spring):
    """Spring about (revolute) or along (prismatic) a joint's axis: theta_i = k_i tau_i."""

    kind = "joint_compliance"

    def __init__(self, where: str, unit: str = "rad/(N m)", scale: float = ROTATION_SCALE) -> None:
        super().__init__(where)
        self.unit, self.scale = unit, scale

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        return (Parameter("k", self.unit, self.scale, lower=0.0),)

    @property
    def names(self) -> tuple[str, ...]:
        return (self.where,)

    @property
    def cone_blocks(self) -> tuple[NDArray[np.int_], ...]:
        return (np.array([[0]]),)

    @property
    def basis(self) -> Array:
        return np.ones((1, 1, 1))

    def settings(self) -> dict[str, object]:
        return {"unit": self.unit, "scale": self.scale}

    def matrix(self, x: Array) -> Array:
        return x.reshape(1, 1)

    def site(self, arm: Arm) -> tuple[str, int]:
        return "joint", arm.joint_names.index(self.where)

    def check(self, arm: Arm, points: Mapping[str, object]) -> None:
        expect(self, self.where, arm.joint_names, "joint")


class LinkCompliance(Spring):
    """The 6x6 spring at the end of a link, in the parent-side frame of the next joint (seed eqs. 21-24)."""

    kind = "link_compliance"

    def __init__(
        self, where: str, template: Template = "symmetric", beam_axis: str = "x", length_m: float = 1.0
    ) -> None:
        super().__init__(where)
        self.template_name, self.beam_axis, self.length_m = template, beam_axis, length_m

    @property
    def template(self) -> SpringTemplate:
        return spring_template(self.template_name, self.beam_axis)

    @property
    def component_scales(self) -> Array:
        """Congruence scales of the six components: k_ij is of the size s_i s_j."""
        return np.sqrt(ROTATION_SCALE) * np.array([self.length_m] * 3 + [1.0] * 3)

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        s, t = self.component_scales, self.template
        return tuple(
            Parameter(name, unit, float(s[i] * s[j]), lower=0.0 if i == j and t.symmetric else -np.inf)
            for name, unit, (i, j) in zip(t.names, t.units, t.entries, strict=True)
        )

    def link_name(self) -> str:
        return self.where

    @property
    def names(self) -> tuple[str, ...]:
        return tuple(f"{self.link_name()}.{name}" for name in self.template.names)

    @property
    def cone_blocks(self) -> tuple[NDArray[np.int_], ...]:
        return self.template.cone_blocks

    @property
    def basis(self) -> Array:
        return self.template.basis

    def settings(self) -> dict[str, object]:
        return {"template": self.template_name, "beam_axis": self.beam_axis, "length_m": self.length_m}

    def matrix(self, x: Array) -> Array:
        return self.template.matrix(x)

    def site(self, arm: Arm) -> tuple[str, int]:
        return "link", arm.link_names.index(self.where)

    def check(self, arm: Arm, points: Mapping[str, object]) -> None:
        if self.where == arm.link_names[0]:
            raise InputError(
                f"{self.kind} at '{self.where}': this is the base link; write kind base_compliance, where base."
            )
        expect(self, self.where, arm.link_names[1:], "link")


class BaseCompliance(LinkCompliance):
    """The base link's spring, in the parent-side frame of the first joint; its place is called "base"."""

    kind = "base_compliance"

    def __init__(
        self,
        where: str = "base",
        template: Template = "symmetric",
        beam_axis: str = "x",
        length_m: float = 1.0,
        link: str = "base",
    ) -> None:
        super().__init__(where, template, beam_axis, length_m)
        self.link = link

    def link_name(self) -> str:
        return self.link

    def settings(self) -> dict[str, object]:
        return {**super().settings(), "link": self.link}

    def site(self, arm: Arm) -> tuple[str, int]:
        return "link", 0

    def check(self, arm: Arm, points: Mapping[str, object]) -> None:
        expect(self, self.where, ("base",), "place")


def expect(effect: Effect, found: str, known: tuple[str, ...], what: str) -> None:
    """Raise InputError unless `found` is one of the known names."""
    if found not in known:
        raise InputError(f"{effect.kind} at '{found}': there is no such {what}; expected one of {', '.join(known)}.")
