"""Waypoints as a CSV table: header ``x_mm, y_mm, z_mm, a_deg, b_deg, c_deg``, one pose a row, KUKA angles.

Units are in the column names (``_m`` and ``_rad`` too); ``e1_mm`` .. ``e6_deg`` are external axes, ``kind`` the motion
(LIN by default), ``feed_mm_per_min`` the feed. Other columns, quotes, separators and line ends are kept as they are.
"""

from __future__ import annotations

import math
import re
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from drake_stiffness.errors import InputError
from toolpaths.printed import NUMBER, read_number
from toolpaths.program import UNWRITTEN, Program
from toolpaths.program_builder import ProgramBuilder

LENGTH_UNITS = {"mm": 1.0, "m": 1000.0}
ANGLE_UNITS = {"deg": 1.0, "rad": 180.0 / math.pi}
# True: the motion carries force. Arcs need two poses a motion and are not a matter of a table of waypoints.
KINDS = {"LIN": True, "SLIN": True, "PTP": False, "SPTP": False, "RAPID": False}

_HEADER = re.compile(rb"(?:\xef\xbb\xbf)?[^\r\n]*?\bx_m{1,2}\b[^\r\n]*", re.IGNORECASE)
COLUMN = re.compile(r"(?P<axis>[xyzabc]|e[1-6])_(?P<unit>[a-z]+)")


@dataclass(frozen=True)
class _Layout:
    """Where the columns are: `pose` and `external` by axis (None: absent), with the unit of each."""

    width: int
    separator: bytes
    pose: tuple[int | None, ...]
    external: tuple[int | None, ...]
    kind: int | None
    feed: int | None
    unit: tuple[float, ...]
    external_unit: tuple[float, ...]


class WaypointsCsv:
    """CSV waypoints as a dialect."""

    name = "csv"

    def recognises(self, raw: bytes, suffix: str) -> bool:
        """A header line with an ``x_mm`` or ``x_m`` column, or a file named ``.csv``."""
        return suffix == ".csv" or _HEADER.match(raw) is not None

    def companions(self, path: Path) -> tuple[Path, ...]:
        """None."""
        return ()

    def parse(self, raw: bytes, path: str, others: Sequence[tuple[str, bytes]] = ()) -> Program:
        """Read all rows; see ``toolpaths.formats.Dialect``.

        Raises
        ------
        InputError
            A missing, doubled or unknown-unit column; a cell that is no finite number; a row of another width; no rows.
        """
        program = self._read(raw, path, None)[0]
        if not len(program):
            raise InputError(f"{path}: the table has a header and no rows; expected one waypoint a row")
        return program

    def cut(self, raw: bytes) -> int:
        """Where the last place is at which a table may be cut in two: before its last line, for every row is whole."""
        return raw.rfind(b"\n") + 1

    def parse_piece(
        self, raw: bytes, path: str, resume: object, others: Sequence[tuple[str, bytes]] = (), last: bool = False
    ) -> tuple[Program, object]:
        """Read a piece of a table that was cut at `cut`; `resume` is what the piece before handed on (None: the first)."""
        return self._read(raw, path, resume)

    def _read(self, raw: bytes, path: str, resume: Any) -> tuple[Program, object]:
        if resume is None:
            start = 3 if raw.startswith(b"\xef\xbb\xbf") else 0
            end = _line_end(raw, start)
            layout, number = _layout(raw[start:end].rstrip(b"\r"), path), 1
            table = _Table(raw, path, layout)
        else:
            layout, number, before = resume
            end = -1
            table = _Table(raw, path, layout)
            table.rows.stand_in(number, "LIN", before)
        while end < len(raw):
            start, number = end + 1, number + 1
            end = _line_end(raw, start)
            if raw[start:end].strip():
                table.read_row(number, start, end)
        handed = layout, number - raw.endswith(b"\n"), tuple(table.rows.values)
        program = table.rows.build(raw, self.name, path, np.array(layout.unit))
        program.external[:] *= np.array(layout.external_unit)
        return replace(program, resume=resume), handed


