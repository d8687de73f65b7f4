"""The wrench of milling at every corrected point of a program, and how it changes when the tool stands elsewhere."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from drake_stiffness.errors import InputError
from toolpaths.milling.cuts import Points, StatedCut, SweptCut
from toolpaths.milling.engagement import SIDES, Engagement, read_engagement
from toolpaths.milling.heightfield import swept_cut
from toolpaths.milling.laws import CuttingLaw
from toolpaths.milling.mechanistic import counterclockwise
from toolpaths.milling.settings import Milling
from toolpaths.path_axes import feed_direction, motion_numbers
from toolpaths.program import Program

Floats = NDArray[np.float64]

# A feed this near to the tool's axis (as a sine) is a plunge or a retract: nothing here knows the force of the end of a cutter.
_PLUNGE = 0.05
# Step of the differences that give slopes, m.
_STEP = 1e-6


@dataclass(frozen=True, eq=False)
class MillingLoad:
    """The load of milling on N points.

    Attributes
    ----------
    axes : (N, 3, 3)
        Cutter axes in the world, as columns.
    cut : StatedCut or SweptCut
    clockwise : bool
        Sense of the spindle, seen from the spindle towards the tip.
    moments : bool
        Whether the moment about the tip is part of the load.
    relative_sigma : float
        Of the force, from that of the coefficients.
    notes : what the user should know
    """

    axes: Floats
    cut: StatedCut | SweptCut
    clockwise: bool
    moments: bool
    relative_sigma: float
    notes: tuple[str, ...]

    def nominal(self) -> Floats:
        """Wrench (6, N) at the tip in world axes, at the depth the process states."""
        return self._in_world(self.cut.nominal(), self.axes)

    def at(self, points: Points, shift: Floats) -> Floats:
        """Wrench (6, n) of some points whose tool stands `shift` (3, n), world, m, off where it is wanted."""
        axes = self.axes[points]
        _, y, z = np.einsum("nij,in->jn", axes, shift)
        return self._in_world(self.cut.moved(points, y if self.clockwise else -y, z), axes)

    def slopes(self, points: Points) -> Floats:
        """Change of the wrench with the place of the tool, (n, 6, 3), N/m and N: central differences."""
        axes = self.axes[points]
        out = np.zeros((len(axes), 6, 3))
        for axis in (1, 2):
            step = _STEP * axes[:, :, axis].T
            slope = (self.at(points, step) - self.at(points, -step)) / (2 * _STEP)
            out += slope.T[:, :, None] * axes[:, None, :, axis]
        return out

    def _in_world(self, wrench: Floats, axes: Floats) -> Floats:
        if not self.clockwise:
            wrench = counterclockwise(wrench)
        force = np.einsum("nij,jn->in", axes, wrench[:3])
        moment = np.einsum("nij,jn->in", axes, wrench[3:]) if self.moments else np.zeros_like(force)
        return np.concatenate([force, moment])


def milling_load(
    milling: Milling,
    folder: Path,
    program: Program,
    rows: NDArray[np.int_],
    p_W: Floats,
    R_WT: Floats,
    spindle_axis: Floats,
    R_WB: Floats,
) -> MillingLoad:
    """The load of milling at the corrected rows of a program.

    Parameters
    ----------
    folder : where paths in the process description start
    p_W : (P, 3), R_WT : (N, 3, 3)
        As `forces.wrenches` takes them.
    spindle_axis : (3,)
        From tip to spindle in the TCP frame.
    R_WB : (3, 3)
        The program's base frame in the world.

    Raises
    ------
    InputError
        If a feed is not known, or the engagement does not fit the program.
    """
    up = R_WT @ spindle_axis
    feed = _carried_on(feed_direction(program, rows, p_W))
    lead = np.einsum("ni,ni->n", feed, up)
    across = feed - lead[:, None] * up
    share = np.linalg.norm(across, axis=1)
    cutting = share > _PLUNGE
    x = np.where(cutting[:, None], across, R_WT[:, :, 0] if abs(spindle_axis[0]) < 0.5 else R_WT[:, :, 1])
    x = x / np.linalg.norm(x, axis=1, keepdims=True)
    axes = np.stack([x, np.cross(up, x), up], axis=2)
    law = milling.coefficients.law
    clockwise = milling.clockwise(spindle_axis)
    notes = _notes(milling, law, int((~cutting).sum()), clockwise=clockwise)
    if milling.heightfield is not None:
        chip = np.where(cutting, _chip(milling, program, rows, cutting) * share, 0.0)
        cut, said = swept_cut(milling, program, rows, chip, up @ R_WB, clockwise=clockwise)
        return MillingLoad(axes, cut, clockwise, milling.moments, law.relative_sigma, notes + said)
    engagement = _engagement(milling, folder, program, rows)
    unknown = np.flatnonzero((np.abs(feed).max(axis=1) == 0) & (engagement.axial > 0))
    if unknown.size:
        raise InputError(
            f"{program.path}, line {program.line[rows[unknown[0]]]}: the direction of feed is not known, so neither is the force of "
            "milling. Start the motion from a literal pose, or give force.table."
        )
    engagement = Engagement(np.where(cutting, engagement.axial, 0.0), engagement.radial, engagement.side)
    chip = np.where(engagement.axial > 0, _chip(milling, program, rows, engagement.axial > 0) * share, 0.0)
    stated = StatedCut(milling.shape, law, engagement, chip)
    return MillingLoad(axes, stated, clockwise, milling.moments, law.relative_sigma, notes)


def _carried_on(feed: Floats) -> Floats:
    """A motion that goes nowhere (a point written twice) keeps the feed of the motion before."""
    known = np.abs(feed).max(axis=1) > 0
    last = np.maximum.accumulate(np.where(known, np.arange(len(feed)), -1))
    return np.where((last >= 0)[:, None], feed[np.maximum(last, 0)], feed)


def _engagement(milling: Milling, folder: Path, program: Program, rows: NDArray[np.int_]) -> Engagement:
    motion = motion_numbers(program, rows)
    if milling.engagement is None:
        assert milling.axial_depth_mm is not None
        assert milling.mode is not None
        one = np.ones(rows.size)
        side = np.full(rows.size, SIDES[milling.mode])
        return Engagement(milling.axial_depth_mm * 1e-3 * one, milling.radial_mm * 1e-3 * one, side)
    path = folder / milling.engagement
    table = read_engagement(path, milling.shape)
    number = int(motion[-1]) + 1 if motion.size else 0
    if table.axial.size != number:
        raise InputError(
            f"{path}: {table.axial.size} rows, but {program.path} has {number} corrected motions (linear and circular moves); "
            "expected one row per corrected motion, in order."
        )
    return table.take(motion)


def _chip(milling: Milling, program: Program, rows: NDArray[np.int_], needed: NDArray[np.bool_]) -> Floats:
    """Feed per tooth (N,), m: the program's feed, else that of process.yaml."""
    feed = program.feed_mm_per_min[rows]
    unknown = ~(feed > 0)
    if milling.feed_mm_per_min is None:
        for row in np.flatnonzero(unknown & needed)[:1].tolist():
            raise InputError(
                f"{program.path}, line {program.line[rows[row]]}: the program does not say the feed of this motion; add "
                "force.milling.feed_mm_per_min to the process description (mm/min)."
            )
    feed = np.where(unknown, milling.feed_mm_per_min or 0.0, feed)
    return feed * 1e-3 / (milling.teeth * milling.spindle_rpm)


def _notes(milling: Milling, law: CuttingLaw, plunges: int, *, clockwise: bool) -> tuple[str, ...]:
    stated = "as stated" if milling.coefficients.relative_sigma is not None else "the spread of published sets"
    said = [
        "forces of milling are averages over a turn of the spindle; vibration and chatter are out of scope",
        f"the coefficients of cutting are uncertain by {100 * law.relative_sigma:.0f} % (one sigma, {stated}), and so is the deflection",
    ]
    if milling.rotation is None:
        side, sense, other = (
            ("left", "clockwise (M3)", "counterclockwise")
            if clockwise
            else ("right", "counterclockwise (M4)", "clockwise, and most spindles do")
        )
        said.append(
            "CHECK THE SPINDLE: force.milling.rotation is not given, so the mean forces were read in path axes as they stand: a slot pushes "
            f"the tool to the {side} of its feed (seen from the spindle), as a spindle does that turns {sense}. If yours turns {other}, "
            f"write rotation: {other.split(',')[0]}; the side force changes sign"
        )
    if plunges:
        said.append(f"{plunges} points reached along the tool's axis (plunge or retract) carry no force of milling")
    return tuple(said)
