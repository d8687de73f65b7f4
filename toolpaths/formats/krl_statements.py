"""What a KRL line that is no motion does to the poses after it: sets a frame, ends a block, calls something that may move."""

from __future__ import annotations

import math
import re

from toolpaths.formats.krl_words import POSE_WORDS, Unreadable, read_aggregate, shown
from toolpaths.program import FrameSetting

_FLAGS = re.IGNORECASE

CONTENT = re.compile(
    rb"^(?:\xef\xbb\xbf)?[ \t]*(?:&ACCESS\b|(?:GLOBAL[ \t]+)?DEF(?:FCT)?[ \t]+[\w$ \t]+\((?![^\r\n]*\)[ \t]*:)"
    rb"|S?(?:LIN|PTP|CIRC)(?:_REL)?[ \t]*\{)",
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
_TABLE = re.compile(rb"\s*(BASE|TOOL)_DATA\s*\[([^\]]*)\](?=\s*[=.](?!=))", _FLAGS)
_NULL_FRAME = re.compile(rb"=\s*\$(?:NULLFRAME|WORLD)\s*\Z", _FLAGS)
_BAS = re.compile(rb"\s*BAS\s*\(\s*#(EX_)?(BASE|TOOL)\b", _FLAGS)
_BAS_FRAMES = re.compile(rb"\s*BAS\s*\(\s*#(?:FRAMES|PTP_PARAMS|CP_PARAMS)\b", _FLAGS)
_FRAME_DATA = re.compile(rb"\s*FDAT_ACT\s*=\s*([A-Za-z_]\w*)\s*\Z", _FLAGS)
_FLOAT = rb"\s*([+]?(?:\d{1,9}\.?\d{0,9}|\.\d{1,9})(?:E[+-]?\d)?)\s*"
_FEED = re.compile(
    rb"\s*(?:\$VEL\s*\.\s*CP\s*=(?!=)|\$VEL\s*=(?!=)|BAS\s*\(\s*#(?:VEL_CP|CP_PARAMS|INITMOV)\b)", _FLAGS
)
_FEED_VALUE = re.compile(
    rb"\s*(?:\$VEL\s*\.\s*CP\s*=%s|\$VEL\s*=\s*\{\s*CP\s+%s[,}].*|BAS\s*\(\s*#(?:VEL_CP|CP_PARAMS)\s*,%s\)\s*)\Z"
    % (_FLOAT, _FLOAT, _FLOAT),
    _FLAGS | re.DOTALL,
)
_FEED_WITH = re.compile(rb"\$VEL(?:\s*\.\s*CP\s*=%s|\s*=\s*SVEL_CP\s*\(%s)(?=[,)]|\s*C_|\Z)" % (_FLOAT, _FLOAT), _FLAGS)
_BLEND = re.compile(
    rb"\s*(?:\$APO\s*\.\s*CDIS\s*=(?!=)|\$APO\s*=(?!=)|BAS\s*\(\s*#(?:INITMOV|CP_DAT|CP_PARAMS)\b)", _FLAGS
)
_BLEND_VALUE = re.compile(
    rb"\s*(?:\$APO\s*\.\s*CDIS\s*=%s|\$APO\s*=\s*\{[^}]*?\bCDIS\s+%s[,}].*)\Z" % (_FLOAT, _FLOAT), _FLAGS | re.DOTALL
)
_BLEND_WITH = re.compile(rb"\$APO\s*(?:\.\s*CDIS\s*=%s|=\s*\{[^}]*?\bCDIS\s+%s[,}])" % (_FLOAT, _FLOAT), _FLAGS)
_PATH_DATA = re.compile(rb"\s*LDAT_ACT\s*=\s*([A-Za-z_]\w*)\s*\Z", _FLAGS)
_FRAME_WITH = re.compile(rb"\$(BASE|TOOL|IPO_MODE)\s*=\s*(?:S(?:BASE|TOOL2?|IPO_MODE)\s*\(\s*(F\w+)|(\S[^,]*))", _FLAGS)
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
        origin = "controller" if called[1] is None else "expression"  # a base that external axes carry
        return FrameSetting(line, called[2].decode().lower(), origin, None, text)
    match = _FRAME.match(raw, start, end)
    if match is None:
        return None
    what = match[1].decode().lower()
    setting = raw[match.end() : end]
    if _CONTROLLER_DATA.match(setting):
        return FrameSetting(line, what, "controller", None, text)
    if _NULL_FRAME.match(setting):
        return FrameSetting(line, what, "literal", (0.0,) * 6, text)
    pose = _literal_frame(raw, match.end(), end)
    return FrameSetting(line, what, "expression" if pose is None else "literal", pose, text)


def _literal_frame(raw: bytes, at: int, end: int) -> tuple[float, ...] | None:
    """The literal frame that an ``=`` gives, NaN for a word not written; None where it is no literal."""
    brace = raw.find(b"{", at, end)
    if brace < 0 or raw[at:brace].strip() != b"=":
        return None
    try:
        aggregate = read_aggregate(raw, brace, end)
    except Unreadable:
        return None
    if aggregate.is_axes or raw[aggregate.end : end].strip():
        return None
    return tuple(math.nan if token is None else float(token) for token in aggregate.tokens[: len(POSE_WORDS)])


def stored_frame(raw: bytes, start: int, end: int) -> tuple[str, str | None, tuple[float, ...] | None] | None:
    """What a line writes into the controller's table of frames: base or tool, its number (None: computed), the literal frame (None:
    something else); None where it writes nothing there.
    """
    match = _TABLE.match(raw, start, end)
    if match is None:
        return None
    number = str(int(match[2])) if match[2].strip().isdigit() else None
    return match[1].decode().lower(), number, _literal_frame(raw, match.end(), end)


def frames_by_data(code: bytes) -> bool:
    """Whether a line takes base and tool from the data of the inline form (``FDAT_ACT``)."""
    return _BAS_FRAMES.match(code) is not None


def frame_data_name(code: bytes) -> str | None:
    """Name of the frame data that a line makes the present ones."""
    match = _FRAME_DATA.match(code)
    return None if match is None else match[1].decode()


def feed_setting(code: bytes) -> float | None:
    """Feed in mm/min that a line sets for motions along a path; NaN where it sets one that is no number; None if it sets none."""
    if _FEED.match(code) is None:
        return None
    match = _FEED_VALUE.match(code)
    return math.nan if match is None else _millimetres_a_minute(match)


def feed_with(clause: bytes) -> float | None:
    """As `feed_setting`, for what a spline segment sets for itself after WITH."""
    if b"$VEL" not in clause.upper():
        return None
    match = _FEED_WITH.search(clause)
    return math.nan if match is None else _millimetres_a_minute(match)


def blend_setting(code: bytes) -> float | str | None:
    """Distance in mm from which C_DIS rounds over a point, where a line sets it: NaN where it sets one that is no number, "data" where
    it takes that of the present path data (``LDAT_ACT``); None if it sets none.
    """
    found = _BLEND.match(code)
    if found is None:
        return None
    if b"#" in found[0]:
        return "data" if b"CP_" in found[0].upper() else math.nan
    match = _BLEND_VALUE.match(code)
    return math.nan if match is None else _number(match)


def blend_with(clause: bytes) -> float | None:
    """As `blend_setting`, for what a spline segment sets for itself after WITH."""
    if b"$APO" not in clause.upper():
        return None
    match = _BLEND_WITH.search(clause)
    return math.nan if match is None else _number(match)


def path_data_name(code: bytes) -> str | None:
    """Name of the path data of an inline form that a line makes the present ones."""
    match = _PATH_DATA.match(code)
    return None if match is None else match[1].decode()


def blend_of(kind: bytes, tail: bytes, distance_mm: float) -> float:
    """Blend of a motion in mm.

    Parameters
    ----------
    kind, tail
        Keyword and what stands behind the target. Without C_ words the arm goes to the point; through that of SPL it always goes.
    distance_mm
        What C_DIS means at present.
    """
    said = tail.upper()
    if kind.upper() == b"SPL" or b"C_" not in said:
        return 0.0
    if b"C_DIS" in said or b"C_SPL" in said:
        return distance_mm
    return math.inf


def _number(match: re.Match[bytes]) -> float:
    return float(next(group for group in match.groups() if group is not None))


def _millimetres_a_minute(match: re.Match[bytes]) -> float:
    return 60e3 * _number(match)


def frames_with(clause: bytes) -> list[tuple[str, str, str]]:
    """What a segment sets for itself: "base", "tool" or "ipo_mode", the name of the frame data (or ""), the text of the value."""
    return [
        (m[1].decode().lower(), (m[2] or b"").decode(), (m[3] or b"").decode("ascii", "replace").strip())
        for m in _FRAME_WITH.finditer(clause)
    ]


def boundary(code: bytes) -> str | None:
    """What makes the pose before a line no longer the pose after it: the edge of a block, a label, a call."""
    block = _BLOCK.match(code)
    if block is not None:
        return f"the {block[1].decode().upper()}"
    if _LABEL.match(code):
        return "the label"
    name = called(code)
    return None if name is None else f"the call of {name}"


def called(code: bytes) -> str | None:
    """Name of the first subprogram that a line calls and that may move the arm."""
    calls = (call[1] for call in _CALL.finditer(without_strings(code)))
    return next((name.decode() for name in calls if name.upper() not in _STILL), None)


def without_strings(code: bytes) -> bytes:
    """A statement with its quoted strings emptied."""
    return _STRING.sub(b'""', code)
