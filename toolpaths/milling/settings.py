"""`force.milling` of process.yaml: cutter, coefficients, engagement, feed."""

from __future__ import annotations

from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray
from pydantic import Field, model_validator

from drake_stiffness.files import Document
from toolpaths.milling.cutters import Cutter
from toolpaths.milling.engagement import misfit
from toolpaths.milling.laws import CuttingLaw, kienzle, linear_edge
from toolpaths.milling.library import LIBRARY, RELATIVE_SIGMA

_LINEAR = ("Ktc", "Krc", "Kac", "Kte", "Kre", "Kae")
_KIENZLE = ("kc1_1", "mc", "radial_ratio", "axial_ratio")


class Coefficients(Document):
    """A published set by name, linear-edge coefficients (N/mm^2, N/mm), or Kienzle's (N/mm^2 and shares of the tangential force)."""

    library: str | None = None
    Ktc: float | None = Field(default=None, gt=0)
    Krc: float | None = None
    Kac: float | None = None
    Kte: float | None = Field(default=None, ge=0)
    Kre: float | None = None
    Kae: float | None = None
    kc1_1: float | None = Field(default=None, gt=0)
    mc: float | None = Field(default=None, ge=0, lt=1)
    radial_ratio: float | None = None
    axial_ratio: float | None = None
    relative_sigma: float | None = Field(default=None, ge=0, le=2)

    @model_validator(mode="before")
    @classmethod
    def _by_name(cls, value: Any) -> Any:
        return {"library": value} if isinstance(value, str) else value

    @model_validator(mode="after")
    def _one_form(self) -> Coefficients:
        given = {name for name in (*_LINEAR, *_KIENZLE) if getattr(self, name) is not None}
        if self.library is not None:
            if given:
                raise ValueError(f"library and {', '.join(sorted(given))} are both given; give one of them")
            if self.library not in LIBRARY:
                raise ValueError(f"no published set '{self.library}' is known; expected one of {', '.join(LIBRARY)}")
            return self
        form = _KIENZLE if given & set(_KIENZLE) else _LINEAR
        missing, foreign = [name for name in form if name not in given], sorted(given - set(form))
        if missing or foreign:
            extra = f"{', '.join(foreign)} does not belong to them" if foreign else f"{', '.join(missing)} is missing"
            raise ValueError(
                f"expected a published set by name ({', '.join(LIBRARY)}), or {', '.join(_LINEAR)} (N/mm^2 and N/mm), or "
                f"{', '.join(_KIENZLE)} (N/mm^2 and ratios to the tangential force); {extra}"
            )
        return self

    @property
    def law(self) -> CuttingLaw:
        """The cutting law, with its spread."""
        sigma = RELATIVE_SIGMA if self.relative_sigma is None else self.relative_sigma
        if self.library is not None:
            known = LIBRARY[self.library]
            return linear_edge(known.cutting, known.edge, sigma)
        if self.kc1_1 is not None:
            kc1_1, mc, radial, axial = (float(getattr(self, name)) for name in _KIENZLE)
            return kienzle(kc1_1, mc, radial, axial, sigma)
        ktc, krc, kac, kte, kre, kae = (float(getattr(self, name)) for name in _LINEAR)
        return linear_edge((ktc, krc, kac), (kte, kre, kae), sigma)


class Stock(Document):
    """A block of material in the program's base frame, flat on top."""

    x_mm: tuple[float, float]
    y_mm: tuple[float, float]
    top_mm: float

    @model_validator(mode="after")
    def _has_size(self) -> Stock:
        if not (self.x_mm[0] < self.x_mm[1] and self.y_mm[0] < self.y_mm[1]):
            raise ValueError("expected x_mm and y_mm as [from, to] with from < to, in mm")
        return self


class HeightField(Document):
    """Engagement found by sweeping the cutter through a map of heights (three-axis work)."""

    cell_mm: float = Field(gt=0)
    stock: Stock

    @model_validator(mode="after")
    def _fits_memory(self) -> HeightField:
        cells = np.prod([(high - low) / self.cell_mm for low, high in (self.stock.x_mm, self.stock.y_mm)])
        if cells > 5e7:
            raise ValueError(f"the map has {cells:.3g} cells, at most 5e7 are held; expected a larger cell_mm")
        return self


