"""The small pieces of ABB RAPID: comments, literal robtargets, confdata, speeds, frames of tools and work objects."""

from __future__ import annotations

import math
import re
from typing import NamedTuple

import numpy as np

from toolpaths.conventions import KUKA, QUATERNION
from toolpaths.formats.reading import NUMBER, Status
from toolpaths.program import EXTERNALS, NO_STATUS

NAME = rb"[A-Za-z]\w*"
_FLAGS = re.IGNORECASE
COMMENT_OR_STRING = re.compile(rb'"[^"\r\n]*"?|![^\r\n]*')

_N = rb"\s*(" + NUMBER + rb")\s*"
TARGET = rb"\[\s*\[%s,%s,%s\]\s*,\s*\[%s,%s,%s,%s\]\s*,\s*\[([^\[\]]{1,80})\]\s*,\s*\[([^\[\]]{1,250})\]\s*\]" % (
    (_N,) * 7
)
ROBTARGET = re.compile(TARGET)
_TAIL = rb"\s*(?:\\ID:=\d+\s*)?,\s*(%s)\s*,\s*(%s)\s*,\s*(%s(?:\s*\\WObj\s*:=\s*%s)?)\s*;" % ((NAME,) * 4)
# What nearly all statements of a program look like: linear and joint moves with a literal or a declared target.
MOVE_LITERAL = re.compile(rb"\s*(Move[LJ])\s*" + TARGET + _TAIL, _FLAGS)
MOVE_NAMED = re.compile(rb"\s*(Move[LJ])\s+(%s)" % NAME + _TAIL, _FLAGS)
DECLARED = re.compile(
    rb"\s*(?:(?:LOCAL|TASK)\s+)?(?:CONST|PERS|VAR)\s+robtarget\s+(%s)\s*:=\s*" % NAME + TARGET + rb"\s*;", _FLAGS
)
DECLARATION = re.compile(
    rb"\s*(?:(?:LOCAL|TASK)\s+)?(?:CONST|PERS|VAR)\s+(robtarget|tooldata|wobjdata|speeddata|zonedata|jointtarget)\s+(%s)\s*(\{[^{}]*\})?\s*(:=)?"
    % NAME,
    _FLAGS,
)
OTHER_DECLARATION = re.compile(rb"\s*(?:(?:LOCAL|TASK)\s+)?(?:CONST|PERS|VAR|ALIAS)\s", _FLAGS)

# Words that open, divide or close something and take no semicolon.
BLOCK = re.compile(
    rb"\s*(?:%%%.{0,300}?%%%"
    rb"|MODULE\s+\w+\s*(?:\([^();]*\))?"
    rb"|(?:LOCAL\s+)?(?:PROC|TRAP|FUNC\s+\w+)\s+(?P<routine>\w+)\s*(?:\([^();]*\))?"
    rb"|(?:IF|ELSEIF)\b[^;]{0,2000}?\bTHEN\b"
    rb"|(?:FOR|WHILE)\b[^;]{0,2000}?\bDO\b"
    rb"|TEST\b[^;]{0,2000}?(?=\b(?:CASE|DEFAULT|ENDTEST)\b)|CASE\b[^:;]{0,2000}:(?!=)|DEFAULT\s*:"
    rb"|RECORD\s+\w+|(?:ENDMODULE|ENDPROC|ENDTRAP|ENDFUNC|ENDRECORD|ENDIF|ENDFOR|ENDWHILE|ENDTEST|ELSE|ERROR|UNDO|BACKWARD)\b"
    rb"|\w+\s*:(?![=:]))",
    _FLAGS | re.DOTALL,
)
COMPACT_IF = re.compile(rb"\s*IF\b", _FLAGS)
MOTION = re.compile(
    rb"(?<![\w.\\])((?:Move|Trigg|Search|Arc|Cap|Disp|Paint|Spot|Nut|Laser|Cut)(?:L|C|J|AbsJ|ExtJ)(?:DO|AO|GO|IOs|Sync|Start\d?|End\d?|\d)?|StepBwdPath|"
    rb"EGMMove[LC]|EGMRun\w+|IndAMove|IndRMove|IndCMove|IndDMove|PaintL|MToolRotCalib|CSSActMove\w*)(?=[\s\\\[*]|\Z)",
    _FLAGS,
)
# Where a motion has its tool, counted in arguments from the first target on; welding and dispensing put their own data in between.
TOOL_AT = {b"MOVE": 3, b"TRIGG": 4, b"ARC": 5}
DISPLACED = re.compile(rb"\s*(PDispOn|PDispSet|EOffsOn|EOffsSet|CorrCon|WorldAccLim\s*\\On)\b", _FLAGS)
CONF_OFF = re.compile(rb"\s*ConfL\s*\\\s*(On|Off)\b", _FLAGS)
IDENTIFIER = re.compile(rb"(?<![\w.\\])[A-Za-z]\w*")
ASSIGNED = re.compile(rb"\s*(%s)(?:\s*\.[\w.]+)?\s*:=" % NAME)
# Instructions that move nothing. Any other name may be a routine with motions of its own.
STILL = re.compile(
    rb"\s*(?:\w+\s*(?:\{[^{}]*\})?(?:\.[\w.]+)?\s*:=|(?:Set\w*|Reset|Pulse\w+|InvertDO|Wait\w+|TP\w+|UI\w+|ErrWrite|Conf[LJ]|SingArea|AccSet|VelSet|"
    rb"PathAccLim|PathResol|Grip\w*|Incr|Decr|Add|Clear|Clk\w+|Close|Open|Write\w*|Read\w*|I(?:Disable|Enable|Watch|Sleep|Delete)|CONNECT|MotionSup|SoftDeact|"
    rb"PDispOff|EOffsOff|ActUnit|DeactUnit|Load|UnLoad|RETURN|EXIT|TRYNEXT|RETRY|RAISE|STOP|SyncMove\w+|SpeedRefresh|CirPathMode|TriggIO|TriggEquip|TriggInt)\b)",
    _FLAGS,
)
RECOGNISED = re.compile(
    rb"^(?:\xef\xbb\xbf)?[ \t]*(?:MODULE\s+\w+|(?:(?:LOCAL|TASK)[ \t]+)?(?:CONST|PERS|VAR)[ \t]+(?:robtarget|tooldata|wobjdata)\s"
    rb"|Move(?:[LJC]|AbsJ)[ \t\\]+[^;\r\n]{0,400},\s*\w+\s*,\s*\w+\s*,\s*\w+[^;\r\n(]{0,80};)",
    _FLAGS | re.MULTILINE,
)


