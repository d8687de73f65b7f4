"""Where the controller rounds over points: blend radii of the program, or as stated, against spacing and change of the correction."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]
Bools = NDArray[np.bool_]

# Less than this share of steps or points is not worth a note.
_WORTH = 0.05


@dataclass(frozen=True, eq=False)
class Blending:
    """Attributes
    ----------
    said_mm : (N,)
        Blend radius that the program says at every point (`Program.blend_mm`): 0 where it stops or goes through it, infinite where
        the distance depends on speed, NaN where it says nothing.
    stated_mm : float
        Radius stated in process.yaml, which goes before what the program says; NaN where not.
    spacing_mm, change_per_mm : (N,)
        Of the path's evenness; NaN where a cut begins.
    """

    said_mm: Floats
    stated_mm: float
    spacing_mm: Floats
    change_per_mm: Floats

    @property
    def radius_mm(self) -> Floats:
        """(N,) what is reckoned with; NaN where neither program nor process.yaml says it."""
        known = np.where(np.isfinite(self.said_mm), self.said_mm, np.nan)
        return known if np.isnan(self.stated_mm) else np.full_like(known, self.stated_mm)

    @property
    def overlapping(self) -> float:
        """Share of the steps that are shorter than the blends at their two ends: there the controller rounds over single points."""
        radius = self.radius_mm
        reach = radius + np.roll(radius, 1)
        known = np.isfinite(self.spacing_mm) & np.isfinite(reach)
        return float((self.spacing_mm[known] < reach[known]).mean()) if known.any() else float("nan")

    @property
    def within_mm(self) -> float:
        """Largest change of the correction over the part of a step that a blend at either of its ends takes: as much of it may be rounded away."""
        larger = np.fmax(self.radius_mm, np.roll(self.radius_mm, 1))
        taken = self.change_per_mm * np.minimum(larger, self.spacing_mm)
        known = taken[np.isfinite(taken)]
        return float(known.max()) if known.size else float("nan")

    @property
    def by_speed(self) -> float:
        """Share of the points whose blend depends on speed."""
        return float(np.isinf(self.said_mm).mean()) if self.said_mm.size else 0.0

    @property
    def all_said(self) -> bool:
        """Whether the program says a radius at every point."""
        return bool(np.isfinite(self.said_mm).all())

    @property
    def limits_mm(self) -> tuple[float, float]:
        """Smallest and largest radius that is reckoned with."""
        known = self.radius_mm[np.isfinite(self.radius_mm)]
        return (float(known.min()), float(known.max())) if known.size else (float("nan"),) * 2

    def to_dict(self) -> dict[str, object]:
        """For `--json`."""
        low, high = self.limits_mm
        return {
            "share_of_steps_shorter_than_two_blend_radii": self.overlapping,
            "largest_change_within_a_blend_mm": self.within_mm,
            "smallest_blend_radius_mm": low,
            "largest_blend_radius_mm": high,
            "share_of_points_whose_blend_the_program_says": float(np.isfinite(self.said_mm).mean()),
            "share_of_points_whose_blend_depends_on_speed": self.by_speed,
        }

    def notes(self) -> list[str]:
        """What the user should know."""
        found, (low, high) = [], self.limits_mm
        if self.overlapping > _WORTH:
            blends = (
                f"twice the blend radius of {high:g} mm"
                if low == high
                else f"the blends at their ends (radii up to {high:g} mm)"
            )
            found.append(
                f"{100 * self.overlapping:.0f} % of the steps are shorter than {blends}: the controller rounds over single points there and "
                f"follows corrections in the mean only; within one blend the correction changes by up to {self.within_mm:.2g} mm"
            )
        if self.by_speed > 0 and np.isnan(self.stated_mm):
            found.append(
                f"at {100 * self.by_speed:.0f} % of the points the blend depends on speed (CNT, C_VEL and the like): state "
                "controller.blend_radius_mm as measured at this speed to have it compared with the steps"
            )
        own = self.said_mm[np.isfinite(self.said_mm)]
        if np.isfinite(self.stated_mm) and own.size and (own != self.stated_mm).any():
            found.append(
                f"the program itself says blend radii of {own.min():g} to {own.max():g} mm; blend_radius_mm: {self.stated_mm:g} of "
                "process.yaml was used instead (leave it out to use the program's)"
            )
        return found
