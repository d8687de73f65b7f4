"""Where on the path a place of the part was cut: the nearest point of the nearest step."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]
Ints = NDArray[np.int_]
Bools = NDArray[np.bool_]

# Steps are looked up by places along them, so far apart (mm) unless that were too many.
_APART_MM, _MOST = 2.0, 400_000


@dataclass(frozen=True, eq=False)
class Places:
    """M places on a path: `(1 - t)` of the way at point `before`, `t` at point `after`.

    Attributes
    ----------
    before, after : (M,)
    t : (M,)
    distance_mm : (M,)
        From the place asked for; infinite where the line named has no corrected motion.
    """

    before: Ints
    after: Ints
    t: Floats
    distance_mm: Floats

    def at(self, values: Floats) -> Floats:
        """Values (N, ...) of the path's points at the places, (M, ...)."""
        t = self.t.reshape(-1, *([1] * (values.ndim - 1)))
        return (1 - t) * values[self.before] + t * values[self.after]

    @property
    def order(self) -> Ints:
        """The places in the order in which the path comes by."""
        return np.argsort(self.before + self.t, kind="stable")


def places_on_path(target_mm: Floats, begin: Bools, line: Ints, wanted_mm: Floats, on_line: Ints) -> Places:
    """Nearest places of a path, its arcs taken as chords.

    Parameters
    ----------
    target_mm, begin, line : (N, 3), (N,), (N,)
        Points of the path, where cuts begin, and lines of the program.
    wanted_mm, on_line : (M, 3), (M,)
        Places to find, and the line each lies on; -1 where any may be.
    """
    # A cut's first point is a step from itself to itself.
    after = np.arange(begin.size)
    before = np.where(begin, after, after - 1)
    M = wanted_mm.shape[0]
    step = np.zeros(M, dtype=int)
    free = np.flatnonzero(on_line < 0)
    if free.size:
        step[free] = _nearest_steps(target_mm, before, wanted_mm[free])
    for name in np.unique(on_line[on_line >= 0]):
        mine, steps = np.flatnonzero(on_line == name), np.flatnonzero(line == name)
        if not steps.size:
            step[mine] = -1
            continue
        a, b = target_mm[before[steps]], target_mm[steps]
        distance = _on_steps(a[None], b[None], wanted_mm[mine, None])[1]
        step[mine] = steps[distance.argmin(axis=1)]
    t, distance = _on_steps(target_mm[before[step]], target_mm[step], wanted_mm)
    return Places(before[step], after[step], t, np.where(step < 0, np.inf, distance))


def _nearest_steps(target_mm: Floats, before: Ints, wanted_mm: Floats) -> Ints:
    from scipy.spatial import cKDTree

    start, end = target_mm[before], target_mm
    length = np.linalg.norm(end - start, axis=1)
    apart = max(_APART_MM, float(length.sum()) / _MOST)
    pieces = np.maximum(np.ceil(length / apart).astype(int), 1)
    step = np.repeat(np.arange(before.size), pieces)
    first = np.repeat(np.cumsum(pieces) - pieces, pieces)
    t = (np.arange(step.size) - first + 0.5) / pieces[step]
    samples = start[step] + t[:, None] * (end - start)[step]
    near = cKDTree(samples).query(wanted_mm, k=min(8, step.size))[1].reshape(wanted_mm.shape[0], -1)
    found = step[near]
    distance = _on_steps(start[found], end[found], wanted_mm[:, None])[1]
    return np.asarray(found[np.arange(found.shape[0]), distance.argmin(axis=1)])


def _on_steps(a: Floats, b: Floats, p: Floats) -> tuple[Floats, Floats]:
    """Share of the way from a to b at which p is nearest, and how near, for (..., 3)."""
    along = b - a
    square = (along**2).sum(axis=-1)
    t = np.clip(((p - a) * along).sum(axis=-1) / np.where(square > 0, square, 1.0), 0.0, 1.0)
    return t, np.sqrt(((a + t[..., None] * along - p) ** 2).sum(axis=-1))
