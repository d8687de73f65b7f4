"""The averages of milling at the points of a path, and at other places of the tool: where engagement is stated, and where it is swept."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from toolpaths.milling.cutters import Cutter
from toolpaths.milling.engagement import Engagement
from toolpaths.milling.laws import CuttingLaw
from toolpaths.milling.mechanistic import average_wrench

Floats = NDArray[np.float64]
Points = slice | NDArray[np.int_]

_CHUNK = 4096


@dataclass(frozen=True, eq=False)
class StatedCut:
    """Averages where the engagement is stated: recomputed at the true depth of cut.

    Attributes
    ----------
    cutter, law, engagement
    chip : (N,) feed per tooth across the tool's axis, m
    """

    cutter: Cutter
    law: CuttingLaw
    engagement: Engagement
    chip: Floats

    def nominal(self) -> Floats:
        """Wrench (6, N) about the tip in cutter axes, clockwise spindle."""
        cut = self.engagement
        states, which = np.unique(
            np.stack([cut.axial, cut.radial, cut.side, self.chip], axis=1), axis=0, return_inverse=True
        )
        out = np.empty((6, len(states)))
        for start in range(0, len(states), _CHUNK):
            axial, radial, side, chip = states[start : start + _CHUNK].T
            some = Engagement(axial, radial, side.astype(int))
            out[:, start : start + _CHUNK] = average_wrench(self.cutter, self.law, some, chip)
        return out[:, which.ravel()]

    def moved(self, points: Points, left: Floats, up: Floats) -> Floats:
        """The wrench (6, n) of some points when the tool stands off to the left of the feed and up, m."""
        cut = Engagement(self.engagement.axial[points], self.engagement.radial[points], self.engagement.side[points])
        return average_wrench(self.cutter, self.law, cut.moved(self.cutter, left, up), self.chip[points])


@dataclass(frozen=True, eq=False)
class SweptCut:
    """Averages found on a height field, linear in where the tool stands: arrays (6, N), the last two per m."""

    wrench: Floats
    by_left: Floats
    by_up: Floats

    def nominal(self) -> Floats:
        """As `StatedCut.nominal`."""
        return self.wrench

    def moved(self, points: Points, left: Floats, up: Floats) -> Floats:
        """As `StatedCut.moved`."""
        return self.wrench[:, points] + self.by_left[:, points] * left + self.by_up[:, points] * up
