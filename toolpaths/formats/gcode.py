"""G-code (ISO 6983 and its relatives): G0 and G1 with literal words, three axes or five with a declared meaning.

Decisions: words not written keep their value; where that is not certain - at the start, after a jump, a call, a tool change,
another zero point, a line that may be skipped - it is unknown, and a feed move that needs it is refused. Arcs are refused,
because their ends cannot move without their I, J, K or R: ``--linearise`` replaces them. Feed moves under G91, G41, G68 and
other numbers that move points away from their words are refused; so is what is no letter with a literal number. X, Y, Z must be
those of the tool's tip (for five axes RTCP), what A, B, C mean is declared (`toolpaths.rotary`).
"""

from __future__ import annotations

import math
import re
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from drake_stiffness.errors import InputError
from toolpaths.arcs import Arc, NoArc
from toolpaths.conventions import FIXED_AXIS
from toolpaths.formats import gcode_pieces
from toolpaths.formats import gcode_words as g
from toolpaths.formats.gcode_arcs import FoundArc, arc_of
from toolpaths.formats.gcode_modal import Modal
from toolpaths.formats.gcode_words import Word
from toolpaths.formats.reading import NeedsWhole, Unreadable, shown
from toolpaths.program import UNWRITTEN, Program, Refusal
from toolpaths.program_builder import ProgramBuilder
from toolpaths.rotary import Undeclared

_SUFFIXES = frozenset((".gcode", ".nc", ".ngc", ".tap", ".mpf", ".cnc", ".gc", ".eia", ".iso"))
_ARC_HINT = "an arc, whose ends cannot move without its {0}: --linearise TOL replaces arcs by straight moves"


class GCode:
    """G-code as a dialect."""

    name = "gcode"

    def recognises(self, raw: bytes, suffix: str) -> bool:
        """A usual suffix, or a line with G0 .. G3 and a coordinate."""
        return suffix in _SUFFIXES or g.CONTENT.search(raw) is not None

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
            bare = b"\n" not in raw and b"\r" in raw.rstrip(b"\r")
            found = "lines that end in bare carriage returns" if bare else "no motion in it"
            raise InputError(
                f"{path}: found {found}; expected G-code with G0 or G1 and coordinates, lines ended by LF or CR LF"
            )
        return reader.program(self.name, path)

    def cut(self, raw: bytes) -> int:
        """Where the last place is at which a program may be cut in two; see ``toolpaths.formats.InPieces``."""
        return gcode_pieces.cut(raw)

    def parse_piece(
        self, raw: bytes, path: str, resume: object, others: Sequence[tuple[str, bytes]] = (), last: bool = False
    ) -> tuple[Program, object]:
        """See ``toolpaths.formats.InPieces``; NeedsWhole where there is a jump, or a rotary word that is new or kept."""
        resume = gcode_pieces.START if resume is None else resume
        assert isinstance(resume, gcode_pieces.Resume)
        reader = read(raw) if resume.rotary is None else Reader(raw, resume.rotary)
        if resume.rotary is not None:
            gcode_pieces.take_over(reader, resume)
            reader.read()
        return replace(reader.program(self.name, path), resume=resume), gcode_pieces.hand_on(reader)


class _Turned(NeedsWhole):
    """A rotary word that no line before has written."""


def read(raw: bytes) -> Reader:
    """Read a program; again where another rotary word turns up, because every pose has it then."""
    rotary: tuple[str, ...] = ()
    while True:
        reader = Reader(raw, rotary)
        try:
            reader.read()
            return reader
        except _Turned as found:
            rotary = tuple(sorted((*rotary, str(found))))


