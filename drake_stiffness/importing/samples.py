"""A tracker's files as samples: which step, which point, where, when; and samples of one step as one reading."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from drake_stiffness.errors import InputError
from drake_stiffness.importing.foreign_tables import check_column
from drake_stiffness.importing.map_file import LENGTHS, Axes, Readings
from drake_stiffness.importing.matching import Steps, lines_of, match_rows, nearest_names
from drake_stiffness.rotations import Array
from drake_stiffness.tables import Table


@dataclass(frozen=True, eq=False)
class Samples:
    """Coordinates that were read.

    Attributes
    ----------
    case : (S,) which step
    point : (S,) names
    p : (S, 3) metres
    time_s, temperature : (S,) NaN where unknown; degrees Celsius
    file, line : where they stand
    """

    case: NDArray[np.int_]
    point: NDArray[np.str_]
    p: Array
    time_s: Array
    temperature: Array
    file: NDArray[np.str_]
    line: NDArray[np.int_]

    def where(self, sample: int) -> str:
        """For messages."""
        return f"{self.file[sample]}, line {self.line[sample]}"


@dataclass(frozen=True, eq=False)
class Unmatched:
    """Rows of a file that belong to no step or point, and why."""

    file: str
    lines: list[int]
    why: str

    def __str__(self) -> str:
        return f"{self.file}, line{'s' if len(self.lines) > 1 else ''} {lines_of(self.lines)}: {self.why}"


def read_samples(
    table: Table, spec: Readings, steps: Steps, time_s: Array, points: Sequence[str]
) -> tuple[Samples, list[Unmatched]]:
    """The samples of one file, and the rows that belong nowhere.

    Raises
    ------
    InputError
        On a missing column, a cell that is no number, a point of the map that the cell does not have.
    """
    groups = spec.points if spec.points is not None else {"": spec.columns}
    for name in [*(spec.points or {}), *spec.rename.values(), *([spec.point] if spec.point else [])]:
        if name not in points:
            raise InputError(
                f"the map names the point '{name}'; the cell's reference_points_m has {', '.join(points)}."
                f"{nearest_names([name], points)}"
            )
    named, unknown = _point_names(table, spec, points)
    case = match_rows(table, spec.match, steps, time_s, None if spec.points is not None else [n or "" for n in named])
    temperature = np.full(len(table.rows), np.nan)
    if spec.temperature_degC is not None:
        check_column(table, spec.temperature_degC, "readings.temperature_degC")
        temperature = table.numbers(spec.temperature_degC, empty=np.nan)
    parts = []
    for name, axes in groups.items():
        assert axes is not None
        p, given = _coordinates(table, axes, may_be_empty=bool(name))
        known = np.array([n is not None for n in named]) if not name else np.ones(len(table.rows), dtype=bool)
        rows = np.flatnonzero(given & known & (case >= 0))
        label = np.array([name or str(named[r]) for r in rows], dtype=str)
        file = np.full(rows.size, table.path.name)
        lines = np.array(table.lines)[rows]
        p = p[rows] * LENGTHS[spec.unit]
        parts.append(Samples(case[rows], label, p, time_s[rows], temperature[rows], file, lines))
    lost = [] if not unknown else [Unmatched(table.path.name, unknown, _unknown_points(table, spec, points))]
    strays = [table.lines[r] for r in np.flatnonzero(case < 0) if named[r] is not None or spec.points is not None]
    if strays:
        lost.append(Unmatched(table.path.name, strays, f"no step of the plan fits (matched by {spec.match.by})"))
    return join_samples(parts), lost


def _point_names(table: Table, spec: Readings, points: Sequence[str]) -> tuple[list[str | None], list[int]]:
    """The point of every row as the cell calls it, None where it has no such point; and the lines of those."""
    if spec.point_column is None:
        return [spec.point] * len(table.rows), []
    check_column(table, spec.point_column, "readings.point_column")
    names = [spec.rename.get(cell, cell) for cell in table.text(spec.point_column)]
    unknown = [table.lines[row] for row, name in enumerate(names) if name not in points]
    return [name if name in points else None for name in names], unknown


def _unknown_points(table: Table, spec: Readings, points: Sequence[str]) -> str:
    assert spec.point_column is not None
    strange = [c for c in dict.fromkeys(table.text(spec.point_column)) if spec.rename.get(c, c) not in points]
    return (
        f"the points {', '.join(repr(s) for s in strange[:6])} are none of the cell's ({', '.join(points)}); name "
        f"them in readings.rename, or leave them out by drop.{nearest_names([strange[0]], points)}"
    )


def _coordinates(table: Table, axes: Axes, *, may_be_empty: bool) -> tuple[Array, NDArray[np.bool_]]:
    """(rows, 3) as written, and which rows have a reading: in a wide table a point that was not read is left empty."""
    names = (axes.x, axes.y, axes.z)
    for name, axis in zip(names, "xyz", strict=True):
        check_column(table, name, f"{'readings.points' if may_be_empty else 'readings.columns'} {axis}")
    columns = np.stack([table.numbers(name, empty=np.nan if may_be_empty else None) for name in names], axis=1)
    missing = np.isnan(columns)
    for row in np.flatnonzero(missing.any(axis=1) & ~missing.all(axis=1)).tolist():
        raise InputError(
            f"{table.path}, line {table.lines[row]}: some of {', '.join(names)} are empty; a point is read whole or "
            "not at all."
        )
    return columns, np.asarray(~missing.any(axis=1))


def join_samples(parts: Sequence[Samples]) -> Samples:
    """Samples of several files or points together."""
    return Samples(
        *(
            np.concatenate([getattr(part, name) for part in parts])
            for name in ("case", "point", "p", "time_s", "temperature", "file", "line")
        )
    )


@dataclass(frozen=True, eq=False)
class Averaged:
    """Readings, one per step and point, or one per sample where all are kept.

    Attributes
    ----------
    case, point, p, time_s, temperature : as in Samples, ordered by step and point
    repeat : (R,) number of the sample; 0 throughout where there is one
    sigma_m : float
        Standard deviation of one coordinate of one sample about the mean of its step, NaN without several.
    samples : (R,) how many were averaged
    worst : str
        The sample farthest from its mean, for a look.
    """

    case: NDArray[np.int_]
    point: NDArray[np.str_]
    p: Array
    time_s: Array
    temperature: Array
    repeat: NDArray[np.int_]
    sigma_m: float
    samples: NDArray[np.int_]
    worst: str


def average(s: Samples, how: str, steps: Steps, points: Sequence[str]) -> Averaged:
    """One reading per step and point.

    Parameters
    ----------
    how : 'one', 'mean' or 'keep'
        `one` refuses a second sample, `mean` averages, `keep` numbers them.
    """
    rank = {name: place for place, name in enumerate(points)}
    place = np.array([rank[str(name)] for name in s.point], dtype=int)
    key = s.case * len(points) + place
    order = np.argsort(key, kind="stable")
    unique, first, group, counts = np.unique(key[order], return_index=True, return_inverse=True, return_counts=True)
    group = group.reshape(-1)
    if how == "one" and (counts > 1).any():
        twice = int(np.flatnonzero(counts > 1)[0])
        a, b = order[first[twice]], order[first[twice] + 1]
        raise InputError(
            f"{s.where(int(b))}: a second reading of point '{s.point[b]}' for {steps.name(int(s.case[b]))} (the first: "
            f"{s.where(int(a))}); {int((counts > 1).sum())} such in all. Drop one, or write samples: mean (they are "
            "averaged) or samples: keep (each becomes a row with its number in the column repeat)."
        )
    p, time, warmth = s.p[order], s.time_s[order], s.temperature[order]
    mean = np.stack([np.bincount(group, weights=p[:, c]) for c in range(3)], axis=1) / counts[:, None]
    off = p - mean[group]
    freedom = 3 * int((counts - 1).sum())
    sigma = float(np.sqrt((off**2).sum() / freedom)) if freedom else float("nan")
    far = int(np.linalg.norm(off, axis=1).argmax())
    worst = f"{s.where(int(order[far]))}, {1e3 * np.linalg.norm(off[far]):.4f} mm from the mean" if freedom else ""
    if how == "keep":
        number = np.arange(group.size) - first[group]
        one = np.ones(group.size, dtype=int)
        return Averaged(s.case[order], s.point[order], p, time, warmth, number, sigma, one, worst)
    mean_time, mean_warmth = (np.bincount(group, weights=values) / counts for values in (time, warmth))
    none = np.zeros(unique.size, dtype=int)
    return Averaged(
        case=unique // len(points),
        point=np.array(points)[unique % len(points)],
        p=mean,
        time_s=mean_time,
        temperature=mean_warmth,
        repeat=none,
        sigma_m=sigma,
        samples=counts,
        worst=worst,
    )
