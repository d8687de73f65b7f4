"""RAPID piece by piece: where a module may be cut."""

from __future__ import annotations

import re

from toolpaths.formats import rapid_words as words
from toolpaths.formats.reading import cut_between

_REST_OF_LINE = re.compile(rb"[ \t]*(?:![^\r\n]*)?\r*(?:\n|\Z)")
_CONFDATA = 10


def cut(raw: bytes) -> int:
    """Where the last place is at which a module may be cut in two, 0 for none: between two moves along a line with literal
    targets and the same confdata, each on a line of its own.
    """
    return cut_between(raw, _along, lambda before, after: before[_CONFDATA] == after[_CONFDATA])


def _along(raw: bytes, at: int) -> re.Match[bytes] | None:
    match = words.MOVE_LITERAL.match(raw, at)
    alone = match is not None and b"\n" not in match[0] and _REST_OF_LINE.match(raw, match.end()) is not None
    return match if match is not None and alone and match[1].upper() == b"MOVEL" else None
