"""A plain FOR over an array: ``FOR i = 1 TO 900 / LIN P[i] C_VEL / ENDFOR`` stands for 900 motions to stored points.

Plain means: the range is of whole numbers that are written (or an INT declared once with a number), there is one motion in
the body and it goes to an element by the counter, and nothing else in the body moves, branches or writes the counter. A call
may stand in it where the counter is the routine's own and is not handed over: whatever it does, the motion goes to the same points.
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
    called,
    fatal_setting,
    frame_setting,
    frames_by_data,
)
from toolpaths.formats.krl_words import code_end

_FOR = re.compile(
    rb"\s*FOR\s+([A-Za-z_]\w*)\s*=\s*(\d{1,9})\s+TO\s+(?:(\d{1,9})|([A-Za-z_]\w*))(?:\s+STEP\s+1)?\s*", re.IGNORECASE
)
_END = re.compile(rb"\s*ENDFOR\s*\Z", re.IGNORECASE)
_CALL = re.compile(rb"\s*([A-Za-z_]\w*)\s*\(([^()]*)\)\s*")
_ROUTINE = re.compile(rb"^[ \t]*(?:GLOBAL[ \t]+)?DEF(?:FCT)?[ \t]", re.IGNORECASE | re.MULTILINE)
_STATEMENTS = 40  # a longer body is no list of points


class Loop(NamedTuple):
    """The loop's counter (upper case) and values, its motion's bytes, the lines before and after that, and where it ends.

    `calls` names what is called in it and may move the arm, or is None.
    """

    counter: str
    values: range
    motion: tuple[int, int]
    lines_before: int
    lines_after: int
    end: int
    calls: str | None


def plain_loop(raw: bytes, start: int, stop: int, points: Callable[[], Points]) -> Loop | None:
    """The loop that begins at a line (`stop`: the end of its code), or None where it is not plain."""
    head = _FOR.fullmatch(raw, start, stop)
    if head is None:
        return None
    counter = head[1].decode().upper()
    written = re.compile(rb"(?<![\w$.])%s\s*=(?!=)" % re.escape(head[1]), re.IGNORECASE)
    motion: tuple[int, int] | None = None
    calls: str | None = None
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
            return None if values is None else Loop(counter, values, motion, before, lines - before, end, calls)
        if MOTION.match(code):
            by_counter = re.search(rb"\[\s*%s\s*\]" % re.escape(head[1]), code, re.IGNORECASE)
            if motion is not None or by_counter is None:
                return None
            motion, before = (at, at + len(code)), lines
        elif (call := _harmless_call(raw, start, code, head[1])) is not None:
            calls = call
        elif _disturbs(code, written):
            return None
    return None


def _harmless_call(raw: bytes, start: int, code: bytes, counter: bytes) -> str | None:
    """What a statement calls, where that cannot change the counter: it is declared in the routine and not an argument."""
    call = _CALL.fullmatch(code)
    if call is None or called(code) is None:
        return None
    routine = max((m.end() for m in _ROUTINE.finditer(raw, 0, start)), default=0)
    declared = rb"^[ \t]*(?:DECL[ \t]+)?INT[ \t]+(?:\w+[ \t]*,[ \t]*)*%s(?!\w)" % re.escape(counter)
    own = re.compile(declared, re.IGNORECASE | re.MULTILINE).search(raw, routine, start) is not None
    bare = re.search(rb"(?:^|[(,])\s*%s\s*(?:[,)]|$)" % re.escape(counter), call[2], re.IGNORECASE)
    return call[1].decode() if own and bare is None else None


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
