"""Universal Robots URScript: ``movel``, ``movep`` and ``movec`` to poses ``p[x, y, z, rx, ry, rz]`` in metres and radians.

Decisions: a pose is written in the move, or in one assignment ``name = p[...]`` that nothing else uses; expressions are
refused. ``pose_trans(frame, p[...])`` is a pose in a base frame that the script sets, where the frame is a literal too.
Poses without it are in the robot's own base frame. ``movej`` carries no force.
"""

from __future__ import annotations

import math
import re
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from drake_stiffness.errors import InputError
from toolpaths.conventions import ROTATION_VECTOR
from toolpaths.formats import urscript_words as words
from toolpaths.formats.reading import (
    HEAD_BYTES,
    Continued,
    NeedsWhole,
    Reading,
    Target,
    Unreadable,
    arguments,
    blanked,
    cut_between,
    shown,
)
from toolpaths.program import Program

UNIT = np.array([1000.0] * 3 + [1.0] * 3)
_MM_PER_MIN = 60_000.0
# Place of the blend radius among the arguments after the poses. Where it is not the third, that is the time.
_RADIUS_AT = {b"movel": 3, b"movej": 3, b"movep": 2, b"movec": 2}


class UrScript:
    """URScript programs as a dialect."""

    name = "urscript"

    def recognises(self, raw: bytes, suffix: str) -> bool:
        """A line ``def name():`` or a call such as ``movel(``, outside XML (VAL3 has a ``movel`` too)."""
        return words.RECOGNISED.search(raw, 0, HEAD_BYTES) is not None and raw.find(b"<![CDATA[", 0, HEAD_BYTES) < 0

    def companions(self, path: Path) -> tuple[Path, ...]:
        """None."""
        return ()

    def parse(self, raw: bytes, path: str, others: Sequence[tuple[str, bytes]] = ()) -> Program:
        """Read a script; see ``toolpaths.formats.Dialect``.

        Raises
        ------
        InputError
            There is no motion in it.
        """
        reader = _Reader(raw)
        reader.read()
        if not reader.has_motion:
            raise InputError(
                f"{path}: found no motion; expected movel, movep, movec or movej; give the script that holds the motions"
            )
        return reader.finish(self.name, path, UNIT)

    def cut(self, raw: bytes) -> int:
        """Where the last place is at which a script may be cut in two, 0 for none: between two moves along a path to literal
        poses, each on a line of its own.
        """
        return cut_between(raw, words.ORDINARY.match, lambda before, after: b"movej" not in (before[1], after[1]))

    def parse_piece(
        self, raw: bytes, path: str, resume: object, others: Sequence[tuple[str, bytes]] = (), last: bool = False
    ) -> tuple[Program, object]:
        """See ``toolpaths.formats.InPieces``; NeedsWhole where moves along a path go to named poses."""
        assert resume is None or isinstance(resume, Continued)
        reader = _Reader(raw)
        if resume is not None:
            reader.take_over(resume)
        reader.read()
        reader.left_open &= not last
        return replace(reader.finish(self.name, path, UNIT), resume=resume), reader.hand_on()


