"""An interval of one value, what it rests on, and the unit in which people read it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np

from drake_stiffness.rotations import Array

Status = Literal["identified", "bounded, not identified", "unbounded"]

# Units in which small SI values read well: factor and name.
_READ_AS = {
    "m/N": (1e9, "µm/kN"),
    "rad/N": (1e9, "µrad/kN"),
    "rad/(N m)": (1e9, "µrad/(kN m)"),
    "m": (1e3, "mm"),
    "rad": (1e3, "mrad"),
}


@dataclass(frozen=True, eq=False)
class Combination:
    """A linear combination of a model's parameters.

    Attributes
    ----------
    name, unit : str
    weights : (n,)
        Per SI unit of every parameter.
    """

    name: str
    unit: str
    weights: Array


@dataclass(frozen=True)
class Interval:
    """What is known of one value, SI.

    Attributes
    ----------
    name, unit : str
    value : float
        The model's.
    low, high : float
        Ends at `level`, all cones respected; infinite where nothing bounds the value. Never narrower than the profile's.
    profile : (low, high)
        Ends of the profile itself. Where many cones are active at once it covers less than it says, see `profile`.
    status : 'identified', 'bounded, not identified' or 'unbounded'
    level : float
    sigma : float
        Seed eq. (14), scaled where the stated noise is rejected; NaN unless identified.
    least_squares : float
        The value without the cones; NaN unless identified.
    noise_factor : float
        By what chi-square was scaled because it rejects the stated noise; 1 where it does not.
    """

    name: str
    unit: str
    value: float
    low: float
    high: float
    profile: tuple[float, float]
    status: Status
    level: float
    sigma: float
    least_squares: float
    noise_factor: float

    @property
    def plain(self) -> tuple[float, float]:
        """The interval of seed eq. (14) around least squares, which knows of no cone."""
        half = float(np.sqrt(quantile(self.level))) * self.sigma
        return self.least_squares - half, self.least_squares + half


def quantile(level: float) -> float:
    """Of chi-square with one degree of freedom."""
    from scipy.special import chdtri

    return float(chdtri(1, 1.0 - level))


def read_as(unit: str) -> tuple[float, str]:
    """Factor and name of the unit in which values of an SI unit are shown to people."""
    return _READ_AS.get(unit, (1.0, unit))
