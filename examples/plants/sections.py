"""Cantilevers of any section along any curve: the compliance of the tip by unit loads and numerical integration.

`section_families` draws links from these.

Beam axes: x along the beam, y and z across it; SI units. A section is six stiffnesses and how far its material reaches.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

Array = npt.NDArray[np.float64]

#: Young's modulus (Pa) and Poisson's ratio.
MATERIALS = {
    "steel": (210e9, 0.29),
    "grey cast iron": (110e9, 0.24),
    "ductile cast iron": (169e9, 0.275),
    "aluminium": (71e9, 0.33),
}


@dataclass(frozen=True)
class Section:
    """Area, shear areas, torsion constant, second moments (m^2, m^4) and half widths (m) of a section."""

    A: float
    A_y: float
    A_z: float
    J: float
    I_y: float
    I_z: float
    half_y: float
    half_z: float


def box(width: float, height: float, wall: float) -> Section:
    """Hollow rectangle, width along y and height along z; Bredt's torsion."""
    w, h = width - 2 * wall, height - 2 * wall
    A = width * height - w * h
    J = 2 * wall * ((width - wall) * (height - wall)) ** 2 / (width + height - 2 * wall)
    I_y, I_z = (width * height**3 - w * h**3) / 12, (height * width**3 - h * w**3) / 12
    return Section(A, 2 * wall * width, 2 * wall * height, J, I_y, I_z, width / 2, height / 2)


def solid(width: float, height: float) -> Section:
    """Solid rectangle; torsion by Roark's formula, shear factor 5/6."""
    a, b = max(width, height), min(width, height)
    J = a * b**3 * (1 / 3 - 0.21 * (b / a) * (1 - (b / a) ** 4 / 12))
    A = width * height
    return Section(A, 5 / 6 * A, 5 / 6 * A, J, width * height**3 / 12, height * width**3 / 12, width / 2, height / 2)


def i_section(width: float, height: float, flange: float, web: float) -> Section:
    """Two flanges of `width` (along y) at the ends of a web along z; torsion of thin open strips."""
    clear = height - 2 * flange
    A = 2 * width * flange + clear * web
    I_y = (width * height**3 - (width - web) * clear**3) / 12
    I_z = (2 * flange * width**3 + clear * web**3) / 12
    J = (2 * width * flange**3 + clear * web**3) / 3
    return Section(A, 5 / 3 * width * flange, clear * web, J, I_y, I_z, width / 2, height / 2)


def tube(radius: float, wall: float) -> Section:
    """Round tube; shear factor one half, as for thin walls."""
    inner = radius - wall
    A, I = np.pi * (radius**2 - inner**2), np.pi / 4 * (radius**4 - inner**4)  # noqa: E741
    return Section(A, A / 2, A / 2, 2 * I, I, I, radius, radius)


@dataclass(frozen=True)
class Cantilever:
    """A clamped beam: its length, its section at every share 0 .. 1 of the way, moduli, and where its centre line runs.

    Attributes
    ----------
    length
        Along x from the clamp to the tip, m.
    section
        From a share of the length, counted from the clamp.
    youngs_modulus, shear_modulus
        Pa.
    breaks
        Shares at which the section jumps.
    line
        From shares (N,) to the centre line's offset (N, 2) along y and z, m; zero at the clamp and the tip.
    """

    length: float
    section: Callable[[float], Section]
    youngs_modulus: float
    shear_modulus: float
    breaks: Sequence[float] = ()
    line: Callable[[Array], Array] = lambda share: np.zeros((share.size, 2))

    def stations(self, points: int = 24) -> tuple[Array, Array]:
        """Gauss-Legendre shares and weights, piece by piece."""
        x, w = np.polynomial.legendre.leggauss(points)
        ends = np.array([0.0, *self.breaks, 1.0])
        middle, half = (ends[1:] + ends[:-1]) / 2, np.diff(ends) / 2
        return (middle[:, None] + half[:, None] * x).ravel(), (half[:, None] * w).ravel()

    def compliance(self) -> Array:
        """(6, 6): displacement and rotation of the tip by a wrench on the tip, sum over the way of T^T diag(1 / stiffness) T."""
        share, weight = self.stations()
        offset, step = self.line(share), 1e-6
        slope = (self.line(share + step) - self.line(share - step)) / (2 * step * self.length)
        total = np.zeros((6, 6))
        for u, w, (y, z), (dy, dz) in zip(share, weight, offset, slope, strict=True):
            s = self.section(float(u))
            along = np.array([1.0, dy, dz])
            stretch = float(np.linalg.norm(along))
            axes = _axes(along / stretch)
            lever = np.array([self.length * (1 - u), -y, -z])
            T = np.zeros((6, 6))
            T[:3, :3], T[3:, 3:] = axes.T, axes.T
            T[3:, :3] = axes.T @ _cross(lever)
            E, G = self.youngs_modulus, self.shear_modulus
            stiffness = np.array([E * s.A, G * s.A_y, G * s.A_z, G * s.J, E * s.I_y, E * s.I_z])
            total += w * self.length * stretch * (T.T / stiffness) @ T
        return total

    def half_widths(self) -> tuple[float, float]:
        """Outer half widths along y and z of the sections themselves, wherever the centre line runs, m."""
        shares = np.concatenate([self.stations()[0], [0.0, 1.0]])
        found = [self.section(float(u)) for u in shares]
        return max(s.half_y for s in found), max(s.half_z for s in found)


def _axes(x: Array) -> Array:
    """Axes of a section as columns, y as near as possible to the beam's."""
    y = np.array([0.0, 1.0, 0.0]) - x[1] * x
    y /= np.linalg.norm(y)
    return np.column_stack([x, y, np.cross(x, y)])


def _cross(p: Array) -> Array:
    return np.array([[0.0, -p[2], p[1]], [p[2], 0.0, -p[0]], [-p[1], p[0], 0.0]])


def moduli(material: str) -> tuple[float, float]:
    """E and G of an isotropic material, Pa."""
    E, nu = MATERIALS[material]
    return E, E / (2 * (1 + nu))
