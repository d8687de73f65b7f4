"""A robot program: its bytes, the spans of its pose words, its waypoints as arrays.

A program is never printed anew: what is read are the places of its number tokens (``toolpaths.rewriting`` replaces some
of them). The dialects (``toolpaths.formats``) fill a `Program`; nothing here knows a dialect.
"""

from __future__ import annotations

import math
from array import array
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import chain

import numpy as np
from numpy.typing import NDArray

from toolpaths.conventions import KUKA, Convention
from toolpaths.printed import print_quanta

Floats = NDArray[np.float64]
Ints = NDArray[np.int32]
Bools = NDArray[np.bool_]

POSITION_WORDS = ("X", "Y", "Z")
UNWRITTEN = (-1, -1)
EXTERNALS = 6
NO_STATUS = (-1, -1, -1)


@dataclass(frozen=True)
class Part:
    """One file of a program: its path and the bytes of `Program.raw` that are its own."""

    path: str
    start: int
    end: int


@dataclass(frozen=True)
class Refusal:
    """A line that is left as it is, and why.

    Attributes
    ----------
    line
        1-based line of the program, or of the file that `path` names.
    reason
        What was found and why it cannot be corrected.
    words
        Words that the correction needs and the line does not write.
    column
        1-based byte column of what was found, where one place can be named.
    carries_force
        Whether the motion carries force, so that leaving it uncorrected costs accuracy.
    fatal
        Whether the construct makes the other lines unsafe to correct too.
    path
        The file, where it is not the program's first.
    """

    line: int
    reason: str
    words: tuple[str, ...] = ()
    column: int | None = None
    carries_force: bool = True
    fatal: bool = False
    path: str | None = None


@dataclass(frozen=True)
class Replacement:
    """Lines of the program as it was, and the lines that have taken their place.

    Attributes
    ----------
    line, before
        First 1-based line in the program as it was, and its text.
    new_line, after
        First 1-based line in the program as it is, and its text.
    """

    line: int
    before: str
    new_line: int
    after: str


def line_before(replaced: Sequence[Replacement], line: int) -> int:
    """The line of the program as it was that stands on a line of the program as it is, or whose place that line has taken."""
    shift = 0
    for change in replaced:
        last = change.new_line + change.after.count("\n") - (not change.after)
        if line < change.new_line:
            break
        if line <= last:
            return change.line
        shift = change.line + change.before.count("\n") - last
    return line + shift


@dataclass(frozen=True)
class FrameSetting:
    """A line that sets the base frame or the tool.

    Attributes
    ----------
    line
        1-based line of the program.
    what
        ``"base"`` or ``"tool"``.
    origin
        ``"literal"``, ``"controller"`` (data stored there, by number) or ``"expression"``.
    pose
        Literal X, Y, Z (mm) and orientation words, NaN for a word not written; None for other origins.
    text
        The setting as written.
    convention
        What the orientation words of `pose` mean.
    key
        What tells this frame from others, where that is not the last number of `text` (a name or number in the controller).
    """

    line: int
    what: str
    origin: str
    pose: tuple[float, ...] | None
    text: str
    convention: Convention = KUKA
    key: str | None = None


