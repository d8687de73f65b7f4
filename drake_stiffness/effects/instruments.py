"""What shifts a reading: the tracker's pose in the world and where the reflectors really sit on the flange."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from drake_stiffness.effects.compliance import expect
from drake_stiffness.effects.effect import Cases, Effect, Parameter, Reading
from drake_stiffness.rotations import Array, exponential, rotate, rotate_back
from drake_stiffness.springs import COMPONENTS

if TYPE_CHECKING:
    from drake_stiffness.arm import Arm


class TrackerFrame(Effect):
    """The tracker's frame T stands at X_WT = (dx, dy, dz, exp(rx, ry, rz)) in the world: p_T = R_WT^T (p_W - p_WT)."""

    kind = "tracker_frame"
    station = "reading"

    def __init__(self, where: str = "tracker") -> None:
        super().__init__(where)

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        return tuple(Parameter(c, "m" if c.startswith("d") else "rad", 1e-3) for c in COMPONENTS)

    def check(self, arm: Arm, points: Mapping[str, object]) -> None:
        expect(self, self.where, ("tracker",), "instrument")

    @classmethod
    def candidates(cls, arm: Arm, points: Mapping[str, object]) -> Iterator[Effect]:
        yield cls()

    def on_reading(self, reading: Reading, cases: Cases, x: Array) -> Reading:
        R_WT = exponential(x[3:, None])
        p = rotate_back(R_WT, reading.p - x[:3, None])
        R = np.einsum("jin,jkn->ikn", np.broadcast_to(R_WT, reading.R.shape), reading.R)
        return replace(reading, p=p, R=R)


class ReflectorOffset(Effect):
    """A reference point sits off its stated place by (dx, dy, dz) in the flange frame: p += R_WE r."""

    kind = "reflector_offset"
    station = "reading"
    needs = ("positions",)

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        return tuple(Parameter(c, "m", 1e-3) for c in COMPONENTS[:3])

    def check(self, arm: Arm, points: Mapping[str, object]) -> None:
        expect(self, self.where, tuple(points), "reference point")

    @classmethod
    def candidates(cls, arm: Arm, points: Mapping[str, object]) -> Iterator[Effect]:
        for point in points:
            yield cls(point)

    def on_reading(self, reading: Reading, cases: Cases, x: Array) -> Reading:
        mine = reading.point == self.where
        p = reading.p.copy()
        p[:, mine] += rotate(reading.R[:, :, mine], x[:, None])
        return replace(reading, p=p)
