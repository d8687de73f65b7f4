"""A tracker that wanders: readings shift with time."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from drake_stiffness.effects.compliance import expect
from drake_stiffness.effects.effect import Cases, Effect, Parameter, Reading
from drake_stiffness.rotations import Array

if TYPE_CHECKING:
    from drake_stiffness.arm import Arm


class TrackerDrift(Effect):
    """Readings move at a constant rate: p += v (t - t_0), t_0 the first time of the readings at hand.

    Needs `time_s`; the order of rows says nothing. Times that are not known count as t_0.
    """

    kind = "tracker_drift"
    station = "reading"
    needs = ("time",)

    def __init__(self, where: str = "tracker", start_s: float = 0.0) -> None:
        super().__init__(where)
        self.start_s = start_s

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        # 1e-8 m/s is 36 um an hour.
        return tuple(Parameter(f"v{c}", "m/s", 1e-8) for c in "xyz")

    def settings(self) -> dict[str, object]:
        return {"start_s": self.start_s}

    def check(self, arm: Arm, points: Mapping[str, object]) -> None:
        expect(self, self.where, ("tracker",), "instrument")

    @classmethod
    def candidates(cls, arm: Arm, points: Mapping[str, object]) -> Iterator[Effect]:
        yield cls()

    def on_reading(self, reading: Reading, cases: Cases, x: Array) -> Reading:
        if not cases.time_s.size:
            return reading
        elapsed = np.nan_to_num(cases.time_s[reading.case] - self.start_s, nan=0.0)
        return replace(reading, p=reading.p + x[:, None] * elapsed)
