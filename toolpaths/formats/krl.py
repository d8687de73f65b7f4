"""KUKA KRL ``.src``: inline poses of LIN, SLIN, CIRC, SCIRC, PTP and SPTP; everything else stays as it is or is refused.

Decisions (``REFERENCE.md`` 7): words a pose does not write keep their value; where that value is not certain - the first
pose, after a named point, at the boundary of a loop or branch, after a call, after a change of base or tool - it is unknown
and a pose that needs it is refused. SLIN and SCIRC inside a SPLINE block are lines and arcs like any other; SPL is refused,
because the path between its points is a curve through all points of the block, of which the points alone say nothing.
"""

from __future__ import annotations

import math
import re
from collections.abc import Sequence
from pathlib import Path

from drake_stiffness.errors import InputError
from toolpaths.formats.krl_statements import (
    ASYNCHRONOUS,
    CONTENT,
    EMBEDDED_MOTION,
    MOTION,
    POINT_TO_POINT,
    boundary,
    fatal_setting,
    frame_setting,
    without_strings,
)
from toolpaths.formats.krl_words import Aggregate, Unreadable, code_end, read_aggregate, shown
from toolpaths.program import FrameSetting, Program, ProgramBuilder, Refusal

# Approximation, and the settings of a spline segment.
_TAIL = re.compile(rb"(?:[\s,]*C_(?:DIS|VEL|ORI|PTP|SPL)\b)*(?:\s+WITH\b.*)?\s*", re.IGNORECASE | re.DOTALL)
_ARC_ANGLE = re.compile(rb"\s*,\s*CA\b\s*=?\s*[^,{}\s]+", re.IGNORECASE)
WORDS = ("X", "Y", "Z", "A", "B", "C")
_NUMBER = rb"([+-]?(?:\d{1,9}\.?\d{0,20}|\.\d{1,20}))"


def _ordinary_line() -> re.Pattern[bytes]:
    """A whole line with one literal pose in the usual order: what nearly all lines of a milling program look like."""
    words = rb"".join(rb"(?:[ \t]*,[ \t]*%s(?:[ \t]+|(?=[+-]))%s)?" % (w.encode(), _NUMBER) for w in WORDS[1:])
    words += rb"".join(rb"(?:[ \t]*,[ \t]*E%d(?:[ \t]+|(?=[+-]))%s)?" % (n, _NUMBER) for n in range(1, 7))
    status = rb"(?:[ \t]*,[ \t]*S[ \t]+\d+)?(?:[ \t]*,[ \t]*T[ \t]+\d+)?"
    pose = rb"\{[ \t]*(?:E6POS[ \t]*:[ \t]*)?(X)(?:[ \t]+|(?=[+-]))%s%s%s[ \t]*\}" % (_NUMBER, words, status)
    tail = rb"(?:[ \t]+C_(?:DIS|VEL|ORI|PTP))*[ \t]*(?:;[^\r\n]*)?\r*(?:\n|\Z)"
    return re.compile(rb"[ \t]*(S?LIN|S?PTP)[ \t]*" + pose + tail, re.IGNORECASE)


_ORDINARY = _ordinary_line()


class Krl:
    """KRL sources as a dialect."""

    name = "krl"

    def recognises(self, raw: bytes, suffix: str) -> bool:
        """An ``&ACCESS`` header, a ``DEF name(`` or a motion with an aggregate; or a file named ``.src``."""
        return suffix == ".src" or CONTENT.search(raw) is not None

    def companions(self, path: Path) -> tuple[Path, ...]:
        """None."""
        return ()

    def parse(self, raw: bytes, path: str, others: Sequence[tuple[str, bytes]] = ()) -> Program:
        """Read a source; see ``toolpaths.formats.Dialect``.

        Raises
        ------
        InputError
            There is no motion at all, or the lines end in bare carriage returns.
        """
        reader = _Reader(raw)
        reader.read()
        if not reader.has_motion:
            if b"\n" not in raw and b"\r" in raw.rstrip(b"\r"):
                found, mend = "lines that end in bare carriage returns", "convert the line ends to CR LF"
            elif b"\0" in raw[:200]:
                found, mend = "NUL bytes between the characters (UTF-16?)", "save it as plain text"
            else:
                found, mend = "no motion in it", "give the .src that holds the motions"
            raise InputError(f"{path}: found {found}; expected a KRL source with LIN, CIRC or PTP; {mend}")
        return reader.rows.build(
            raw,
            self.name,
            path,
            frames=tuple(reader.frames),
            refusals=tuple(reader.refusals),
            notes=tuple(reader.notes),
            warnings=tuple(reader.warnings),
        )


