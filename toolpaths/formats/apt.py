"""APT and CLDATA of CAM systems: ``GOTO`` to points with or without a tool axis; the rest stays as it is or is refused.

Decisions: i, j, k are the direction from the tool's tip to the spindle, read renormalised; a GOTO with three numbers keeps the
axis of the one before, and 0, 0, 1 where none was said or MULTAX/OFF stands. RAPID is for the next GOTO only. Points under a CYCLE are
holes, under CUTCOM no places of the tool: both refused, as are arcs (``--linearise`` replaces them), GODLTA and other motions
along curves. A coordinate system or clamping (NX MSYS, CATIA's matrix, Creo's and SolidWorks' CSYS, SETUP) may be stated; points
after another one are refused.
"""

from __future__ import annotations

import math
import re
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from drake_stiffness.errors import InputError
from toolpaths.conventions import TOOL_AXIS
from toolpaths.formats import apt_pieces
from toolpaths.formats import apt_records as records
from toolpaths.formats.apt_arcs import FoundArc, circle_arc, contour_arc
from toolpaths.formats.apt_records import Record
from toolpaths.formats.reading import shown
from toolpaths.program import UNWRITTEN, Program, Refusal
from toolpaths.program_builder import ProgramBuilder

_SUFFIXES = frozenset((".apt", ".aptsource", ".cls", ".clsf", ".cl", ".ncl", ".cldata"))
_SAME_AXIS = 1e-4
_NO_AXIS = (UNWRITTEN,) * 3
Floats = NDArray[np.float64]
Tokens = Sequence[bytes | None]
Spans = Sequence[tuple[int, int]]


class Apt:
    """APT sources and cutter location files as a dialect."""

    name = "apt"

    def recognises(self, raw: bytes, suffix: str) -> bool:
        """A usual suffix, or a line with ``GOTO/`` or a mark of CATIA, Creo or NX."""
        return suffix in _SUFFIXES or records.CONTENT.search(raw) is not None

    def companions(self, path: Path) -> tuple[Path, ...]:
        """None."""
        return ()

    def parse(self, raw: bytes, path: str, others: Sequence[tuple[str, bytes]] = ()) -> Program:
        """Read a program; see ``toolpaths.formats.Dialect``.

        Raises
        ------
        InputError
            There is no motion at all.
        """
        reader = read(raw)
        if not reader.has_motion:
            raise InputError(f"{path}: found no motion in it; expected APT with GOTO/x,y,z")
        return self.program(reader, path)

    def cut(self, raw: bytes) -> int:
        """Where the last place is at which a program may be cut in two; see ``toolpaths.formats.InPieces``."""
        return apt_pieces.cut(raw)

    def parse_piece(
        self, raw: bytes, path: str, resume: object, others: Sequence[tuple[str, bytes]] = (), last: bool = False
    ) -> tuple[Program, object]:
        """Read a piece of a program that was cut at `cut`; `resume` is what the piece before handed on (None: the first).

        Raises
        ------
        NeedsWhole
            The first point keeps the tool axis of a piece before.
        """
        resume = apt_pieces.START if resume is None else resume
        assert isinstance(resume, apt_pieces.Resume)
        reader = Reader(raw)
        if resume.modal:
            apt_pieces.take_over(reader, resume)
        reader.read()
        return replace(self.program(reader, path), resume=resume), apt_pieces.hand_on(reader)

    def program(self, reader: Reader, path: str) -> Program:
        """What a reader has found."""
        unit = np.array([reader.mm] * 3 + [1.0] * 3)
        refusals = tuple(sorted(reader.refusals, key=lambda refusal: refusal.line))
        return reader.rows.build(reader.raw, self.name, path, unit, refusals=refusals, notes=tuple(reader.notes))


def read(raw: bytes) -> Reader:
    """Read a program."""
    reader = Reader(raw)
    reader.read()
    return reader


