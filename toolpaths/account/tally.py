"""Mean, root mean square, largest and 95th percentile of values that come in pieces and are not kept."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]

# Bins by powers of ten: a percentile is good to half a bin, 0.06 %.
_LOWEST, _HIGHEST, _BINS_A_DECADE = -9, 6, 2000
_BINS = (_HIGHEST - _LOWEST) * _BINS_A_DECADE


def summary_of(values: Floats) -> dict[str, float]:
    """Mean, rms, p95 and max of the finite values; NaN where there is none."""
    known = values[np.isfinite(values)]
    if not known.size:
        return {"mean": float("nan"), "rms": float("nan"), "p95": float("nan"), "max": float("nan")}
    return {
        "mean": float(known.mean()),
        "rms": float(np.sqrt((known**2).mean())),
        "p95": float(np.percentile(known, 95)),
        "max": float(known.max()),
    }


@dataclass(frozen=True, eq=False)
class Tally:
    """What is kept of values that are not negative.

    Attributes
    ----------
    count, total, square, largest
        Of the finite ones: how many, sum, sum of squares, largest.
    bins
        (B,) how many in every bin of the logarithm; the first bin holds what is smaller than all. None where another tally
        has taken them over (`give_bins`).
    """

    count: int
    total: float
    square: float
    largest: float
    bins: NDArray[np.int64]

    @classmethod
    def of(cls, values: Floats) -> Tally:
        """Count a piece."""
        known = values[np.isfinite(values)]
        with np.errstate(divide="ignore"):
            place = (np.log10(np.abs(known)) - _LOWEST) * _BINS_A_DECADE
        number = np.clip(place, 0, _BINS - 1).astype(np.int64)
        return cls(
            int(known.size),
            float(known.sum()),
            float((known**2).sum()),
            float(known.max(initial=-np.inf)),
            np.bincount(number, minlength=_BINS),
        )

    def __add__(self, other: Tally) -> Tally:
        return Tally(
            self.count + other.count,
            self.total + other.total,
            self.square + other.square,
            max(self.largest, other.largest),
            self.bins + other.bins if self.bins.size and other.bins.size else max(self.bins, other.bins, key=len),
        )

    def give_bins(self, other: Tally) -> Tally:
        """This tally without its bins, which another one adds to its own: of many tallies one is enough to hold them."""
        other.bins[:] += self.bins
        return replace(self, bins=np.zeros(0, dtype=np.int64))

    @property
    def mean(self) -> float:
        """Mean; NaN without values."""
        return self.total / self.count if self.count else float("nan")

    def summary(self) -> dict[str, float]:
        """As `summary_of`; the percentile from the bins."""
        if not self.count:
            return summary_of(np.zeros(0))
        at = int(np.searchsorted(np.cumsum(self.bins), 0.95 * (self.count - 1), side="right"))
        p95 = 10.0 ** (_LOWEST + (at + 0.5) / _BINS_A_DECADE) if at else 0.0
        return {
            "mean": self.mean,
            "rms": float(np.sqrt(self.square / self.count)),
            "p95": min(p95, self.largest),
            "max": self.largest,
        }
