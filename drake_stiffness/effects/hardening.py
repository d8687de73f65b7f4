"""Springs whose slope changes with load: gears that wind up softly at first, teeth and rollers that indent."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import TYPE_CHECKING, Literal, get_args

import numpy as np

from drake_stiffness.effects.compliance import ROTATION_SCALE
from drake_stiffness.effects.effect import Carried, Cases, Effect, Parameter
from drake_stiffness.effects.transmission import JointEffect
from drake_stiffness.errors import InputError
from drake_stiffness.rotations import Array

if TYPE_CHECKING:
    from drake_stiffness.arm import Arm

Form = Literal["quadratic", "cubic", "contact", "two_slopes"]
_POWERS: dict[Form, float] = {"quadratic": 2.0, "cubic": 3.0, "contact": 2.0 / 3.0}
# Torques (N m, or N) at which a search lets the slope change.
KNEES = tuple(10.0 * 1.5**k for k in range(15))
# Below this torque an indentation is linear: bodies in contact are pressed together before they are loaded.
_PRESSED = 5.0
# With fewer of the loads on the way to the knee, or above it, than these shares, that slope is not seen: it is lost motion, or a spring.
_BELOW, _ABOVE, _ON_THE_WAY = 0.2, 0.03, 0.2


class JointHardening(JointEffect):
    """A spring whose slope changes with load, by a term theta = c f(tau) beside its linear compliance:

        quadratic   tau |tau|             cubic        tau^3                     c < 0 where it hardens
        contact     tau |tau|^(-1/3)      two_slopes   min(|tau|, knee) sgn tau  c > 0 where it hardens

    `contact` is the indentation of curved bodies (Hertz, power 2/3), `two_slopes` the soft windup up to a torque `knee` that
    makers of strain-wave gears state. Needs three levels of load or more. A search takes the form that fits best; that does not
    make it the true one (the first two have a canonical correlation of 0.98 in an experiment of the usual kind).
    """

    kind = "joint_hardening"
    needs = ("load", "levels")
    refines = "joint_compliance"

    def __init__(
        self, where: str, prismatic: bool = False, form: Form = "quadratic", knee: float | None = None
    ) -> None:
        super().__init__(where, prismatic)
        if form not in get_args(Form):
            raise InputError(f"{self.kind} at '{where}': found form: {form!r}; expected {', '.join(get_args(Form))}.")
        able = isinstance(knee, int | float) and not isinstance(knee, bool) and 0 < knee < np.inf
        if (not able) if form == "two_slopes" else knee is not None:
            raise InputError(
                f"{self.kind} at '{where}': found form: {form} with knee: {knee!r}; expected a torque above zero ({self.load_unit}) where "
                "the form is two_slopes, and none where it is another."
            )
        self.form, self.knee = form, knee

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        # A tenth of a typical compliance at a typical torque of 1 kN m.
        if self.knee is not None:
            return (Parameter("softness", f"{self.deflection_unit}/({self.load_unit})", 0.1 * ROTATION_SCALE),)
        power = _POWERS[self.form]
        exponent = "(2/3)" if self.form == "contact" else f"{power:.0f}"
        unit = f"{self.deflection_unit}/({self.load_unit})^{exponent}"
        return (Parameter("curvature", unit, 0.1 * ROTATION_SCALE / 1e3 ** (power - 1)),)

    def settings(self) -> dict[str, object]:
        knee = {} if self.knee is None else {"knee": self.knee}
        return {**super().settings(), "form": self.form, **knee}

    @classmethod
    def candidates(cls, arm: Arm, points: Mapping[str, object]) -> Iterator[Effect]:
        for name, prismatic in zip(arm.joint_names, arm.prismatic, strict=True):
            for form in _POWERS:
                yield cls(name, bool(prismatic), form)
            for knee in KNEES:
                yield cls(name, bool(prismatic), "two_slopes", knee)

    def neighbours(self, step: float) -> Iterator[Effect]:
        if self.knee is not None:
            for factor in (1 + step, 1 / (1 + step)):
                yield JointHardening(self.where, self.prismatic, "two_slopes", self.knee * factor)

    @property
    def bounded(self) -> bool:
        return self.form == "two_slopes"

    def idle(self, arm: Arm, carried: Carried) -> bool:
        """A joint that is loaded on one side of the knee only shows one slope."""
        if self.knee is None:
            return False
        share = np.abs(carried.tau_joint[self.number(arm)]) / self.knee
        below, above = np.mean((share > _ON_THE_WAY) & (share < 1)), np.mean(share > 1)
        return bool(below < _BELOW or above < _ABOVE)

    def deflection(self, arm: Arm, carried: Carried, cases: Cases, x: Array) -> dict[int, Array]:
        i = self.number(arm)
        tau = carried.tau_joint[i]
        if self.knee is not None:
            return {i: x[0] * np.clip(tau, -self.knee, self.knee)}
        if self.form == "contact":
            return {i: x[0] * tau * (tau**2 + _PRESSED**2) ** (-1.0 / 6.0)}
        return {i: x[0] * tau * np.abs(tau) ** (_POWERS[self.form] - 1)}
