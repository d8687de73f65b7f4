"""A robot program: its bytes, the spans of its pose words, its waypoints as arrays.

A program is never printed anew: what is read are the places of its number tokens (``toolpaths.rewriting`` replaces some
of them). The dialects (``toolpaths.formats``) fill a `Program`; nothing here knows a dialect.
"""

from __future__ import annotations

from array import array
from collections.abc import Iterable
from dataclasses import dataclass
from functools import cached_property
from itertools import chain

import numpy as np
from numpy.typing import NDArray

from toolpaths.printed import print_quanta

Floats = NDArray[np.float64]
Ints = NDArray[np.int32]
Bools = NDArray[np.bool_]

WORDS = ("X", "Y", "Z", "A", "B", "C")
UNWRITTEN = (-1, -1)
NO_SPANS = (UNWRITTEN,) * 6


@dataclass(frozen=True)
class Refusal:
    """A line that is left as it is, and why.

    Attributes
    ----------
    line
        1-based line of the program.
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
    """

    line: int
    reason: str
    words: tuple[str, ...] = ()
    column: int | None = None
    carries_force: bool = True
    fatal: bool = False


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
        Literal X, Y, Z (mm), A, B, C (deg), NaN for a word not written; None for other origins.
    text
        The setting as written.
    """

    line: int
    what: str
    origin: str
    pose: tuple[float, ...] | None
    text: str


@dataclass(frozen=True, eq=False)
class Program:
    """A program and the N literal poses of its motions, in the order of the file.

    Attributes
    ----------
    raw
        The bytes of the file.
    dialect, path
        Who read it, and from where.
    line
        (N,) 1-based line.
    kind
        (N,) motion in upper case: LIN, SLIN, PTP, CIRC, ...
    role
        (N,) "point", or "via" and "end" for the two poses of an arc (two rows on one line).
    carries_force
        (N,) linear and circular motions do; point-to-point motions and rapids do not and are never changed.
    refused
        (N,) rows that `refusals` say cannot be corrected.
    position_mm, abc_deg
        (N, 3) effective pose: words not written keep their value. NaN where no line says it.
    external
        (N, 6) E1..E6 in mm or deg, NaN where not known.
    span
        (N, 6, 2) byte start and end of the number tokens of X Y Z A B C, -1 where this row does not write the word.
    source
        (N, 6) row whose token gives each word, -1 where none does.
    also
        (M, 3) further (row, word, source) for words that two rows could give alike.
    body
        (N,) byte offset at which the words of the pose begin, -1 where the dialect cannot insert words.
    unit
        (6,) mm or deg per unit of the token.
    follows
        (N,) whether the motion starts where the row before ends; not so after a motion whose target is not known.
    frames, refusals, notes, warnings
        Frames the program sets; what cannot be corrected; motions without force whose pose is not known; the rest.
    """

    raw: bytes
    dialect: str
    path: str
    line: Ints
    kind: NDArray[np.str_]
    role: NDArray[np.str_]
    carries_force: Bools
    refused: Bools
    position_mm: Floats
    abc_deg: Floats
    external: Floats
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

    def __len__(self) -> int:
        return len(self.line)

    @property
    def corrected(self) -> Bools:
        """(N,) rows a correction may change: they carry force and are not refused."""
        return self.carries_force & ~self.refused

    @cached_property
    def written(self) -> Bools:
        """(N, 6) words that the row itself writes."""
        return self.span[..., 0] >= 0

    @cached_property
    def position_only(self) -> Bools:
        """(N,) rows whose orientation is never changed.

        These are the rows that write none of A, B, C, and the rows such a row keeps its orientation from: correcting
        that would turn the tool in all of them. Auxiliary points without orientation ask nothing of other rows.
        """
        only: Bools = np.logical_not(self.written[:, 3:].any(axis=1))
        keeping = only & ~self.free_orientation
        givers = np.concatenate([self.source[keeping][:, 3:].ravel(), self.also[keeping[self.also[:, 0]], 2]])
        only[givers[givers >= 0]] = True
        return only

    @cached_property
    def free_orientation(self) -> Bools:
        """(N,) auxiliary points of arcs that write none of A, B, C: their orientation is the controller's business.

        A CIRC disregards the orientation of its auxiliary point; what such a point keeps from the line before must not
        hold back the correction of that line.
        """
        return np.logical_and(self.role == "via", ~self.written[:, 3:].any(axis=1))

    @cached_property
    def quantum(self) -> Floats:
        """(N, 6) worth of one printed digit of each word the row writes, mm or deg; NaN where it writes none."""
        return print_quanta(self.raw, self.span) * self.unit


def quantum_mm(program: Program) -> Floats:
    """Half a printed digit of the position of each row, mm: no correction can be printed more finely.

    Returns
    -------
    (N,) the largest over X, Y and Z; for a word not written that of the line it is kept from; NaN where unknown.
    """
    return _half_quantum(program, slice(0, 3))


def quantum_deg(program: Program) -> Floats:
    """Half a printed digit of the orientation of each row, deg; otherwise as `quantum_mm`."""
    return _half_quantum(program, slice(3, 6))


def _half_quantum(program: Program, words: slice) -> Floats:
    source = program.source[:, words]
    given = np.take_along_axis(program.quantum[:, words], np.maximum(source, 0), axis=0) if len(program) else source
    return 0.5 * np.where(source >= 0, given, np.nan).max(axis=1)


class ProgramBuilder:
    """Collects rows while a dialect reads, and keeps the values of words that later rows may leave out.

    Rows are held in compact arrays, never as objects. `values` (X..C, E1..E6) and `source` are the pose the machine is in
    after the rows so far: NaN and -1 where unknown.
    """

    def __init__(self) -> None:
        self.values = [float("nan")] * 12
        self.source = [-1] * 6
        self.also = array("i")
        self._line, self._body, self._source, self._span = array("i"), array("i"), array("i"), array("i")
        self._poses = array("d")
        self._kind: list[str] = []
        self._role: list[str] = []
        self._flags = bytearray()
        self._moved = True

    def __len__(self) -> int:
        return len(self._line)

    def forget(self, *, moved: bool = True) -> None:
        """From here on, the words of the pose are not known; with `moved` not even where the machine stands."""
        self._moved = self._moved or moved
        self.values = [float("nan")] * 12
        self.source = [-1] * 6

    def update(self, numbers: Iterable[bytes | None]) -> None:
        """Take over the words that are written (None: not written) into the pose that the next row will have."""
        row, values, source = len(self._line), self.values, self.source
        for word, token in enumerate(numbers):
            if token is not None:
                values[word] = float(token)
                if word < 6:
                    source[word] = row

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

    def build(self, raw: bytes, dialect: str, path: str, unit: Floats | None = None, **said: object) -> Program:
        """The program; `unit` scales X..C from tokens to mm and deg, `said` are frames, refusals, notes, warnings."""
        count = len(self._line)
        unit = np.ones(6) if unit is None else unit
        poses = np.frombuffer(self._poses, dtype=float).reshape(count, 12)
        flags = np.frombuffer(bytes(self._flags), dtype=np.uint8)
        return Program(
            raw=raw,
            dialect=dialect,
            path=path,
            line=_ints(self._line, count),
            kind=np.array(self._kind, dtype=np.str_),
            role=np.array(self._role, dtype=np.str_),
            carries_force=(flags & 1) == 1,
            refused=(flags & 2) == 2,
            position_mm=poses[:, :3] * unit[:3],
            abc_deg=poses[:, 3:6] * unit[3:],
            external=poses[:, 6:].copy(),
            span=_ints(self._span, count, 6, 2),
            source=_ints(self._source, count, 6),
            also=_ints(self.also, len(self.also) // 3, 3),
            body=_ints(self._body, count),
            unit=unit,
            follows=(flags & 4) == 4,
            **said,  # type: ignore[arg-type]
        )


def _ints(values: array[int], *shape: int) -> Ints:
    return np.frombuffer(values, dtype=np.int32).reshape(shape).copy()