class _Reader(Reading):
    """Goes through a script statement by statement, on a copy whose comments and strings are blanks."""

    MODAL = ("poses", "numbers", "first_set", "assigned_again", "last_block")

    def __init__(self, raw: bytes) -> None:
        super().__init__(raw, ROTATION_VECTOR)
        self.code = blanked(raw, words.COMMENT_OR_STRING)
        self.poses: dict[bytes, Target | str] = {}
        self.numbers: dict[bytes, float] = {}
        self.first_set: dict[bytes, int] = {}
        self.assigned_again: set[bytes] = set()
        self.last_block = 0
        self.left_open = False
        # Call and options of the last ordinary move, and feed and blend that they say; an assignment may change what they mean.
        self.options: tuple[bytes, bytes] | None = None
        self.fast = math.nan, math.nan

    def read(self) -> None:
        code, at, size = self.code, 3 if self.raw.startswith(b"\xef\xbb\xbf") else 0, len(self.raw)
        while at < size:
            match = words.ORDINARY.match(code, at)
            if match is not None:
                self.to(match.start(1))
                self.has_motion = True
                if (match[1], match[8]) != self.options:
                    self.options = match[1], match[8]
                    self.mention(self.names(*match.span(8)), shown(self.raw, *match.span()))
                    options = arguments(code, *match.span(8))[1:]
                    self.fast = self.feed(match[1], options), self.blend(match[1], options)
                self.rows.feed_mm_per_min, self.rows.blend_mm = self.fast
                self.set_frame("base", "base", "the robot's base frame")
                target = Target(match.groups()[1:7], match.regs[2:8])
                self.add(match[1].upper().decode(), "point", target, force=match[1] != b"movej")
                at = match.end()
                continue
            end = self.statement_end(at)
            text = code[at:end]
            if text.strip():
                start = at + len(text) - len(text.lstrip())
                self.to(start)
                self.statement(start, end)
            at = end + 1

    def statement_end(self, at: int) -> int:
        """The end of the line, or of the line on which the brackets opened here are closed."""
        depth = 0
        for mark in words.BRACKET.finditer(self.code, at):
            if mark[0] == b"\n":
                if depth <= 0:
                    return mark.start()
            else:
                depth += 1 if mark[0] in b"[({" else -1
        self.left_open = depth > 0
        return len(self.code)

    def hand_on(self) -> Continued:
        """See `Reading`.

        Raises
        ------
        NeedsWhole
            A move along a path goes to a named pose, which other pieces may use too; or a bracket is not closed in this one.
        """
        if self.goes_to_stored or self.left_open:
            raise NeedsWhole
        return super().hand_on()

    def names(self, start: int, end: int) -> list[object]:
        found: list[object] = list(words.IDENTIFIER.findall(self.code, start, end))
        return found

    def statement(self, start: int, end: int) -> None:
        """Any statement that is no ordinary move."""
        code, done = self.code, start
        for call in words.CALL.finditer(code, start, end):
            if call.start() < done:
                continue
            self.mention(self.names(done, call.start()), shown(self.raw, start, end))
            done = end
            self.has_motion = self.has_motion or call[1] != b"set_tcp"
            try:
                pieces, done = self.call_arguments(call.end(), end)
                if call[1] == b"set_tcp":
                    self.set_tcp(pieces)
                else:
                    self.motion(call, pieces)
            except Unreadable as error:
                self.mention(self.names(call.end(), done), shown(self.raw, start, end))
                self.refuse(error.at, error.found, force=call[1] not in (b"movej", b"servoj", b"speedj"))
        if done == start:
            self.assignment(start, end)
        else:
            self.mention(self.names(done, end), shown(self.raw, start, end))
        if words.BLOCK.match(code, start, end) is not None:
            self.last_block = self.line
            self.rows.forget()
        elif done == start and words.STILL.match(code, start, end) is None:
            self.rows.forget()

    def call_arguments(self, start: int, end: int) -> tuple[list[tuple[int, int]], int]:
        """Spans of the arguments of a call, and the byte after its bracket."""
        depth = 1
        for mark in words.BRACKET.finditer(self.code, start, end):
            depth += 1 if mark[0] in b"[({" else -1 if mark[0] in b"])}" else 0
            if depth == 0:
                return arguments(self.code, start, mark.start()), mark.end()
        raise Unreadable(start, "a bracket that is not closed")

    def assignment(self, start: int, end: int) -> None:
        """Names that get a literal pose or number; every other use of a name is noted."""
        code, self.options = self.code, None
        match = words.ASSIGNED.match(code, start, end)
        if match is None or match[2] is not None or match[3] != b"=":
            self.mention(self.names(start, end), shown(self.raw, start, end))
            return
        name, value = match[1], code[match.end() : end].strip()
        self.first_set.setdefault(name, self.line)
        pose = words.POSE.fullmatch(code, match.end(), match.end() + len(value))
        again = name in self.poses
        if pose is not None:
            self.poses[name] = Target(pose.groups(), pose.regs[1:7], point=name)
        elif again:
            self.poses[name] = "which is computed"
        if again:
            self.assigned_again.add(name)
            self.mention([name], f"another value of {name.decode()}")
        self.numbers.pop(name, None)
        if words.NUMBER_ALONE.fullmatch(value) is not None:
            self.numbers[name] = float(value)
        if pose is None:
            self.mention(self.names(match.end(), end), shown(self.raw, start, end))

    def motion(self, call: re.Match[bytes], pieces: list[tuple[int, int]]) -> None:
        """A motion call with its arguments."""
        code, name = self.code, call[1].decode()
        if name not in ("movel", "movep", "movec", "movej"):
            raise Unreadable(call.start(), f"{name}: a motion that is no move to a pose")
        arc = name == "movec"
        keys = ("pose_via", "pose_to") if arc else ("pose",)
        named = {
            found[1].decode(): (found.end(), piece[1])
            for piece in pieces
            if (found := words.KEYWORD.match(code, *piece)) is not None
        }
        places = [
            named.get(key, pieces[place] if place < len(pieces) else (call.end(), call.end()))
            for place, key in enumerate(keys)
        ]
        options = [piece for piece in pieces if piece not in places and (piece[1] not in [end for _, end in places])]
        if name == "movej" and (code[places[0][0] : places[0][0] + 1] == b"[" or self.is_joints(places[0])):
            self.rows.forget()
            return
        targets = [self.target(*place, force=name != "movej") for place in places]
        for piece in options:
            self.mention(self.names(*piece), shown(self.raw, *piece))
        self.rows.feed_mm_per_min = self.feed(call[1], options)
        self.rows.blend_mm = self.blend(call[1], options)
        for role, target in zip(("via", "end") if arc else ("point",), targets, strict=True):
            self.add(name.upper(), role, target, force=name != "movej")

    def is_joints(self, place: tuple[int, int]) -> bool:
        """Whether a name is no pose (joint positions, or the result of a call)."""
        text = self.code[slice(*place)]
        return re.fullmatch(words.NAME, text) is not None and text not in self.poses

    def target(self, start: int, end: int, *, force: bool) -> Target:
        """A literal pose or the name of one, in the base frame or behind ``pose_trans`` of a literal frame."""
        code = self.code
        frame: bytes | None = None
        within = words.POSE_TRANS.match(code, start, end)
        if within is not None and code[start:end].rstrip().endswith(b")"):
            pieces, done = self.call_arguments(within.end(), end)
            if len(pieces) == 2 and done == end and re.fullmatch(words.NAME, code[slice(*pieces[0])]) is not None:
                frame, (start, end) = code[slice(*pieces[0])], pieces[1]
        what = repr(shown(self.raw, start, end))
        text = code[start:end]
        match = words.POSE.fullmatch(code, start, end)
        if match is not None:
            target = Target(match.groups(), match.regs[1:7])
        elif re.fullmatch(words.NAME, text) is not None:
            found = self.poses.get(text, "which is not assigned a literal pose before")
            if isinstance(found, str):
                raise Unreadable(start, f"the pose {what}, {found}")
            target = found
        elif text.startswith(b"["):
            raise Unreadable(start, f"{what}: joint positions in a motion along a path")
        else:
            raise Unreadable(start, f"the pose {what}, which is computed while the script runs" if text else "no pose")
        if frame is not None:
            self.set_base(frame, start)
        elif force:
            self.set_frame("base", "base", "the robot's base frame")
        return target

    def set_base(self, name: bytes, at: int) -> None:
        """The frame of ``pose_trans``: its last literal value, unless another way through the script may give it another."""
        pose = self.poses.get(name)
        key = name.decode()
        if not isinstance(pose, Target) or (name in self.assigned_again and self.last_block > self.first_set[name]):
            raise Unreadable(at, f"a pose in the frame {key!r}, whose value is not one literal p[...]")
        literal = _literal(pose)
        self.mention([name], f"as the frame {key}")
        self.set_frame("base", f"{key} {literal}", f"pose_trans({key}, ..)", literal, convention=ROTATION_VECTOR)

    def set_tcp(self, pieces: list[tuple[int, int]]) -> None:
        text = self.code[slice(*pieces[0])]
        match = words.POSE.fullmatch(self.code, *pieces[0])
        pose = Target(match.groups(), match.regs[1:7]) if match is not None else self.poses.get(text)
        said = f"set_tcp({shown(self.raw, *pieces[0])})"
        if isinstance(pose, Target):
            literal = _literal(pose)
            self.set_frame("tool", str(literal), said, literal, convention=ROTATION_VECTOR)
        else:
            self.set_frame("tool", said, said, origin="expression")

    def feed(self, call: bytes, options: list[tuple[int, int]]) -> float:
        """Programmed feed in mm/min; NaN where a time is given or the speed is computed."""
        speed = math.nan
        for place, piece in enumerate(options):
            found = words.KEYWORD.match(self.code, *piece)
            value = self.code[found.end() if found else piece[0] : piece[1]].strip()
            number = float(value) if words.NUMBER_ALONE.fullmatch(value) else self.numbers.get(value, math.nan)
            if (found[1] == b"v") if found else place == 1:
                speed = number * _MM_PER_MIN
            elif ((found[1] == b"t") if found else place == _RADIUS_AT[call] - 1 != 1) and number != 0:
                return math.nan
        return speed

    def blend(self, call: bytes, options: list[tuple[int, int]]) -> float:
        """Blend radius in mm, 0 where none is given; NaN where it is computed."""
        radius = 0.0
        for place, piece in enumerate(options):
            found = words.KEYWORD.match(self.code, *piece)
            if (found[1] == b"r") if found else place == _RADIUS_AT[call]:
                value = self.code[found.end() if found else piece[0] : piece[1]].strip()
                radius = float(value) if words.NUMBER_ALONE.fullmatch(value) else self.numbers.get(value, math.nan)
        return 1000.0 * radius


def _literal(pose: Target) -> tuple[float, ...]:
    return tuple((np.array([float(token) for token in pose.tokens]) * UNIT).tolist())
