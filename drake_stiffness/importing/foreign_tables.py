"""Text tables as other programs write them: any delimiter, decimal commas, comments, no header, kinds of times."""

from __future__ import annotations

import csv
import difflib
import re
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path

import numpy as np

from drake_stiffness.errors import InputError
from drake_stiffness.files import read_bytes
from drake_stiffness.importing.map_file import TextFile, Time
from drake_stiffness.rotations import Array
from drake_stiffness.tables import Table

_DELIMITERS = {"tab": "\t", "space": " "}
_DECIMAL_COMMA = re.compile(r"[+-]?(\d+,\d*|,\d+)([eE][+-]?\d+)?")
_DAY_S = 86400.0


def read_foreign(folder: Path, spec: TextFile) -> tuple[Table, list[int]]:
    """The table, and the lines of the rows that `drop` left out.

    Raises
    ------
    InputError
        If it is missing, in another encoding, ragged, has no rows, or `drop` names a column it does not have.
    """
    path = folder / spec.file
    text = _decoded(path, spec.encoding)
    lines = text.splitlines()
    rows: list[list[str]] = []
    numbers: list[int] = []
    for number, line in enumerate(lines, start=1):
        if number <= spec.skip_lines or not line.strip() or (spec.comment and line.lstrip().startswith(spec.comment)):
            continue
        rows.append(_cells(path, number, line, spec))
        numbers.append(number)
    header = tuple(spec.header) if spec.header is not None else tuple(rows.pop(0) if rows else ())
    if spec.header is None and numbers:
        numbers.pop(0)
    while header and not header[-1]:
        header = header[:-1]
    if len(header) == 1 and any(mark in header[0] for mark in ",;\t "):
        raise InputError(
            f"{path}: the header is one cell, '{header[0][:60]}', with the delimiter '{spec.delimiter}'; set "
            "delimiter in the map to what separates the names (',', ';', tab or space)."
        )
    rows, numbers = rows[spec.skip_after_header :], numbers[spec.skip_after_header :]
    if not rows:
        raise InputError(f"{path}: no rows below the header; check skip_lines ({spec.skip_lines}) and comment.")
    for cells, number in zip(rows, numbers, strict=True):
        while len(cells) > len(header) and not cells[-1]:
            cells.pop()
        if len(cells) != len(header):
            hint = "" if len(header) > 1 else f" Is the delimiter really '{spec.delimiter}'?"
            raise InputError(
                f"{path}, line {number}: {len(cells)} cells, but the header has {len(header)} columns "
                f"({', '.join(header)}).{hint} Set delimiter, decimal, comment or skip_lines in the map."
            )
    table = Table(path, header, rows, numbers)
    return _without_dropped(table, spec)


def _decoded(path: Path, encoding: str) -> str:
    data = read_bytes(path, "a table exported by another program")
    try:
        return data.decode("utf-8-sig" if encoding.lower().replace("_", "-") == "utf-8" else encoding)
    except UnicodeDecodeError as error:
        raise InputError(
            f"{path}: byte {error.start} is not {encoding}; set encoding (cp1252 and utf-16 are usual on Windows)."
        ) from None
    except LookupError:
        raise InputError(
            f"{path}: there is no encoding '{encoding}'; expected utf-8, cp1252, utf-16 or another."
        ) from None


def _cells(path: Path, number: int, line: str, spec: TextFile) -> list[str]:
    spaced = spec.delimiter == "space"
    source = " ".join(line.split()) if spaced and '"' not in line else line.strip() if spaced else line
    try:
        (cells,) = csv.reader(
            [source], delimiter=_DELIMITERS.get(spec.delimiter, spec.delimiter), skipinitialspace=True, strict=True
        )
    except csv.Error as error:
        raise InputError(f"{path}, line {number}: not a table row ({error}).") from None
    cells = [cell.strip() for cell in cells]
    if spec.decimal == ",":
        cells = [cell.replace(",", ".") if _DECIMAL_COMMA.fullmatch(cell) else cell for cell in cells]
    return cells


def _without_dropped(table: Table, spec: TextFile) -> tuple[Table, list[int]]:
    """Rows whose flag says so are left out, and named."""
    out: set[int] = set()
    for rule in spec.drop:
        check_column(table, rule.column, "drop.column")
        for row, cell in enumerate(table.text(rule.column)):
            flagged = cell in rule.values if rule.values is not None else cell not in (rule.keep or ())
            if flagged:
                out.add(row)
    kept = [row for row in range(len(table.rows)) if row not in out]
    if not kept:
        raise InputError(f"{table.path}: drop leaves no row; check its values.")
    left = Table(table.path, table.header, [table.rows[r] for r in kept], [table.lines[r] for r in kept])
    return left, [table.lines[r] for r in sorted(out)]