class Reader:
    """Goes through a program record by record; holds what is modal."""

    def __init__(self, raw: bytes) -> None:
        self.raw = raw
        self.rows = ProgramBuilder(TOOL_AXIS)
        self.rows.values[3:6] = 0.0, 0.0, 1.0
        self.refusals: list[Refusal] = []
        self.notes: list[Refusal] = []
        self.arcs: list[FoundArc] = []
        self.has_motion = False
        self.line = 1
        self.mm = 1.0
        self.rapid = False
        self.cycle = ""
        self.blocked: dict[str, str] = {}
        self.feed_unit: float | None = 0.0  # 0: a unit of length per minute
        self.systems: dict[str, tuple[float, ...]] = {}
        self._circle: FoundArc | None = None
        self.direction: tuple[float, ...] = ()
        self.axis_since = ""
        self._row_here = self._movable = False  # the tool stands where the last row says; that row may be corrected
        self._place: Floats | None = None
        self.indent: int | None = None  # of the REMARK above, while its text may go on
        self._begin = 0

    def read(self) -> None:
        raw, at, ordinary = self.raw, 0, records.ORDINARY.match
        while at < len(raw):
            if raw.startswith(records.BOM, at):
                at += len(records.BOM)
            match = ordinary(raw, at)
            if match is not None and self.indent is None:
                self._begin, end = at, match.end()
                self.point(match.groups(), match.regs[1:], match.start(1))
            else:
                record = records.read_record(raw, at)
                self._begin, end = at, record.end
                self.record(record)
            self.line += raw.count(b"\n", at, end)
            at = end

    def record(self, record: Record) -> None:
        """Any record that is not an ordinary GOTO."""
        stated = records.system(self.raw, record.start)
        if stated is not None:
            self.system(*stated)
        text = record.code.strip()
        if not text:
            return
        indent = len(record.code) - len(record.code.lstrip(b" \t"))
        inside, self.indent = self.indent is not None and indent > self.indent, self.indent
        if not inside:
            self.indent = None
        match = records.STATEMENT.match(record.code)
        major = match[1].upper() if match is not None else b""
        if inside and major == b"GOTO":
            self.leave("GOTO inside the text of a REMARK: text or motion?", force=True)
        elif inside:
            return
        elif (first := records.FIRST_WORD.match(record.code)) is not None and first[1].upper() in records.TEXT:
            self.indent = indent if first[1].upper() == b"REMARK" else None
        elif records.CONTOUR.search(text):
            self.contour(record)
        elif match is not None:
            self.statement(major, match[2] or b"", record.start + max(match.start(2), 0), record)

    def statement(self, major: bytes, minor: bytes, at: int, record: Record) -> None:
        """A major word and what stands behind its slash."""
        said = minor.upper()
        if major in (b"GOTO", b"FROM"):
            self.goto(major, minor, at)
        elif major == b"RAPID":
            self.rapid = said != b"OFF"
        elif major == b"FEDRAT":
            self.feed(said)
        elif major in (b"UNITS", b"UNIT"):
            self.units(said)
        elif major == b"MULTAX" and said == b"OFF":
            self.rows.values[3:6], self.rows.source[3:6] = [0.0, 0.0, 1.0], [-1] * 3
        elif major == b"TLAXIS":
            self.axis(minor)
        elif major == b"CYCLE":
            self.cycle = "" if said.startswith(b"OFF") else f"CYCLE in line {self.line}"
        elif major in (b"CUTCOM", b"MODE"):
            fine = said.startswith((b"OFF", b"ABSOL", b"NORMPS")) or (major == b"MODE" and not said.startswith(b"INCR"))
            self.obstacle(
                major.decode(), "" if fine else f"{shown(record.code, 0, len(record.code))} in line {self.line}"
            )
        elif major in records.SYSTEMS:
            if not (major == b"SETUP" and said.startswith(b"END")):
                self.system(major.decode(), tuple(float(n) for n in re.findall(records.NUMBER, minor)))
        elif major in records.SHIFTS or major in records.TURNS or major in records.CALLS:
            tokens = records.numbers(minor, at)
            nothing = (
                major not in records.CALLS and tokens is not None and all(float(token) == 0 for token, _ in tokens)
            )
            self.obstacle(
                major.decode(), "" if nothing else f"{major.decode()} in line {self.line} moves points elsewhere"
            )
        elif major == b"CIRCLE":
            self.circle(minor, at, record)
        elif major == b"INDIRV":
            self.direction = tuple(float(token) for token, _ in records.numbers(minor, at) or ())
        elif major == b"GODLTA" or major in records.CURVES:
            self.leave(f"{major.decode()}, a motion to no literal point", force=not self.rapid)
            self.rapid = False
        elif major in (b"GOHOME", b"LOADTL", b"TLCHG"):
            self.elsewhere()

    def goto(self, major: bytes, minor: bytes, at: int) -> None:
        """A GOTO that is not ordinary, or a FROM."""
        found = records.numbers(minor, at)
        if found is None or len(found) not in (3, 6):
            what = "no literal number" if found is None else f"{len(found)} numbers"
            self.leave(f"{shown(minor, 0, len(minor), 30)!r} ({what}) instead of 3 or 6 numbers", force=not self.rapid)
            self.rapid = False
            return
        tokens: list[bytes | None] = [token for token, _ in found]
        spans = [span for _, span in found]
        self.point(tokens + [None] * (6 - len(tokens)), [*spans, *_NO_AXIS][:6], at, moving=major == b"GOTO")

    def point(self, tokens: Tokens, spans: Spans, at: int, *, moving: bool = True) -> None:
        """A literal point, with or without an axis."""
        rows, force = self.rows, moving and not self.rapid
        circle, self._circle = self._circle, None
        self.rapid = self.rapid and not moving
        axis = rows.values[3:6]
        if self.blocked:
            self.leave(next(iter(self.blocked.values())), force=force, at=at)
            if tokens[3] is not None:
                rows.values[3:6], rows.source[3:6] = [float(token or 0) for token in tokens[3:]], [-1] * 3
            return
        rows.update(tokens)
        if tokens[3] is not None:
            self.axis_since = ""
            if not any(rows.values[3:6]):
                rows.values[3:6], rows.source[3:6] = [math.nan] * 3, [-1] * 3
                self.axis_since = f"a tool axis without direction (0, 0, 0) in line {self.line}"
        reason = ""
        if circle is not None:
            reason = self.arc(circle, tokens, turned=math.dist(axis, rows.values[3:6]) > _SAME_AXIS)
        elif self.cycle:
            reason = f"a hole: {self.cycle}"
        elif self.axis_since:
            reason = self.axis_since
        if reason and force:
            self.refusals.append(Refusal(self.line, f"found {reason}", column=at - self._begin + 1))
        kind = "FROM" if not moving else "GOTO" if force else "RAPID"
        rows.add(self.line, kind, "point", spans, -1, carries_force=force, refused=bool(reason) and force)
        self.has_motion = self._row_here = True
        self._movable = force and not reason

    def circle(self, minor: bytes, at: int, record: Record) -> None:
        """CIRCLE before the GOTO to its end: the row that stands here is its start."""
        self.start_stays()
        found = records.numbers(minor, at)
        values = None if found is None else [float(token) for token, _ in found]
        self._circle = FoundArc(self.line, record.start, record.end, values=values, start=self.place())

    def arc(self, circle: FoundArc, tokens: Tokens, *, turned: bool) -> str:
        """The end of a CIRCLE: why it is refused."""
        end = np.array(self.rows.values[:3])
        arc = circle_arc(circle.values, circle.start, end, self.mm)
        found = circle.ended(self._begin, tokens, "the tool's axis turns along it" if turned else arc)
        self.arcs.append(found)
        return found.reason(f"the end of the CIRCLE in line {circle.line}")

    def contour(self, record: Record) -> None:
        """Motion along a curve; CATIA's circle up to a line is known."""
        self.start_stays()
        arc = contour_arc(record.code, self.direction, self.place(), self.mm)
        found = FoundArc(self.line, record.start, record.end, arc=arc, at=record.start, whole=True)
        self.arcs.append(found)
        self.leave(found.reason("a motion along a curve"), force=not self.rapid)
        self.rapid = False
        self._place = None if isinstance(arc, str) else arc.end / self.mm

    def start_stays(self) -> None:
        """An arc stays as it is, so the row where it starts must stay too."""
        row = len(self.rows) - 1
        if self._row_here and self._movable:
            self.rows.refuse(row)
            reason = f"the arc in line {self.line} starts here and stays as it is, so this end must stay too"
            self.refusals.append(Refusal(self.rows.line(row), reason))

    def place(self) -> Floats | None:
        """Where the tool stands, in the program's unit; None where that is not known."""
        return np.array(self.rows.values[:3]) if self._row_here else self._place

    def leave(self, what: str, *, force: bool, at: int | None = None) -> None:
        """A motion that stays as it is."""
        self.has_motion = True
        column = None if at is None else at - self._begin + 1
        (self.refusals if force else self.notes).append(
            Refusal(self.line, f"found {what}", column=column, carries_force=force)
        )
        self.elsewhere()

    def elsewhere(self) -> None:
        """The tool's place is not known from here on; its axis is."""
        values, source = self.rows.values[3:6], self.rows.source[3:6]
        self.rows.forget()
        self.rows.values[3:6], self.rows.source[3:6] = values, source
        self._row_here, self._place, self._circle = False, None, None

    def obstacle(self, key: str, why: str) -> None:
        """Something that moves points away from their words, or its end (an empty reason)."""
        self.blocked.pop(key, None)
        if why:
            self.blocked[key] = why

    def system(self, kind: str, numbers: tuple[float, ...]) -> None:
        """A coordinate system is stated: another one than at the points before is in the way of those after it."""
        if not len(self.rows):
            self.systems[kind] = numbers
        same = self.systems.get(kind) == numbers
        self.obstacle(
            kind,
            ""
            if same
            else f"another coordinate system or clamping since line {self.line} ({kind}); split the program there",
        )

    def axis(self, minor: bytes) -> None:
        tokens = records.numbers(minor, 0)
        known = tokens is not None and len(tokens) == 3 and any(float(token) != 0 for token, _ in tokens)
        self.rows.values[3:6] = [float(token) for token, _ in tokens or ()] if known else [math.nan] * 3
        self.rows.source[3:6] = [-1] * 3
        self.axis_since = "" if known else f"a tool axis that is not known: TLAXIS in line {self.line}"

    def units(self, said: bytes) -> None:
        mm = records.UNITS_MM.get(said.strip())
        if mm is None:
            self.obstacle("UNITS", f"an unknown unit in line {self.line}: {shown(said, 0, len(said))}")
        elif len(self.rows) and mm != self.mm:
            self.obstacle("UNITS", f"the unit changes in line {self.line}; split the program there")
        else:
            self.mm = mm

    def feed(self, said: bytes) -> None:
        value = math.nan
        for word in said.split(b","):
            word = word.strip()
            if word in records.FEED_UNITS:
                self.feed_unit = records.FEED_UNITS[word]
            elif re.fullmatch(records.NUMBER, word):
                value = float(word)
        unit = self.feed_unit if self.feed_unit else self.mm
        self.rows.feed_mm_per_min = math.nan if self.feed_unit is None else value * unit
