"""The wrench on the tool at every corrected point, in world axes."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from drake_stiffness.errors import InputError
from drake_stiffness.tables import read_table
from toolpaths.process import FRAMES, Process
from toolpaths.program import Program

Floats = NDArray[np.float64]

_COLUMNS = (("fx", 0), ("fy", 1), ("fz", 2), ("mx", 3), ("my", 4), ("mz", 5))


def wrenches(process: Process, program: Program, rows: NDArray[np.int_], p_W: Floats, R_WT: Floats) -> Floats:
    """Wrench (6, N) at the TCP in world axes for the corrected rows.

    Parameters
    ----------
    rows : (N,)
        Rows of the program that are corrected.
    p_W : (P, 3)
        World positions of *all* rows of the program, m (the feed comes from the row before); NaN where not known.
    R_WT : (N, 3, 3)
        Orientation of the tool in the world.

    Raises
    ------
    InputError
        If a force table does not fit the program, or path axes are not defined where they are needed.
    """
    local, frame = _stated(process, program, rows)
    axes = np.broadcast_to(np.eye(3), (rows.size, 3, 3)).copy()
    axes[frame == "workpiece"] = process.base[0]
    axes[frame == "tool"] = R_WT[frame == "tool"]
    along = frame == "path"
    if along.any():
        turns = np.abs(local[:, [0, 1, 3, 4]]).max(axis=1) > 0
        axes[along] = path_axes(program, rows, p_W, R_WT, needed=turns & along)[along]
    force = np.einsum("nij,nj->in", axes, local[:, :3])
    moment = np.einsum("nij,nj->in", axes, local[:, 3:])
    return np.concatenate([force, moment])


def _stated(process: Process, program: Program, rows: NDArray[np.int_]) -> tuple[Floats, NDArray[np.str_]]:
    """Loads (N, 6) and the frame (N,) they are stated in; an arc's auxiliary pose has the load of its motion."""
    constant = process.force.constant
    if constant is not None:
        return np.broadcast_to(constant.wrench, (rows.size, 6)), np.full(rows.size, constant.frame)
    assert process.force.table is not None
    path = process.path.parent / process.force.table
    table, frame = read_force_table(path, process.force.frame or "tool")
    # "via" opens a motion, "end" closes the same one.
    motion = np.cumsum(program.role[rows] != "end") - 1
    number = int(motion[-1]) + 1 if motion.size else 0
    if table.shape[0] != number:
        raise InputError(
            f"{path}: {table.shape[0]} rows, but {program.path} has {number} corrected motions (linear and circular moves); expected "
            "one row per corrected motion, in order."
        )
    return table[motion], frame[motion]


def read_force_table(path: Path, default: str) -> tuple[Floats, NDArray[np.str_]]:
    """Forces and moments (N, 6) in SI, columns not given being zero, and the frame (N,) of every row.

    Parameters
    ----------
    default : str
        The frame where the table has no column `frame`.
    """
    table = read_table(path, "a force table with columns fx_N .. mz_Nm")
    units = {"f": ("_N", "_kN"), "m": ("_Nm", "_kNm")}
    known = {stem + unit for stem, _ in _COLUMNS for unit in units[stem[0]]} | {"frame"}
    table.refuse_unknown(known, allowed_prefix="note")
    out = np.zeros((len(table.rows), 6))
    for stem, place in _COLUMNS:
        column = table.quantity(stem, units[stem[0]], required=False)
        if column is not None:
            out[:, place] = column
    frame = [cell or default for cell in table.text("frame")]
    for row, name in enumerate(frame):
        if name not in FRAMES:
            raise InputError(f"{table.where(row, 'frame')}: found '{name}'; expected one of {', '.join(FRAMES)}.")
    return out, np.array(frame)


def path_axes(program: Program, rows: NDArray[np.int_], p_W: Floats, R_WT: Floats, needed: NDArray[np.bool_]) -> Floats:
    """Path axes (N, 3, 3): x along the feed at the point, z the tool's z made perpendicular to it, y completes them.

    Parameters
    ----------
    needed : (N,)
        Where the load really depends on the feed; elsewhere the tool's axes will do.
    """
    feed = _feed(program, rows, p_W)
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


def _feed(program: Program, rows: NDArray[np.int_], p_W: Floats) -> Floats:
    """Unit feed (N, 3) at the end of the segment that leads to each row; of the one that leaves it for the very first."""
    before = np.maximum(rows - 1, 0)
    first = rows == 0
    before[first] = np.minimum(rows[first] + 1, p_W.shape[0] - 1)
    step = p_W[rows] - p_W[before]
    step[first] *= -1
    step[~first & ~program.follows[rows]] = 0.0  # it starts from somewhere else
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
