"""The wrench on the tool at every corrected point, in world axes, and how sure it is."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from drake_stiffness.errors import InputError
from drake_stiffness.tables import Table, TableReader, read_table
from toolpaths.milling.along_path import MillingLoad, milling_load
from toolpaths.path_axes import motion_numbers, path_axes
from toolpaths.process import FRAMES, Process
from toolpaths.program import Program

Floats = NDArray[np.float64]

_TABLE = "a force table with columns fx_N .. mz_Nm"
_COLUMNS = (("fx", 0), ("fy", 1), ("fz", 2), ("mx", 3), ("my", 4), ("mz", 5))


@dataclass(frozen=True, eq=False)
class Load:
    """The load on N corrected points.

    Attributes
    ----------
    wrench : (6, N)
        At the TCP in world axes; for milling at the depth of cut that the process states.
    relative_sigma : (N,)
        Standard deviation of the wrench as a share of it: one common factor on all six components of all points. What
        `force.relative_sigma` says, else that of the coefficients of cutting, else 0: not stated.
    milling : MillingLoad or None
        How the wrench follows the true depth of cut, where it does.
    notes : what the user should know
    """

    wrench: Floats
    relative_sigma: Floats
    milling: MillingLoad | None = None
    notes: tuple[str, ...] = ()


def loads(process: Process, program: Program, rows: NDArray[np.int_], p_W: Floats, R_WT: Floats) -> Load:
    """The load at the TCP for the corrected rows.

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
        If a force or engagement table does not fit the program, or path axes or a feed are not defined where they are needed.
    """
    settings, stated = process.force.milling, process.force.relative_sigma
    if settings is not None:
        milling = milling_load(
            settings, process.path.parent, program, rows, p_W, R_WT, process.spindle_axis, process.base[0]
        )
        sigma = np.full(rows.size, milling.relative_sigma if stated is None else stated)
        return Load(milling.nominal(), sigma, milling if settings.coupled else None, milling.notes)
    return Load(_given(process, program, rows, p_W, R_WT), np.full(rows.size, stated or 0.0))


def wrenches(process: Process, program: Program, rows: NDArray[np.int_], p_W: Floats, R_WT: Floats) -> Floats:
    """Wrench (6, N) alone, as `loads` finds it."""
    return loads(process, program, rows, p_W, R_WT).wrench


def _given(process: Process, program: Program, rows: NDArray[np.int_], p_W: Floats, R_WT: Floats) -> Floats:
    """Wrench (6, N) of a constant or a table."""
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
    table, frame = process.force_rows or read_force_table(path, process.force.frame or "tool")
    motion = motion_numbers(program, rows)
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
    return force_columns(read_table(path, _TABLE), default)


def force_columns(table: Table, default: str) -> tuple[Floats, NDArray[np.str_]]:
    """See `read_force_table`."""
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


class ForceRows:
    """A force table that is read in step with a program that comes in pieces."""

    def __init__(self, process: Process) -> None:
        assert process.force.table is not None
        self.path = process.path.parent / process.force.table
        self._default = process.force.frame or "tool"
        self._reader = TableReader(self.path, _TABLE)
        self._taken = 0

    def take(self, program: Program) -> tuple[Floats, NDArray[np.str_]]:
        """The rows of the corrected motions of a piece.

        Raises
        ------
        InputError
            If the table ends before the program does.
        """
        number = int((program.role[program.corrected] != "end").sum())
        table = self._reader.take(number)
        self._taken += len(table.rows)
        if len(table.rows) < number:
            raise InputError(
                f"{self.path}: {self._taken} rows, but {program.path} has more corrected motions (linear and circular moves); expected one "
                "row per corrected motion, in order."
            )
        return force_columns(table, self._default)

    def finish(self, path: str) -> None:
        """Raise InputError if rows are left over."""
        left = len(self._reader.take(1).rows)
        if left:
            raise InputError(
                f"{self.path}: more rows than the {self._taken} corrected motions of {path} (linear and circular moves); expected one row per "
                "corrected motion, in order."
            )
