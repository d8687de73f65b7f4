"""The small pieces of KUKA KRL: where a comment starts, and the words of an aggregate ``{X 1.0, Y 2.0, ...}``."""

from __future__ import annotations

import re
from typing import NamedTuple

from toolpaths.formats.reading import Unreadable
from toolpaths.printed import read_number
from toolpaths.program import NO_STATUS, UNWRITTEN

POSE_WORDS = (b"X", b"Y", b"Z", b"A", b"B", b"C")
EXTERNAL_WORDS = tuple(b"E%d" % n for n in range(1, 7))
AXIS_WORDS = tuple(b"A%d" % n for n in range(1, 7))
STATUS_WORDS = (b"S", b"T")
_PLACE = {word: place for place, word in enumerate((*POSE_WORDS, *EXTERNAL_WORDS))}

_TYPE = re.compile(rb"\s*([A-Za-z]\w*)\s*:")
_TYPES = (b"E6POS", b"E3POS", b"POS", b"FRAME", b"E6AXIS", b"E3AXIS", b"AXIS")
_WORD = re.compile(rb"\s*([A-Za-z_$][\w$]*)(?:\s+|(?=[+-]))(\S(?:.*\S)?)\s*", re.DOTALL)
_NUMERIC = re.compile(rb"[\d.+\-eE]+")
_BITS = re.compile(rb"(?:'B([01]+)'|'H([0-9A-F]+)'|(\d{1,9}))", re.IGNORECASE)


class Aggregate(NamedTuple):
    """A literal aggregate.

    Attributes
    ----------
    tokens, spans
        Numbers of X..C and E1..E6 (None: not written), byte spans of X..C.
    body, end
        First byte of its words (-1: none can be inserted) and the byte after it.
    is_axes
        Whether it gives axis angles.
    status
        The value of S as written, None where it is not.
    point
        Key of the stored point that these are the numbers of, None for a pose written in the motion.
    """

    tokens: tuple[bytes | None, ...]
    spans: tuple[tuple[int, int], ...]
    body: int
    end: int
    is_axes: bool
    status: bytes | None = None
    point: object = None


def status_bits(value: bytes | None) -> tuple[int, int, int]:
    """Shoulder, elbow and wrist (0 or 1; -1 unknown) of a KRL status: bits 0, 1 and 2."""
    match = None if value is None else _BITS.fullmatch(value.strip())
    if match is None:
        return NO_STATUS
    bits, hexadecimal, decimal = match.groups()
    number = int(bits, 2) if bits else int(hexadecimal, 16) if hexadecimal else int(decimal)
    return number & 1, number >> 1 & 1, number >> 2 & 1


def code_end(raw: bytes, start: int, end: int) -> int:
    """Where the comment of a line begins (a ``;`` outside quotes), else its end without line-end bytes."""
    while end > start and raw[end - 1] in b"\r\n":
        end -= 1
    semicolon = raw.find(b";", start, end)
    if semicolon < 0:
        return end
    if raw.find(b'"', start, semicolon) < 0:
        return semicolon
    quoted = False
    for at in range(start, end):
        if raw[at] == ord('"'):
            quoted = not quoted
        elif raw[at] == ord(";") and not quoted:
            return at
    return end


def shown(raw: bytes, start: int, end: int, limit: int = 60) -> str:
    """A piece of a program for a message, in ASCII."""
    text = raw[start:end].strip()[:limit].decode("ascii", "backslashreplace")
    return text.replace("\t", " ").replace("\r", "\\r")


def read_aggregate(raw: bytes, start: int, end: int) -> Aggregate:
    """Read the aggregate that begins at the brace at `start` and must close before `end`.

    Raises
    ------
    Unreadable
        A brace without partner, a word that is doubled, unknown or without value, a value that is no literal number.
    """
    close = raw.find(b"}", start, end)
    if close < 0:
        raise Unreadable(start, "a brace that is not closed on this line")
    inner = raw.find(b"{", start + 1, close)
    if inner >= 0:
        raise Unreadable(inner, "a brace inside a pose")
    typed = _TYPE.match(raw, start + 1, close)
    if typed is not None and typed[1].upper() not in _TYPES:
        raise Unreadable(typed.start(1), f"the type {shown(raw, *typed.span(1))!r}, not one of a pose")
    body = start + 1 if typed is None else typed.end()
    tokens: list[bytes | None] = [None] * 12
    spans = [UNWRITTEN] * len(POSE_WORDS)
    seen: set[bytes] = set()
    status = None
    at = body
    while at <= close:
        comma = raw.find(b",", at, close)
        stop = close if comma < 0 else comma
        word, span = _word(raw, at, stop, seen)
        place = _PLACE.get(word)
        if place is not None:
            tokens[place] = raw[span[0] : span[1]]
            if place < 6:
                spans[place] = span
        elif word == b"S":
            status = raw[span[0] : span[1]]
        at = stop + 1
    is_axes = any(word in seen for word in AXIS_WORDS)
    if is_axes and any(word in seen for word in POSE_WORDS):
        raise Unreadable(body, "axis angles and a pose in one aggregate")
    return Aggregate(tuple(tokens), tuple(spans), _first_byte(raw, body, close), close + 1, is_axes, status)


def _word(raw: bytes, start: int, end: int, seen: set[bytes]) -> tuple[bytes, tuple[int, int]]:
    """Name (upper case) and value span of one ``NAME value``."""
    match = _WORD.fullmatch(raw, start, end)
    if match is None:
        found = shown(raw, start, end)
        raise Unreadable(
            _first_byte(raw, start, end), f"{found!r} instead of a word and its value" if found else "no word"
        )
    name, span = match[1].upper(), match.span(2)
    if name in seen:
        raise Unreadable(match.start(1), f"the word {name.decode()} twice")
    seen.add(name)
    if name in STATUS_WORDS:  # status and turn: bit patterns too; they are never changed
        return name, span
    if name not in _PLACE and name not in AXIS_WORDS:
        raise Unreadable(match.start(1), f"the unknown word {name.decode('ascii', 'backslashreplace')!r}")
    if read_number(match[2]) is None:
        what = "no number" if _NUMERIC.fullmatch(match[2]) or match[2].upper() == b"NAN" else "not a literal number"
        raise Unreadable(span[0], f"{shown(raw, *span)!r} for {name.decode()}, {what}")
    return name, span


def _first_byte(raw: bytes, start: int, end: int) -> int:
    """First byte that is no blank."""
    while start < end and raw[start] in b" \t":
        start += 1
    return start
