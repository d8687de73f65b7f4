"""Directions along a program: the feed at every point, path axes, and which rows belong to one motion."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from drake_stiffness.errors import InputError
from toolpaths.program import Program

Floats = NDArray[np.float64]


def motion_numbers(program: Program, rows: NDArray[np.int_]) -> NDArray[np.int_]:
    """(N,) number of the motion each row belongs to, from 0; both poses of an arc are one motion."""
    # "via" opens a motion, "end" closes the same one.
    return np.asarray(np.cumsum(program.role[rows] != "end") - 1)


def path_axes(program: Program, rows: NDArray[np.int_], p_W: Floats, R_WT: Floats, needed: NDArray[np.bool_]) -> Floats:
    """Path axes (N, 3, 3): x along the feed at the point, z the tool's z made perpendicular to it, y completes them.

    Parameters
    ----------
    needed : (N,)
        Where the load really depends on the feed; elsewhere the tool's axes will do.
    """
    feed = feed_direction(program, rows, p_W)
    z = R_WT[:, :, 2]
    across = np.cross(z, feed)
    size = np.linalg.norm(across, axis=1)
    undefined = ~(size > 1e-6)
    for row in np.flatnonzero(undefined & needed)[:1].tolist():
        raise InputError(
            f"{program.path}, line {program.line[rows[row]]}: path axes are not defined: the feed is zero, unknown or along the "
            "tool's z. Give the force in tool, workpiece or world axes, or as a table."
        )
    y = across / np.where(undefined, 1.0, size)[:, None]
    axes = np.stack([feed, y, np.cross(feed, y)], axis=2)
    return np.where(undefined[:, None, None], R_WT, axes)


def feed_direction(program: Program, rows: NDArray[np.int_], p_W: Floats) -> Floats:
    """Unit feed (N, 3) at the end of the segment that leads to each row; zero where it is not known.

    Where it is not known from where a motion starts (the first of a program, one after a joint move) the feed is that of the
    segment that leaves its end.
    """
    before = np.maximum(rows - 1, 0)
    first = (rows == 0) | ~program.follows[rows]
    after = np.minimum(rows[first] + 1, p_W.shape[0] - 1)
    before[first] = after
    step = p_W[rows] - p_W[before]
    step[first] *= -1
    lost = np.flatnonzero(first)[~program.follows[after]]
    step[lost] = 0.0  # nor is it known where it goes on to
    via, end = program.role[rows] == "via", program.role[rows] == "end"
    if via.any():
        # Both poses of an arc are rows in sequence: start, via, end.
        for at, mine in ((0, via), (1, end)):
            here = rows[mine] - at
            start, middle, last = p_W[np.maximum(here - 1, 0)], p_W[here], p_W[np.minimum(here + 1, p_W.shape[0] - 1)]
            step[mine] = _arc_tangent(start, middle, last, at_end=at == 1)
    size = np.linalg.norm(step, axis=1, keepdims=True)
    known = size > 1e-9
    return np.where(known, step / np.where(known, size, 1.0), 0.0)


def _arc_tangent(a: Floats, b: Floats, c: Floats, *, at_end: bool) -> Floats:
    """Tangents (N, 3), in the sense of travel, of the circles through a, b, c at b or at c.

    With chords u = b - a, v = c - b of one circle, the tangent at b is u/|u|^2 + v/|v|^2 up to length, and the tangent at c is
    v/|v|^2 + (a - c)/|a - c|^2 (the same, seen from c with the chord to a).
    """

    def over_square(w: Floats) -> Floats:
        square = (w**2).sum(axis=1, keepdims=True)
        return w / np.where(square > 0, square, 1.0)

    if at_end:
        return over_square(c - b) + over_square(a - c)
    return over_square(b - a) + over_square(c - b)
