"""Fanuc listings piece by piece: the points are cut, and every piece goes through the instructions that go to its points.

The instructions of ``/MN`` come with the first piece and are handed on as they are; the points of ``/POS`` follow. Where the
points of a piece are used by instructions that follow each other, and no other instruction uses them, the piece is a listing
of its own. Some points that joint moves alone go to, such as home, are handed on: nothing corrects them.
"""

from __future__ import annotations

import re
from collections.abc import Collection, Iterator, Mapping, Sequence
from typing import NamedTuple

from toolpaths.formats import fanuc_words as words
from toolpaths.formats.reading import Continued, NeedsWhole

# So many points are handed on.
_FREE = 100
# So far from the end of what was read a point begins at the latest.
_CUT_WITHIN = 65_536
_REMARK_OR_POINT = re.compile(
    rb"^[ \t]*+\d*+[ \t]*+:[ \t]*(?:!|//|--)[^\r\n]*|P\s*\[\s*(\d{1,9})", re.MULTILINE | re.IGNORECASE
)


class Resume(NamedTuple):
    """What a reader hands on to the next piece of a listing.

    Attributes
    ----------
    so_far
        As every reader; None before the first piece.
    lines
        Lines of the file before the instructions.
    instructions, at
        What stands below ``/MN``, and where in it the next piece goes on.
    last
        The largest number of a point so far.
    alone
        Whether the instructions are those of one piece alone.
    free
        Points of pieces before that later ones may use, because no correction changes them.
    """

    so_far: Continued | None
    lines: int
    instructions: bytes
    at: int
    last: int
    alone: bool
    free: dict[int, words.Point | str]


def cut(raw: bytes) -> int:
    """Where the last place is at which a listing may be cut in two, 0 for none: before a point of ``/POS``."""
    begin = 0
    if words.HEAD.match(raw) is None:
        marks = words.SECTION.finditer(raw) if b"/POS" in raw else ()
        begin = next((mark.end() for mark in marks if mark[1] == b"POS"), len(raw))
    found = [match.start() for match in words.HEAD.finditer(raw, max(begin, len(raw) - _CUT_WITHIN))]
    return found[-1] if found else 0


def first(raw: bytes) -> Resume:
    """What the first piece starts from.

    Raises
    ------
    NeedsWhole
        It does not hold one section ``/MN`` with ``/POS`` behind it.
    """
    marks = list(words.SECTION.finditer(raw))
    if [mark[1] for mark in marks[:2]] != [b"MN", b"POS"]:
        raise NeedsWhole
    begin = raw.find(b"\n", marks[0].end()) + 1
    if raw[marks[0].end() : begin].strip():
        raise NeedsWhole
    return Resume(None, raw.count(b"\n", 0, begin), raw[begin : marks[1].start()], 0, -1, False, {})


def listed(raw: bytes, resume: Resume, last: bool) -> tuple[int, int, bool]:
    """Where the points of a piece stand, and whether the listing ends there.

    Raises
    ------
    NeedsWhole
        More sections than ``/MN``, ``/POS`` and ``/END``, or something below the end.
    """
    begin, marks = 0, list(words.SECTION.finditer(raw))
    if resume.so_far is None:
        begin, marks = marks[1].end(), marks[2:]
    if not marks:
        return begin, len(raw), last
    if marks[0][1] != b"END" or not last:
        raise NeedsWhole
    return begin, marks[0].start(), True


class Share(NamedTuple):
    """What a piece goes through alone, what is left for those after it, and the point before which the piece ends, if not at its end."""

    mine: Resume
    rest: Resume
    before: int | None = None


def share(resume: Resume, numbers: Sequence[int], ended: bool) -> Share:
    """The instructions that use the points of these numbers.

    An instruction that uses points of the next piece too belongs to that, and the points it uses with it.

    Raises
    ------
    NeedsWhole
        An instruction uses a point of a piece before, or points are not listed in rising order where pieces meet.
    """
    if resume.alone:
        return Share(resume, resume)
    if numbers and min(numbers) <= resume.last:
        raise NeedsWhole
    last, text = max(numbers, default=resume.last), resume.instructions
    stop, before = len(text), None
    for at, number in _used(text, resume.at, len(text)):
        if number <= resume.last and number not in resume.free:
            raise NeedsWhole
        if number > last and not ended:
            stop = _line_of_instruction(text, resume.at, at)
            before = min((used for _, used in _used(text, stop, at)), default=None)
            break
    if before is not None:
        last = before - 1
        place = numbers.index(before) if before in numbers else -1
        # Only the first piece, which holds the instructions, may be left without a point.
        whole = place > 0 or (place == 0 and resume.so_far is None)
        in_order = max(numbers[:place], default=last) <= last < min(numbers[place:])
        if not whole or not in_order or any(number > last for _, number in _used(text, resume.at, stop)):
            raise NeedsWhole
    mine = resume._replace(instructions=text[resume.at : stop], at=0, alone=True)
    return Share(mine, resume._replace(at=stop, last=last), before)


def still_free(rest: Resume, points: Mapping[int, words.Point | str], by_joints: Collection[object]) -> Resume:
    """What is left for the pieces after one with these points, of which joint moves alone go to some."""
    free = dict(rest.free)
    for number, point in points.items():
        if number > rest.last or len(free) >= _FREE:
            break
        if isinstance(point, str):
            free[number] = point
        elif number in by_joints:
            free[number] = point._replace(target=point.target.elsewhere())
    return rest._replace(free=free)


def end_before(raw: bytes, begin: int, number: int | None) -> int:
    """Where a piece ends whose points begin at `begin`, if it ends before a point."""
    if number is None:
        return len(raw)
    return next(match.start() for match in words.HEAD.finditer(raw, begin) if int(match[1]) == number)


def _used(text: bytes, begin: int, end: int) -> Iterator[tuple[int, int]]:
    """Where points are named outside remarks, and their numbers."""
    for match in _REMARK_OR_POINT.finditer(text, begin, end):
        if match[1] is not None:
            yield match.start(), int(match[1])


def _line_of_instruction(text: bytes, begin: int, at: int) -> int:
    """The line after the last semicolon before a byte."""
    semicolon = text.rfind(b";", begin, at)
    if semicolon < 0:
        return begin
    newline = text.find(b"\n", semicolon, at)
    if newline < 0 or text[semicolon + 1 : newline].strip():
        raise NeedsWhole
    return newline + 1
