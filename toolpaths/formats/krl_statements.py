"""What a KRL line that is no motion does to the poses after it: sets a frame, ends a block, calls something that may move."""

from __future__ import annotations

import math
import re

from toolpaths.formats.krl_words import POSE_WORDS, Unreadable, read_aggregate, shown
from toolpaths.program import FrameSetting

_FLAGS = re.IGNORECASE

CONTENT = re.compile(
    rb"^(?:\xef\xbb\xbf)?[ \t]*(?:&ACCESS\b|(?:GLOBAL[ \t]+)?DEF(?:FCT)?[ \t]+[\w$ \t]+\(|S?(?:LIN|PTP|CIRC)(?:_REL)?[ \t]*\{)",
    _FLAGS | re.MULTILINE,
)
MOTION = re.compile(rb"(?:\xef\xbb\xbf)?\s*(S?(?:LIN|PTP|CIRC)(?:_REL)?|SPL(?:_REL)?)(?![\w$])", _FLAGS)
EMBEDDED_MOTION = re.compile(rb"(?<![\w$])(?:S?(?:LIN|PTP|CIRC)(?:_REL)?|SPL)\s*\{", _FLAGS)
ASYNCHRONOUS = re.compile(rb"(?:ASYPTP|ASYCONT|MOVE_EMI)(?![\w$])", _FLAGS)
POINT_TO_POINT = frozenset({"PTP", "SPTP", "PTP_REL", "SPTP_REL"})

# Poses after these lines may be reached by another way than from the line above.
_BLOCK = re.compile(
    rb"(?:GLOBAL\s+)?(DEFFCT|DEFDAT|DEF|ENDFCT|ENDDAT|ENDFOR|ENDIF|ENDLOOP|ENDSWITCH|ENDWHILE|END|LOOP|FOR|WHILE|REPEAT|UNTIL|IF"
    rb"|ELSE|SWITCH|CASE|DEFAULT|GOTO|RETURN|RESUME)(?![\w$])",
    _FLAGS,
)
_LABEL = re.compile(rb"[A-Za-z_]\w*\s*:\s*\Z")
_CALL = re.compile(rb"(?<![\w$])([A-Za-z_]\w*)\s*\(")
_STRING = re.compile(rb'"[^"]*"')
# Calls and built-in functions that move nothing. Any other name may be a subprogram with motions of its own.
_STILL = frozenset(
    b"ABS ACOS ANIN ANOUT ATAN2 AND BAS B_AND B_EXOR B_NOT B_OR CAST_FROM CAST_TO CCLOSE COPEN COS CREAD CWRITE DO EXOR FOR"
    b" FORWARD IF INV_POS INVERSE MAXIMUM_I MINIMUM_I NOT OR PULSE ROUND SIN SQRT SREAD STRADD STRCLEAR STRCOMP STRCOPY"
    b" STRFIND STRLEN SWRITE TAN TIMER UNTIL VARSTATE VARTYPE WAIT WHEN WHILE".split()
)

_FRAME = re.compile(rb"\s*\$(BASE|TOOL)\s*(?=[=.\[])", _FLAGS)
_CONTROLLER_DATA = re.compile(rb"=\s*(?:BASE|TOOL)_DATA\s*\[[^\]]*\]\s*\Z", _FLAGS)
_NULL_FRAME = re.compile(rb"=\s*\$(?:NULLFRAME|WORLD)\s*\Z", _FLAGS)
_BAS = re.compile(rb"\s*BAS\s*\(\s*#(BASE|TOOL|FRAMES|PTP_PARAMS|CP_PARAMS)\b", _FLAGS)
_FATAL = (
    (
        re.compile(rb"\$IPO_MODE\s*=\s*#TCP\b", _FLAGS),
        "found $IPO_MODE = #TCP: the tool stands still and the arm carries the part, so poses mean something else",
    ),
    (
        re.compile(rb"\$ROBROOT\b[^=]*=(?!=)", _FLAGS),
        "found an assignment to $ROBROOT: the program moves the robot's own place in the world",
    ),
)


def fatal_setting(code: bytes) -> str | None:
    """Why a setting makes every pose of the program unsafe to correct."""
    return next((reason for pattern, reason in _FATAL if pattern.match(code)), None)


def frame_setting(raw: bytes, start: int, end: int, line: int) -> FrameSetting | None:
    """The base or tool that a line sets, if any."""
    text = shown(raw, start, end)
    called = _BAS.match(raw, start, end)
    if called is not None:
        # PTP_PARAMS and CP_PARAMS of inline forms take base and tool from FDAT_ACT; the base decides what poses mean.
        return FrameSetting(line, "tool" if called[1].upper() == b"TOOL" else "base", "controller", None, text)
    match = _FRAME.match(raw, start, end)
    if match is None:
        return None
    what = match[1].decode().lower()
    setting = raw[match.end() : end]
    if _CONTROLLER_DATA.match(setting):
        return FrameSetting(line, what, "controller", None, text)
    if _NULL_FRAME.match(setting):
        return FrameSetting(line, what, "literal", (0.0,) * 6, text)
    brace = raw.find(b"{", match.end(), end)
    if brace >= 0 and raw[match.end() : brace].strip() == b"=":
        try:
            aggregate = read_aggregate(raw, brace, end)
        except Unreadable:
            return FrameSetting(line, what, "expression", None, text)
        if not aggregate.is_axes and not raw[aggregate.end : end].strip():
            tokens = aggregate.tokens[: len(POSE_WORDS)]
            pose = tuple(math.nan if token is None else float(token) for token in tokens)
            return FrameSetting(line, what, "literal", pose, text)
    return FrameSetting(line, what, "expression", None, text)


def boundary(code: bytes) -> str | None:
    """What makes the pose before a line no longer the pose after it: the edge of a block, a label, a call."""
    block = _BLOCK.match(code)
    if block is not None:
        return f"the {block[1].decode().upper()}"
    if _LABEL.match(code):
        return "the label"
    for call in _CALL.finditer(without_strings(code)):
        if call[1].upper() not in _STILL:
            return f"the call of {call[1].decode()}"
    return None


def without_strings(code: bytes) -> bytes:
    """A statement with its quoted strings emptied."""
    return _STRING.sub(b'""', code)