class Frame(NamedTuple):
    """A literal tooldata or wobjdata: pose as X, Y, Z (mm), A, B, C (KUKA, deg), and why it cannot be worked with, if so."""

    pose: tuple[float, ...]
    problem: str | None


_FRAME_NUMBERS = re.compile(_N)
_TOOLDATA = re.compile(
    rb"\s*\[\s*(TRUE|FALSE)\s*,\s*\[\s*\[%s,%s,%s\]\s*,\s*\[%s,%s,%s,%s\]\s*\]" % ((_N,) * 7), _FLAGS
)
_WOBJDATA = re.compile(
    rb"\s*\[\s*(TRUE|FALSE)\s*,\s*(TRUE|FALSE)\s*,\s*,\s*\[\s*\[%s,%s,%s\]\s*,\s*\[%s,%s,%s,%s\]\s*\]\s*,"
    rb"\s*\[\s*\[%s,%s,%s\]\s*,\s*\[%s,%s,%s,%s\]\s*\]\s*\]" % ((_N,) * 14),
    _FLAGS,
)


def literal_frame(kind: bytes, code: bytes, at: int, end: int) -> Frame | None:
    """Frame of a tooldata or wobjdata literal (strings blanked), None where it is not literal."""
    match = (_TOOLDATA if kind == b"TOOLDATA" else _WOBJDATA).match(code, at, end)
    if match is None:
        return None
    held = match[1].upper() == b"TRUE"
    if kind == b"TOOLDATA":
        problem = (
            None
            if held
            else "a stationary tool (robhold FALSE): the arm carries the part, so poses mean something else"
        )
        return Frame(_pose(np.array(match.groups()[1:], dtype=float)), problem)
    numbers = np.array(match.groups()[2:], dtype=float)
    problem = None
    if held:
        problem = "a work object that the robot holds (robhold TRUE): poses mean something else"
    elif match[2].upper() == b"FALSE":
        problem = "a work object on a moving unit (ufprog FALSE): where it stands is not in this program"
    return Frame(_pose(numbers[:7], numbers[7:]), problem)


def _pose(outer: np.ndarray, inner: np.ndarray | None = None) -> tuple[float, ...]:
    """X, Y, Z and KUKA angles of one frame, or of one inside another."""
    p, R = outer[:3], QUATERNION.rotation(outer[None, 3:])
    if inner is not None:
        p = p + R[0] @ inner[:3]
        R = R @ QUATERNION.rotation(inner[None, 3:])
    return (*p.tolist(), *KUKA.near(R, np.zeros((1, 3)))[0].tolist())


