"""RAPID piece by piece: where a module may be cut, and what a piece takes over from those before it."""

from __future__ import annotations

import re
from typing import TYPE_CHECKING, Any, NamedTuple

from toolpaths.formats import rapid_words as words
from toolpaths.formats.reading import Continued, NeedsWhole, cut_between

if TYPE_CHECKING:
    from toolpaths.formats.rapid_reader import Reader

# What is in force or declared in a reader besides its rows; speed and tool are looked up anew.
_MODAL = ("routine", "conf_off", "points", "speeds", "zones", "local", "frame_data", "assigned")
_REST_OF_LINE = re.compile(rb"[ \t]*(?:![^\r\n]*)?\r*(?:\n|\Z)")
_CONFDATA = 10


class Resume(NamedTuple):
    """What a reader hands on to the next piece of a module: as every reader, and what is in force or declared, by name."""

    so_far: Continued | None
    modal: dict[str, Any]


START = Resume(None, {})


def cut(raw: bytes) -> int:
    """Where the last place is at which a module may be cut in two, 0 for none: between two moves along a line with literal
    targets and the same confdata, each on a line of its own.
    """
    return cut_between(raw, _along, lambda before, after: before[_CONFDATA] == after[_CONFDATA])


def _along(raw: bytes, at: int) -> re.Match[bytes] | None:
    match = words.MOVE_LITERAL.match(raw, at)
    alone = match is not None and b"\n" not in match[0] and _REST_OF_LINE.match(raw, match.end()) is not None
    return match if match is not None and alone and match[1].upper() == b"MOVEL" else None


def take_over(reader: Reader, resume: Resume) -> None:
    """Go on where the piece before ended."""
    if resume.so_far is None:
        return
    for name, value in resume.modal.items():
        setattr(reader, name, value.copy() if isinstance(value, dict | set) else value)
    reader.take_over(resume.so_far)


def hand_on(reader: Reader) -> Resume:
    """What the next piece needs to know.

    Raises
    ------
    NeedsWhole
        A move along a path goes to a declared point, which other pieces may use too; or a tool or work object in use is
        assigned to.
    """
    used = {(setting.key or "").encode() for setting in reader.frames}
    if reader.goes_to_stored or used & reader.assigned:
        raise NeedsWhole
    return Resume(reader.hand_on(), {name: getattr(reader, name) for name in _MODAL})
