"""Fanuc TP listings ``.ls``: motions of the ``/MN`` section to the points of the ``/POS`` section.

Decisions: every point is a whole pose, stored once and corrected where it stands; two motions to one point must agree.
Position registers, indirect points and the options that shift a target (``Offset``, ``Tool_Offset``, ``INC``) are refused.
A point names its user frame and tool by number, their values are the controller's. Further motion groups stay as they are;
where a motion is coordinated with them (``COORD``) they carry the workpiece and must stand still over the program.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

from drake_stiffness.errors import InputError
from toolpaths.conventions import FANUC
from toolpaths.formats import fanuc_pieces
from toolpaths.formats import fanuc_words as words
from toolpaths.formats.reading import HEAD_BYTES, NeedsWhole, Reading, Unreadable, blanked, shown
from toolpaths.program import Program

_GROUPS = "the points drive further motion groups as well; those stay as they are, and what they carry was reckoned to stand still"


class Fanuc:
    """TP listings as a dialect."""

    name = "fanuc"

    def recognises(self, raw: bytes, suffix: str) -> bool:
        """A line ``/PROG name`` with a section ``/ATTR``, ``/MN`` or ``/POS`` below it."""
        return words.RECOGNISED.search(raw, 0, HEAD_BYTES) is not None

    def companions(self, path: Path) -> tuple[Path, ...]:
        """None."""
        return ()

    def parse(self, raw: bytes, path: str, others: Sequence[tuple[str, bytes]] = ()) -> Program:
        """Read a listing; see ``toolpaths.formats.Dialect``.

        Raises
        ------
        InputError
            There is no motion in it.
        """
        reader = _Reader(raw)
        reader.read()
        if not reader.has_motion:
            raise InputError(
                f"{path}: found no motion in a section /MN; expected L, C, A or J to points P[n]; export the listing again"
            )
        return reader.finish(self.name, path)

    def cut(self, raw: bytes) -> int:
        """Where the last place is at which a listing may be cut in two; see ``toolpaths.formats.InPieces``."""
        return fanuc_pieces.cut(raw)

    def parse_piece(
        self, raw: bytes, path: str, resume: object, others: Sequence[tuple[str, bytes]] = (), last: bool = False
    ) -> tuple[Program, object]:
        """See ``toolpaths.formats.InPieces``; NeedsWhole where points are not used in the order in which they are listed."""
        resume = fanuc_pieces.first(raw) if resume is None else resume
        assert isinstance(resume, fanuc_pieces.Resume)
        begin, end, ended = fanuc_pieces.listed(raw, resume, last or resume.alone)
        points = _points(raw, begin, end)
        mine, rest, before = fanuc_pieces.share(resume, list(points), ended)
        reader = _Reader(mine.instructions)
        reader.points = {**mine.free, **points}
        reader.line += mine.lines
        if mine.so_far is not None:
            reader.take_over(mine.so_far)
        reader.code = blanked(reader.raw, words.NUMBERING_OR_REMARK)
        if not ended and reader.code.strip() and not reader.code.rstrip().endswith(b";"):
            raise NeedsWhole
        reader.instructions(0, len(reader.raw))
        along, by_joints = reader.used()
        if along & mine.free.keys():
            raise NeedsWhole
        rest = fanuc_pieces.still_free(rest, points, by_joints - along)
        so_far, reader.raw = reader.hand_on(), raw[: fanuc_pieces.end_before(raw, begin, before)]
        return replace(reader.finish(self.name, path), resume=mine), rest._replace(so_far=so_far)


def _points(raw: bytes, begin: int, end: int) -> dict[int, words.Point | str]:
    """The points of a section by number."""
    found: dict[int, words.Point | str] = {}
    for number, point in words.points(raw, begin, end):
        found[number] = "which is listed twice in /POS" if number in found else point
    return found


class _Reader(Reading):
    """Goes through ``/MN`` instruction by instruction, on a copy whose line numbers and remarks are blanks."""

    MODAL = ("numbers", "changes")

    def __init__(self, raw: bytes) -> None:
        super().__init__(raw, FANUC)
        self.points: dict[int, words.Point | str] = {}
        self.numbers = {"base": "as set on the controller", "tool": "as set on the controller"}
        self.changes: dict[str, int] = {}
        self.code = b""

    def read(self) -> None:
        raw = self.raw
        marks = [(match[1].upper(), match.end()) for match in words.SECTION.finditer(raw)]
        starts = [match.start() for match in words.SECTION.finditer(raw)] + [len(raw)]
        sections = {name: (begin, starts[place + 1]) for place, (name, begin) in reversed(list(enumerate(marks)))}
        self.points = _points(raw, *sections.get(b"POS", (0, 0)))
        start, end = sections.get(b"MN", (0, 0))
        self.code = raw[:start] + blanked(raw[start:end], words.NUMBERING_OR_REMARK)
        self.to(start)
        self.instructions(start, end)

    def instructions(self, at: int, end: int) -> None:
        code = self.code
        while at < end:
            match = words.MOVE.match(code, at)
            if match is not None:
                point = self.points.get(int(match[2]))
                if isinstance(point, words.Point):
                    self.to(match.start(1))
                    self.has_motion = True
                    self.rows.feed_mm_per_min = words.feed(match[3], match[4])
                    kind = match[1].upper().decode()
                    self.rows.blend_mm = words.blend(match[6])
                    coordinated = bool(point.groups) and b"COORD" in match[7].upper()
                    self.go(kind, "point", point, coordinated=coordinated)
                    at = match.end()
                    continue
            semicolon = code.find(b";", at, end)
            stop = end if semicolon < 0 else semicolon
            text = code[at:stop]
            self.to(at + len(text) - len(text.lstrip()))
            if text.strip():
                self.instruction(at, stop)
            at = stop + 1

    def used(self) -> tuple[set[object], set[object]]:
        """Points that motions along a path go to, and those that joint moves go to."""
        along = {point for row, point in self._goes if self.rows.carries_force(row)}
        return along, {point for row, point in self._goes if not self.rows.carries_force(row)}

    def go(self, kind: str, role: str, point: words.Point, *, coordinated: bool) -> None:
        """A motion to a point, with the frames that the point names (F: those that are set)."""
        for what, number in (("base", point.frame), ("tool", point.tool)):
            own = self.numbers[what] if number == b"F" else number.decode()
            key = f"{own} (set anew {self.changes[what + own]} times)" if what + own in self.changes else own
            text = f"{'UF' if what == 'base' else 'UT'} : {own}"
            if what == "base" and coordinated:
                key += f" on a positioner at {', '.join(group.decode() for group in point.groups)}"
                text += f", further groups at {', '.join(group.decode() for group in point.groups)}"
            self.set_frame(what, key, text)
        self.add(kind, role, point.target, force=kind != "J")
        if point.groups and not coordinated and _GROUPS not in self.warnings:
            self.warnings.append(_GROUPS)

    def instruction(self, start: int, end: int) -> None:
        """Any instruction that is not an ordinary motion."""
        code = self.code
        motion = words.MOTION.match(code, start, end)
        if motion is not None:
            self.has_motion = True
            try:
                self.motion(motion[1].upper().decode(), motion.start(1), motion.end(), end)
            except Unreadable as error:
                self.mention(self.named(start, end), shown(self.raw, start, end))
                self.refuse(error.at, error.found, force=motion[1].upper() != b"J")
        else:
            self.mention(self.named(start, end), shown(self.raw, start, end))
            self.setting(start, end)
            if words.BOUNDARY.match(code, start, end) is not None:
                self.rows.forget()
        indexed = words.INDEXED.search(code, start, end)
        if indexed is not None:
            found = f"{shown(self.raw, indexed.start(), end, 20)!r}: an indirect point may be any of the points"
            self.refuse(indexed.start(), found, force=False, fatal=True)

    def named(self, start: int, end: int) -> list[object]:
        return [int(number) for number in words.MENTIONED.findall(self.code, start, end)]

    def setting(self, start: int, end: int) -> None:
        number = words.FRAME_NUMBER.match(self.code, start, end)
        if number is not None:
            self.numbers["base" if number[1].upper() == b"FRAME" else "tool"] = shown(number[2], 0, len(number[2]))
        data = words.FRAME_DATA.match(self.code, start, end)
        if data is not None:
            what = "base" if data[1].upper() == b"FRAME" else "tool"
            which = what + shown(data[2], 0, len(data[2]))
            self.changes[which] = self.changes.get(which, 0) + 1
            said = "workpiece of process.yaml" if what == "base" else "tool.tcp of the cell"
            self.warnings.append(
                f"line {self.line}: {shown(self.raw, start, end)}: sets a frame while it runs; {said} was reckoned with"
            )

    def motion(self, kind: str, begin: int, at: int, end: int) -> None:
        """A motion that is no ordinary line: an arc, other options, a target that is no point."""
        code = self.code
        if kind == "S":
            raise Unreadable(begin, "S: the curve of a spline depends on all its points")
        targets = []
        for _ in range(2 if kind == "C" else 1):
            match = words.TARGET.match(code, at, end)
            if match is None:
                rest = code[at:end]
                at += len(rest) - len(rest.lstrip(b" \t\r\n:"))
                what = shown(self.raw, at, end, 20)
                raise Unreadable(
                    at,
                    f"{what!r}: a position register or an indirect point, whose numbers are not in /POS"
                    if what
                    else "no end point",
                )
            point = self.points.get(int(match[1]), "which is not in /POS")
            if isinstance(point, str):
                if kind == "J" and "joint angles" in point:
                    self.rows.forget()
                    return
                raise Unreadable(match.start(1), f"P[{match[1].decode()}], {point}")
            targets.append(point)
            at = match.end()
        speed = words.SPEED.match(code, at, end)
        self.rows.feed_mm_per_min = words.feed(speed[1], speed[2]) if speed is not None else math.nan
        self.rows.blend_mm = words.blend(code[speed.end() if speed is not None else at : end])
        option = words.unknown_option(code, speed.end() if speed is not None else at, end)
        if option is not None:
            found = option[1].decode("ascii", "backslashreplace")
            raise Unreadable(
                option[0],
                f"{found!r} behind the motion, which may shift its target by amounts that are not in this file",
            )
        coordinated = b"COORD" in code[at:end].upper()
        if len({(point.frame, point.tool) for point in targets}) > 1:
            raise Unreadable(begin, "an arc between two user frames or tools")
        roles = ("via", "end") if kind == "C" else ("point",)
        for role, point in zip(roles, targets, strict=True):
            self.go(kind, role, point, coordinated=coordinated and bool(point.groups))
