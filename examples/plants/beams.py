"""Hollow-box beam elements: section properties and the exact compliance of an element's tip.

Beam axes: x along the beam, y across its width, z across its height. SI units throughout.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

Array = npt.NDArray[np.float64]

#: The four ways an element gives, each with a stiffness factor of its own.
PARTS = ("bending_y", "bending_z", "torsion", "axial")


@dataclass(frozen=True)
class HollowBox:
    """A thin-walled rectangular tube.

    Attributes
    ----------
    width, height, wall
        Outer size along y, along z, and wall thickness, m.
    youngs_modulus, shear_modulus
        E and G, Pa.
    """

    width: float
    height: float
    wall: float
    youngs_modulus: float
    shear_modulus: float

    def __post_init__(self) -> None:
        if min(self.width, self.height, self.youngs_modulus, self.shear_modulus) <= 0.0:
            raise ValueError(f"a box section needs positive sizes and moduli, got {self}")
        if not 0.0 < 2.0 * self.wall < min(self.width, self.height):
            raise ValueError(f"wall must be positive and below half the smaller side, got {self.wall} m in {self}")

    def scaled(self, factor: float) -> HollowBox:
        """The same tube with width and height multiplied by `factor`, the wall kept (a taper)."""
        return replace(self, width=self.width * factor, height=self.height * factor)

    @property
    def area(self) -> float:
        """Area of the section, m^2."""
        return self.width * self.height - (self.width - 2 * self.wall) * (self.height - 2 * self.wall)

    @property
    def bending_inertia_y(self) -> float:
        """Second moment of area about y, (b h^3 - b_i h_i^3) / 12, m^4."""
        inner = (self.width - 2 * self.wall) * (self.height - 2 * self.wall) ** 3
        return (self.width * self.height**3 - inner) / 12.0

    @property
    def bending_inertia_z(self) -> float:
        """Second moment of area about z, (h b^3 - h_i b_i^3) / 12, m^4."""
        inner = (self.height - 2 * self.wall) * (self.width - 2 * self.wall) ** 3
        return (self.height * self.width**3 - inner) / 12.0

    @property
    def torsion_constant(self) -> float:
        """Bredt's constant of a closed tube, 4 A_m^2 t / s_m, m^4 (A_m, s_m: area inside and length of the midline)."""
        b, h = self.width - self.wall, self.height - self.wall
        return 2.0 * self.wall * (b * h) ** 2 / (b + h)

    @property
    def shear_area_y(self) -> float:
        """Area of the two walls that carry shear along y, m^2."""
        return 2.0 * self.wall * self.width

    @property
    def shear_area_z(self) -> float:
        """Area of the two walls that carry shear along z, m^2."""
        return 2.0 * self.wall * self.height


def element_parts(section: HollowBox, length: float, *, shear: bool = True) -> Array:
    r"""Compliance of the tip of a clamped beam element, split into the four `PARTS`.

    With the wrench w at the tip and the tip's displacement (dx, dy, dz, rx, ry, rz) = C w, the Timoshenko beam has

    .. math::
        C_{22} = l^3/3EI_z + l/GA_y,\; C_{26} = l^2/2EI_z,\; C_{66} = l/EI_z, \quad
        C_{33} = l^3/3EI_y + l/GA_z,\; C_{35} = -l^2/2EI_y,\; C_{55} = l/EI_y, \quad
        C_{11} = l/EA,\; C_{44} = l/GJ.

    This is exact for a wrench at the tip, so a chain of such elements is exact too: element n sees the rest of the beam
    as a rigid lever.

    Parameters
    ----------
    section, length
        The section and the element's length, m.
    shear
        False leaves the shear terms out (Euler-Bernoulli).

    Returns
    -------
    (4, 6, 6) array, SI. "bending_y" is bending about y with the shear along z that goes with it, and so on.
    """
    if length <= 0.0:
        raise ValueError(f"a beam element needs a positive length, got {length} m")
    e, g = section.youngs_modulus, section.shear_modulus
    by, bz = e * section.bending_inertia_y, e * section.bending_inertia_z
    parts = np.zeros((4, 6, 6))
    parts[0, 2, 2] = length**3 / (3 * by) + (length / (g * section.shear_area_z) if shear else 0.0)
    parts[0, 2, 4] = parts[0, 4, 2] = -(length**2) / (2 * by)
    parts[0, 4, 4] = length / by
    parts[1, 1, 1] = length**3 / (3 * bz) + (length / (g * section.shear_area_y) if shear else 0.0)
    parts[1, 1, 5] = parts[1, 5, 1] = length**2 / (2 * bz)
    parts[1, 5, 5] = length / bz
    parts[2, 3, 3] = length / (g * section.torsion_constant)
    parts[3, 0, 0] = length / (e * section.area)
    return parts


def tapered_parts(root: HollowBox, length: float, segments: int, taper: float, *, shear: bool = True) -> Array:
    """The parts of `segments` equal elements of a beam whose width and height shrink linearly to `taper` at the tip.

    Each element has the section at its middle.

    Returns
    -------
    (segments, 4, 6, 6) array, SI.
    """
    middle = (np.arange(segments) + 0.5) / segments
    factors = 1.0 + (taper - 1.0) * middle
    return np.stack([element_parts(root.scaled(float(f)), length / segments, shear=shear) for f in factors])