@dataclass(frozen=True, eq=False)
class Program:
    """A program and the N literal poses of its motions, in the order in which they run.

    A pose has 3 + K words: X, Y, Z and the K orientation words of its convention.

    Attributes
    ----------
    raw
        The bytes of all files of the program, one after the other.
    dialect, path
        Who read it, and from where.
    parts
        The files: the one with the motions first, then those that hold points (a KRL ``.dat``).
    convention
        What the orientation words mean.
    line
        (N,) 1-based line of the motion.
    kind
        (N,) motion in upper case: LIN, SLIN, PTP, CIRC, ...
    role
        (N,) "point", or "via" and "end" for the two poses of an arc (two rows on one line).
    carries_force
        (N,) linear and circular motions do; point-to-point motions and rapids do not and are never changed.
    refused
        (N,) rows that `refusals` say cannot be corrected.
    position_mm, orientation
        (N, 3) and (N, K) effective pose: words not written keep their value. NaN where no line says it.
    external
        (N, 6) E1..E6 in mm or deg, NaN where not known.
    status
        (N, 3) what the program says of the arm's branch - shoulder, elbow, wrist - as 0 or 1; -1 where it says nothing.
        Only changes along the program are read: what 0 and 1 mean is learnt from the posture it starts in.
    feed_mm_per_min
        (N,) programmed feed, NaN where the program does not say it.
    span
        (N, 3 + K, 2) byte start and end of the number tokens of the words, -1 where this row does not write the word. Motions
        that go to one stored point have the same spans.
    source
        (N, 3 + K) row whose token gives each word, -1 where none does; for a stored point the first row that goes there.
    also
        (M, 3) further (row, word, source) for words that two rows could give alike.
    body
        (N,) byte offset at which the words of the pose begin, -1 where the dialect cannot insert words.
    unit
        (3 + K,) mm, or units of the convention, per unit of the token.
    follows
        (N,) whether the motion starts where the row before ends; not so after a motion whose target is not known.
    frames, refusals, notes, warnings
        Frames the program sets; what cannot be corrected; motions without force whose pose is not known; the rest.
    container
        The file as it is, where `raw` is only its text (Parquet).
    resume
        What a piece of a longer program takes over from the pieces before it (its dialect knows what that is).
    spaced_words
        Whether words follow each other without commas, as in G-code.
    replaced
        Lines that straight moves have taken the place of before the program was read.
    """

    raw: bytes
    dialect: str
    path: str
    parts: tuple[Part, ...]
    convention: Convention
    line: Ints
    kind: NDArray[np.str_]
    role: NDArray[np.str_]
    carries_force: Bools
    refused: Bools
    position_mm: Floats
    orientation: Floats
    external: Floats
    status: Ints
    feed_mm_per_min: Floats
    span: Ints
    source: Ints
    also: Ints
    body: Ints
    unit: Floats
    follows: Bools
    frames: tuple[FrameSetting, ...] = ()
    refusals: tuple[Refusal, ...] = ()
    notes: tuple[Refusal, ...] = ()
    warnings: tuple[str, ...] = ()
    container: bytes | None = None
    resume: object = None
    spaced_words: bool = False
    replaced: tuple[Replacement, ...] = ()

    def __len__(self) -> int:
        return len(self.line)

    @property
    def words(self) -> tuple[str, ...]:
        """Names of the 3 + K words of a pose."""
        return (*POSITION_WORDS, *self.convention.words)

    @property
    def pose(self) -> Floats:
        """(N, 3 + K) position and orientation words, mm and units of the convention."""
        return np.concatenate([self.position_mm, self.orientation], axis=1)

    @property
    def corrected(self) -> Bools:
        """(N,) rows a correction may change: they carry force and are not refused."""
        return self.carries_force & ~self.refused

    @cached_property
    def written(self) -> Bools:
        """(N, 3 + K) words that the row itself writes, or the stored point it goes to."""
        return self.span[..., 0] >= 0

    @cached_property
    def position_only(self) -> Bools:
        """(N,) rows whose orientation is never changed.

        These are the rows that write no orientation word, and the rows such a row keeps its orientation from: correcting
        that would turn the tool in all of them. Auxiliary points without orientation ask nothing of other rows.
        """
        only: Bools = np.logical_not(self.written[:, 3:].any(axis=1))
        keeping = only & ~self.free_orientation
        givers = np.concatenate([self.source[keeping][:, 3:].ravel(), self.also[keeping[self.also[:, 0]], 2]])
        only[givers[givers >= 0]] = True
        return only

    @cached_property
    def free_orientation(self) -> Bools:
        """(N,) auxiliary points of arcs that write no orientation: it is the controller's business.

        A CIRC disregards the orientation of its auxiliary point; what such a point keeps from the line before must not
        hold back the correction of that line.
        """
        return np.logical_and(self.role == "via", ~self.written[:, 3:].any(axis=1))

    @cached_property
    def quantum(self) -> Floats:
        """(N, 3 + K) worth of one printed digit of each word the row writes, NaN where it writes none."""
        return print_quanta(self.raw, self.span) * self.unit


def quantum_mm(program: Program) -> Floats:
    """Half a printed digit of the position of each row, mm: no correction can be printed more finely.

    Returns
    -------
    (N,) the largest over X, Y and Z; for a word not written that of the line it is kept from; NaN where unknown.
    """
    return _half_quantum(program, slice(0, 3))


def quantum_deg(program: Program) -> Floats:
    """Half a printed digit of the orientation of each row, deg; otherwise as `quantum_mm`. NaN without orientation words."""
    if not program.convention.words:
        return np.full(len(program), np.nan)
    return _half_quantum(program, slice(3, None)) * program.convention.degrees


def _half_quantum(program: Program, words: slice) -> Floats:
    source = program.source[:, words]
    given = np.take_along_axis(program.quantum[:, words], np.maximum(source, 0), axis=0) if len(program) else source
    return 0.5 * np.where(source >= 0, given, np.nan).max(axis=1)


