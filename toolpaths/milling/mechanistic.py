"""Forces of milling from pieces of edge: tooth by tooth over the rotation, and averaged over it.

With the angle phi of a tooth (from y, in the sense of rotation, see engagement.py) a piece of edge at radius r, height z and normal
angle kappa cuts a chip h = c sin(phi) sin(kappa). On the tool act, in cutter axes and for a clockwise spindle,

    dF_x = -dF_t cos(phi) - (dF_r sin(kappa) + dF_a cos(kappa)) sin(phi)
    dF_y =  dF_t sin(phi) - (dF_r sin(kappa) + dF_a cos(kappa)) cos(phi)
    dF_z =  dF_r cos(kappa) - dF_a sin(kappa)

(tangential: against the speed of the edge; radial: against the outward normal; axial: along the profile, away from the spindle), at
the place (r sin(phi), r cos(phi), z). This is the force model of general end mills of Altintas and co-workers. For a cylinder, F_x and F_y
averaged are the closed forms of the literature, and F_z is minus theirs: they count the axial force towards the tip.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from toolpaths.milling.cutters import Cutter, Pieces, pieces
from toolpaths.milling.engagement import Engagement
from toolpaths.milling.laws import CuttingLaw, sine_integrals

Floats = NDArray[np.float64]


def average_wrench(cutter: Cutter, law: CuttingLaw, cut: Engagement, chip: Floats) -> Floats:
    """Force and moment about the tip (6, M), averaged over a turn of a clockwise spindle.

    Parameters
    ----------
    chip : (M,)
        Feed per tooth c, m.

    Notes
    -----
    The integral over phi is in closed form, that along a rounded corner by Gauss-Legendre. Helix has no part in averages.
    """
    edge = pieces(cutter, cut.axial, 0.5 * cut.radial)
    start, end = cut.angles(edge.r)
    out = np.zeros((6, chip.size))
    share = cutter.teeth / (2 * np.pi) * edge.width
    for power, k in zip(law.powers, law.k, strict=True):
        moments = sine_integrals(power, start, np.maximum(start, end))
        out += sum_pieces(edge, k, share * (chip[:, None] * edge.sin_k) ** power, moments)
    return out


def sum_pieces(
    edge: Pieces, k: tuple[float, float, float], scale: Floats, moments: tuple[Floats, Floats, Floats]
) -> Floats:
    """Wrench (6, M) of pieces whose integrals of 1, cos(phi), sin(phi) times h^p are `moments` times `scale`, (M, S)."""
    plain, cosine, sine = (scale * m for m in moments)
    inward = k[1] * edge.sin_k + k[2] * edge.cos_k
    up = k[1] * edge.cos_k - k[2] * edge.sin_k
    fx = -k[0] * cosine - inward * sine
    fy = k[0] * sine - inward * cosine
    parts = (
        fx,
        fy,
        up * plain,
        edge.r * up * cosine - edge.z * fy,
        edge.z * fx - edge.r * up * sine,
        edge.r * k[0] * plain,
    )
    return np.stack([part.sum(axis=1) for part in parts])


def wrench_over_turn(
    cutter: Cutter, law: CuttingLaw, cut: Engagement, chip: float, turn: Floats, slices: int = 200
) -> Floats:
    """Force and moment about the tip (teeth, 6, T) of every tooth at T angles of rotation, for one cut (M = 1).

    Tooth j has its tip at phi = turn + 2 pi j / teeth; higher up it lags by the helix. The edge is cut into `slices`.
    """
    edge = _slices(cutter, float(cut.axial[0]), slices)
    start, end = cut.angles(edge.r)
    tooth = 2 * np.pi * np.arange(cutter.teeth) / cutter.teeth
    phi = (turn[None, :, None] + tooth[:, None, None] - cutter.lag(edge.z)[0]) % (2 * np.pi)
    engaged = (phi >= start[0]) & (phi <= end[0]) & (phi <= np.pi)
    s, c = np.where(engaged, np.sin(phi), 0.0), np.cos(phi)
    out = np.zeros((cutter.teeth, turn.size, 6))
    flat = (cutter.teeth * turn.size, -1)
    for power, k in zip(law.powers, law.k, strict=True):
        scale = np.where(engaged, np.maximum(chip * s * edge.sin_k[0], 0.0) ** power, 0.0) * edge.width[0]
        shape = scale.reshape(flat)
        moments = (np.ones_like(shape), c.reshape(flat), s.reshape(flat))
        out += sum_pieces(edge, k, shape, moments).T.reshape(out.shape)
    return out.transpose(0, 2, 1)


def _slices(cutter: Cutter, axial: float, number: int) -> Pieces:
    """The edge up to a depth in equal slices of its profile, (1, S), by midpoints."""
    rho = cutter.corner_radius
    arc = rho * float(np.arccos(np.clip(1.0 - axial / rho, 0.0, 1.0))) if rho else 0.0
    length = arc + max(axial - rho, 0.0)
    along = (np.arange(number) + 0.5) * length / number
    on_arc = along < arc
    kappa = np.where(on_arc, along / rho if rho else 0.0, np.pi / 2)
    z = np.where(on_arc, rho * (1 - np.cos(kappa)), rho + along - arc)
    r = cutter.radius - rho + rho * np.sin(kappa)
    width = np.full(number, length / number)
    return Pieces(*(a[None] for a in (r, z, np.sin(kappa), np.cos(kappa), width)))


def counterclockwise(wrench: Floats) -> Floats:
    """The wrench (6, ...) of the mirrored cutter, which turns the other way: y mirrored, moments as axial vectors."""
    sign = np.array([1.0, -1.0, 1.0, -1.0, 1.0, -1.0])
    return wrench * sign.reshape(6, *([1] * (wrench.ndim - 1)))
