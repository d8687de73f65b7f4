"""Where a cutter is in the material: axial and radial depth, and which side the material is on.

The angle phi of a tooth is counted in the sense of rotation from the y axis, so a tooth at phi = 90 deg points along the feed and cuts
a chip of thickness c sin(phi) sin(kappa). Where the pass before ran a_e (the radial depth, or step-over) beside this one, an edge of
radius r is engaged

    up:   0 <= phi <= arccos(1 - a_e / r)          down: pi - arccos(1 - a_e / r) <= phi <= pi

and in a slot, or where a_e is more than 2 r near the tip of a ball, from 0 to pi. A spindle that turns clockwise (seen from the spindle) has the material of an up cut on the left of the feed
and that of a down (climb) cut on the right.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from drake_stiffness.errors import InputError
from drake_stiffness.tables import read_table
from toolpaths.milling.cutters import Cutter

Floats = NDArray[np.float64]

SIDES = {"slot": 0, "up": 1, "down": -1}


@dataclass(frozen=True, eq=False)
class Engagement:
    """Engagement of M cuts.

    Attributes
    ----------
    axial, radial : (M,)
        Depths, m. An axial depth of 0 is a move through air.
    side : (M,)
        0 slot, 1 up, -1 down.
    """

    axial: Floats
    radial: Floats
    side: NDArray[np.int_]

    def take(self, which: NDArray[np.int_] | NDArray[np.bool_] | slice) -> Engagement:
        """Some of the cuts."""
        return Engagement(self.axial[which], self.radial[which], self.side[which])

    def angles(self, r: Floats) -> tuple[Floats, Floats]:
        """Entry and exit (M, S), rad, of edges at radii r (M, S)."""
        share = np.divide(self.radial[:, None], r, out=2.0 + 0 * r, where=r > 1e-12)
        reach = np.arccos(np.clip(1.0 - share, -1.0, 1.0))
        side = self.side[:, None]
        return np.where(side < 0, np.pi - reach, 0.0), np.where(side > 0, reach, np.pi)

    def moved(self, cutter: Cutter, left: Floats, up: Floats) -> Engagement:
        """The engagement of a tool that stands off by (M,) to the left of its feed, seen from the spindle, and up, m.

        `left` and the sides are those of a clockwise spindle. In a slot moving sideways changes nothing.
        """
        axial = np.where(self.axial > 0, np.maximum(self.axial - up, 0.0), 0.0)
        return Engagement(axial, np.clip(self.radial + self.side * left, 0.0, 2 * cutter.radius), self.side)


def read_engagement(path: Path, cutter: Cutter) -> Engagement:
    """Engagement from a table with columns axial_depth_mm, radial_depth_mm, mode, one row per corrected motion.

    Raises
    ------
    InputError
        If a depth is negative, wider than the cutter or does not fit its mode.
    """
    table = read_table(path, "a table with columns axial_depth_mm, radial_depth_mm, mode")
    names = ("axial_depth_mm", "radial_depth_mm", "mode")
    table.refuse_unknown(set(names), allowed_prefix="note")
    missing = [name for name in names if name not in table.header]
    if missing:
        raise InputError(f"{path}: column {', '.join(missing)} is missing; expected {', '.join(names)}.")
    mode = table.text("mode")
    axial = table.numbers("axial_depth_mm")
    radial = table.numbers("radial_depth_mm", empty=np.nan)
    for row, name in enumerate(mode):
        if axial[row] == 0 and not name:
            mode[row], radial[row] = "slot", 0.0
            continue
        if name not in SIDES:
            raise InputError(f"{table.where(row, 'mode')}: found '{name}'; expected one of {', '.join(SIDES)}.")
        if np.isnan(radial[row]) and (name == "slot" or axial[row] == 0):
            radial[row] = 2e3 * cutter.radius
        wrong = misfit(axial[row], radial[row], name, 2e3 * cutter.radius)
        if wrong:
            raise InputError(f"{path}, line {table.lines[row]}: {wrong}")
    return Engagement(axial * 1e-3, radial * 1e-3, np.array([SIDES[name] for name in mode]))


def misfit(axial_mm: float, radial_mm: float, mode: str, diameter_mm: float) -> str | None:
    """What is wrong with an engagement, or None."""
    if axial_mm < 0:
        return f"axial_depth_mm is {axial_mm:g}; expected 0 (air) or more, in mm."
    if axial_mm == 0:
        return None
    if not 0 < radial_mm <= diameter_mm * (1 + 1e-9):
        return (
            f"radial_depth_mm is {radial_mm:g}; expected more than 0 and at most the cutter's diameter {diameter_mm:g}, in mm. "
            "A move through air has axial_depth_mm 0."
        )
    if mode == "slot" and abs(radial_mm - diameter_mm) > 1e-6 * diameter_mm:
        return (
            f"radial_depth_mm is {radial_mm:g} with mode slot; a slot is as wide as the cutter ({diameter_mm:g} mm). Use mode up or "
            "down, or leave radial_depth_mm out."
        )
    return None
