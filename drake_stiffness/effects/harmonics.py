"""What repeats with the angle of a joint: stiffness of the tooth mesh, and transmission error."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import TYPE_CHECKING

import numpy as np

from drake_stiffness.effects.compliance import ROTATION_SCALE
from drake_stiffness.effects.effect import Carried, Cases, Effect, Parameter
from drake_stiffness.effects.transmission import JointEffect
from drake_stiffness.errors import InputError
from drake_stiffness.rotations import Array

if TYPE_CHECKING:
    from drake_stiffness.arm import Arm

# Harmonics of the joint angle that a search tries: eccentricity, lobes and teeth of the last stages.
HARMONICS = tuple(range(1, 61))
# So many of them one effect may hold; a joint that needs more is described by something else.
_MOST = 6


class _Harmonic(JointEffect):
    """Sines and cosines of the commanded angle, `harmonic` periods a turn (a metre, for a prismatic joint).

    Parameters
    ----------
    harmonic : float or sequence of floats
        One number of periods, or several: a gear repeats with its eccentricity and with its teeth.
    """

    def __init__(self, where: str, prismatic: bool = False, harmonic: float | Sequence[float] = 1.0) -> None:
        super().__init__(where, prismatic)
        several = harmonic if isinstance(harmonic, Sequence) and not isinstance(harmonic, str) else (harmonic,)
        self.harmonics: tuple[float, ...] = tuple(several)
        numbers = all(isinstance(h, int | float) and 0 < h < np.inf for h in several)
        if not several or not numbers or len(set(several)) < len(several):
            raise InputError(
                f"{self.kind} at '{where}': found harmonic: {harmonic!r}; expected one positive number of periods a turn (a metre), "
                "or a list of different ones."
            )

    @property
    def harmonic(self) -> float:
        """The first of them."""
        return self.harmonics[0]

    def settings(self) -> dict[str, object]:
        one = len(self.harmonics) == 1
        return {**super().settings(), "harmonic": self.harmonics[0] if one else list(self.harmonics)}

    @classmethod
    def candidates(cls, arm: Arm, points: Mapping[str, object]) -> Iterator[Effect]:
        for name, prismatic in zip(arm.joint_names, arm.prismatic, strict=True):
            for harmonic in HARMONICS:
                yield cls(name, bool(prismatic), float(harmonic))

    def further(self) -> Iterator[Effect]:
        if len(self.harmonics) < _MOST:
            for harmonic in HARMONICS:
                if harmonic not in self.harmonics:
                    yield type(self)(self.where, self.prismatic, float(harmonic))

    def joined(self, other: Effect) -> Effect:
        assert isinstance(other, _Harmonic)
        return type(self)(self.where, self.prismatic, (*self.harmonics, *other.harmonics))

    def waves(self, unit: str, scale: float) -> tuple[Parameter, ...]:
        """`sin` and `cos`, for several harmonics with their number: `sin_2`, `cos_2`."""
        ends = [""] if len(self.harmonics) == 1 else [f"_{h:g}".replace(".", "_") for h in self.harmonics]
        return tuple(Parameter(f"{name}{end}", unit, scale) for end in ends for name in ("sin", "cos"))

    def wave(self, arm: Arm, cases: Cases, x: Array) -> Array:
        """Sum over the harmonics N of x_1 sin(N q) + x_2 cos(N q), `(N,)`."""
        q = cases.q[self.number(arm)] * (2 * np.pi if self.prismatic else 1.0)
        out = np.zeros_like(q)
        for harmonic, s, c in zip(self.harmonics, x[::2], x[1::2], strict=True):
            if s:
                out += s * np.sin(harmonic * q)
            if c:
                out += c * np.cos(harmonic * q)
        return out


class JointMeshStiffness(_Harmonic):
    """The compliance of a joint varies with its angle: theta = tau (s sin(N q) + c cos(N q)). Needs loads; many angles."""

    kind = "joint_mesh_stiffness"
    needs = ("load", "angles")
    refines = "joint_compliance"

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        unit = "m/N" if self.prismatic else "rad/(N m)"
        return self.waves(unit, 0.1 * ROTATION_SCALE)

    def deflection(self, arm: Arm, carried: Carried, cases: Cases, x: Array) -> dict[int, Array]:
        i = self.number(arm)
        return {i: carried.tau_joint[i] * self.wave(arm, cases, x)}


class JointPeriodicError(_Harmonic):
    """The joint's angle itself is off, load or no load: theta = s sin(N q) + c cos(N q). Needs positions; many angles."""

    kind = "joint_periodic_error"
    needs = ("positions", "angles")

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        return self.waves(self.deflection_unit, 1e-4)

    def deflection(self, arm: Arm, carried: Carried, cases: Cases, x: Array) -> dict[int, Array]:
        return {self.number(arm): self.wave(arm, cases, x)}
