"""Whether a correction bends the path where it was straight, and what is left to limits and singularities once corrected."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from drake_stiffness.arm import Arm
from toolpaths.postures import least_margin

Floats = NDArray[np.float64]
Ints = NDArray[np.int_]
Bools = NDArray[np.bool_]

# A correction that changes by more than this per mm of path turns the path by more than a degree: a new kink.
MAX_CHANGE = 0.02
# Points nearer than this are one place.
_SAME_MM = 1e-6
_SHOWN = 12


@dataclass(frozen=True, eq=False)
class Evenness:
    """Attributes
    ----------
    spacing_mm : (N,)
        Distance to the point before in the same cut; NaN where a cut begins.
    change_per_mm : (N,)
        Change of the correction since the point before, less what printing may do, per mm of that distance; NaN as above.
    bound : float
        What counts as a kink.
    """

    spacing_mm: Floats
    change_per_mm: Floats
    bound: float

    @property
    def kinks(self) -> Ints:
        """Points at which the correction bends the path by more than the bound."""
        return np.flatnonzero(np.nan_to_num(self.change_per_mm) > self.bound)

    def to_dict(self, line: Ints) -> dict[str, object]:
        """For `--json`."""
        change = self.change_per_mm[np.isfinite(self.change_per_mm)]
        return {
            "bound_mm_per_mm": self.bound,
            "largest_mm_per_mm": float(change.max(initial=0.0)),
            "median_spacing_mm": _median(self.spacing_mm),
            "kink_lines": sorted(set(line[self.kinks].tolist())),
        }

    def notes(self, line: Ints) -> list[str]:
        """What the user should know, with lines."""
        found = []
        if self.kinks.size:
            lines = sorted(set(line[self.kinks].tolist()))
            more = f" and {len(lines) - _SHOWN} more" if len(lines) > _SHOWN else ""
            found.append(
                f"new kinks: the correction changes by up to {np.nanmax(self.change_per_mm):.2g} mm per mm of path (bound {self.bound:g}) at "
                f"line {', '.join(map(str, lines[:_SHOWN]))}{more}; look whether force or posture really jump there, or insert points"
            )
        return found


def evenness(target_mm: Floats, correction_mm: Floats, begin: Bools, quantum_mm: Floats) -> Evenness:
    """Change of a correction along a path.

    Parameters
    ----------
    target_mm, correction_mm : (N, 3)
    begin : (N,)
        Where a cut begins.
    quantum_mm : (N,)
        Half a printed digit of every point.
    """
    spacing, change = np.full(begin.size, np.nan), np.full(begin.size, np.nan)
    on = np.flatnonzero(~begin)
    step = np.linalg.norm(target_mm[on] - target_mm[on - 1], axis=1)
    printing = np.sqrt(3) * (np.nan_to_num(quantum_mm[on]) + np.nan_to_num(quantum_mm[on - 1]))
    moved = np.maximum(np.linalg.norm(correction_mm[on] - correction_mm[on - 1], axis=1) - printing, 0.0)
    spacing[on] = step
    change[on] = np.where(moved > 0, moved / np.maximum(step, _SAME_MM), 0.0)
    return Evenness(spacing, change, MAX_CHANGE)


@dataclass(frozen=True, eq=False)
class End:
    """The first or last corrected point of a piece of a long program, where the path goes on from it without a break.

    Attributes
    ----------
    target_mm, correction_mm : (3,)
    quantum_mm : float
        Half a printed digit.
    line : int
    """

    target_mm: Floats
    correction_mm: Floats
    quantum_mm: float
    line: int


def across(before: End, after: End) -> tuple[Evenness, Ints]:
    """Change of the correction from the end of one piece to the beginning of the next, and the lines of the two points."""
    ends = (before, after)
    step = evenness(
        np.array([end.target_mm for end in ends]),
        np.array([end.correction_mm for end in ends]),
        np.array([True, False]),
        np.array([end.quantum_mm for end in ends]),
    )
    return step, np.array([end.line for end in ends])


@dataclass(frozen=True)
class Reserve:
    """Attributes
    ----------
    joint : str
        The joint that comes nearest to a limit once corrected; empty where no joint has limits.
    limit_margin : float
        By how much it stays inside, deg or mm; infinite without limits.
    unit : str
    line : int
        Where.
    singularity_margin : float
        Smallest along the corrected path (`postures.singularity_margin`).
    """

    joint: str
    limit_margin: float
    unit: str
    line: int
    singularity_margin: float

    def to_dict(self) -> dict[str, object]:
        """For `--json`."""
        return {
            "nearest_joint": self.joint or None,
            "limit_margin": self.limit_margin,
            "unit": self.unit,
            "line": self.line,
            "singularity_margin": self.singularity_margin,
        }


def reserve(arm: Arm, q: Floats, line: Ints) -> Reserve:
    """What is left to the limits and to singularities at corrected joints `q (n, N)`."""
    scale = np.where(arm.prismatic, 1e3, np.degrees(1.0))
    margin = np.minimum(q - arm.lower[:, None], arm.upper[:, None] - q) * scale[:, None]
    joint, point = np.unravel_index(int(margin.argmin()), margin.shape)
    known = bool(np.isfinite(margin[joint, point]))
    return Reserve(
        arm.joint_names[joint] if known else "",
        float(margin[joint, point]),
        "mm" if arm.prismatic[joint] else "deg",
        int(line[point]),
        least_margin(arm, q),
    )


def _median(values: Floats) -> float:
    known = values[np.isfinite(values)]
    return float(np.median(known)) if known.size else float("nan")
