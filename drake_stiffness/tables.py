"""CSV tables whose columns carry units: reading with line and column in every error.

Used for measurements, plans, force tables and waypoints: a header row, UTF-8, a unit at the end of every name.
"""

from __future__ import annotations

import csv
import difflib
import io
import math
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from drake_stiffness.errors import InputError
from drake_stiffness.files import read_bytes
from drake_stiffness.rotations import Array

# What one unit of a suffix is in SI.
UNITS = {
    "_mm": 1e-3, "_m": 1.0, "_um": 1e-6,
    "_deg": math.pi / 180, "_rad": 1.0, "_mrad": 1e-3,
    "_N": 1.0, "_kN": 1e3, "_Nm": 1.0, "_kNm": 1e3,
}  # fmt: skip


# No quantity of a robot cell is larger in any of these units; beyond, squares would overflow on the way.
LARGEST, LARGEST_COUNT = 1e15, 1e9


@dataclass(frozen=True, eq=False)
class Table:
    """A CSV file as text cells.

    Attributes
    ----------
    path : Path
    header : tuple of column names
    rows : list of rows of cells
    lines : list of line numbers (1-based, the header is line 1)
    delimiter : str
    """

    path: Path
    header: tuple[str, ...]
    rows: list[list[str]]
    lines: list[int]

    def column(self, name: str) -> int:
        return self.header.index(name)

    def where(self, row: int, name: str) -> str:
        """`file, line L, column 'name'`."""
        return f"{self.path}, line {self.lines[row]}, column '{name}'"

    def text(self, name: str) -> list[str]:
        """Stripped cells of a column; empty strings where the column does not exist."""
        if name not in self.header:
            return [""] * len(self.rows)
        place = self.column(name)
        return [row[place].strip() for row in self.rows]

    def numbers(self, name: str, *, empty: float | None = None) -> Array:
        """A column as floats in the unit it is written in.

        Parameters
        ----------
        empty : float, optional
            What an empty cell stands for; without it an empty cell is an error.

        Raises
        ------
        InputError
            On an empty, non-numeric, NaN or infinite cell, with line and column.
        """
        values = np.empty(len(self.rows))
        for row, cell in enumerate(self.text(name)):
            if not cell and empty is not None:
                values[row] = empty
                continue
            try:
                if "_" in cell:  # Python reads 1_0 as ten; a table never means that
                    raise ValueError
                values[row] = float(cell)
            except ValueError:
                found = f"'{cell}'" if cell else "an empty cell"
                raise InputError(f"{self.where(row, name)}: found {found}; expected a number.") from None
            if not math.isfinite(values[row]):
                raise InputError(
                    f"{self.where(row, name)}: found '{cell}'; expected a finite number. Leave out rows without a reading."
                )
            if abs(values[row]) > LARGEST:
                raise InputError(
                    f"{self.where(row, name)}: found '{cell}'; expected a number below {LARGEST:g} (a slip, or a wrong unit?)."
                )
        return values

    def whole_numbers(self, name: str) -> np.ndarray:
        """A column of whole numbers from 0."""
        values = self.numbers(name)
        for row in np.flatnonzero((values != np.round(values)) | (values < 0) | (values > LARGEST_COUNT)):
            raise InputError(
                f"{self.where(int(row), name)}: found '{self.rows[row][self.column(name)]}'; expected a whole number from 0."
            )
        return values.astype(int)

    def quantity(
        self, stem: str, suffixes: tuple[str, ...], *, required: bool, empty: float | None = None
    ) -> Array | None:
        """A column `stem` + one of the unit suffixes, in SI; None if absent and not required.

        Raises
        ------
        InputError
            If it is required and absent, or written in two units at once.
        """
        found = [stem + suffix for suffix in suffixes if stem + suffix in self.header]
        if len(found) > 1:
            raise InputError(f"{self.path}: the columns {' and '.join(found)} say the same thing twice; keep one.")
        if not found:
            if not required:
                return None
            expected = " or ".join(f"'{stem}{suffix}'" for suffix in suffixes)
            near = [name for name in self.header if name.casefold().startswith(stem.casefold())]
            hint = f" There is '{near[0]}': is its unit or spelling wrong?" if near else ""
            raise InputError(f"{self.path}: missing column {expected}.{hint} Columns found: {', '.join(self.header)}.")
        suffix = found[0].removeprefix(stem)
        return self.numbers(found[0], empty=empty) * UNITS[suffix]

    def refuse_unknown(self, known: set[str], allowed_prefix: str) -> None:
        """Raise InputError for the first column that is neither known nor starts with the allowed prefix."""
        for name in self.header:
            if name in known or name.startswith(allowed_prefix):
                continue
            near = difflib.get_close_matches(name, sorted(known), n=1, cutoff=0.5)
            hint = f" Did you mean '{near[0]}'?" if near else ""
            raise InputError(
                f"{self.path}, line 1: unknown column '{name}' (wrong unit suffix, or a joint the arm does not have?).{hint} "
                f"Known columns: {', '.join(sorted(known))}."
            )