class Milling(Document):
    """Cutter, coefficients and one of: depths and mode, a table of them (`engagement`), a `heightfield`."""

    diameter_mm: float = Field(gt=0)
    teeth: int = Field(ge=1)
    helix_deg: float = Field(default=0.0, ge=0, lt=90)
    cutter: Literal["cylindrical", "ball", "bull-nose"] = "cylindrical"
    corner_radius_mm: float | None = Field(default=None, ge=0)
    spindle_rpm: float = Field(gt=0)
    rotation: Literal["clockwise", "counterclockwise"] | None = None
    feed_mm_per_min: float | None = Field(default=None, gt=0)
    axial_depth_mm: float | None = None
    radial_depth_mm: float | None = None
    mode: Literal["slot", "up", "down"] | None = None
    engagement: str | None = None
    heightfield: HeightField | None = None
    coefficients: Coefficients
    moments: bool = True
    coupled: bool = True

    @model_validator(mode="after")
    def _fits_together(self) -> Milling:
        if (self.cutter == "bull-nose") != (self.corner_radius_mm is not None):
            raise ValueError("corner_radius_mm belongs to cutter: bull-nose, and a bull-nose needs it (in mm)")
        if self.corner_radius_mm is not None and self.corner_radius_mm > self.diameter_mm / 2:
            raise ValueError(f"corner_radius_mm is at most half of diameter_mm, {self.diameter_mm / 2:g} mm")
        depths = [self.axial_depth_mm, self.radial_depth_mm, self.mode]
        given = [any(d is not None for d in depths), self.engagement is not None, self.heightfield is not None]
        if sum(given) != 1:
            raise ValueError(
                "give the engagement once: axial_depth_mm, radial_depth_mm and mode; or engagement (a CSV table); or heightfield"
            )
        if not given[0]:
            return self
        if self.axial_depth_mm is None or self.mode is None or (self.radial_depth_mm is None and self.mode != "slot"):
            raise ValueError("axial_depth_mm (mm), radial_depth_mm (mm) and mode (slot, up or down) go together")
        wrong = misfit(self.axial_depth_mm, self.radial_mm, self.mode, self.diameter_mm)
        if wrong:
            raise ValueError(wrong.rstrip("."))
        return self

    def clockwise(self, spindle_axis: NDArray[np.float64]) -> bool:
        """Sense of the spindle seen from the spindle; where `rotation` does not say it, the one of the averages in `path` axes.

        The averages of the literature are read as they stand, F_x, F_y, F_z along x, y, z of the path, z the tool's. With z into the work
        (the default, `tool_axis: -z`) that is a spindle that turns counterclockwise; with any other axis stated it is taken to turn clockwise.
        """
        if self.rotation is not None:
            return self.rotation == "clockwise"
        return float(spindle_axis[2]) >= -0.5

    @property
    def radial_mm(self) -> float:
        """The radial depth; that of a slot is the diameter."""
        return self.diameter_mm if self.radial_depth_mm is None else self.radial_depth_mm

    @property
    def shape(self) -> Cutter:
        """The cutter, SI."""
        corner = {"cylindrical": 0.0, "ball": self.diameter_mm / 2}.get(self.cutter, self.corner_radius_mm or 0.0)
        return Cutter(self.diameter_mm * 5e-4, corner * 1e-3, self.teeth, float(np.radians(self.helix_deg)))

    @property
    def in_words(self) -> str:
        """A sentence for reports."""
        if self.heightfield is not None:
            where = f"engagement from a height field of {self.heightfield.cell_mm:g} mm cells"
        elif self.engagement is not None:
            where = f"engagement from the table {self.engagement}"
        else:
            where = f"{self.axial_depth_mm:g} mm deep, {self.radial_mm:g} mm wide, {self.mode}"
        return (
            f"The force is the mean force of milling over a turn: {self.cutter} cutter of {self.diameter_mm:g} mm, {self.teeth} teeth, "
            f"{self.spindle_rpm:g} rpm{'' if self.rotation is None else ' ' + self.rotation}, {where}. Vibration and chatter are out of scope."
        )
