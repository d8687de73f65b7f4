"""A tracker that wanders: readings shift with time."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from drake_stiffness.effects.compliance import expect
from drake_stiffness.effects.effect import Cases, Effect, Parameter, Reading
from drake_stiffness.errors import InputError
from drake_stiffness.rotations import Array

if TYPE_CHECKING:
    from drake_stiffness.arm import Arm


# Time constants that a search tries, s: settling within ten minutes to four hours, and drifts that grow; and the least size, below which a
# rate says nothing.
_SETTLING_S, _LEAST_S = (600.0, 1200.0, 2400.0, 4800.0, 14400.0, -4800.0, -14400.0), 60.0

_LARGEST = 50.0  # times T: what grows for so long has left every campaign it was found in


class TrackerDrift(Effect):
    """Readings move with time: p += v T (1 - exp(-t / T)), at a constant rate where T is infinite.

    An instrument that warms up drifts fast at first and settles with a time constant T; a negative T is a drift that grows. v is the rate
    at the start. Needs `time_s`; the order of rows says nothing. Times that are not known count as the start.

    Parameters
    ----------
    start_s : float
        Time at which t is 0; a search sets it to the first reading.
    settling_s : float, optional
        T; None for a steady drift.
    """

    kind = "tracker_drift"
    station = "reading"
    needs = ("time",)

    def __init__(self, where: str = "tracker", start_s: float = 0.0, settling_s: float | None = None) -> None:
        super().__init__(where)
        if settling_s is not None and not (isinstance(settling_s, int | float) and abs(settling_s) >= _LEAST_S):
            raise InputError(
                f"{self.kind} at '{where}': found settling_s: {settling_s!r}; expected a time of at least {_LEAST_S:g} s (negative for a "
                "drift that grows), or none for a steady drift."
            )
        self.start_s, self.settling_s = start_s, settling_s

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        # 1e-8 m/s is 36 um an hour.
        return tuple(Parameter(f"v{c}", "m/s", 1e-8) for c in "xyz")

    def settings(self) -> dict[str, object]:
        settling = {} if self.settling_s is None else {"settling_s": self.settling_s}
        return {"start_s": self.start_s, **settling}

    def check(self, arm: Arm, points: Mapping[str, object]) -> None:
        expect(self, self.where, ("tracker",), "instrument")

    @classmethod
    def candidates(cls, arm: Arm, points: Mapping[str, object]) -> Iterator[Effect]:
        yield cls()
        for settling_s in _SETTLING_S:
            yield cls(settling_s=settling_s)

    def timed_from(self, start_s: float) -> Effect:
        """Clocks may count from 1970: a rate would be lost in rounding."""
        return TrackerDrift(self.where, start_s, self.settling_s)

    def neighbours(self, step: float) -> Iterator[Effect]:
        if self.settling_s is not None:
            for factor in (1 + step, 1 / (1 + step)):
                settling_s = self.settling_s * factor
                if abs(settling_s) >= _LEAST_S:
                    yield TrackerDrift(self.where, self.start_s, settling_s)

    def on_reading(self, reading: Reading, cases: Cases, x: Array) -> Reading:
        if not cases.time_s.size:
            return reading
        elapsed = np.nan_to_num(cases.time_s[reading.case] - self.start_s, nan=0.0)
        if self.settling_s is not None:
            elapsed = -self.settling_s * np.expm1(np.minimum(-elapsed / self.settling_s, _LARGEST))
        return replace(reading, p=reading.p + x[:, None] * elapsed)
