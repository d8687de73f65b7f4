"""What repeats with the angle of a joint: stiffness of the tooth mesh, and transmission error."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import TYPE_CHECKING

import numpy as np

from drake_stiffness.effects.compliance import ROTATION_SCALE
from drake_stiffness.effects.effect import Carried, Cases, Effect, Parameter
from drake_stiffness.effects.transmission import JointEffect
from drake_stiffness.rotations import Array

if TYPE_CHECKING:
    from drake_stiffness.arm import Arm

# Harmonics of the joint angle that a search tries: eccentricity, lobes and teeth of the last stages.
HARMONICS = tuple(range(1, 61))


class _Harmonic(JointEffect):
    """A sine and a cosine of the commanded angle, `harmonic` periods a turn (a metre, for a prismatic joint)."""

    def __init__(self, where: str, prismatic: bool = False, harmonic: float = 1.0) -> None:
        super().__init__(where, prismatic)
        self.harmonic = harmonic

    def settings(self) -> dict[str, object]:
        return {**super().settings(), "harmonic": self.harmonic}

    @classmethod
    def candidates(cls, arm: Arm, points: Mapping[str, object]) -> Iterator[Effect]:
        for name, prismatic in zip(arm.joint_names, arm.prismatic, strict=True):
            for harmonic in HARMONICS:
                yield cls(name, bool(prismatic), float(harmonic))

    def wave(self, arm: Arm, cases: Cases, x: Array) -> Array:
        """x_1 sin(N q) + x_2 cos(N q), `(N,)`."""
        angle = self.harmonic * cases.q[self.number(arm)] * (2 * np.pi if self.prismatic else 1.0)
        return x[0] * np.sin(angle) + x[1] * np.cos(angle)


class JointMeshStiffness(_Harmonic):
    """The compliance of a joint varies with its angle: theta = tau (s sin(N q) + c cos(N q)). Needs loads; many angles."""

    kind = "joint_mesh_stiffness"
    needs = ("load", "angles")
    refines = "joint_compliance"

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        unit = "m/N" if self.prismatic else "rad/(N m)"
        return tuple(Parameter(name, unit, 0.1 * ROTATION_SCALE) for name in ("sin", "cos"))

    def deflection(self, arm: Arm, carried: Carried, cases: Cases, x: Array) -> dict[int, Array]:
        i = self.number(arm)
        return {i: carried.tau_joint[i] * self.wave(arm, cases, x)}


class JointPeriodicError(_Harmonic):
    """The joint's angle itself is off, load or no load: theta = s sin(N q) + c cos(N q). Needs positions; many angles."""

    kind = "joint_periodic_error"
    needs = ("positions", "angles")

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        return tuple(Parameter(name, self.deflection_unit, 1e-4) for name in ("sin", "cos"))

    def deflection(self, arm: Arm, carried: Carried, cases: Cases, x: Array) -> dict[int, Array]:
        return {self.number(arm): self.wave(arm, cases, x)}