def status(conf: bytes) -> Status | None:
    """Branch bits of ``cf1, cf4, cf6, cfx``; None where they are no four whole numbers.

    For six-axis arms cfx counts 0 .. 7: four for a wrist centre behind axis 1, two for one behind the lower arm, one for a
    negative angle of axis 5. Posts that do not know write anything else, or the same number throughout.
    """
    parts = conf.split(b",")
    if len(parts) != 4 or any(re.fullmatch(rb"\s*[+-]?\d{1,3}(?:\.0*)?\s*", part) is None for part in parts):
        return None
    cfx = int(float(parts[3]))
    return (cfx >> 2 & 1, cfx >> 1 & 1, cfx & 1) if 0 <= cfx <= 7 else NO_STATUS


def externals(axes: bytes) -> tuple[float, ...] | None:
    """Six external axes, NaN for 9E9 (not there); None where they are no six numbers."""
    parts = [part.strip() for part in axes.split(b",")]
    if len(parts) != EXTERNALS or any(re.fullmatch(NUMBER, part) is None for part in parts):
        return None
    return tuple(math.nan if abs(value) >= 8.9e9 else value for value in map(float, parts))


_PREDEFINED = re.compile(rb"v(\d{1,4})", _FLAGS)
_LITERAL_SPEED = re.compile(rb"\[" + _N + rb",", _FLAGS)
_OVERRIDE = re.compile(rb"\\\s*V\s*:=" + _N, _FLAGS)


def feed(text: bytes, declared: dict[bytes, float]) -> float:
    """Programmed feed in mm/min of a speed argument, NaN where it is not known; speeddata is in mm/s."""
    if b"\\" in text:
        override = _OVERRIDE.search(text)
        return float(override[1]) * 60 if override else math.nan
    known = declared.get(text.upper())
    if known is not None:
        return known
    predefined = _PREDEFINED.fullmatch(text)
    if predefined is not None:
        return float(predefined[1]) * 60
    literal = _LITERAL_SPEED.match(text)
    return float(literal[1]) * 60 if literal else math.nan


# Radius of the TCP's zone in mm, by the number in the name of predefined zonedata.
_ZONES = {0: 0.3, **{n: float(n) for n in (1, 5, 10, 15, 20, 30, 40, 50, 60, 80, 100, 150, 200)}}
_ZONE = re.compile(rb"z(\d{1,3})", _FLAGS)
_LITERAL_ZONE = re.compile(rb"\[\s*(TRUE|FALSE)\s*," + _N + rb",", _FLAGS)
_ZONE_OVERRIDE = re.compile(rb"\\\s*Z\s*:=" + _N, _FLAGS)


def blend(text: bytes, declared: dict[bytes, float]) -> float:
    """Blend radius in mm of a zone argument: 0 for ``fine``, NaN where it is not known."""
    name, mark, options = text.partition(b"\\")
    name = name.strip()
    override = _ZONE_OVERRIDE.search(mark + options) if mark else None
    if override is not None:
        return float(override[1])
    known = declared.get(name.upper())
    if known is not None:
        return known
    if name.upper() == b"FINE":
        return 0.0
    predefined, literal = _ZONE.fullmatch(name), _LITERAL_ZONE.match(name)
    if predefined is not None:
        return _ZONES.get(int(predefined[1]), math.nan)
    if literal is None:
        return math.nan
    return 0.0 if literal[1].upper() == b"TRUE" else float(literal[2])


ID = re.compile(rb"\s*\\\s*ID\s*:=", _FLAGS)
CORRECTED = re.compile(rb"\\\s*Corr\b", _FLAGS)
_WOBJ = re.compile(rb"\\\s*WObj\s*:=\s*(%s)" % NAME, _FLAGS)
_BY_JOINTS = re.compile(rb"\w*?(?:AbsJ|ExtJ|J)(?:DO|AO|GO|IOs|Sync)?\Z|Ind", _FLAGS)


def tool_and_object(text: bytes) -> tuple[bytes, bytes]:
    r"""Names in a tool argument such as ``tool \WObj:=name``; without one it is wobj0."""
    name, mark, rest = text.partition(b"\\")
    found = _WOBJ.search(mark + rest)
    return name.strip(), found[1] if found else b"wobj0"


def by_joints(name: bytes) -> bool:
    """Whether an instruction moves joint by joint, along no path."""
    return _BY_JOINTS.match(name) is not None
