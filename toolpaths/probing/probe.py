"""What a probe found on the part that was cut: a table of places and deviations."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from drake_stiffness.errors import InputError
from drake_stiffness.tables import Table, read_table

Floats = NDArray[np.float64]
Ints = NDArray[np.int_]
CutWith = Literal["uncorrected", "corrected"]

_LENGTH = ("_mm", "_m", "_um")
# A deviation of so much is a slip, or absolute positions in the wrong columns.
_LARGEST_M = 0.05


@dataclass(frozen=True, eq=False)
class Probe:
    """M probed places.

    Attributes
    ----------
    path : Path
    nominal_mm : (M, 3)
        Where the part should be, in the program's base frame.
    deviation_mm : (M, 3)
        Measured minus nominal, in that frame; along `normal` only where that is known.
    normal : (M, 3)
        Unit direction the deviation is known along; NaN where all three components are.
    line : (M,)
        Line of the program that cut the place; -1 where not said.
    sigma_mm : (M,)
        Standard deviation of one coordinate; NaN where not said.
    table_line : (M,)
        Line of the table.
    """

    path: Path
    nominal_mm: Floats
    deviation_mm: Floats
    normal: Floats
    line: Ints
    sigma_mm: Floats
    table_line: Ints

    @property
    def size(self) -> int:
        return self.line.size

    @property
    def along_normal(self) -> NDArray[np.bool_]:
        """(M,) places whose deviation is known along a normal only."""
        return np.asarray(np.isfinite(self.normal).all(axis=1))

    def take(self, which: NDArray[np.bool_]) -> Probe:
        """Some of the places."""
        return Probe(
            self.path,
            self.nominal_mm[which],
            self.deviation_mm[which],
            self.normal[which],
            self.line[which],
            self.sigma_mm[which],
            self.table_line[which],
        )


def read_probe(path: Path | str) -> Probe:
    """Read a probe table (docs/reference.md).

    Columns `x_mm, y_mm, z_mm` (nominal place in the program's base frame) and either `dx_mm, dy_mm, dz_mm` or `deviation_mm` with
    `nx, ny, nz`; optional `line`, `sigma_mm`. `_m` and `_um` serve as well.

    Raises
    ------
    InputError
        With line and column.
    """
    table = read_table(path, "a probe table with columns x_mm, y_mm, z_mm, dx_mm, dy_mm, dz_mm")
    lengths = {stem + unit for stem in ("x", "y", "z", "dx", "dy", "dz", "deviation", "sigma") for unit in _LENGTH}
    table.refuse_unknown(lengths | {"nx", "ny", "nz", "line"}, allowed_prefix="note")
    place = _three(table, ("x", "y", "z"))
    by_normal = any(name.startswith("deviation") for name in table.header)
    by_axes = any(name.startswith(("dx", "dy", "dz")) for name in table.header)
    if by_normal == by_axes:
        raise InputError(
            f"{table.path}: give either dx_mm, dy_mm, dz_mm or deviation_mm with nx, ny, nz. Columns found: {', '.join(table.header)}."
        )
    normal = np.full(place.shape, np.nan)
    if by_normal:
        size = table.quantity("deviation", _LENGTH, required=True)
        assert size is not None
        normal = _normals(table)
        deviation = size[:, None] * normal
    else:
        deviation = _three(table, ("dx", "dy", "dz"))
    for row in np.flatnonzero(np.linalg.norm(deviation, axis=1) > _LARGEST_M)[:1].tolist():
        raise InputError(
            f"{table.path}, line {table.lines[row]}: a deviation of {1e3 * np.linalg.norm(deviation[row]):.4g} mm; expected measured minus "
            f"nominal, less than {1e3 * _LARGEST_M:g} mm. Is it an absolute position, or the unit wrong?"
        )
    sigma = table.quantity("sigma", _LENGTH, required=False, empty=np.nan)
    if sigma is not None:
        for row in np.flatnonzero(sigma <= 0)[:1].tolist():
            raise InputError(f"{table.path}, line {table.lines[row]}: sigma is {sigma[row]:g}; expected more than 0.")
    line = table.numbers("line", empty=-1.0) if "line" in table.header else np.full(len(table.rows), -1.0)
    return Probe(
        path=Path(path),
        nominal_mm=place * 1e3,
        deviation_mm=deviation * 1e3,
        normal=normal,
        line=line.astype(int),
        sigma_mm=np.full(len(table.rows), np.nan) if sigma is None else sigma * 1e3,
        table_line=np.array(table.lines),
    )


def _three(table: Table, stems: tuple[str, str, str]) -> Floats:
    columns = [table.quantity(stem, _LENGTH, required=True) for stem in stems]
    return np.stack([column for column in columns if column is not None], axis=1)


def _normals(table: Table) -> Floats:
    for name in ("nx", "ny", "nz"):
        if name not in table.header:
            raise InputError(
                f"{table.path}: deviation_mm needs the normal it was measured along: column '{name}' is missing."
            )
    normal = np.stack([table.numbers(name) for name in ("nx", "ny", "nz")], axis=1)
    length = np.linalg.norm(normal, axis=1)
    for row in np.flatnonzero((length < 0.9) | (length > 1.1))[:1].tolist():
        raise InputError(
            f"{table.where(row, 'nx')}: the normal has the length {length[row]:.4g}; expected a direction of length 1."
        )
    return normal / length[:, None]