class _Reader:
    """Goes through a source line by line; holds what has been found so far."""

    def __init__(self, raw: bytes) -> None:
        self.raw = raw
        self.rows = ProgramBuilder()
        self.frames: list[FrameSetting] = []
        self.refusals: list[Refusal] = []
        self.notes: list[Refusal] = []
        self.warnings: list[str] = []
        self.has_motion = False
        self.line = 0
        self.line_start = 0
        self.unknown_since = "no line before it says"

    def read(self) -> None:
        raw, at = self.raw, 3 if self.raw.startswith(b"\xef\xbb\xbf") else 0
        while at < len(raw):
            self.line += 1
            self.line_start = at
            match = _ORDINARY.match(raw, at)
            if match is not None:
                groups = match.groups()
                aggregate = Aggregate(groups[2:], match.regs[3:9], match.start(2), match.end(), is_axes=False)
                self.point(groups[0].upper().decode(), aggregate)
                at = match.end()
                continue
            newline = raw.find(b"\n", at)
            end = len(raw) if newline < 0 else newline + 1
            self.statement(at, code_end(raw, at, end))
            at = end

    def statement(self, start: int, end: int) -> None:
        """Any line that is not an ordinary motion, without its comment."""
        raw = self.raw
        code = raw[start:end].strip()
        if not code or code.startswith(b"&"):
            return
        match = MOTION.match(raw, start, end)
        if match is not None:
            self.has_motion = True
            self.motion(match[1].upper().decode(), match.end(), end)
            return
        fatal = fatal_setting(code)
        if fatal is not None:
            self.refusals.append(Refusal(self.line, fatal, carries_force=False, fatal=True))
        frame = frame_setting(raw, start, end, self.line)
        if frame is not None:
            self.frames.append(frame)
            self.forget(f"the {frame.what} set in line {self.line}", moved=False)
        elif EMBEDDED_MOTION.search(without_strings(code)) is not None:
            self.has_motion = True
            self.refuse("LIN", start, "a motion inside another statement")
        elif ASYNCHRONOUS.match(code) is not None:
            self.has_motion = True
            self.refuse("PTP", start, f"a motion that is not a pose: {shown(raw, start, end)!r}")
        else:
            why = boundary(code)
            if why is not None:
                self.forget(f"{why} in line {self.line}")

    def forget(self, since: str, *, moved: bool = True) -> None:
        self.rows.forget(moved=moved)
        self.unknown_since = since

    def refuse(self, kind: str, at: int, found: str) -> None:
        """Leave a motion without a row: its pose is not known, nor what it leaves behind."""
        force = kind not in POINT_TO_POINT
        refusal = Refusal(self.line, f"found {found}", column=at - self.line_start + 1, carries_force=force)
        (self.refusals if force else self.notes).append(refusal)
        self.forget(f"the motion in line {self.line}")

    def motion(self, kind: str, at: int, end: int) -> None:
        """A motion that is not an ordinary line: `at` is the byte after its keyword."""
        raw = self.raw
        if b"\r" in raw[at:end].rstrip():
            self.refuse(kind, at, "a carriage return in the middle of the line")
            return
        if kind.endswith("_REL"):
            self.refuse(kind, self.line_start, f"{kind}: a relative motion starts from the corrected point before it")
            return
        try:
            first = self.target(at, end)
            arc = kind in ("CIRC", "SCIRC")
            if arc:
                comma = _skip_blanks(raw, first.end, end)
                if raw[comma:end][:1] != b",":
                    raise Unreadable(comma, "no end point after the auxiliary point of the arc")
                self.arc(kind, first, self.target(comma + 1, end), end)
                return
            self.check_tail(first.end, end)
            if first.is_axes and kind in POINT_TO_POINT:
                self.forget(f"the axis angles in line {self.line}")
                self.rows.update((None,) * 6 + first.tokens[6:])
                return
            if first.is_axes:
                raise Unreadable(first.body, "axis angles in a motion along a path")
            self.point(kind, first)
        except Unreadable as error:
            self.refuse(kind, error.at, error.found)

    def target(self, at: int, end: int) -> Aggregate:
        at = _skip_blanks(self.raw, at, end)
        if self.raw[at:end][:1] == b"{":
            return read_aggregate(self.raw, at, end)
        what = shown(self.raw, at, end)
        hint = "a named point or an expression, whose numbers are not on this line"
        raise Unreadable(at, f"{what!r}: {hint}" if what else "no target")

    def check_tail(self, at: int, end: int) -> None:
        if _TAIL.fullmatch(self.raw, at, end) is None:
            at = _skip_blanks(self.raw, at, end)
            raise Unreadable(at, f"{shown(self.raw, at, end)!r} after the pose, which may change where it is")

    def point(self, kind: str, aggregate: Aggregate) -> None:
        """A literal pose reached by a motion."""
        self.has_motion = True
        self.rows.update(aggregate.tokens)
        force = kind not in POINT_TO_POINT
        reason = self.unknown_words(self.rows.values) if force and -1 in self.rows.source else None
        if kind == "SPL":
            reason = "found SPL: the curve between its points depends on all points of the block"
        if reason is not None:
            self.refusals.append(Refusal(self.line, reason, column=aggregate.body - self.line_start + 1))
        self.add(kind, "point", aggregate, force, refused=reason is not None)

    def arc(self, kind: str, via: Aggregate, end: Aggregate, stop: int) -> None:
        """Auxiliary and end pose of an arc."""
        angle = _ARC_ANGLE.match(self.raw, end.end, stop)
        self.check_tail(angle.end() if angle else end.end, stop)
        if via.is_axes or end.is_axes:
            raise Unreadable(via.body, "axis angles in a motion along a path")
        rows = self.rows
        start = rows.values, rows.source
        rows.values, rows.source = start[0].copy(), start[1].copy()
        rows.update(via.tokens)
        kept_values, kept_source = self.kept_at_end(start, via, end)
        end_values = [kept if t is None else float(t) for t, kept in zip(end.tokens, kept_values, strict=True)]
        reason = self.unknown_words(rows.values) or self.unknown_words(end_values)
        if reason is not None:
            self.refusals.append(Refusal(self.line, reason, column=via.body - self.line_start + 1))
        self.add(kind, "via", via, True, refused=reason is not None)
        rows.values, rows.source = kept_values, kept_source
        rows.update(end.tokens)
        self.add(kind, "end", end, True, refused=reason is not None)
        if angle is not None:
            self.warnings.append(
                f"line {self.line}: with CA the arc ends elsewhere than printed; its two printed points are corrected"
            )
            self.forget(f"the arc to an angle (CA) in line {self.line}")

    def kept_at_end(
        self, start: tuple[list[float], list[int]], via: Aggregate, end: Aggregate
    ) -> tuple[list[float], list[int]]:
        """What the end of an arc keeps for words it does not write.

        The controller takes "the value of the previous position", which may be read as that of the start or of the
        auxiliary point. Where both say the same, the word is known, and both must go on saying the same (`also`).
        Called when the auxiliary pose is the present one and has no row yet.
        """
        rows = self.rows
        values, source = start[0].copy(), start[1].copy()
        for word in range(12):
            if end.tokens[word] is not None or via.tokens[word] is None:
                continue
            if rows.values[word] != values[word]:  # also where the start is not known: NaN
                values[word] = math.nan
                if word < 6:
                    source[word] = -1
            elif word < 6:
                rows.also.extend((len(rows) + 1, word, len(rows)))
        return values, source

    def unknown_words(self, values: list[float]) -> str | None:
        """Why a pose along a path cannot be used: words it keeps from nowhere."""
        unknown = [word for word, value in zip(WORDS, values, strict=False) if math.isnan(value)]
        if not unknown:
            return None
        return f"{', '.join(unknown)} not written here and not known: {self.unknown_since} (write them on this line)"

    def add(self, kind: str, role: str, aggregate: Aggregate, force: bool, *, refused: bool) -> None:
        self.rows.add(self.line, kind, role, aggregate.spans, aggregate.body, carries_force=force, refused=refused)


def _skip_blanks(raw: bytes, at: int, end: int) -> int:
    while at < end and raw[at] in b" \t":
        at += 1
    return at