class Reader:
    """Goes through a program line by line; holds what is modal."""

    def __init__(self, raw: bytes, rotary: tuple[str, ...]) -> None:
        self.raw = raw
        self.rows = ProgramBuilder(Undeclared(rotary) if rotary else FIXED_AXIS)
        self.refusals: list[Refusal] = []
        self.notes: list[Refusal] = []
        self.has_motion = False
        self.line = 0
        self.letters = (*g.AXES, *(letter.encode() for letter in rotary))
        self.modal = Modal()
        self.unknown_since = "no line before it says"
        self.all_known = False
        self.arcs: list[FoundArc] = []
        self._movable = False  # whether the machine stands where the last row says, and that row may be corrected
        self._begin = self._end = 0
        self._pattern = g.ordinary_line(self.letters)
        self._targets = {int(jump[1]) if jump[1] else None for jump in g.JUMP.finditer(raw)}

    def read(self) -> None:
        raw, at, match_ordinary = self.raw, 3 if self.raw.startswith(b"\xef\xbb\xbf") else 0, self._pattern.match
        while at < len(raw):
            self.line += 1
            match = match_ordinary(raw, at)
            if match is not None and self.quick(match):
                at = match.end()
                continue
            newline = raw.find(b"\n", at)
            self._begin, self._end = at, len(raw) if newline < 0 else newline + 1
            self.block(g.code_of(raw, at, self._end), at)
            at = self._end

    def program(self, dialect: str, path: str) -> Program:
        """What was read."""
        unit = np.array([self.modal.mm] * 3 + [1.0] * (self.rows.width - 3))
        return self.rows.build(
            self.raw,
            dialect,
            path,
            unit,
            frames=tuple(self.modal.frames),
            refusals=tuple(sorted(self.refusals, key=lambda refusal: refusal.line)),
            notes=tuple(self.notes),
            spaced_words=True,
        )

    def quick(self, match: re.Match[bytes]) -> bool:
        """An ordinary line, if it is a straight move and nothing is in the way."""
        groups = match.groups()
        mode = int(groups[1]) if groups[1] is not None else self.modal.mode
        if (mode != 0 and mode != 1) or self.modal.blocked or (self._targets and groups[0]):
            return False
        self.modal.mode = mode
        if groups[-1] is not None:
            self.set_feed(groups[-1])
        self._begin = match.start()
        self.straight(mode == 1, groups[3:-1], match.regs[4:-1], match.start(3))
        return True

    def straight(
        self, force: bool, tokens: Sequence[bytes | None], spans: Sequence[tuple[int, int]], body: int
    ) -> None:
        """A rapid or feed move to a literal pose."""
        rows = self.rows
        rows.update(tokens)
        refused = force and not self.all_known and not self.complete(body)
        rows.add(self.line, "G1" if force else "G0", "point", spans, body, carries_force=force, refused=refused)
        self.has_motion = self._movable = True

    def complete(self, at: int) -> bool:
        """Whether all words of the present pose are known; if not, the line is refused."""
        pairs = zip(self.letters, self.rows.values, strict=False)
        unknown = ", ".join(letter.decode() for letter, value in pairs if math.isnan(value))
        self.all_known = not unknown
        if unknown:
            reason = f"{unknown} not written here and not known: {self.unknown_since} (write them on this line)"
            self.refusals.append(Refusal(self.line, reason, column=at - self._begin + 1))
        return self.all_known

    def set_feed(self, token: bytes) -> None:
        self.rows.feed_mm_per_min = float(token) * self.modal.mm if self.modal.per_minute else math.nan

    def lost(self, since: str, *, moved: bool = True) -> None:
        """From here on no word is known that is not written."""
        self.rows.forget(moved=moved)
        self.unknown_since, self.all_known = since, False
        self._movable = self._movable and not moved

    def leave(self, at: int, found: str, *, force: bool = True) -> None:
        """Leave the line as it is: refused, or only noted where it carries no force."""
        self.has_motion = True
        refusal = Refusal(self.line, f"found {found}", column=at - self._begin + 1, carries_force=force)
        (self.refusals if force else self.notes).append(refusal)
        self.lost(f"line {self.line}")

    def block(self, code: bytes, start: int) -> None:
        """Any line that is not ordinary: `code` is the line with comments as blanks."""
        text = code.lstrip(b" \t\xef\xbb\xbf")
        at = start + len(code) - len(text)
        text = text.rstrip()
        if not text or text.startswith(b"%"):
            return
        skipped = text.startswith(b"/")
        if skipped:
            number = re.match(rb"/[1-9]?(?![\d.])", text)
            cut = number.end() if number else 1
            text, at = text[cut:], at + cut
        try:
            if b")" in text:
                raise Unreadable(at + text.index(b")"), "a ')' without its '('")
            words = g.read_words(text, at)
        except Unreadable as error:
            self.statement(text, at, error)
            return
        if self._targets and any(w.letter == b"N" and {None, int(float(w.token))} & self._targets for w in words):
            self.lost(f"the jump to line {self.line}")
        self.words(words, at, skipped)

    def statement(self, code: bytes, at: int, error: Unreadable) -> None:
        """A line that is not made of words: left as it is, with what it may do to the lines after it."""
        for number in g.G_PATTERN.findall(code):
            self.set(g.g_number(number))
        if g.FRAME.search(code):
            self.modal.blocked["frame"] = f"line {self.line} moves the program's frame: {shown(code, 0, len(code))!r}"
        if g.DIRECTION.search(code):
            why = f"the tool is tilted by words that are not read here, since line {self.line}: {shown(code, 0, len(code))!r}"
            self.modal.blocked["direction"] = why
        if g.AXIS_PATTERN.search(code) or g.CALL.search(code):
            if self.modal.mode in (2, 3):
                explicit = bool(g.G_PATTERN.search(code))
                self.arcs.append(FoundArc(self.line, self._begin, self._end, (), explicit, error.found))
            self.leave(error.at, error.found, force=self.modal.mode != 0)
        elif not g.ASSIGNMENT.match(code):
            self.lost(f"line {self.line}: {shown(code, 0, len(code), 30)!r}")

    def words(self, words: list[Word], at: int, skipped: bool) -> None:
        """A line of words: settings first, then the motion."""
        numbers = [g.g_number(w.token) for w in words if w.letter == b"G"]
        values = {w.letter: w for w in words if w.letter != b"G" and w.letter != b"M"}
        before = self.modal.mode
        zero = all(float(values[letter].token) == 0 for letter in g.AXES if letter in values)
        for number in numbers:
            # A zero shift where there is none, and Fanuc's G05 P10000 (a way to hurry), change nothing.
            hurry = number == "5" and b"P" in values and not any(letter in values for letter in g.AXES)
            if not hurry and not (number == "52" and zero and "52" not in self.modal.blocked):
                self.set(number, values[b"P"].token if number in ("54.1", "154") and b"P" in values else b"")
        if b"F" in values and "4" not in numbers:  # the F of a dwell is a time
            self.set_feed(values[b"F"].token)
        stops = {int(float(w.token)) for w in words if w.letter == b"M"}
        if stops & {6, 60}:
            self.lost(f"the tool change in line {self.line}")
        if stops & {97, 98, 198} or "65" in numbers or (b"L" in values and not numbers and not stops):
            self.leave(at, "a call of a subprogram, whose motions are not known here")
            return
        posed = [w for w in words if w.letter in g.AXES or w.letter in g.ROTARY or w.letter in g.SECOND_AXES]
        around = self.modal.mode in (2, 3) and any(letter in values for letter in g.ARC_WORDS)
        if (posed or around) and not g.NO_POSE.intersection(numbers):
            self.motion(words, values, numbers, (posed or words)[0].at)
        elif g.ELSEWHERE.intersection(numbers):
            self.leave(at, "a motion to a place of the machine", force=False)
        if skipped and (posed or self.modal.mode != before):
            self.lost(f"line {self.line}, which may be skipped (/)")
            if self.modal.mode != before:
                self.modal.mode, self.modal.why_no_mode = None, f"line {self.line} may be skipped"
        if stops & {2, 30, 99} or b"O" in values:
            self.lost(f"the end or start of a program in line {self.line}")

    def set(self, number: str, table: bytes = b"") -> None:
        """Apply a G number."""
        if number in ("93", "94", "95"):
            self.rows.feed_mm_per_min = math.nan
        rotary = len(self.letters) > 3
        loss = self.modal.apply(number, self.line, started=len(self.rows) > 0, rotary=rotary, table=table)
        if loss is not None and loss.words is None:
            self.lost(loss.since, moved=False)
        elif loss is not None:
            for word in loss.words or ():
                self.rows.values[word], self.rows.source[word] = math.nan, -1
            self.unknown_since, self.all_known = loss.since, False

    def motion(self, words: list[Word], values: dict[bytes, Word], numbers: list[str], at: int) -> None:
        """A line with coordinates: a row, or a refusal."""
        force = self.modal.mode != 0
        posing = [w for w in words if w.letter not in b"GMNSTHDE"]
        twice = next((w for n, w in enumerate(posing) if any(w.letter == v.letter for v in posing[:n])), None)
        rotary = next((w for w in words if w.letter in g.ROTARY and w.letter not in self.letters), None)
        if "53" in numbers or g.ELSEWHERE.intersection(numbers):
            self.leave(at, "a motion to a place of the machine", force="53" in numbers and force)
        elif self.modal.blocked:
            if self.modal.mode in (2, 3):
                self.found_arc(words, numbers, next(iter(self.modal.blocked.values())))
            self.leave(at, next(iter(self.modal.blocked.values())), force=force)
        elif self.modal.mode is None:
            self.leave(at, self.modal.why_no_mode)
        elif twice is not None:
            self.leave(twice.at, f"the word {twice.letter.decode()} twice", force=force)
        elif len(set(numbers) & set(g.MOTIONS)) > 1:
            self.leave(at, "two kinds of motion on one line")
        elif any(letter in values for letter in (*g.SECOND_AXES, b"L")):
            self.leave(at, "U, V, W or L, whose meaning is not known here", force=force)
        elif self.modal.mode < 2 and any(letter in values for letter in g.ARC_WORDS):
            self.leave(at, "I, J, K or R on a straight move", force=force)
        elif rotary is not None:
            raise _Turned(rotary.letter.decode())
        else:
            tokens = [values[letter].token if letter in values else None for letter in self.letters]
            spans = [values[letter].span if letter in values else UNWRITTEN for letter in self.letters]
            if self.modal.mode < 2:
                self.straight(force, tokens, spans, at)
            else:
                self.arc(words, values, numbers, tokens, spans, at)

    def arc(
        self,
        words: list[Word],
        values: dict[bytes, Word],
        numbers: list[str],
        tokens: list[bytes | None],
        spans: list[tuple[int, int]],
        at: int,
    ) -> None:
        """An arc stays as it is: neither its end nor its start, the row before, may move."""
        rows, unit = self.rows, self.modal.mm
        start = np.array(rows.values[:3]) * unit
        before = len(rows) - 1
        if self._movable and rows.carries_force(before):
            rows.refuse(before)
            reason = f"the arc in line {self.line} starts here and stays as it is, so this end must stay too"
            self.refusals.append(Refusal(rows.line(before), reason))
        rows.update(tokens)
        end = np.array(rows.values[:3]) * unit
        try:
            if any(letter in values for letter in g.ROTARY):
                raise NoArc("rotary words on an arc")
            found: Arc | str = arc_of(values, start, end, self.modal.mode == 3, self.modal.plane, unit)
        except NoArc as error:
            found = str(error)
        self.found_arc(words, numbers, found)
        hint = _ARC_HINT.format("I, J, K" if b"R" not in values else "R")
        what = hint if isinstance(found, Arc) else f"an arc: {found}"
        self.refusals.append(Refusal(self.line, f"found {what}", column=at - self._begin + 1))
        body = at if any(token is not None for token in tokens) else -1
        rows.add(self.line, f"G{self.modal.mode}", "point", spans, body, carries_force=True, refused=True)
        self.has_motion, self._movable, self.all_known = True, False, False

    def found_arc(self, words: list[Word], numbers: list[str], arc: Arc | str) -> None:
        explicit = bool({"2", "3"} & set(numbers))
        self.arcs.append(FoundArc(self.line, self._begin, self._end, tuple(words), explicit, arc))
