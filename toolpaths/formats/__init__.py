"""Dialects of robot programs: one file each behind one small interface, recognised from content."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Protocol, runtime_checkable

from drake_stiffness.errors import InputError
from toolpaths.formats.apt import Apt
from toolpaths.formats.fanuc import Fanuc
from toolpaths.formats.gcode import GCode
from toolpaths.formats.krl import Krl
from toolpaths.formats.krl_points import naming_note
from toolpaths.formats.rapid import Rapid
from toolpaths.formats.urscript import UrScript
from toolpaths.formats.val3 import Val3
from toolpaths.formats.waypoints_csv import WaypointsCsv
from toolpaths.formats.waypoints_parquet import WaypointsParquet, with_cells
from toolpaths.program import Program
from toolpaths.rotary import with_meaning

# Spans are held as 32-bit offsets.
LARGEST_FILE = 2**31 - 1


# Dialects whose points may stand in other files than the motions.
OF_SEVERAL_FILES = (Krl.name, Rapid.name, Val3.name)


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


@runtime_checkable
class InPieces(Protocol):
    """A dialect whose programs can be read piece by piece, so that their length costs no memory."""

    def cut(self, raw: bytes) -> int:
        """Where the last place is at which these bytes may be cut in two, 0 for none."""

    def parse_piece(
        self, raw: bytes, path: str, resume: object, others: Sequence[tuple[str, bytes]] = (), last: bool = False
    ) -> tuple[Program, object]:
        """Read a piece, given what the piece before handed on (None: the first), and what this one hands on. `last`: no other follows.

        Its first row stands for the last motion before it and is no row of its own. A piece may end earlier than the bytes
        given; the next one begins there.
        """


@runtime_checkable
class Packed(InPieces, Protocol):
    """A dialect whose files are no text: `Program.raw` is what they say as text, and pieces are pieces of that."""

    def length(self, path: Path) -> int:
        """About how many bytes of text a file holds."""

    def blocks(self, path: Path, size: int) -> Iterator[bytes]:
        """The text of a file in blocks of about so many bytes."""

    def pack(self, path: Path, text: Path) -> None:
        """Overwrite a file that holds the corrected text of `path` with the corrected file itself."""


# The order decides where two dialects recognise the same file.
DIALECTS: tuple[Dialect, ...] = (
    WaypointsParquet(),
    Rapid(),
    Fanuc(),
    UrScript(),
    Val3(),
    Krl(),
    WaypointsCsv(),
    Apt(),
    GCode(),
)


def read_program(path: str | Path, dialect: str | None = None, beside: Sequence[Path] = ()) -> Program:
    """Read a robot program.

    Parameters
    ----------
    path
        The file.
    dialect
        Name of the dialect; by default it is recognised from content.
    beside
        Further files of the program that hold points, besides those that its dialect finds itself.

    Raises
    ------
    InputError
        The file is missing, empty, of no known dialect, or has no motion; a further file is missing, or its dialect knows none.
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
    if beside and chosen.name not in OF_SEVERAL_FILES:
        raise InputError(
            f"{path}: --with {beside[0]}: a program of the dialect {chosen.name} has one file; further files with points are read for "
            f"{', '.join(OF_SEVERAL_FILES)}"
        )
    found = [other for other in chosen.companions(path) if other.is_file()]
    seen = {other.resolve() for other in (path, *found)}
    for other in beside:
        if other.resolve() not in seen:
            if other.name.lower() in {file.name.lower() for file in (path, *found)}:
                raise InputError(
                    f"{other}: the program has another file of this name, and both would be written under one; rename it"
                )
            found.append(other)
            seen.add(other.resolve())
    return chosen.parse(raw, str(path), [(str(other), _read(other, known)) for other in found])


def read_again(program: Program, parts: Sequence[bytes]) -> Program:
    """A program with other bytes in its files, read by the same dialect."""
    dialect = dialect_of(program)
    if program.resume is not None and isinstance(dialect, InPieces):
        again, _ = dialect.parse_piece(parts[0], program.path, program.resume)
    else:
        others = [(part.path, raw) for part, raw in zip(program.parts[1:], parts[1:], strict=True)]
        again = dialect.parse(parts[0], program.path, others)
    if len(again) != len(program):
        raise AssertionError("the corrected program reads as another number of motions")  # a fault of ours: exit code 1
    return with_meaning(again, program.convention, program.unit[3:])


def dialect_of(program: Program) -> Dialect:
    """The dialect that read a program."""
    return next(d for d in DIALECTS if d.name == program.dialect)


def files_of(program: Program, parts: Sequence[bytes]) -> tuple[bytes, ...]:
    """The bytes to write for a program whose parts now read so, one entry a file."""
    if program.container is None:
        return tuple(parts)
    return (program.container if parts[0] == program.raw else with_cells(program, parts[0]),)


def paths_beside(program: Program, output: Path) -> list[Path]:
    """Where the further files of a program go: beside the output, under its name and their suffix, or their name too where they are many."""
    own = Path(program.path)
    others = [Path(part.path) for part in program.parts[1:]]
    suffixes = [file.suffix.lower() for file in (own, *others)]
    paths: list[Path] = []
    for other in others:
        short = output.with_suffix(other.suffix)
        belongs = suffixes.count(other.suffix.lower()) == 1 or other.stem.lower() == own.stem.lower()
        free = belongs and output.suffix.lower() != other.suffix.lower() and short not in paths
        paths.append(short if free else output.with_name(f"{output.stem}_{other.name}"))
    return paths


def naming_notes(program: Program, output: Path) -> list[str]:
    """What the user should know of the names under which the files of a program are written."""
    if program.dialect == Val3.name and len(program.parts) > 1:
        return [
            "the corrected points are in the .dtx beside the output; the application's .pjx names its files: give both the names of "
            "the originals"
        ]
    if program.dialect != Krl.name or len(program.parts) < 2:
        return []
    names = [path.stem for path in paths_beside(program, output)]
    found = [
        naming_note(program.raw[part.start : part.end], name, output.stem)
        for part, name in zip(program.parts[1:], names, strict=True)
    ]
    return [note for note in found if note is not None]


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