def check_column(table: Table, name: str, key: str) -> None:
    """Raise InputError if a column the map names is not there, or is there twice; a near miss is named."""
    found = table.header.count(name)
    if found == 1:
        return
    if found > 1:
        raise InputError(f"{table.path}: the column '{name}' ({key}) appears {found} times; rename one.")
    near = difflib.get_close_matches(name.casefold(), [h.casefold() for h in table.header], n=1, cutoff=0.5)
    close = [h for h in table.header if near and h.casefold() == near[0]]
    hint = f" Did you mean '{close[0]}'?" if close else ""
    raise InputError(
        f"{table.path}: no column '{name}' ({key} of the map).{hint} Columns found: {', '.join(table.header)}."
    )


@dataclass(frozen=True)
class Start:
    """What `time_s = 0` is on the clocks of the files: a date, or a time of day alone.

    Attributes
    ----------
    epoch_s : float
        Seconds since 1970 for a date, since midnight for a time of day.
    dated, zoned : bool
    """

    epoch_s: float
    dated: bool
    zoned: bool


def read_start(text: str, where: str) -> Start:
    """A start as written in the map, `2026-03-01T08:00:00` or `08:00:00`."""
    try:
        moment = datetime.fromisoformat(text)
        return Start(_epoch(moment), True, moment.tzinfo is not None)
    except ValueError:
        pass
    seconds = _of_clock(text)
    if seconds is None:
        raise InputError(
            f"{where}: start: found '{text}'; expected a date like 2026-03-01T08:00:00 or a time like 08:00:00."
        )
    return Start(seconds, False, False)


def read_times(table: Table, spec: Time, start: Start | None) -> tuple[Array, Start | None]:
    """Seconds since the start for every row, and the start, which is the first row's time if none was known.

    Raises
    ------
    InputError
        On a cell that is no time; on a date against a start that is only a time of day, or clocks with and without
        zone.
    """
    check_column(table, spec.column, "time.column")
    if spec.format == "seconds":
        return table.numbers(spec.column) + spec.offset_s, start
    seconds = np.empty(len(table.rows))
    zoned = False
    for row, cell in enumerate(table.text(spec.column)):
        value, zoned = _moment(cell, spec.format)
        if value is None:
            raise InputError(
                f"{table.where(row, spec.column)}: found '{cell}'; expected a time in the format '{spec.format}' "
                "(time.format)."
            )
        seconds[row] = value
    dated = spec.format == "iso" or any(word in spec.format for word in ("%d", "%j", "%s", "%x", "%c"))
    if start is None:
        start = Start(float(seconds.min() if dated else seconds[0]), dated, zoned)
    if dated and (not start.dated or start.zoned != zoned):
        what = (
            "a time of day alone" if not start.dated else "with a time zone" if start.zoned else "without a time zone"
        )
        raise InputError(
            f"{table.path}: the dates of column '{spec.column}' cannot be set against a start that is {what}; give "
            "the key start as a date written the way this file writes it."
        )
    if not dated:  # a clock knows no days: it runs on past midnight
        seconds = np.unwrap(seconds, period=_DAY_S)
        apart = seconds[0] - start.epoch_s % _DAY_S
        seconds += (apart + _DAY_S / 2) % _DAY_S - _DAY_S / 2 - seconds[0]
        return seconds + spec.offset_s, start
    return seconds - start.epoch_s + spec.offset_s, start


def _moment(cell: str, pattern: str) -> tuple[float | None, bool]:
    """Seconds (since 1970, or since midnight), and whether a zone is written."""
    cell = cell.replace(",", ".")
    if pattern == "clock":
        return _of_clock(cell), False
    try:
        moment = datetime.fromisoformat(cell) if pattern == "iso" else datetime.strptime(cell, pattern)
    except ValueError:
        return None, False
    if moment.year == 1900:  # the pattern has no date
        return moment.hour * 3600.0 + moment.minute * 60.0 + moment.second + moment.microsecond * 1e-6, False
    return _epoch(moment), moment.tzinfo is not None


def _epoch(moment: datetime) -> float:
    return (moment if moment.tzinfo is not None else moment.replace(tzinfo=UTC)).timestamp()


def _of_clock(text: str) -> float | None:
    found = re.fullmatch(r"(\d{1,2}):(\d\d)(?::(\d\d(?:\.\d*)?))?", text.strip())
    if found is None:
        return None
    return int(found[1]) * 3600.0 + int(found[2]) * 60.0 + float(found[3] or 0.0)
