"""The small pieces of G-code: comments, words of a letter and a number, and what G numbers do to the words after them."""

from __future__ import annotations

import re
from collections.abc import Sequence
from typing import NamedTuple

from toolpaths.formats.reading import Unreadable, shown
from toolpaths.printed import read_number

AXES = (b"X", b"Y", b"Z")
ROTARY = (b"A", b"B", b"C")
SECOND_AXES = frozenset((b"U", b"V", b"W"))
ARC_WORDS = (b"I", b"J", b"K", b"R")

# No exponent: E is a word of its own. No digit can be shared between two parts of the pattern.
NUMBER = rb"[+-]?(?:\d{1,12}(?:\.\d{0,25})?|\.\d{1,25})"
_WORD = re.compile(rb"[ \t]*([A-Za-z])[ \t]*(%s)(?![\d.])" % NUMBER)
_EXPONENT = re.compile(rb"[eE][+-]?\d")
_BLANK = re.compile(rb"[ \t]*\Z")
_COMMENT_MARK = re.compile(rb"[();]")
_NOTHING = bytes.maketrans(b"\0\x1a\r", b"   ")

CONTENT = re.compile(
    rb"^(?:\xef\xbb\xbf)?[ \t]*/?[ \t]*(?:N[ \t]*\d+[ \t]*)?(?:G[ \t]*\d{2,3}(?:\.\d)?[ \t]*)*G[ \t]*0?[0-3](?![\d.])"
    rb"[ \t]*(?:G[ \t]*\d{2,3}[ \t]*)*(?:F[\d.]+[ \t]*)?[XYZIJKABC][ \t]*[-+.\d#\[=]",
    re.IGNORECASE | re.MULTILINE,
)
# What names an axis and gives it a value, also where the value is no number.
AXIS_PATTERN = re.compile(rb"(?<![A-Za-z_#<])[XYZABC][ \t]*(?:[-+.\d=\[#<]|[A-Za-z]{2,}[ \t]*\[)", re.IGNORECASE)
G_PATTERN = re.compile(rb"(?<![A-Za-z_#<])G[ \t]*(\d{1,3}(?:\.\d)?)(?![\d.\[])", re.IGNORECASE)
ASSIGNMENT = re.compile(rb"[ \t]*(?:N[ \t]*\d+[ \t]*)?(?:#+[ \t]*\d+|#<[^>]*>|R\d+)[ \t]*=", re.IGNORECASE)
# Statements of other letters than one: jumps, calls, and those that move the program's frame.
CALL = re.compile(
    rb"(?<![A-Za-z_])(?:CALL|EXTCALL|PCALL|MCALL|CYCLE(?!800|832)\d+|POCKET\d*|SLOT\d*|HOLES\d*|LONGHOLE|FGREF)(?![A-Za-z_])",
    re.IGNORECASE,
)
FRAME = re.compile(
    rb"(?<![A-Za-z_])(?:A?TRANS|A?ROTS?|A?SCALE|A?MIRROR|CYCLE800|TRANSMIT|TRACYL|TRAANG|DIAMON|WORKPIECE_SHIFT)(?![A-Za-z_])",
    re.IGNORECASE,
)
# The tool's direction by words of its own; it stays tilted on the lines after it.
DIRECTION = re.compile(rb"(?<![A-Za-z_])(?:[ABC][2-7]|LEAD|TILT|THETA)[ \t]*=", re.IGNORECASE)
JUMP = re.compile(rb"(?<![A-Za-z_])GOTO[BFCS]?[ \t]*(?:N[ \t]*)?(\d+)?", re.IGNORECASE)


class Word(NamedTuple):
    """A letter (upper case), its number as written, the span of the number, and where the letter stands."""

    letter: bytes
    token: bytes
    span: tuple[int, int]
    at: int


def code_of(raw: bytes, start: int, end: int) -> bytes:
    """A line with comments, NUL bytes and line ends as blanks; offsets stay. A stray ``)`` stays where it is.

    Comments in brackets may be nested if their brackets pair up; one that is not closed ends with the line. A ``;`` outside
    brackets ends the code.
    """
    line = raw[start:end].translate(_NOTHING)
    mark = _COMMENT_MARK.search(line)
    if mark is None:
        return line
    clean, depth, begin, done = b"", 0, 0, 0
    for mark in _COMMENT_MARK.finditer(line):
        found = mark[0]
        if depth == 0 and found == b";":
            return clean + line[done : mark.start()] + b" " * (len(line) - mark.start())
        if found == b"(":
            if depth == 0:
                begin = mark.start()
            depth += 1
        elif found == b")" and depth:
            depth -= 1
            if depth == 0:
                clean += line[done:begin] + b" " * (mark.end() - begin)
                done = mark.end()
    if depth:
        return clean + line[done:begin] + b" " * (len(line) - begin)
    return clean + line[done:]


