"""Dialects of robot programs: one file each behind one small interface, recognised from content."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Protocol

from drake_stiffness.errors import InputError
from toolpaths.formats.krl import Krl
from toolpaths.formats.waypoints_csv import WaypointsCsv
from toolpaths.program import Program

# Spans are held as 32-bit offsets.
LARGEST_FILE = 2**31 - 1


class Dialect(Protocol):
    """What a dialect must do. A dialect is registered in `DIALECTS`."""

    @property
    def name(self) -> str:
        """Short name, as given to override recognition."""

    def recognises(self, raw: bytes, suffix: str) -> bool:
        """Whether a file is of this dialect, from its bytes first and its suffix (lower case, with dot) second."""

    def companions(self, path: Path) -> tuple[Path, ...]:
        """Files that hold points of this program and are read with it where they exist."""

    def parse(self, raw: bytes, path: str, others: Sequence[tuple[str, bytes]] = ()) -> Program:
        """Read a whole program and its companions (path and bytes of those that exist).

        A construct that cannot be corrected becomes a `Refusal`; InputError is for files without any use.
        """


# The order decides where two dialects recognise the same file.
DIALECTS: tuple[Dialect, ...] = (Krl(), WaypointsCsv())


def read_program(path: str | Path, dialect: str | None = None) -> Program:
    """Read a robot program.

    Parameters
    ----------
    path
        The file.
    dialect
        Name of the dialect; by default it is recognised from content.

    Raises
    ------
    InputError
        The file is missing, empty, of no known dialect, or has no motion.
    """
    path = Path(path)
    known = ", ".join(d.name for d in DIALECTS)
    chosen = next((d for d in DIALECTS if d.name == dialect), None)
    if dialect is not None and chosen is None:
        raise InputError(f"{path}: dialect {dialect!r} is not known; expected one of: {known}")
    raw = _read(path, known)
    if chosen is None:
        chosen = next((d for d in DIALECTS if d.recognises(raw, path.suffix.lower())), None)
    if chosen is None:
        start = raw[:40].decode("ascii", "backslashreplace")
        raise InputError(
            f"{path}: the content is of no known dialect; found {start!r} at its start, expected one of: {known}. "
            "Name the dialect if it is one of these, or export the program in one of them"
        )
    others = [(str(other), _read(other, known)) for other in chosen.companions(path) if other.is_file()]
    return chosen.parse(raw, str(path), others)


def read_again(program: Program, parts: Sequence[bytes]) -> Program:
    """A program with other bytes in its files, read by the same dialect."""
    dialect = next(d for d in DIALECTS if d.name == program.dialect)
    others = [(part.path, raw) for part, raw in zip(program.parts[1:], parts[1:], strict=True)]
    again = dialect.parse(parts[0], program.path, others)
    if len(again) != len(program):
        raise AssertionError("the corrected program reads as another number of motions")  # a fault of ours: exit code 1
    return again


def _read(path: Path, known: str) -> bytes:
    try:
        raw = path.read_bytes()
    except OSError as error:
        raise InputError(
            f"{path}: the program cannot be read ({error.strerror}); expected a file of: {known}"
        ) from error
    if not raw:
        raise InputError(f"{path}: the file is empty (0 bytes); expected a robot program: {known}. Export it again")
    if len(raw) > LARGEST_FILE:
        raise InputError(f"{path}: {len(raw)} bytes; expected less than 2 GiB. Split the program")
    if not raw.strip(b"\0 \t\r\n"):
        raise InputError(f"{path}: the file holds only NUL bytes and blanks; expected a robot program. Export it again")
    return raw