class ProgramBuilder:
    """Collects rows while a dialect reads, and keeps the values of words that later rows may leave out.

    Rows are held in compact arrays, never as objects. `values` (the 3 + K words, then E1..E6) and `source` are the pose the
    machine is in after the rows so far: NaN and -1 where unknown. `status` and `feed_mm_per_min` are those of the next row.
    """

    def __init__(self, convention: Convention = KUKA) -> None:
        self.convention = convention
        self.width = len(POSITION_WORDS) + len(convention.words)
        self.values = [math.nan] * (self.width + EXTERNALS)
        self.source = [-1] * self.width
        self._stored: dict[object, int] = {}
        self.status: tuple[int, int, int] = NO_STATUS
        self.feed_mm_per_min = math.nan
        self.also = array("i")
        self._line, self._body, self._source, self._span = array("i"), array("i"), array("i"), array("i")
        self._poses, self._feed = array("d"), array("d")
        self._status = array("b")
        self._kind: list[str] = []
        self._role: list[str] = []
        self._flags = bytearray()
        self._moved = True

    def __len__(self) -> int:
        return len(self._line)

    def forget(self, *, moved: bool = True) -> None:
        """From here on, the words of the pose are not known; with `moved` not even where the machine stands."""
        self._moved = self._moved or moved
        self.values = [math.nan] * (self.width + EXTERNALS)
        self.source = [-1] * self.width

    def forget_place(self) -> None:
        """The next row does not start where the last one ends, though the words of the pose are known."""
        self._moved = True

    @property
    def moved(self) -> bool:
        """Whether the next row starts from a place that is not known."""
        return self._moved

    def last_status(self) -> tuple[int, int, int]:
        """What was last said of each bit of the branch; -1 where nothing was."""
        said = np.frombuffer(self._status, dtype=np.int8).reshape(-1, 3)
        last = [int(bit[bit >= 0][-1]) if (bit >= 0).any() else -1 for bit in said.T]
        return last[0], last[1], last[2]

    def update(self, numbers: Iterable[bytes | None]) -> None:
        """Take over the words that are written (None: not written) into the pose that the next row will have."""
        row, values, source, width = len(self._line), self.values, self.source, self.width
        for word, token in enumerate(numbers):
            if token is not None:
                values[word] = float(token)
                if word < width:
                    source[word] = row

    def update_stored(self, point: object, numbers: Iterable[bytes | None]) -> None:
        """As `update`, for a point that is stored once and may be gone to more than once."""
        first = self._stored.setdefault(point, len(self._line))
        tokens = list(numbers)
        self.update(tokens)
        for word in range(self.width):
            if tokens[word] is not None:
                self.source[word] = first

    def add(
        self,
        line: int,
        kind: str,
        role: str,
        span: Iterable[tuple[int, int]],
        body: int,
        *,
        carries_force: bool,
        refused: bool,
    ) -> None:
        """Append a row with the present pose."""
        self._line.append(line)
        self._kind.append(kind)
        self._role.append(role)
        self._flags.append(carries_force + 2 * refused + 4 * (not self._moved))
        self._moved = False
        self._poses.extend(self.values)
        self._source.extend(self.source)
        self._span.extend(chain.from_iterable(span))
        self._body.append(body)
        self._status.extend(self.status)
        self._feed.append(self.feed_mm_per_min)

    def line(self, row: int) -> int:
        """Line of a row."""
        return self._line[row]

    def carries_force(self, row: int) -> bool:
        """Whether a row is of a motion that carries force."""
        return self._flags[row] & 1 == 1

    def refuse(self, row: int) -> None:
        """Mark a row that turns out not to be correctable after all; both rows of an arc."""
        other = {"via": row + 1, "end": row - 1}.get(self._role[row], row)
        for mine in (row, other):
            self._flags[mine] |= 2

    def build(
        self,
        raw: bytes,
        dialect: str,
        path: str,
        unit: Floats | None = None,
        others: Iterable[tuple[str, bytes]] = (),
        **said: object,
    ) -> Program:
        """The program.

        Parameters
        ----------
        raw, path
            The file with the motions.
        unit
            (3 + K,) scales words from tokens to mm and units of the convention.
        others
            Path and bytes of further files; their spans count on from the end of the file before.
        said
            Frames, refusals, notes, warnings.
        """
        count, width = len(self._line), self.width
        unit = np.ones(width) if unit is None else unit
        files = [(path, raw), *others]
        ends = np.cumsum([len(content) for _, content in files]).tolist()
        parts = tuple(Part(name, end - len(content), end) for (name, content), end in zip(files, ends, strict=True))
        poses = np.frombuffer(self._poses, dtype=float).reshape(count, width + EXTERNALS)
        flags = np.frombuffer(bytes(self._flags), dtype=np.uint8)
        return Program(
            raw=b"".join(content for _, content in files) if len(files) > 1 else raw,
            dialect=dialect,
            path=path,
            parts=parts,
            convention=self.convention,
            line=_ints(self._line, count),
            kind=np.array(self._kind, dtype=np.str_),
            role=np.array(self._role, dtype=np.str_),
            carries_force=(flags & 1) == 1,
            refused=(flags & 2) == 2,
            position_mm=poses[:, :3] * unit[:3],
            orientation=poses[:, 3:width] * unit[3:],
            external=poses[:, width:].copy(),
            status=np.frombuffer(self._status, dtype=np.int8).reshape(count, 3).astype(np.int32),
            feed_mm_per_min=np.frombuffer(self._feed, dtype=float).copy(),
            span=_ints(self._span, count, width, 2),
            source=_ints(self._source, count, width),
            also=_ints(self.also, len(self.also) // 3, 3),
            body=_ints(self._body, count),
            unit=unit,
            follows=(flags & 4) == 4,
            **said,  # type: ignore[arg-type]
        )


def _ints(values: array[int], *shape: int) -> Ints:
    return np.frombuffer(values, dtype=np.int32).reshape(shape).copy()