def read_table(path: Path | str, what: str) -> Table:
    """Read a CSV file with a header row.

    Raises
    ------
    InputError
        If it is missing, empty, not UTF-8, has no rows, a ragged row, or a column written twice.
    """
    path = Path(path)
    data = read_bytes(path, what)
    try:
        text = data.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        raise InputError(f"{path}: byte {error.start} is not UTF-8; save the table as UTF-8 CSV.") from None
    reader = csv.reader(io.StringIO(text, newline=""), strict=True)
    rows: list[list[str]] = []
    lines: list[int] = []
    try:
        for cells in reader:
            if any(cell.strip() for cell in cells):
                rows.append(cells)
                lines.append(reader.line_num)
    except csv.Error as error:
        raise InputError(f"{path}, line {reader.line_num}: not a CSV table ({error}).") from None
    if not rows:
        raise InputError(f"{path}: nothing but separators; expected {what}.")
    header = tuple(cell.strip() for cell in rows[0])
    if len(header) == 1 and ";" in header[0]:
        raise InputError(
            f"{path}, line {lines[0]}: the cells are separated by ';'; expected commas. Save the table as CSV with commas."
        )
    for name in header:
        if header.count(name) > 1:
            raise InputError(f"{path}, line {lines[0]}: the column '{name}' appears twice; keep one.")
    if len(rows) == 1:
        raise InputError(f"{path}: a header but no rows; expected {what}.")
    for cells, line in zip(rows[1:], lines[1:], strict=True):
        if len(cells) != len(header):
            raise InputError(f"{path}, line {line}: {len(cells)} cells, but the header has {len(header)} columns.")
    return Table(path, header, rows[1:], lines[1:])


class TableReader:
    """A CSV table as `read_table` reads it, some rows at a time; for tables too long to be held."""

    def __init__(self, path: Path, what: str) -> None:
        self.path = path
        self._what = what
        try:
            self._file = path.open(encoding="utf-8-sig", newline="")
        except OSError as error:
            raise InputError(f"{path}: cannot be read ({error.strerror}); expected {what}.") from None
        self._reader = csv.reader(self._file, strict=True)
        header = self._next()
        if header is None:
            raise InputError(f"{path}: the file is empty; expected {what}.")
        self.header = tuple(cell.strip() for cell in header)
        for name in self.header:
            if self.header.count(name) > 1:
                raise InputError(f"{path}, line 1: the column '{name}' appears twice; keep one.")

    def take(self, number: int) -> Table:
        """The next rows, fewer where the table ends.

        Raises
        ------
        InputError
            If a row is ragged, or the text is not UTF-8 or no CSV.
        """
        rows: list[list[str]] = []
        lines: list[int] = []
        while len(rows) < number:
            cells = self._next()
            if cells is None:
                self._file.close()
                break
            if len(cells) != len(self.header):
                raise InputError(
                    f"{self.path}, line {self._reader.line_num}: {len(cells)} cells, but the header has {len(self.header)} columns."
                )
            rows.append(cells)
            lines.append(self._reader.line_num)
        return Table(self.path, self.header, rows, lines)

    def _next(self) -> list[str] | None:
        if self._file.closed:
            return None
        try:
            return next((cells for cells in self._reader if any(cell.strip() for cell in cells)), None)
        except UnicodeDecodeError:
            raise InputError(
                f"{self.path}: not UTF-8 after line {self._reader.line_num}; save the table as UTF-8 CSV."
            ) from None
        except csv.Error as error:
            raise InputError(f"{self.path}, line {self._reader.line_num}: not a CSV table ({error}).") from None
