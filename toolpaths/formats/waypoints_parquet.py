"""Waypoints as a Parquet table: the columns of the CSV dialect, read and written with pyarrow (an optional package).

A Parquet file has no printed digits, so its pose columns are read as text of enough decimals, corrected like any other
text, and only cells whose text has changed are written back. Everything else of the table - other columns, types, order,
metadata, compression - is kept; a file with nothing to change is the very same bytes.
"""

from __future__ import annotations

import io
import shutil
import tempfile
from collections.abc import Iterator, Sequence
from dataclasses import replace
from itertools import islice
from pathlib import Path
from types import ModuleType
from typing import IO, Any

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
# Bytes of a cell as text, about, and rows of which cells are replaced at once.
_CELL_BYTES = 13
_ROWS = 20_000


class WaypointsParquet(WaypointsCsv):
    """Parquet waypoints as a dialect: a table of waypoints whose text is made from the file, and put back into it."""

    name = "parquet"

    def recognises(self, raw: bytes, suffix: str) -> bool:
        """The mark at the start of every Parquet file."""
        return raw.startswith(MAGIC)

    def parse(self, raw: bytes, path: str, others: Sequence[tuple[str, bytes]] = ()) -> Program:
        """Read all rows; see ``toolpaths.formats.Dialect``. `raw` may also be the text of such a table (reading back).

        Line n of messages is row n - 1 of the table: line 1 are the names of the columns.

        Raises
        ------
        InputError
            pyarrow is not installed, the file is damaged, or what the CSV dialect refuses.
        """
        if not raw.startswith(MAGIC):
            return super().parse(raw, path)
        file = _opened(io.BytesIO(raw), path)
        text = b"\n".join([_header(file, path), *_lines(file, path, file.metadata.num_rows or 1)])
        return replace(super().parse(text, path), container=raw)

    def length(self, path: Path) -> int:
        """About how many bytes the text of a file has; see ``toolpaths.formats.Packed``."""
        file = _opened(path, str(path))
        return int(file.metadata.num_rows) * len(_header(file, str(path)).split(b",")) * _CELL_BYTES

    def blocks(self, path: Path, size: int) -> Iterator[bytes]:
        """The text of a file, block by block; see ``toolpaths.formats.Packed``."""
        file = _opened(path, str(path))
        header = _header(file, str(path))
        rows = max(size // (len(header.split(b",")) * _CELL_BYTES), 1)
        yield header
        for lines in _lines(file, str(path), rows):
            yield b"\n" + lines

    def pack(self, path: Path, text: Path) -> None:
        """Put what a file now says in place of the corrected text; see ``toolpaths.formats.Packed``."""
        with text.open("rb") as lines, tempfile.TemporaryFile(dir=text.parent) as out:
            names = next(lines).strip().decode().split(",")
            changed = _put_back(_opened(path, str(path)), str(path), names, (line.rstrip(b"\n") for line in lines), out)
            out.seek(0)
            with path.open("rb") as same, text.open("wb") as packed:
                shutil.copyfileobj(out if changed else same, packed)


def with_cells(program: Program, text: bytes) -> bytes:
    """The Parquet file of a program with the cells that differ in `text` replaced."""
    assert program.container is not None
    header, *lines = text.split(b"\n")
    out = io.BytesIO()
    file = _opened(io.BytesIO(program.container), program.path)
    _put_back(file, program.path, header.decode().split(","), iter(lines), out)
    return out.getvalue()


def _put_back(file: Any, path: str, names: list[str], lines: Iterator[bytes], out: IO[bytes]) -> bool:
    """Write a file with other texts of its waypoints, row group by row group; whether any cell has changed."""
    pyarrow, parquet = _pyarrow(path)
    first = file.metadata.row_group(0)
    packed = {first.column(c).path_in_schema: first.column(c).compression for c in range(first.num_columns)}
    any_changed = False
    with parquet.ParquetWriter(
        out, file.schema_arrow, compression=packed, version=file.metadata.format_version
    ) as writer:
        for group in range(file.num_row_groups):
            tables = []
            for table in _tables(file, path, _ROWS, row_groups=[group]):
                now, changed = _changed(table, path, names, islice(lines, table.num_rows))
                any_changed |= changed
                tables.append(now)
            whole = pyarrow.concat_tables(tables) if tables else file.schema_arrow.empty_table()
            writer.write_table(whole, row_group_size=max(whole.num_rows, 1))
    return any_changed


def _changed(table: Any, path: str, names: list[str], lines: Iterator[bytes]) -> tuple[Any, bool]:
    """A table with the cells replaced whose text has changed, and whether there are any."""
    pyarrow, _ = _pyarrow(path)
    columns: dict[str, Any] = {}
    for row, (old, new) in enumerate(zip(_text(table, path).split(b"\n"), lines, strict=True)):
        if old == new:
            continue
        for name, before, after in zip(names, old.split(b","), new.split(b","), strict=True):
            if before != after:
                columns.setdefault(name, table[name].to_numpy().copy())[row] = float(after)
    for name, values in columns.items():
        place = table.schema.get_field_index(name)
        field = table.schema.field(place)
        table = table.set_column(place, field, pyarrow.array(values, type=field.type))
    return table, bool(columns)


def _opened(source: Path | IO[bytes], path: str) -> Any:
    pyarrow, parquet = _pyarrow(path)
    try:
        return parquet.ParquetFile(source)
    except (pyarrow.ArrowException, OSError) as error:
        raise _unreadable(path, error) from None


def _tables(file: Any, path: str, rows: int, **of: Any) -> Iterator[Any]:
    """A file in tables of so many rows."""
    pyarrow, _ = _pyarrow(path)
    try:
        for batch in file.iter_batches(batch_size=rows, **of):
            yield pyarrow.Table.from_batches([batch])
    except (pyarrow.ArrowException, OSError) as error:
        raise _unreadable(path, error) from None


def _unreadable(path: str, error: Exception) -> InputError:
    return InputError(f"{path}: the Parquet file cannot be read: {str(error).splitlines()[0]}. Export it again")


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


def _header(file: Any, path: str) -> bytes:
    """The names of the columns that the CSV dialect reads.

    Raises
    ------
    InputError
        There are none, or one is of a type that holds no coordinates.
    """
    schema = file.schema_arrow
    fields = [field for field in schema if _is_read(field.name)]
    if not fields:
        raise InputError(f"{path}: no column x_mm .. c_deg in the table; found {', '.join(schema.names)}")
    for field in fields:
        if COLUMN.fullmatch(field.name.lower()) is not None and str(field.type) not in ("double", "float"):
            raise InputError(
                f"{path}: column '{field.name}' is of type {field.type}; expected double or float (float64, float32)"
            )
    return ",".join(field.name for field in fields).encode()


def _is_read(name: str) -> bool:
    return name.lower() in ("kind", "feed_mm_per_min") or COLUMN.fullmatch(name.lower()) is not None


def _lines(file: Any, path: str, rows: int) -> Iterator[bytes]:
    """The text of a file, so many rows at a time."""
    columns = _header(file, path).decode().split(",")
    return (_text(table, path) for table in _tables(file, path, rows, columns=columns))


def _text(table: Any, path: str) -> bytes:
    """The columns that the CSV dialect reads, as lines of CSV."""
    columns = []
    for place, name in enumerate(table.column_names):
        match = COLUMN.fullmatch(name.lower())
        if name.lower() == "kind":
            cells = ["" if value is None else str(value) for value in table.column(place).to_pylist()]
            columns.append(['"' + cell.replace('"', "").replace("\n", " ") + '"' for cell in cells])
        elif name.lower() == "feed_mm_per_min":
            columns.append([str(value) for value in table.column(place).to_numpy()])
        elif match is not None:
            decimals = _DECIMALS.get((str(table.schema.field(place).type), match["unit"]), 9)
            columns.append([f"{value:.{decimals}f}" for value in table.column(place).to_numpy()])
    return "\n".join(",".join(cells) for cells in zip(*columns, strict=True)).encode()