class _Table:
    """Reads rows by one regular expression made for the header; what it does not match is explained cell by cell."""

    def __init__(self, raw: bytes, path: str, layout: _Layout) -> None:
        self.raw, self.path, self.layout = raw, path, layout
        self.rows = ProgramBuilder()
        numbers = {column for column in (*layout.pose, *layout.external, layout.feed) if column is not None}
        # Every pattern can match a cell in one way only, so that a bad row fails at once.
        other = rb'(?:[ \t]*"([^"\r\n]*)"[ \t]*|([^"%s\r\n]*))' % layout.separator
        patterns = []
        self.groups: list[int] = []
        group = 1
        for column in range(layout.width):
            if column in numbers:
                patterns.append(rb'[ \t]*("[ \t]*)?(%s)[ \t]*(?(%d)"[ \t]*)' % (NUMBER, group))
                self.groups.append(group + 1)
            else:
                patterns.append(other)
                self.groups.append(group)
            group += 2
        self.pattern = re.compile(layout.separator.join(patterns) + rb"\r*")
        self.number_groups = [None if c is None else self.groups[c] for c in (*layout.pose, *layout.external)]
        self.feed_group = None if layout.feed is None else self.groups[layout.feed]

    def read_row(self, line: int, start: int, end: int) -> None:
        match = self.pattern.fullmatch(self.raw, start, end)
        if match is None:
            raise self.explain(line, start, end)
        tokens = [None if group is None else match[group] for group in self.number_groups]
        for token in tokens:
            if token is not None and read_number(token) is None:
                raise InputError(f"{self.path}: line {line}: {_shown(token)} is no number that a controller can hold")
        kind = self.kind_of(match, line)
        regs = match.regs
        spans = [UNWRITTEN if group is None else regs[group] for group in self.number_groups[:6]]
        if self.feed_group is not None:
            self.rows.feed_mm_per_min = float(match[self.feed_group])
        self.rows.update(tokens)
        self.rows.add(line, kind, "point", spans, -1, carries_force=KINDS[kind], refused=False)

    def kind_of(self, match: re.Match[bytes], line: int) -> str:
        if self.layout.kind is None:
            return "LIN"
        group = self.groups[self.layout.kind]
        found = (match[group] or match[group + 1] or b"").strip()
        kind = found.decode("ascii", "backslashreplace").upper() or "LIN"
        if kind not in KINDS:
            raise InputError(
                f"{self.path}: line {line}, column 'kind': found {_shown(found)}, expected one of {', '.join(KINDS)}"
            )
        return kind

    def explain(self, line: int, start: int, end: int) -> InputError:
        """Why a row does not read: the first bad cell, or the number of cells."""
        layout = self.layout
        text = self.raw[start:end].rstrip(b"\r")
        cells = _cells(text, layout.separator)
        where = f"{self.path}: line {line}"
        if len(cells) != layout.width:
            return InputError(f"{where}: found {len(cells)} cells, expected {layout.width} as in the header")
        names = [*"xyzabc", *(f"e{n}" for n in range(1, 7)), "feed"]
        for axis, column in zip(names, (*layout.pose, *layout.external, layout.feed), strict=True):
            if column is not None and read_number(cells[column].strip(b' \t"')) is None:
                found = _shown(cells[column])
                hint = " (decimals need a point)" if b"," in cells[column] else ""
                return InputError(
                    f"{where}, column {column + 1} ({axis}): found {found}, expected a finite number{hint}"
                )
        return InputError(f"{where}: the quotes do not pair up: {_shown(text[:60])}")


def _layout(header: bytes, path: str) -> _Layout:
    separator = b";" if header.count(b";") > header.count(b",") else b","
    names = [cell.strip(b' \t"').decode("utf-8", "replace").lower() for cell in _cells(header, separator)]
    places: dict[str, tuple[int, float]] = {}
    for column, name in enumerate(names):
        match = COLUMN.fullmatch(name)
        if match is None:
            continue
        axis, unit = match["axis"], match["unit"]
        units = LENGTH_UNITS if axis in "xyz" else ANGLE_UNITS if axis in "abc" else LENGTH_UNITS | ANGLE_UNITS
        if unit not in units:
            raise InputError(f"{path}: line 1: column {name!r} has unit {unit!r}, expected one of {', '.join(units)}")
        if axis in places:
            raise InputError(
                f"{path}: line 1: {axis} is given twice ({names[places[axis][0]]!r} and {name!r}); keep one"
            )
        places[axis] = column, units[unit]
    orientation = [axis for axis in "abc" if axis in places]
    missing = [f"{axis}_mm" for axis in "xyz" if axis not in places]
    missing += [f"{axis}_deg" for axis in "abc" if orientation and axis not in places]
    if missing:
        raise InputError(
            f"{path}: line 1: missing column {', '.join(missing)}; found {', '.join(names)}; "
            "expected x_mm, y_mm, z_mm (or _m) and a_deg, b_deg, c_deg (or _rad; all three or none)"
        )
    externals = [f"e{n}" for n in range(1, 7)]
    return _Layout(
        width=len(names),
        separator=separator,
        pose=tuple(places.get(axis, (None, 1.0))[0] for axis in "xyzabc"),
        external=tuple(places.get(axis, (None, 1.0))[0] for axis in externals),
        kind=names.index("kind") if "kind" in names else None,
        feed=names.index("feed_mm_per_min") if "feed_mm_per_min" in names else None,
        unit=tuple(places.get(axis, (None, 1.0))[1] for axis in "xyzabc"),
        external_unit=tuple(places.get(axis, (None, 1.0))[1] for axis in externals),
    )


def _cells(text: bytes, separator: bytes) -> list[bytes]:
    """Cells of a line, separators inside quotes kept together."""
    return re.findall(rb'(?:\A|(?<=%s))((?:[ \t]*"[^"]*"[ \t]*)|[^%s]*)(?=%s|\Z)' % ((separator,) * 3), text)


def _line_end(raw: bytes, start: int) -> int:
    end = raw.find(b"\n", start)
    return len(raw) if end < 0 else end


def _shown(text: bytes) -> str:
    return repr(text.decode("utf-8", "backslashreplace"))
