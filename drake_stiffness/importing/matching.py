"""Which step of which experiment a row of a log belongs to: by its columns, by its order, or by its time."""

from __future__ import annotations

import difflib
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from drake_stiffness.campaign import Measurements
from drake_stiffness.errors import InputError
from drake_stiffness.importing.foreign_tables import check_column
from drake_stiffness.importing.map_file import Match
from drake_stiffness.rotations import Array
from drake_stiffness.tables import Table

_SHOWN = 5


@dataclass(frozen=True, eq=False)
class Steps:
    """The steps of all experiments in their order; `time_s` NaN where the plan has none."""

    experiment: tuple[str, ...]
    step: tuple[int, ...]
    time_s: Array

    @property
    def number(self) -> int:
        return len(self.step)

    def name(self, case: int) -> str:
        """For messages."""
        return f"experiment '{self.experiment[case]}', step {self.step[case]}"

    def names(self, cases: Sequence[int]) -> str:
        """The first few of some steps, for messages."""
        shown = "; ".join(self.name(case) for case in cases[:_SHOWN])
        return shown + (f"; and {len(cases) - _SHOWN} more" if len(cases) > _SHOWN else "")


def steps_of_plan(m: Measurements) -> Steps:
    """The steps of a plan."""
    names = tuple(m.experiments[e] for e in m.cases.experiment)
    return Steps(names, tuple(m.cases.step.tolist()), m.cases.time_s)


def steps_of_columns(tables: Sequence[tuple[Table, Match]]) -> Steps:
    """The steps that the files themselves name, where there is no plan: experiments as they appear, steps in order."""
    found: dict[str, set[int]] = {}
    for table, match in tables:
        for name, step in zip(*_columns(table, match), strict=True):
            found.setdefault(name, set()).add(int(step))
    pairs = [(name, step) for name, steps in found.items() for step in sorted(steps)]
    return Steps(tuple(n for n, _ in pairs), tuple(s for _, s in pairs), np.full(len(pairs), np.nan))


def _columns(table: Table, match: Match) -> tuple[list[str], NDArray[np.int_]]:
    check_column(table, match.experiment, "match.experiment")
    check_column(table, match.step, "match.step")
    return table.text(match.experiment), table.whole_numbers(match.step)


def match_rows(
    table: Table, match: Match, steps: Steps, time_s: Array, series: Sequence[str] | None = None
) -> NDArray[np.int_]:
    """(rows,) the step every row belongs to; -1 where there is none.

    Parameters
    ----------
    series : (rows,) names, optional
        Rows that are counted apart when the order decides: the points of a table with one row per point; '' is not
        counted.

    Raises
    ------
    InputError
        If two steps fit a row equally, or the number of rows is not what the order needs.
    """
    if match.by == "columns":
        index = {pair: case for case, pair in enumerate(zip(steps.experiment, steps.step, strict=True))}
        names, step = _columns(table, match)
        return np.array([index.get((name, int(s)), -1) for name, s in zip(names, step, strict=True)])
    if match.by == "order":
        return _by_order(table, match, steps, series)
    return _by_time(table, match, steps, time_s)


def _by_order(table: Table, match: Match, steps: Steps, series: Sequence[str] | None) -> NDArray[np.int_]:
    series = ["row"] * len(table.rows) if series is None else series
    expected = steps.number * match.samples
    seen: dict[str, int] = {}
    case = np.full(len(table.rows), -1)
    for row, name in enumerate(series):
        if not name:  # a point that is none of the cell's
            continue
        case[row] = seen.get(name, 0) // match.samples
        seen[name] = seen.get(name, 0) + 1
    for name, count in seen.items():
        if count != expected:
            each = f" of {match.samples} samples" if match.samples > 1 else ""
            what = "rows" if name == "row" else f"readings of '{name}'"
            raise InputError(
                f"{table.path}: {count} {what}; matched by order, the {steps.number} steps of the plan{each} need "
                f"{expected}. Where a reading is missing or doubled, order cannot tell which: drop the doubled row, "
                "or match by time or columns."
            )
    return case


def _by_time(table: Table, match: Match, steps: Steps, time_s: Array) -> NDArray[np.int_]:
    assert match.window_s is not None
    if np.isnan(steps.time_s).any():
        lacking = int(np.flatnonzero(np.isnan(steps.time_s))[0])
        raise InputError(
            f"matching by time: the plan has no time_s for {steps.name(lacking)}; fill that column, or match otherwise."
        )
    order = np.argsort(steps.time_s, kind="stable")
    times = steps.time_s[order]
    if match.how == "since":
        before = np.searchsorted(times, time_s, side="right") - 1
        late = time_s - times[np.maximum(before, 0)]
        return np.where((before >= 0) & (late <= match.window_s), order[np.maximum(before, 0)], -1)
    apart = np.abs(time_s[:, None] - times)
    near = apart <= match.window_s
    for row in np.flatnonzero(near.sum(axis=1) > 1).tolist():
        both = order[near[row]][:2].tolist()
        raise InputError(
            f"{table.path}, line {table.lines[row]}: at {time_s[row]:.6g} s it fits {steps.names(both)}, both within "
            f"{match.window_s:g} s; make match.window_s smaller, or match.how: since (the last step that has begun)."
        )
    return np.where(near.any(axis=1), order[apart.argmin(axis=1)], -1)


def nearest_names(names: Sequence[str], known: Sequence[str]) -> str:
    """A hint for a name that is not known."""
    near = difflib.get_close_matches(names[0], known, n=1, cutoff=0.5)
    return f" Did you mean '{near[0]}'?" if near else ""


def lines_of(lines: Sequence[int]) -> str:
    """Line numbers for messages, runs shortened: `4-9, 12`."""
    ordered = sorted(lines)
    runs: list[list[int]] = []
    for line in ordered:
        if runs and line == runs[-1][1] + 1:
            runs[-1][1] = line
        else:
            runs.append([line, line])
    shown = ", ".join(str(a) if a == b else f"{a}-{b}" for a, b in runs[:8])
    return shown + (f" and {len(runs) - 8} more stretches" if len(runs) > 8 else "")
