"""Engagement from a height field: the cutter is swept through a map of heights of the stock (three-axis work).

The map holds one height a cell. The cutter moves in steps of a cell; at every step the material ahead is looked up around the edge,
just outside of it, and what the cutter covers is removed. The force of a motion is that of its last steps, where its pose is.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from drake_stiffness.errors import InputError
from toolpaths.milling.cuts import SweptCut
from toolpaths.milling.cutters import Cutter, Pieces
from toolpaths.milling.laws import CuttingLaw, sine_integrals
from toolpaths.milling.mechanistic import sum_pieces
from toolpaths.milling.settings import HeightField, Milling
from toolpaths.program import Program

Floats = NDArray[np.float64]

_BINS = 90
_RINGS = 24
# The force at a point is the mean over this many last steps: single steps show the grain of the map.
_LAST = 4
_TILT = 1e-3


@dataclass
class HeightMap:
    """Heights of the stock, changed as it is cut; lengths in m.

    Attributes
    ----------
    height : (nx, ny) top of the material in each cell
    x0, y0, cell : the corner of the map, and the size of a cell
    top : of the uncut stock
    """

    height: Floats
    x0: float
    y0: float
    cell: float
    top: float

    @classmethod
    def block(cls, settings: HeightField) -> HeightMap:
        """The uncut stock."""
        cell, stock = settings.cell_mm * 1e-3, settings.stock
        nx, ny = (max(1, round((high - low) / settings.cell_mm)) for low, high in (stock.x_mm, stock.y_mm))
        top = stock.top_mm * 1e-3
        return cls(np.full((nx, ny), top), stock.x_mm[0] * 1e-3, stock.y_mm[0] * 1e-3, cell, top)

    def at(self, x: Floats, y: Floats) -> Floats:
        """Height at places of one shape; -inf where there is no stock."""
        i = np.floor((x - self.x0) / self.cell).astype(int)
        j = np.floor((y - self.y0) / self.cell).astype(int)
        nx, ny = self.height.shape
        inside = (i >= 0) & (i < nx) & (j >= 0) & (j < ny)
        return np.where(inside, self.height[np.clip(i, 0, nx - 1), np.clip(j, 0, ny - 1)], -np.inf)

    def remove(self, tip: Floats, cutter: Cutter) -> bool:
        """Take away what the cutter covers with its tip at a place (3,); whether there was anything."""
        low = np.floor((tip[:2] - cutter.radius - (self.x0, self.y0)) / self.cell).astype(int)
        high = np.ceil((tip[:2] + cutter.radius - (self.x0, self.y0)) / self.cell).astype(int) + 1
        i0, j0 = np.maximum(low, 0)
        i1, j1 = np.minimum(high, self.height.shape)
        if i0 >= i1 or j0 >= j1:
            return False
        x = self.x0 + (np.arange(i0, i1) + 0.5) * self.cell - tip[0]
        y = self.y0 + (np.arange(j0, j1) + 0.5) * self.cell - tip[1]
        r = np.sqrt(x[:, None] ** 2 + y**2)
        under = np.maximum(r - cutter.radius + cutter.corner_radius, 0.0)
        rise = cutter.corner_radius - np.sqrt(np.maximum(cutter.corner_radius**2 - under**2, 0.0))
        part = self.height[i0:i1, j0:j1]
        floor = np.where(r <= cutter.radius, tip[2] + rise, np.inf)
        found = bool((part > floor).any())
        np.minimum(part, floor, out=part)
        return found


@dataclass(frozen=True, eq=False)
class Probe:
    """Looks up around an edge what is engaged, and sums its force."""

    cutter: Cutter
    law: CuttingLaw
    clockwise: bool
    phi: Floats = field(init=False)
    bins: tuple[tuple[Floats, Floats, Floats], ...] = field(init=False)

    def __post_init__(self) -> None:
        edges = np.linspace(0.0, np.pi, _BINS + 1)
        object.__setattr__(self, "phi", 0.5 * (edges[:-1] + edges[1:]))
        object.__setattr__(self, "bins", tuple(sine_integrals(p, edges[:-1], edges[1:]) for p in self.law.powers))

    def around(self, stock: HeightMap, tip: Floats, along: Floats, chip: float) -> Floats:
        """Average (6,) with the tip at a place (3,) and the feed along a unit vector (2,), and its slopes to the left and up: (3, 6).

        Axes are those of a clockwise spindle (see mechanistic.py). Moved sideways, the tool meets what its own way has cleared already on the
        side it leaves; so it is moved towards the material, and its far side is left as it was.
        """
        kappa, width = self._rings(stock.top - float(tip[2]))
        left = np.array([-along[1], along[0]]) * (1.0 if self.clockwise else -1.0)
        outward = np.sin(self.phi)[:, None] * along + np.cos(self.phi)[:, None] * left
        rho, cell = self.cutter.corner_radius, stock.cell
        r = np.append(self.cutter.radius - rho + rho * np.sin(kappa), self.cutter.radius)
        # (rings, bins, 2): half a cell outside, because the cell of the edge itself is cut already
        places = tip[:2] + (r + 0.5 * cell)[:, None, None] * outward
        here = stock.at(places[..., 0], places[..., 1]) - tip[2]
        material = np.maximum(here[-1], 0.0)
        side = 1.0 if material[: _BINS // 2].sum() >= material[_BINS // 2 :].sum() else -1.0
        aside = places + side * cell * left
        there = stock.at(aside[..., 0], aside[..., 1]) - tip[2]
        far = np.cos(self.phi) * side < -0.5
        there[:, far] = here[:, far]
        rise = 0.5 * cell
        w = self._wrench(kappa, width, np.stack([here, there, here - rise]), chip)
        return np.stack([w[:, 0], (w[:, 1] - w[:, 0]) / (side * cell), (w[:, 2] - w[:, 0]) / rise])

    def _wrench(self, kappa: Floats, width: Floats, above: Floats, chip: float) -> Floats:
        """Averages (6, V) from heights of material above the tip (V, rings + 1, bins); the last ring is the wall."""
        rho, radius = self.cutter.corner_radius, self.cutter.radius
        r = np.append(radius - rho + rho * np.sin(kappa), radius)
        z = np.append(rho * (1 - np.cos(kappa)), rho)
        weight = np.where(above > z[:, None], np.append(width, 0.0)[:, None], 0.0)
        wall = np.maximum(above[:, -1] - rho, 0.0)
        weight[:, -1] = wall
        height = np.broadcast_to(z[:, None], weight.shape).copy()
        height[:, -1] += 0.5 * wall
        flat = (len(above), -1)

        def spread(a: Floats) -> Floats:
            return np.broadcast_to(a[:, None], weight.shape).reshape(flat)

        sin_k, cos_k = np.append(np.sin(kappa), 1.0), np.append(np.cos(kappa), 0.0)
        edge = Pieces(spread(r), height.reshape(flat), spread(sin_k), spread(cos_k), weight.reshape(flat))
        out = np.zeros((6, len(above)))
        for power, k, bins in zip(self.law.powers, self.law.k, self.bins, strict=True):
            scale = self.cutter.teeth / (2 * np.pi) * edge.width * (chip * edge.sin_k) ** power
            plain, cosine, sine = (np.broadcast_to(b, weight.shape).reshape(flat) for b in bins)
            out += sum_pieces(edge, k, scale, (plain, cosine, sine))
        return out

    def _rings(self, depth: float) -> tuple[Floats, Floats]:
        """Angles and widths of rings on the corner, up to a depth."""
        rho = self.cutter.corner_radius
        if rho == 0 or depth <= 0:
            return np.zeros(0), np.zeros(0)
        top = float(np.arccos(np.clip(1.0 - depth / rho, 0.0, 1.0)))
        return (np.arange(_RINGS) + 0.5) * top / _RINGS, np.full(_RINGS, rho * top / _RINGS)


def swept_cut(
    milling: Milling, program: Program, rows: NDArray[np.int_], chip: Floats, up: Floats, *, clockwise: bool
) -> tuple[SweptCut, tuple[str, ...]]:
    """Averages of the corrected rows from sweeping the whole program through the stock, and notes.

    Parameters
    ----------
    chip : (N,)
        Feed per tooth across the axis, m.
    up : (N, 3)
        The tool's axis in the program's base frame.
    clockwise : bool
        Sense of the spindle.

    Raises
    ------
    InputError
        If the tool is not upright in the program's base frame.
    """
    assert milling.heightfield is not None
    for row in np.flatnonzero(np.abs(up - (0.0, 0.0, 1.0)).max(axis=1) > _TILT)[:1].tolist():
        raise InputError(
            f"{program.path}, line {program.line[rows[row]]}: the tool's axis (tip to spindle, tool_axis of the process description) is "
            f"({', '.join(f'{v:.3f}' for v in up[row])}) in the program's base frame; a heightfield needs (0, 0, 1), three-axis work. "
            "Use an engagement table instead."
        )
    stock = HeightMap.block(milling.heightfield)
    probe = Probe(milling.shape, milling.coefficients.law, clockwise)
    number = np.full(len(program), -1)
    number[rows] = np.arange(rows.size)
    out = np.zeros((3, 6, rows.size))
    crashes: list[int] = []
    place = program.position_mm * 1e-3
    for row in range(len(program)):
        way = _way(program, place, row, stock.cell)
        if program.role[row] != "via" and not program.carries_force[row]:
            crashes += [int(program.line[row])] if any([stock.remove(tip, probe.cutter) for tip in way]) else []
            continue
        samples = []
        for left, (before, tip) in zip(range(len(way) - 1, 0, -1), pairwise(way), strict=True):
            flat = tip[:2] - before[:2]
            size = float(np.hypot(*flat))
            if number[row] >= 0 and left <= _LAST and size > 0.05 * stock.cell:
                samples.append(probe.around(stock, tip, flat / size, float(chip[number[row]])))
            stock.remove(tip, probe.cutter)
        if samples:
            out[:, :, number[row]] = np.mean(samples, axis=0)
    notes = ["the engagement comes from a height field; it is that at the end of every motion"]
    if crashes:
        shown = ", ".join(map(str, crashes[:10]))
        notes.append(f"moves without cutting force run through the stock of the height field: line {shown}")
    return SweptCut(*out), tuple(notes)


def _way(program: Program, place: Floats, row: int, cell: float) -> Floats:
    """Places (S, 3) of the tip from the row before to this row, at most a cell apart; the end alone if the start is unknown."""
    end = place[row]
    if not np.isfinite(end).all():
        return np.zeros((0, 3))
    if row == 0 or not program.follows[row] or not np.isfinite(place[row - 1]).all():
        return end[None]
    start = place[row - 1]
    role = program.role[row]
    if role == "point":
        steps = max(1, int(np.ceil(np.linalg.norm(end - start) / cell)))
        return start + np.linspace(0.0, 1.0, steps + 1)[:, None] * (end - start)
    a, b, c = (start, end, place[row + 1]) if role == "via" else (place[row - 2], start, end)
    return _arc(a, b, c, role == "end", cell)


def _arc(a: Floats, b: Floats, c: Floats, second: bool, cell: float) -> Floats:
    """Half of the arc through a, b, c: from a to b, or from b to c."""
    u, v = b - a, c - a
    normal = np.cross(u, v)
    size = float(normal @ normal)
    start, end = (b, c) if second else (a, b)
    if size < 1e-18:
        steps = max(1, int(np.ceil(np.linalg.norm(end - start) / cell)))
        return start + np.linspace(0.0, 1.0, steps + 1)[:, None] * (end - start)
    centre = a + np.cross((u @ u) * v - (v @ v) * u, normal) / (2 * size)
    x = start - centre
    y = np.cross(normal / np.sqrt(size), x)
    turn = float(np.arctan2((end - centre) @ y, (end - centre) @ x) % (2 * np.pi))
    steps = max(2, int(np.ceil(turn * np.linalg.norm(x) / cell)))
    t = np.linspace(0.0, turn, steps + 1)[:, None]
    return centre + np.cos(t) * x + np.sin(t) * y
