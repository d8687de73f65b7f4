"""A plain FOR over an array: ``FOR i = 1 TO 900 / LIN P[i] C_VEL / ENDFOR`` stands for 900 motions to stored points.

Plain means: the range is of whole numbers that are written (or an INT declared once with a number), there is one motion in
the body and it goes to an element by the counter, and nothing else in the body moves, branches or writes the counter.
"""

from __future__ import annotations

import re
from collections.abc import Callable
from typing import NamedTuple

from toolpaths.formats.krl_points import Points
from toolpaths.formats.krl_statements import (
    EMBEDDED_MOTION,
    MOTION,
    boundary,
    fatal_setting,
    frame_setting,
    frames_by_data,
)
from toolpaths.formats.krl_words import code_end

_FOR = re.compile(
    rb"\s*FOR\s+([A-Za-z_]\w*)\s*=\s*(\d{1,9})\s+TO\s+(?:(\d{1,9})|([A-Za-z_]\w*))(?:\s+STEP\s+1)?\s*", re.IGNORECASE
)
_END = re.compile(rb"\s*ENDFOR\s*\Z", re.IGNORECASE)
_STATEMENTS = 40  # a longer body is no list of points


class Loop(NamedTuple):
    """The loop's counter (upper case) and values, its motion's bytes, the lines before and after that, and where it ends."""

    counter: str
    values: range
    motion: tuple[int, int]
    lines_before: int
    lines_after: int
    end: int


def plain_loop(raw: bytes, start: int, stop: int, points: Callable[[], Points]) -> Loop | None:
    """The loop that begins at a line (`stop`: the end of its code), or None where it is not plain."""
    head = _FOR.fullmatch(raw, start, stop)
    if head is None:
        return None
    counter = head[1].decode().upper()
    written = re.compile(rb"(?<![\w$.])%s\s*=(?!=)" % re.escape(head[1]), re.IGNORECASE)
    motion: tuple[int, int] | None = None
    newline = raw.find(b"\n", stop)
    before = 0
    for lines in range(1, _STATEMENTS + 1):
        if newline < 0:
            return None
        at = newline + 1
        newline = raw.find(b"\n", at)
        end = len(raw) if newline < 0 else newline + 1
        code = raw[at : code_end(raw, at, end)]
        if _END.match(code):
            if motion is None:
                return None
            values = _range(head, points)
            return None if values is None else Loop(counter, values, motion, before, lines - before, end)
        if MOTION.match(code):
            by_counter = re.search(rb"\[\s*%s\s*\]" % re.escape(head[1]), code, re.IGNORECASE)
            if motion is not None or by_counter is None:
                return None
            motion, before = (at, at + len(code)), lines
        elif _disturbs(code, written):
            return None
    return None


def _disturbs(code: bytes, written: re.Pattern[bytes]) -> bool:
    stripped = code.strip()
    if not stripped:
        return False
    return bool(
        boundary(stripped)
        or fatal_setting(stripped)
        or frames_by_data(stripped)
        or frame_setting(stripped, 0, len(stripped), 0)
        or EMBEDDED_MOTION.search(stripped)
        or written.search(stripped)
        or stripped.upper().startswith((b"EXIT", b"HALT", b"CONTINUE"))
    )


def _range(head: re.Match[bytes], points: Callable[[], Points]) -> range | None:
    last = int(head[3]) if head[3] else points().whole_number(head[4].decode())
    first = int(head[2])
    return None if last is None or not 0 <= last - first < len(points()) else range(first, last + 1)
