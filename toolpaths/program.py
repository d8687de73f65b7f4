"""A robot program: its bytes, the spans of its pose words, its waypoints as arrays.

A program is never printed anew: what is read are the places of its number tokens (``toolpaths.rewriting`` replaces some
of them). The dialects (``toolpaths.formats``) fill a `Program`; nothing here knows a dialect.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

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
    blend_mm
        (N,) distance from the point at which the controller may leave the programmed path: 0 where it goes to the point itself,
        infinite where the distance depends on speed, NaN where the program does not say it.
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
    blend_mm: Floats
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
