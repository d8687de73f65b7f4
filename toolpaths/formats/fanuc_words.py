"""The small pieces of Fanuc ``.ls`` listings: points of the ``/POS`` section, motion instructions and what may stand behind them."""

from __future__ import annotations

import math
import re
from collections.abc import Iterator
from functools import lru_cache
from typing import NamedTuple

from toolpaths.formats.reading import NO_EXTERNALS, NUMBER, Status, Target, shown

_FLAGS = re.IGNORECASE
RECOGNISED = re.compile(
    rb"^(?:\xef\xbb\xbf)?[ \t]*/PROG[ \t]+\S[^\r\n]*\r*\n(?:[^\r\n]*\r*\n){0,200}?[ \t]*/(?:ATTR|APPL|MN|POS)\b",
    re.MULTILINE,
)
SECTION = re.compile(rb"^[ \t]*/(MN|POS|END)\b", re.MULTILINE)

# Line numbers with their colon, and remarks: what is not the instruction itself.
NUMBERING_OR_REMARK = re.compile(rb"^[ \t]*+\d*+[ \t]*+:[ \t]*(?:(?:!|//|--)[^\r\n]*)?", re.MULTILINE)

_POINT = rb"P\s*\[\s*(\d{1,9})\s*(?::[^\]\r\n]*)?\]"
_NUM = rb"\s*=\s*(" + NUMBER + rb")\s*"
_SPEED = rb"((?:\d{1,9}(?:\.\d{0,9})?|\.\d{1,9})|R\[[^\]\r\n]{1,20}\])\s*(mm/sec|cm/min|inch/min|deg/sec|msec|sec|%)|(WELD_SPEED|max_speed|AR\[\d+\]\s*\w*/?\w*)"
# What nearly all lines of a program look like.
MOVE = re.compile(
    rb"\s*([LJA])\s*"
    + _POINT
    + rb"\s*(?:"
    + _SPEED
    + rb")\s*(FINE|CNT\s*\d{1,3})((?:\s+ACC\s*\d{1,3})?\s*(?:\bCOORD\b)?\s*(?:\bPTH\b)?)\s*;",
    _FLAGS,
)
MOTION = re.compile(rb"\s*([LJCAS])\s*(?=P(?:R)?\s*\[)", _FLAGS)
TARGET = re.compile(rb"\s*:?\s*" + _POINT, _FLAGS)
SPEED = re.compile(rb"\s*(?:" + _SPEED + rb")", _FLAGS)
INDEXED = re.compile(rb"(?<![A-Za-z])P\s*\[\s*(?:A?R)\s*\[", _FLAGS)
MENTIONED = re.compile(rb"(?<![A-Za-z])P\s*\[\s*(\d{1,9})", _FLAGS)
# Options that leave the target where it is.
_HARMLESS = re.compile(
    rb"\s*(?:FINE|(?:CNT|CR|CD|ACC|PSPD|AP_LD|RT_LD|EV|Ind\.EV)\s*(?:\d{1,6}(?:\.\d*)?\s*(?:mm|%)?|R\[\d+\]\s*(?:mm|%)?)|Wjnt|BREAK|PTH|MROT|COORD(?:\[[^\]]*\])?"
    rb"|Skip(?:Jump)?\s*,\s*LBL\[[^\]]*\](?:\s*,\s*PR\[[^\]]*\]\s*=\s*[LJ]POS)?|(?:TA|TB|DB|DA)\s*[+-]?[\d.]+\s*(?:sec|mm)?\s*,\s*[^;\r\n]*"
    rb"|(?:Arc|Weld)\s+(?:Start|End)\s*\[[^\]]*\]|Weave\s+[\w ]{1,30}(?:\[[^\]]*\])?)(?![A-Za-z_])\s*,?",
    _FLAGS,
)
FRAME_NUMBER = re.compile(rb"\s*U(FRAME|TOOL)_NUM(?:\[GP\d[^\]]*\])?\s*=\s*([^;]*)", _FLAGS)
FRAME_DATA = re.compile(rb"\s*U(FRAME|TOOL)\s*\[\s*([^\]]*)\]\s*=", _FLAGS)
BOUNDARY = re.compile(rb"\s*(?:LBL|JMP|IF|ELSE|ENDIF|SELECT|FOR|ENDFOR|CALL|RUN|END|ABORT|MONITOR)\b|\s*=", _FLAGS)

