"""Cutters as surfaces of revolution: a flat, a corner of constant radius, a wall; and their edges in small pieces.

A piece of edge sits at radius r and height z above the tip; kappa is the angle between the tool's axis and the outward normal of
the surface there, counted from the tip: 0 where the surface looks along the axis, 90 deg on the wall. On the corner

    r = R - rho + rho sin(kappa),   z = rho (1 - cos(kappa)),   db = rho dkappa

and on the wall r = R, kappa = 90 deg, db = dz. A ball has rho = R, a cylinder rho = 0. The flat end does not cut while the tool
feeds across its axis.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]

_NODES = 12


@dataclass(frozen=True)
class Cutter:
    """A milling cutter.

    Attributes
    ----------
    radius, corner_radius
        m; the corner radius is 0 for a cylinder and the radius for a ball.
    teeth
        Number of equal teeth.
    helix
        Helix angle on the wall, rad. The lead is constant: a tooth lags by z tan(helix) / radius at height z.
    """

    radius: float
    corner_radius: float = 0.0
    teeth: int = 1
    helix: float = 0.0

    def corner_angle(self, r: Floats) -> Floats:
        """Angle kappa at which the corner has radius r, clipped to the corner."""
        if self.corner_radius == 0:
            return np.full(np.shape(r), np.pi / 2)
        return np.arcsin(np.clip((r - self.radius + self.corner_radius) / self.corner_radius, 0.0, 1.0))

    def lag(self, z: Floats) -> Floats:
        """Angle by which a tooth lags at height z behind its tip, rad."""
        return z * (np.tan(self.helix) / self.radius)


@dataclass(frozen=True, eq=False)
class Pieces:
    """Pieces of one edge, arrays (M, S) for M cuts.

    Attributes
    ----------
    r, z : radius and height, m
    sin_k, cos_k : of the angle kappa
    width : length of the piece along the profile, db, m; weights of a quadrature
    """

    r: Floats
    z: Floats
    sin_k: Floats
    cos_k: Floats
    width: Floats


def pieces(cutter: Cutter, axial: Floats, kink: Floats) -> Pieces:
    """Pieces of the edge up to a depth of cut; sums over them are integrals along the edge.

    Parameters
    ----------
    axial : (M,)
        Axial depth, m.
    kink : (M,)
        Radius at which the angles of engagement have a kink (see engagement.py): the quadrature is split there, m.
    """
    rho = cutter.corner_radius
    wall = np.maximum(axial - rho, 0.0)[:, None]
    one = np.ones_like(wall)
    # Forces on the wall do not change along it and moments change linearly, so one piece is exact.
    on_wall = Pieces(cutter.radius * one, rho + 0.5 * wall, one, 0 * one, wall)
    if rho == 0:
        return on_wall
    top = np.arccos(np.clip(1.0 - axial / rho, 0.0, 1.0))
    middle = np.minimum(cutter.corner_angle(kink), top)
    u, weight = _rule()
    zero = np.zeros_like(top)
    kappa, width = [], []
    for low, high in ((zero, middle), (middle, top)):
        span = (high - low)[:, None]
        # u^2 spreads the nodes so that the square root with which engagement begins at the kink is smooth.
        kappa.append(low[:, None] + span * u**2)
        width.append(span * 2 * u * weight * rho)
    k, db = np.concatenate(kappa, axis=1), np.concatenate(width, axis=1)
    s, c = np.sin(k), np.cos(k)
    corner = (cutter.radius - rho + rho * s, rho * (1 - c), s, c, db)
    walls = (on_wall.r, on_wall.z, on_wall.sin_k, on_wall.cos_k, on_wall.width)
    return Pieces(*(np.concatenate(both, axis=1) for both in zip(corner, walls, strict=True)))


@cache
def _rule() -> tuple[Floats, Floats]:
    """Gauss-Legendre nodes and weights on [0, 1]."""
    x, w = np.polynomial.legendre.leggauss(_NODES)
    return 0.5 * (x + 1), 0.5 * w
