"""Waypoints as a Parquet table: the columns of the CSV dialect, read and written with pyarrow (an optional package).

A Parquet file has no printed digits, so its pose columns are read as text of enough decimals, corrected like any other
text, and only cells whose text has changed are written back. Everything else of the table - other columns, types, order,
metadata, compression - is kept; a file with nothing to change is the very same bytes.
"""

from __future__ import annotations

import io
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from types import ModuleType
from typing import Any

from drake_stiffness.errors import InputError
from toolpaths.formats.waypoints_csv import COLUMN, WaypointsCsv
from toolpaths.program import Program

MAGIC = b"PAR1"
# Decimals by type and unit: what a float64 holds exactly, and what a float32 of a few metres or turns can hold.
_DECIMALS = {
    ("double", "mm"): 9,
    ("double", "m"): 12,
    ("double", "deg"): 9,
    ("double", "rad"): 11,
    ("float", "mm"): 3,
    ("float", "m"): 6,
    ("float", "deg"): 4,
    ("float", "rad"): 6,
}


class WaypointsParquet:
    """Parquet waypoints as a dialect."""

    name = "parquet"

    def recognises(self, raw: bytes, suffix: str) -> bool:
        """The mark at the start of every Parquet file."""
        return raw.startswith(MAGIC)

    def companions(self, path: Path) -> tuple[Path, ...]:
        """None."""
        return ()

    def parse(self, raw: bytes, path: str, others: Sequence[tuple[str, bytes]] = ()) -> Program:
        """Read all rows; see ``toolpaths.formats.Dialect``. `raw` may also be the text of such a table (reading back).

        Line n of messages is row n - 1 of the table: line 1 are the names of the columns.

        Raises
        ------
        InputError
            pyarrow is not installed, the file is damaged, or what the CSV dialect refuses.
        """
        if not raw.startswith(MAGIC):
            return replace(WaypointsCsv().parse(raw, path), dialect=self.name)
        text = _text(_table(raw, path), path)
        return replace(WaypointsCsv().parse(text, path), dialect=self.name, container=raw)


def with_cells(program: Program, text: bytes) -> bytes:
    """The Parquet file of a program with the cells that differ in `text` replaced."""
    pyarrow, parquet = _pyarrow(program.path)
    assert program.container is not None
    file = parquet.ParquetFile(io.BytesIO(program.container))
    table = file.read()
    names = program.raw.partition(b"\n")[0].decode().split(",")
    columns: dict[str, Any] = {}
    for row, (old, new) in enumerate(zip(program.raw.split(b"\n")[1:], text.split(b"\n")[1:], strict=True)):
        if old == new:
            continue
        for name, before, after in zip(names, old.split(b","), new.split(b","), strict=True):
            if before != after:
                columns.setdefault(name, table[name].to_numpy().copy())[row] = float(after)
    for name, values in columns.items():
        place = table.schema.get_field_index(name)
        field = table.schema.field(place)
        table = table.set_column(place, field, pyarrow.array(values, type=field.type))
    first = file.metadata.row_group(0)
    packed = {first.column(c).path_in_schema: first.column(c).compression for c in range(first.num_columns)}
    out = io.BytesIO()
    parquet.write_table(
        table, out, compression=packed, row_group_size=first.num_rows, version=file.metadata.format_version
    )
    return out.getvalue()


def _table(raw: bytes, path: str) -> Any:
    pyarrow, parquet = _pyarrow(path)
    try:
        return parquet.read_table(io.BytesIO(raw))
    except (pyarrow.ArrowException, OSError) as error:
        raise InputError(
            f"{path}: the Parquet file cannot be read: {str(error).splitlines()[0]}. Export it again"
        ) from None


def _pyarrow(path: str) -> tuple[ModuleType, ModuleType]:
    try:
        import pyarrow
        import pyarrow.parquet
    except ImportError:
        raise InputError(
            f"{path}: reading Parquet needs the package pyarrow, which is not installed; install it "
            "(pip install 'drake-stiffness[parquet]') or export the table as CSV"
        ) from None
    return pyarrow, pyarrow.parquet


def _text(table: Any, path: str) -> bytes:
    """The columns that the CSV dialect reads, as CSV."""
    columns = []
    for place, name in enumerate(table.column_names):
        match = COLUMN.fullmatch(name.lower())
        if name.lower() == "kind":
            cells = ["" if value is None else str(value) for value in table.column(place).to_pylist()]
            columns.append([name, *('"' + cell.replace('"', "").replace("\n", " ") + '"' for cell in cells)])
        elif name.lower() == "feed_mm_per_min":
            columns.append([name, *(str(value) for value in table.column(place).to_numpy())])
        elif match is not None:
            stored = str(table.schema.field(place).type)
            decimals = _DECIMALS.get((stored, match["unit"]), 9)
            if stored not in ("double", "float"):
                raise InputError(
                    f"{path}: column '{name}' is of type {stored}; expected double or float (float64, float32)"
                )
            columns.append([name, *(f"{value:.{decimals}f}" for value in table.column(place).to_numpy())])
    if not columns:
        raise InputError(f"{path}: no column x_mm .. c_deg in the table; found {', '.join(table.column_names)}")
    return "\n".join(",".join(cells) for cells in zip(*columns, strict=True)).encode()