_HEAD = rb"P\s*\[\s*(\d{1,9})\s*(?::[^\]\r\n]*)?\]\s*\{"
HEAD = re.compile(rb"^[ \t]*" + _HEAD, re.MULTILINE)
BLOCK = re.compile(HEAD.pattern + rb"([^{}]*)\}", re.MULTILINE)
_WORDS = rb"\s*,".join(
    rb"\s*%s%s%s" % (word, _NUM, unit)
    for word, unit in zip((b"X", b"Y", b"Z", b"W", b"P", b"R"), (b"mm",) * 3 + (b"deg",) * 3, strict=True)
)
# Of a point the first motion group is the arm; further groups are axes of their own and stay as they are.
_CARTESIAN = re.compile(
    rb"\s*GP1\s*:\s*UF\s*:\s*(\w+)\s*,\s*UT\s*:\s*(\w+)\s*,\s*CONFIG\s*:\s*'([^'\r\n]*)'\s*,"
    + _WORDS
    + rb"((?:\s*,\s*E[1-6]\s*=[^,{}=]{1,40})*)\s*(GP[2-9][^{}]*)?",
    _FLAGS,
)
_EXTERNAL = re.compile(rb"E([1-6])" + _NUM + rb"(?:mm|deg)\s*\Z", _FLAGS)
_JOINTS = re.compile(rb"\s*GP1\s*:[^{}]*?\bJ1\s*=", _FLAGS)
_GROUP = re.compile(rb"J\d\s*=\s*(" + NUMBER + rb")", _FLAGS)

FEED = {b"MM/SEC": 60.0, b"CM/MIN": 10.0, b"INCH/MIN": 25.4}


class Point(NamedTuple):
    """A stored point: its pose, the numbers of its user frame and tool, where further motion groups stand."""

    target: Target
    frame: bytes
    tool: bytes
    groups: tuple[bytes, ...]


def points(raw: bytes, start: int, end: int) -> Iterator[tuple[int, Point | str]]:
    """Number and content of the points of a ``/POS`` section, or why a point is no whole literal pose."""
    for block in BLOCK.finditer(raw, start, end):
        number = int(block[1])
        match = _CARTESIAN.fullmatch(raw, *block.span(2))
        if match is None:
            joints = _JOINTS.match(raw, *block.span(2)) is not None
            yield (
                number,
                "which holds joint angles"
                if joints
                else f"which is no whole literal pose: {shown(raw, *block.span(2))!r}",
            )
            continue
        external = list(NO_EXTERNALS)
        problem = None
        for piece in match[10].split(b",")[1:]:
            found = _EXTERNAL.fullmatch(piece.strip())
            if found is None:
                problem = f"whose external axis is not literal: {shown(piece, 0, len(piece))!r}"
            else:
                external[int(found[1]) - 1] = float(found[2])
        target = Target(match.groups()[3:9], match.regs[4:10], tuple(external), status(match[3]), number)
        groups = tuple(_GROUP.findall(match[11])) if match[11] else ()
        yield number, problem or Point(target, match[1].upper(), match[2].upper(), groups)


@lru_cache(maxsize=1000)
def status(config: bytes) -> Status:
    """Branch bits of a CONFIG such as ``N U T, 0, 0, 0``: Toward or Back, Up or Down, No flip or Flip."""
    letters = config.partition(b",")[0].upper().split()
    bits = [
        [place for place, letter in enumerate(pair) if letter in letters]
        for pair in ((b"T", b"B"), (b"U", b"D"), (b"N", b"F"))
    ]
    shoulder, elbow, wrist = (found[0] if len(found) == 1 else -1 for found in bits)
    return shoulder, elbow, wrist


def feed(value: bytes | None, unit: bytes | None) -> float:
    """Programmed feed in mm/min, NaN for times, percentages, registers and speeds of the process."""
    if value is None or unit is None or not value.strip(b".").replace(b".", b"").isdigit():
        return math.nan
    return float(value) * FEED.get(unit.upper(), math.nan)


_BLEND = re.compile(
    rb"(?<![A-Za-z])(?:(FINE)|CNT\s*(\d{1,3}|R\[)|C[RD]\s*(\d{1,6}(?:\.\d*)?)(?:\s*mm)?)(?![A-Za-z_])", _FLAGS
)


def blend(options: bytes) -> float:
    """Blend in mm: 0 for FINE and CNT0, infinite for CNT (its distance depends on speed), the number of CR and CD; NaN for none of these."""
    match = _BLEND.search(options)
    if match is None:
        return math.nan
    if match[3] is not None:
        return float(match[3])
    return 0.0 if match[1] is not None or match[2].strip(b"0") == b"" else math.inf


def unknown_option(code: bytes, at: int, end: int) -> tuple[int, bytes] | None:
    """Place and name of the first option behind a motion that is not known to leave its target alone; None without one."""
    while code[at:end].strip():
        match = _HARMLESS.match(code, at, end)
        if match is None:
            rest = code[at:end]
            at += len(rest) - len(rest.lstrip())
            return at, rest.split()[0]
        at = match.end()
    return None
