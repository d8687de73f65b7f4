"""KUKA KRL ``.src`` with its ``.dat``: poses of LIN, SLIN, SPL, CIRC, SCIRC, PTP and SPTP, written in the motion or stored by name.

Decisions (``REFERENCE.md`` 7): words a pose does not write keep their value; where that value is not certain - the first
pose, after an unknown point, at the boundary of a loop or branch, after a call, after a change of base or tool - it is unknown
and a pose that needs it is refused. The points of a SPLINE block are corrected as points; the curve that SPL lays through them
follows. A plain FOR over the elements of an array is read as the motions it stands for.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

from drake_stiffness.errors import InputError
from toolpaths.formats.krl_loops import Loop, plain_loop
from toolpaths.formats.krl_motions import START, WORDS, Motions, Resume
from toolpaths.formats.krl_runs import alike
from toolpaths.formats.krl_statements import (
    ASYNCHRONOUS,
    CONTENT,
    EMBEDDED_MOTION,
    MOTION,
    blend_of,
    blend_setting,
    boundary,
    fatal_setting,
    feed_setting,
    path_data_name,
    without_strings,
)
from toolpaths.formats.krl_words import Aggregate, code_end, shown
from toolpaths.formats.reading import cut_between
from toolpaths.program import Program, Refusal

_NUMBER = rb"([+-]?(?:\d{1,9}(?:\.\d{0,20})?|\.\d{1,20}))"


def _ordinary_line() -> re.Pattern[bytes]:
    """A whole line with one literal pose in the usual order: what nearly all lines of a milling program look like."""
    words = rb"".join(rb"(?:[ \t]*,[ \t]*%s(?:[ \t]+|(?=[+-]))%s)?" % (w.encode(), _NUMBER) for w in WORDS[1:])
    words += rb"".join(rb"(?:[ \t]*,[ \t]*E%d(?:[ \t]+|(?=[+-]))%s)?" % (n, _NUMBER) for n in range(1, 7))
    status = rb"(?:[ \t]*,[ \t]*S[ \t]+(\d{1,9}))?(?:[ \t]*,[ \t]*T[ \t]+\d+)?"
    pose = rb"\{[ \t]*(?:E6POS[ \t]*:[ \t]*)?(X)(?:[ \t]+|(?=[+-]))%s%s%s[ \t]*\}" % (_NUMBER, words, status)
    tail = rb"((?:[ \t]+C_(?:DIS|VEL|ORI|PTP))*)[ \t]*(?:;[^\r\n]*)?\r*(?:\n|\Z)"
    return re.compile(rb"[ \t]*(S?LIN|S?PTP)[ \t]*" + pose + tail, re.IGNORECASE)


_ORDINARY = _ordinary_line()
# Bytes in which lines alike are looked for: few at first, more where there are many. After a vain look so many lines are left out.
_WINDOW, _LEAST_WINDOW, _LARGEST_WINDOW, _REST = 8_000, 1_000, 1_000_000, 20


def _along(raw: bytes, at: int) -> re.Match[bytes] | None:
    """An ordinary line with a motion along a path."""
    match = _ORDINARY.match(raw, at)
    return match if match is not None and match[1].upper() in (b"LIN", b"SLIN") else None


class Krl:
    """KRL sources as a dialect."""

    name = "krl"

    def recognises(self, raw: bytes, suffix: str) -> bool:
        """An ``&ACCESS`` header, a ``DEF name(`` or a motion with an aggregate; or a file named ``.src``."""
        return suffix == ".src" or CONTENT.search(raw) is not None

    def companions(self, path: Path) -> tuple[Path, ...]:
        """The ``.dat`` of the same name, in capitals or not; of several the one that is spelt like the program."""
        if path.suffix.lower() == ".dat" or not path.parent.is_dir():
            return ()
        wanted = path.stem.lower()
        found = [p for p in path.parent.iterdir() if p.suffix.lower() == ".dat" and p.stem.lower() == wanted]
        return tuple(sorted(found, key=lambda p: (p.stem != path.stem, str(p)))[:1])

    def parse(self, raw: bytes, path: str, others: Sequence[tuple[str, bytes]] = ()) -> Program:
        """Read a source; see ``toolpaths.formats.Dialect``.

        Raises
        ------
        InputError
            There is no motion at all, or the lines end in bare carriage returns.
        """
        reader = _Reader(raw, others)
        reader.read()
        self.refuse_nothing(reader, raw, path)
        return self.program(reader, path, others)

    def cut(self, raw: bytes) -> int:
        """Where the last place is at which a program may be cut in two, 0 for none: before an ordinary line that writes all
        six words, after an ordinary line. Nothing is kept from before such a line but base, tool, feed and external axes.
        """
        return cut_between(raw, _along, lambda _, match: None not in match.groups()[2:8])

    def parse_piece(
        self, raw: bytes, path: str, resume: object, others: Sequence[tuple[str, bytes]] = (), last: bool = False
    ) -> tuple[Program, object]:
        """Read a piece of a program that was cut at `cut`; `resume` is what the piece before handed on (None: the first).

        Raises
        ------
        NeedsWhole
            A motion along a path goes to a stored point.
        """
        resume = START if resume is None else resume
        assert isinstance(resume, Resume)
        reader = _Reader(raw, others, piece=True)
        reader.take_over(resume)
        reader.read()
        return replace(self.program(reader, path, ()), resume=resume), reader.hand_on()

    def refuse_nothing(self, reader: _Reader, raw: bytes, path: str) -> None:
        """InputError where there is no motion at all."""
        if not reader.has_motion:
            if b"\n" not in raw and b"\r" in raw.rstrip(b"\r"):
                found, mend = "lines that end in bare carriage returns", "convert the line ends to CR LF"
            elif b"\0" in raw[:200]:
                found, mend = "NUL bytes between the characters (UTF-16?)", "save it as plain text"
            else:
                found, mend = "no motion in it", "give the .src that holds the motions"
            raise InputError(f"{path}: found {found}; expected a KRL source with LIN, CIRC or PTP; {mend}")

    def program(self, reader: _Reader, path: str, others: Sequence[tuple[str, bytes]]) -> Program:
        """What a reader has found."""
        return reader.rows.build(
            reader.raw,
            self.name,
            path,
            others=others,
            frames=tuple(reader.frames.settings),
            refusals=tuple(reader.refusals),
            notes=tuple(reader.notes),
            warnings=tuple(reader.warnings),
        )


class _Reader(Motions):
    """Goes through a source line by line, or through many lines that are alike at once."""

    tries_from = 0
    window = _WINDOW

    def read(self) -> None:
        raw, at = self.raw, 3 if self.raw.startswith(b"\xef\xbb\xbf") else 0
        while at < len(raw):
            self.line += 1
            self.line_start = at
            match = _ORDINARY.match(raw, at)
            if match is not None:
                groups, regs = match.groups(), match.regs
                aggregate = Aggregate(groups[2:14], regs[3:9], regs[2][0], regs[0][1], False, groups[14])
                if self.frames.borrowed:
                    self.frames.give_back(self.line)
                self.rows.blend_mm = blend_of(b"", groups[15], self.blend_distance) if groups[15] else 0.0
                self.point(groups[0].upper().decode(), aggregate)
                at = self.alike(at, groups, regs)
                continue
            newline = raw.find(b"\n", at)
            end = len(raw) if newline < 0 else newline + 1
            stop = code_end(raw, at, end)
            loop = plain_loop(raw, at, stop, self.points) if raw[at:stop].lstrip()[:3].upper() == b"FOR" else None
            if loop is None:
                self.statement(at, stop)
                at = end
            else:
                self.unroll(loop)
                at = loop.end
        self.finish()

    def alike(self, at: int, groups: tuple[bytes | None, ...], regs: tuple[tuple[int, int], ...]) -> int:
        """Read the lines after an ordinary one that differ from it in digits alone; where the first other line begins."""
        end = regs[0][1]
        kind = (groups[0] or b"").upper()
        if kind not in (b"LIN", b"SLIN") or None in groups[2:8] or groups[14] is not None:
            return end
        if self.line < self.tries_from:
            return end
        written = [word for word in range(12) if groups[2 + word] is not None]
        tokens = [regs[3 + word] for word in written]
        found = alike(self.raw, at, end, tokens, self.window)
        if found is None:
            self.tries_from, self.window = self.line + _REST, _WINDOW
            return end
        body = found.span[:, 0, 0] - (regs[3][0] - regs[2][0])
        self.rows.add_run(self.line + 1, kind.decode(), found.span, found.value, written, body)
        self.line += len(found)
        # Twice what this look found: short runs (a feed every few lines) must not be paid for with long looks, and the shortest with none.
        self.window = min(max(2 * (found.end - end), _LEAST_WINDOW), _LARGEST_WINDOW)
        if len(found) < _REST:
            self.tries_from = self.line + 10 * _REST
        return found.end

    def unroll(self, found: Loop) -> None:
        """Read a plain FOR as the motions it stands for."""
        first = self.line
        self.line += found.lines_before
        self.line_start = found.motion[0]
        for value in found.values:
            self.counter = {found.counter: value}
            if found.calls is not None:
                self.after_call(f"the call of {found.calls} in the loop that begins in line {first}")
            self.statement(*found.motion)
        self.counter = {}
        self.forget(f"the ENDFOR in line {self.line + found.lines_after}", moved=False)
        self.line += found.lines_after

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
        feed = feed_setting(code)
        if feed is not None:
            self.rows.feed_mm_per_min = feed
        self.blending(code)
        changed = self.frames.read(raw, start, end, self.line)
        if changed is not None:
            self.forget(f"the {changed} set in line {self.line}", moved=False)
        elif EMBEDDED_MOTION.search(without_strings(code)) is not None:
            self.has_motion = True
            self.refuse("LIN", start, "a motion inside another statement")
        elif ASYNCHRONOUS.match(code) is not None:
            self.has_motion = True
            self.refuse("PTP", start, f"a motion that is not a pose: {shown(raw, start, end)!r}")
        else:
            why = boundary(code)
            if why is not None:
                self.after_call(f"{why} in line {self.line}")

    def blending(self, code: bytes) -> None:
        """What C_DIS means from here on, if a line says so."""
        self.path_data = path_data_name(code) or self.path_data
        blend = blend_setting(code)
        if isinstance(blend, float):
            self.blend_distance = blend
        elif blend is not None:
            named = self.path_data is not None and not self.piece
            self.blend_distance = self.points().blend_distance(self.path_data or "") if named else float("nan")

    def after_call(self, since: str) -> None:
        """Something may have moved the arm, and set another feed."""
        self.forget(since)
        self.rows.feed_mm_per_min = self.blend_distance = float("nan")
