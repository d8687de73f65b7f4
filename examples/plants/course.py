"""The course of a campaign: which load step of which experiment every posture is, and when."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from .beams import Array

Numbers = npt.NDArray[np.intp]


@dataclass(frozen=True)
class Course:
    """N postures in time.

    Attributes
    ----------
    experiment, step
        (N,) numbers: arm configuration, and order of the load steps in it.
    time_s
        (N,) s.
    """

    experiment: Numbers
    step: Numbers
    time_s: Array

    @classmethod
    def unknown(cls, count: int) -> Course:
        """Every posture the first step of its own experiment, all at time zero."""
        return cls(np.arange(count), np.zeros(count, dtype=np.intp), np.zeros(count))

    def rows(self) -> list[tuple[Numbers, Numbers]]:
        """Per step after the first: the cases before and the cases now, over all experiments that have it."""
        order = np.lexsort((self.step, self.experiment))
        same = self.experiment[order][1:] == self.experiment[order][:-1]
        before, now = order[:-1][same], order[1:][same]
        starts = np.flatnonzero(np.diff(self.experiment[order], prepend=-1))
        place = (np.arange(order.size) - np.repeat(starts, np.diff(np.append(starts, order.size))))[1:][same]
        return [(before[place == k], now[place == k]) for k in range(1, int(place.max(initial=0)) + 1)]

    def first(self) -> Numbers:
        """(N,) the first case of every case's experiment."""
        order = np.lexsort((self.step, self.experiment))
        _, start, which = np.unique(self.experiment[order], return_index=True, return_inverse=True)
        out = np.empty(order.size, dtype=np.intp)
        out[order] = order[start][which]
        return out
