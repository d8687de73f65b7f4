"""Linear springs: joints, links and the base. theta = k tau on the whole torque or wrench carried (seed eqs. 4, 8)."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Iterable, Iterator, Mapping
from typing import TYPE_CHECKING, Literal

import numpy as np
from numpy.typing import NDArray

from drake_stiffness.effects.effect import Effect, Parameter
from drake_stiffness.errors import InputError
from drake_stiffness.rotations import Array
from drake_stiffness.springs import SpringTemplate, Template, mask_entries, masked_template, spring_template

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

    def __init__(self, where: str, unit: str = "rad/(N m)", scale: float = ROTATION_SCALE, floor: float = 0.0) -> None:
        super().__init__(where)
        self.unit, self.scale, self.floor = unit, scale, floor

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        # Beside a floor the solver wants a ceiling of about the same size.
        return (Parameter("k", self.unit, self.scale, self.floor, 1e3 * self.scale if self.floor else np.inf),)

    def kept_above(self, floor: float) -> JointCompliance:
        """The same spring with a least compliance."""
        return JointCompliance(self.where, self.unit, self.scale, floor)

    @property
    def names(self) -> tuple[str, ...]:
        return (self.where,)

    @property
    def cone_blocks(self) -> tuple[NDArray[np.int_], ...]:
        return () if self.floor else (np.array([[0]]),)

    @property
    def basis(self) -> Array:
        return np.ones((1, 1, 1))

    def settings(self) -> dict[str, object]:
        return {"unit": self.unit, "scale": self.scale} | ({"floor": self.floor} if self.floor else {})

    def matrix(self, x: Array) -> Array:
        return x.reshape(1, 1)

    def site(self, arm: Arm) -> tuple[str, int]:
        return "joint", arm.joint_names.index(self.where)

    def check(self, arm: Arm, points: Mapping[str, object]) -> None:
        expect(self, self.where, arm.joint_names, "joint")

    @classmethod
    def candidates(cls, arm: Arm, points: Mapping[str, object]) -> Iterator[Effect]:
        for name, prismatic in zip(arm.joint_names, arm.prismatic, strict=True):
            yield cls(name, "m/N", ROTATION_SCALE * arm.length_m**2) if prismatic else cls(name)


class LinkCompliance(Spring):
    """The 6x6 spring at the end of a link, in the parent-side frame of the next joint (seed eqs. 21-24).

    Parameters
    ----------
    template : a name of `springs.TEMPLATES`, or "mask"
    entries : iterable of str
        For "mask": the unknowns that are left, as ["k22", "k26", "k66"]; everything else of the matrix is zero.
    combined : bool
        Entries stand for combinations with parameters that a reduction took away as redundant (seed 4.1, G3). They predict what
        a physical model with the same combinations predicts, but need not be positive themselves.

    Raises
    ------
    InputError
        If a mask names what is no entry, or none.
    """

    kind = "link_compliance"

    def __init__(
        self,
        where: str,
        template: Template | Literal["mask"] = "symmetric",
        beam_axis: str = "x",
        length_m: float = 1.0,
        entries: Iterable[str] = (),
        combined: bool = False,
    ) -> None:
        super().__init__(where)
        self.template_name, self.beam_axis, self.length_m, self.combined = template, beam_axis, length_m, combined
        self.entries: tuple[str, ...] = ()
        if template == "mask":
            try:
                self.entries = mask_entries(entries)
            except ValueError as error:
                raise InputError(f"{self.kind} at '{where}': entries: {error}.") from None
        elif tuple(entries):
            raise InputError(f"{self.kind} at '{where}': entries belong to template mask; found template {template}.")

    @property
    def template(self) -> SpringTemplate:
        if self.template_name == "mask":
            return masked_template(self.entries)
        return spring_template(self.template_name, self.beam_axis)

    def masked(self, entries: Iterable[str], *, combined: bool = False) -> LinkCompliance:
        """The same spring with the named entries only."""
        settings = {**self.settings(), "template": "mask", "entries": tuple(entries), "combined": combined}
        return type(self)(self.where, **settings)  # type: ignore[arg-type]

    @property
    def component_scales(self) -> Array:
        """Congruence scales of the six components: k_ij is of the size s_i s_j."""
        return np.sqrt(ROTATION_SCALE) * np.array([self.length_m] * 3 + [1.0] * 3)

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        s, t = self.component_scales, self.template
        bounded = t.symmetric and not self.combined
        return tuple(
            Parameter(name, unit, float(s[i] * s[j]), lower=0.0 if i == j and bounded else -np.inf)
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
        own = {"template": self.template_name, "beam_axis": self.beam_axis, "length_m": self.length_m}
        return own | ({"entries": list(self.entries), "combined": self.combined} if self.entries else {})

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

    @classmethod
    def candidates(cls, arm: Arm, points: Mapping[str, object]) -> Iterator[Effect]:
        for name in arm.link_names[1:]:
            yield cls(name, "beam", default_beam_axis(arm, name) or "x", arm.length_m)


class BaseCompliance(LinkCompliance):
    """The base link's spring, in the parent-side frame of the first joint; its place is called "base"."""

    kind = "base_compliance"

    def __init__(
        self,
        where: str = "base",
        template: Template | Literal["mask"] = "symmetric",
        beam_axis: str = "x",
        length_m: float = 1.0,
        link: str = "base",
        entries: Iterable[str] = (),
        combined: bool = False,
    ) -> None:
        super().__init__(where, template, beam_axis, length_m, entries, combined)
        self.link = link

    def link_name(self) -> str:
        return self.link

    def settings(self) -> dict[str, object]:
        return {**super().settings(), "link": self.link}

    def site(self, arm: Arm) -> tuple[str, int]:
        return "link", 0

    def check(self, arm: Arm, points: Mapping[str, object]) -> None:
        expect(self, self.where, ("base",), "place")

    @classmethod
    def candidates(cls, arm: Arm, points: Mapping[str, object]) -> Iterator[Effect]:
        link = arm.link_names[0]
        yield cls("base", "beam", default_beam_axis(arm, link) or "z", arm.length_m, link)


def default_beam_axis(arm: Arm, link: str) -> str | None:
    """The spring-frame axis nearest to the vector from the link's own joint to its spring; None for zero length."""
    k = arm.link_names.index(link)
    along = np.abs(arm.R_PF[k].T @ arm.p_PF[k])
    return "xyz"[int(along.argmax())] if along.max() > 1e-9 else None


def expect(effect: Effect, found: str, known: tuple[str, ...], what: str) -> None:
    """Raise InputError unless `found` is one of the known names."""
    if found not in known:
        raise InputError(f"{effect.kind} at '{found}': there is no such {what}; expected one of {', '.join(known)}.")
