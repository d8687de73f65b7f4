"""The small pieces of APT: records over several lines, comments, and what the major words mean for where points are."""

from __future__ import annotations

import re
from typing import NamedTuple

from toolpaths.formats.reading import NUMBER

BOM = b"\xef\xbb\xbf"

# A comma, after which the record may go on in the next line.
_COMMA = rb"[ \t]*,[ \t]*(?:\$[ \t]*\r?\n[ \t]*)?"
_AXIS = _COMMA + rb"(%s)" % NUMBER
ORDINARY = re.compile(
    rb"[ \t]*GOTO[ \t]*/[ \t]*(%s)%s%s(?:%s%s%s)?[ \t]*\r?(?:\n|\Z)" % (NUMBER, _AXIS, _AXIS, _AXIS, _AXIS, _AXIS),
    re.IGNORECASE,
)
CONTENT = re.compile(
    rb"^(?:\xef\xbb\xbf)?[ \t]*(?:GOTO[ \t]*/[ \t]*[-+.\d(]|GODLTA[ \t]*/|\$\$\*CATIA|\$\$->|PARTNO\b|TOOL PATH/|MULTAX[ \t]*(?:/|\r?$))",
    re.IGNORECASE | re.MULTILINE,
)
STATEMENT = re.compile(rb"\s*([A-Za-z][A-Za-z0-9]*)\s*(?:/\s*(.*?))?\s*\Z", re.DOTALL)
FIRST_WORD = re.compile(rb"[ \t]*([A-Za-z]+)")
TOKEN = re.compile(rb"\s*(%s)\s*(?:,|\Z)" % NUMBER)
# What can be continued at all (not prose that happens to end in a $), and what is never the continuation of another record.
_LISTS = re.compile(rb"(?:\xef\xbb\xbf)?[ \t]*[A-Za-z]\w*[ \t]*[/,=]")
_OWN = re.compile(rb"[ \t]*(?:GOTO[ \t]*/|RAPID[ \t]*/?[ \t]*(?:\r?\n|\Z))", re.IGNORECASE)
_MARK = re.compile(rb"['$]")

# The rest of the line is text.
TEXT = frozenset((b"REMARK", b"PARTNO", b"PPRINT", b"INSERT", b"LETTER", b"TITLES", b"REMARKS"))
# Motions other than to one point. The first part of a record may set the tool's place on the curve: TLON,GOFWD/..
CONTOUR = re.compile(rb"(?:^|,)\s*(?:GOFWD|GOBACK|GOLFT|GORGT|GOUP|GODOWN|GO)\s*(?:/|,|$)", re.IGNORECASE)
CURVES = frozenset(
    (
        b"HELIX",
        b"NURBS",
        b"SPLINE",
        b"BSPLIN",
        b"PARAB",
        b"MOVARC",
        b"ARCMOV",
        b"GOCONE",
        b"RMILL",
        b"FMILL",
        b"POCKET",
        b"GOPOLY",
    )
)
CALLS = frozenset((b"CALL", b"COPY", b"MACRO", b"LOOPST", b"JUMPTO", b"TRACUT", b"IF"))
TURNS = frozenset((b"ROTABL", b"ROTHED", b"ROTATE", b"INDEX", b"PIVOTZ", b"ROTAXI"))
# Where points lie in the world: another one than at the first point means another place.
SYSTEMS = frozenset((b"MSYS", b"CSYS", b"SETUP", b"TRNTYP"))
SHIFTS = frozenset((b"TRANS", b"ORIGIN"))

FEED_UNITS = {
    b"MMPM": 1.0,
    b"IPM": 25.4,
    b"MPM": 1000.0,
    b"FPM": 304.8,
    b"PERMIN": 0.0,
    b"MMPR": None,
    b"IPR": None,
    b"PERREV": None,
}
UNITS_MM = {
    b"MM": 1.0,
    b"CM": 10.0,
    b"M": 1000.0,
    b"INCH": 25.4,
    b"INCHES": 25.4,
    b"IN": 25.4,
    b"FEET": 304.8,
    b"FT": 304.8,
}

# Coordinate systems that other programs write beside the points: comments, and NX's record.
_ROW = rb"\$\$(?:[ \t]+%s){4}[ \t]*\r?\n" % NUMBER
_CATIA = re.compile(rb"\$\$\*CATIA0[^\n]*\n(?:\$\$[^\n]*[A-Za-z][^\n]*\n)?((?:%s){3,4})" % _ROW)
_CREO = re.compile(rb"\$\$->[ \t]*CSYS[ \t]*/((?:[^\n$]*\$[ \t]*\r?\n){0,12}[^\n]*)", re.IGNORECASE)


class Record(NamedTuple):
    """A record with comments and continuation marks as blanks, where it starts and ends in the file."""

    code: bytes
    start: int
    end: int


def read_record(raw: bytes, start: int) -> Record:
    """The record that begins at a line start: this line, and the next ones while a ``$`` says so.

    Everything after a ``$`` outside quotes is comment; ``$$`` does not go on. A line that is a GOTO or a RAPID of its own, or a
    comment, continues nothing: then the mark was no mark. Prose and lines of text are not continued.
    """
    code, at = [], start
    text = FIRST_WORD.match(raw, start)
    single = _LISTS.match(raw, start) is None
    if text is not None and text[1].upper() in TEXT:
        newline = raw.find(b"\n", start)
        end = len(raw) if newline < 0 else newline + 1
        return Record(raw[start:end], start, end)
    while True:
        newline = raw.find(b"\n", at)
        end = len(raw) if newline < 0 else newline + 1
        line, more = _code(raw[at:end])
        code.append(line)
        at = end
        if not more or single or at >= len(raw) or _OWN.match(raw, at) or raw.startswith(b"$$", at):
            return Record(b"".join(code), start, end)


def _code(line: bytes) -> tuple[bytes, bool]:
    """A line with what is no code as blanks, and whether it goes on in the next."""
    quoted = False
    for mark in _MARK.finditer(line):
        if mark[0] == b"'":
            quoted = not quoted
        elif not quoted:
            more = line[mark.end() : mark.end() + 1] != b"$"
            return line[: mark.start()] + b" " * (len(line) - mark.start()), more
    return line.translate(_BLANKED), False


def numbers(code: bytes, offset: int) -> list[tuple[bytes, tuple[int, int]]] | None:
    """Tokens and spans of numbers between commas, or None where something is no literal number."""
    found, at = [], 0
    while at < len(code):
        match = TOKEN.match(code, at)
        if match is None:
            return None
        found.append((match[1], (offset + match.start(1), offset + match.end(1))))
        at = match.end()
    return found


def system(raw: bytes, at: int) -> tuple[str, tuple[float, ...]] | None:
    """The coordinate system that a comment of CATIA or Creo states at a line start: its kind and numbers."""
    for kind, pattern in (("CATIA's matrix", _CATIA), ("CSYS", _CREO)):
        match = pattern.match(raw, at)
        if match is not None:
            return kind, tuple(float(token) for token in re.findall(NUMBER, match[1]))
    return None


_BLANKED = bytes.maketrans(b"\0\x1a", b"  ")