def read_words(line: bytes, offset: int) -> list[Word]:
    """All words of a line whose comments are blank; `offset` is where the line starts in the file.

    Raises
    ------
    Unreadable
        Something is no letter with a literal number, or a number that a control could not hold.
    """
    words: list[Word] = []
    at = 0
    while True:
        match = _WORD.match(line, at)
        if match is None:
            break
        letter, token = match.groups()
        at = match.end()
        if letter not in b"Nn" and _EXPONENT.match(line, at):
            raise Unreadable(offset + at, f"{shown(line, match.start(1), at + 4)!r}: an exponent, or a word E")
        if read_number(token) is None:
            raise Unreadable(offset + match.start(2), f"{shown(line, *match.span(2))!r}, no number")
        words.append(Word(letter.upper(), token, (offset + match.start(2), offset + at), offset + match.start(1)))
    if _BLANK.match(line, at) is None:
        at += len(line[at:]) - len(line[at:].lstrip())
        raise Unreadable(offset + at, f"{shown(line, at, len(line))!r} instead of a letter and a literal number")
    return words


def ordinary_line(letters: Sequence[bytes]) -> re.Pattern[bytes]:
    """A whole line with N, G0 or G1, coordinates in the usual order, F and a comment."""
    words = rb"".join(rb"(?:%s[ \t]*(%s)[ \t]*)?" % (letter, NUMBER) for letter in letters)
    any_letter = rb"(?=[%s])" % b"".join(letters)
    head = rb"[ \t]*(?:N[ \t]*(\d{1,9})[ \t]*)?(?:G0?([01])[ \t]*%s)?%s" % (any_letter, any_letter)
    tail = rb"(?:F[ \t]*(%s)[ \t]*)?(?:;[^\r\n]*|\([^()\r\n]*\)[ \t]*)?\r?(?:\n|\Z)" % NUMBER
    return re.compile(head + rb"(" + words + rb")" + tail, re.IGNORECASE)


def g_number(token: bytes) -> str:
    """``b"01"`` as "1", ``b"54.10"`` as "54.1"."""
    value = float(token)
    return f"{value:g}"


MOTIONS = {"0": 0, "1": 1, "2": 2, "3": 3}
PLANES = {"17": (0, 1, 2), "18": (2, 0, 1), "19": (1, 2, 0)}  # first and second axis of the plane, and the third
UNITS_MM = {"20": 25.4, "70": 25.4, "700": 25.4, "21": 1.0, "71": 1.0, "710": 1.0}
OFFSETS = frozenset(
    ("54", "55", "56", "57", "58", "59", "59.1", "59.2", "59.3", "54.1", "154", *map(str, range(500, 600)))
)
CYCLES = frozenset(("73", "74", "76", *map(str, range(81, 90))))
ELSEWHERE = frozenset(("27", "28", "28.1", "29", "30", "30.1", "53", "74.1", "75"))  # machine positions; one line only
LENGTHS = frozenset(("43", "44", "49", "43.1", "43.2", "43.4", "234"))
# Without effect on where the words of later lines are.
_STILL = (
    *(
        "4",
        "5.1",
        "8",
        "9",
        "13.1",
        "15",
        "40",
        "40.1",
        "42.2",
        "50",
        "50.1",
        "60",
        "61",
        "61.1",
        "62",
        "63",
        "64",
        "67",
    ),
    *("69", "69.1", "80", "90", "91.1", "92.1", "92.2", "93", "94", "95", "96", "97", "98", "99", "113", "187"),
    *("22", "23", "25", "26", "103", "450", "451", "460"),
    *("601", "602", "641", "642", "643", "644", "645", "65"),
)
PROBING = frozenset(("31", "36", "37", "38.2", "38.3", "38.4", "38.5"))
# Whose axis words are no pose (dwell, data, zero points, mirrors).
NO_POSE = frozenset(
    (
        "4",
        "10",
        "22",
        "25",
        "26",
        "92",
        "52",
        "68",
        "68.2",
        "68.3",
        "51",
        "51.1",
        "92.1",
        "92.2",
        "92.3",
        "50",
        "50.1",
        "10.6",
        "107",
    )
)
# From here on, until the number that follows, points are not where the words say. None: to the end of the program.
BLOCKING: dict[str, tuple[str | None, str]] = {
    "41": ("40", "cutter radius compensation"),
    "42": ("40", "cutter radius compensation"),
    "41.1": ("40", "cutter radius compensation"),
    "42.1": ("40", "cutter radius compensation"),
    "41.2": ("40", "cutter radius compensation"),
    "43.5": ("49", "tool axis as I, J, K"),
    "91": ("90", "relative motion; it starts from the corrected point before it"),
    "10": (None, "data of the control are changed"),
    "52": (None, "the zero point is moved"),
    "92": (None, "the zero point is moved"),
    "92.3": (None, "the zero point is moved"),
    "68": ("69", "coordinates are turned"),
    "68.2": ("69", "the working plane is tilted"),
    "68.3": ("69", "the working plane is tilted"),
    "51": ("50", "coordinates are scaled"),
    "51.1": ("50.1", "coordinates are mirrored"),
    "16": ("15", "polar coordinates"),
    "7.1": (None, "cylindrical interpolation"),
    "12.1": ("13.1", "polar interpolation"),
    "112": ("113", "polar interpolation"),
    "66": ("67", "a macro runs at every motion"),
    "66.1": ("67", "a macro runs at every motion"),
    "7": ("8", "diameters instead of positions"),
}

HARMLESS = frozenset(_STILL)


def known(number: str) -> bool:
    """Whether what a G number does is known here."""
    return any(number in table for table in (HARMLESS, ELSEWHERE, BLOCKING, LENGTHS))
