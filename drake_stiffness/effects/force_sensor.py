"""What is wrong with the stated load: bias and misalignment of the force sensor, and its scale."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import TYPE_CHECKING, Literal

import numpy as np

from drake_stiffness.effects.compliance import expect
from drake_stiffness.effects.effect import Cases, Effect, Parameter
from drake_stiffness.rotations import Array, exponential, rotate, rotate_back

if TYPE_CHECKING:
    from drake_stiffness.arm import Arm

Frame = Literal["tool", "world"]


class ForceSensorEffect(Effect):
    """An error of the force sensor, constant in the axes of the `frame` it is fixed to: tool (flange) or world."""

    station = "wrench"
    place = "force_sensor"
    needs = ("load",)

    def __init__(self, where: str = "force_sensor", frame: Frame = "world") -> None:
        super().__init__(where)
        self.frame = frame

    def settings(self) -> dict[str, object]:
        return {"frame": self.frame}

    def check(self, arm: Arm, points: Mapping[str, object]) -> None:
        expect(self, self.where, (self.place,), "instrument")

    @classmethod
    def candidates(cls, arm: Arm, points: Mapping[str, object]) -> Iterator[Effect]:
        frames: tuple[Frame, ...] = ("world", "tool")
        for frame in frames:
            yield cls(cls.place, frame)


class ForceSensorBias(ForceSensorEffect):
    """A constant that the sensor reads too little: the true force is the stated one plus b, in every loaded step.

    A step whose stated wrench is zero carries nothing: nobody pulls then, whatever the sensor says. So a bias shows as an
    intercept: displacement extrapolated to zero load is not zero.
    """

    kind = "force_sensor_bias"

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        return tuple(Parameter(f"f{c}", "N", 10.0) for c in "xyz")

    def on_wrench(self, wrench: Array, cases: Cases, R_E: Array, x: Array) -> Array:
        bias = np.broadcast_to(x[:, None], (3, wrench.shape[1]))
        if self.frame == "tool":
            bias = rotate(R_E, bias)
        out = wrench.copy()
        out[:3] += np.where(np.abs(wrench).max(axis=0) > 0, bias, 0.0)
        return out


class ForceSensorMisalignment(ForceSensorEffect):
    """The sensor's axes are turned by a small rotation vector phi: the true wrench is exp(phi) times the stated one."""

    kind = "force_sensor_misalignment"

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        return tuple(Parameter(f"r{c}", "rad", 1e-2) for c in "xyz")

    def on_wrench(self, wrench: Array, cases: Cases, R_E: Array, x: Array) -> Array:
        turn = exponential(x[:, None])
        parts = []
        for part in (wrench[:3], wrench[3:]):
            if self.frame == "tool":
                parts.append(rotate(R_E, rotate(turn, rotate_back(R_E, part))))
            else:
                parts.append(rotate(turn, part))
        return np.concatenate(parts)


class Scale(Effect):
    """A common factor 1 + s on every stated load (or on every displacement: no campaign tells which).

    It cannot be told from one common factor on all compliances either, so it shows only where compliances are held fixed.
    """

    kind = "scale"
    station = "wrench"
    needs = ("load", "known_springs")

    def __init__(self, where: str = "force_or_tracker") -> None:
        super().__init__(where)

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        return (Parameter("factor", "1", 1e-2),)

    def check(self, arm: Arm, points: Mapping[str, object]) -> None:
        expect(self, self.where, ("force_or_tracker",), "place")

    @classmethod
    def candidates(cls, arm: Arm, points: Mapping[str, object]) -> Iterator[Effect]:
        yield cls()

    def on_wrench(self, wrench: Array, cases: Cases, R_E: Array, x: Array) -> Array:
        return wrench * (1.0 + x[0])
