"""Points that a KRL program keeps by name: in the ``.dat`` beside it, or assigned once in the ``.src`` itself.

A point is known when its numbers stand in one place only, as literals, and nothing but motions uses it: what else reads it
would be changed by a correction, and what else writes it makes its numbers uncertain. Names are not case-sensitive.
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterable, Sequence
from typing import NamedTuple

from toolpaths.formats.krl_words import Aggregate, Unreadable, read_aggregate
from toolpaths.formats.reading import blanked
from toolpaths.program import UNWRITTEN

_FLAGS = re.IGNORECASE | re.MULTILINE

# Base name, index (None: none, "": not a literal) and members, in upper case.
Key = tuple[str, str | None, tuple[str, ...]]

# An index has an end to its length: brackets that never close must not be searched to the end of the line each.
REFERENCE = re.compile(rb"([A-Za-z_]\w*)(?:[ \t]*(\[[^\]\r\n]{0,200}\]))?((?:[ \t]*\.[ \t]*[A-Za-z_]\w*)*)")
_STORED = re.compile(
    rb"^(?:\xef\xbb\xbf)?[ \t]*(?:(?:DECL|GLOBAL|CONST)[ \t]+)*(?:\w+[ \t]+)?([A-Za-z_]\w*)[ \t]*(\[[^\]\r\n]*\])?"
    rb"((?:[ \t]*\.[ \t]*[A-Za-z_]\w*)*)[ \t]*=[ \t]*(\{)",
    _FLAGS,
)
_WHOLE = re.compile(
    rb"^[ \t]*(?:(?:DECL|GLOBAL|CONST)[ \t]+)*INT[ \t]+([A-Za-z_]\w*)[ \t]*=[ \t]*(\d{1,9})[ \t]*[;\r\n]", _FLAGS
)
_MEMBER = re.compile(rb"([A-Za-z_]\w*)[ \t]*(\{[^{}]*\})")
_SILENT = re.compile(rb'"[^"\r\n]*"|;[^\n]*')
_DECLARES = re.compile(rb"[ \t]*(?:GLOBAL|DECL|CONST|E6POS|E3POS|POS|FRAME|E6AXIS|E3AXIS|AXIS|EXT)[ \t]", re.IGNORECASE)
_FDAT = re.compile(rb"\b(TOOL_NO|BASE_NO)[ \t]+(-?\d+)|\bIPO_FRAME[ \t]+(#\w+)", re.IGNORECASE)
_LDAT = re.compile(rb"\bAPO_DIST[ \t]+(\d{1,6}(?:\.\d{0,9})?)[ \t]*[,}]", re.IGNORECASE)
_MODULE = re.compile(rb"^[ \t]*DEFDAT[ \t]+([A-Za-z_]\w*)", _FLAGS)
_GLOBAL_POINT = re.compile(rb"^[ \t]*(?:DECL[ \t]+)?GLOBAL[ \t]+(?:DECL[ \t]+)?(?:E6POS|E3POS|POS|FRAME)\b", _FLAGS)


class FrameData(NamedTuple):
    """What a ``DECL FDAT`` says: numbers of tool and base, and whether the tool stands still (``#TCP``)."""

    tool: str
    base: str
    stands: bool


class _Place(NamedTuple):
    """Where a point's aggregate begins, in which file."""

    file: int
    brace: int
    end: int


def key_of(match: re.Match[bytes], counter: dict[str, int] | None = None) -> Key:
    """The key of a `REFERENCE`; an index that names a loop's counter has the counter's value."""
    name, index, members = match[1], match[2], match[3]
    literal: str | None = None
    if index is not None:
        inside = index[1:-1].strip().decode("ascii", "replace").upper()
        value = (counter or {}).get(inside)
        parts = [part.strip() for part in inside.split(",")]
        literal = str(value) if value is not None else ""
        if all(part.isdigit() for part in parts):
            literal = ",".join(str(int(part)) for part in parts)
    names = tuple(part.strip().decode().upper() for part in members.split(b".")[1:])
    return name.decode().upper(), literal, names


class Points:
    """The stored points of a program, found in the bytes of its files."""

    def __init__(self, raw: bytes, others: Sequence[tuple[str, bytes]]) -> None:
        self.files = [raw, *(content for _, content in others)]
        self.offset = [0]
        for content in self.files[:-1]:
            self.offset.append(self.offset[-1] + len(content))
        self._places: dict[Key, list[_Place]] = {}
        self._declared: set[int] = set()  # where in the first file a literal is assigned
        self._uncertain: set[str] = set()
        self._targets: dict[int, Key] = {}
        self._whole: dict[str, list[int]] = {}
        for file, content in enumerate(self.files):
            self._scan(file, content)
        self.has_global = any(_GLOBAL_POINT.search(content) for content in self.files)

    def _scan(self, file: int, content: bytes) -> None:
        for match in _STORED.finditer(content):
            key = key_of(match)
            newline = content.find(b"\n", match.end())
            end = len(content) if newline < 0 else newline
            if file == 0:
                self._declared.add(match.start(1))
            if key[1] == "":
                self._uncertain.add(key[0])
            self._places.setdefault(key, []).append(_Place(file, match.start(4), end))
            if content.find(b"{", match.end(), end) >= 0:
                for member in _MEMBER.finditer(content, match.end(), end):
                    name = member[1].decode().upper()
                    inner = (key[0], key[1], (*key[2], name))
                    self._places.setdefault(inner, []).append(_Place(file, member.start(2), member.end(2)))
        for match in _WHOLE.finditer(content):
            self._whole.setdefault(match[1].decode().upper(), []).append(int(match[2]))
            if file == 0:
                self._declared.add(match.start(1))

    def whole_number(self, name: str) -> int | None:
        """Value of an INT that is declared once with a number and that nothing assigns."""
        values = self._whole.get(name.upper(), [])
        pattern = re.compile(rb"(?<![\w$.])%s[ \t]*=(?!=)" % re.escape(name.encode()), re.IGNORECASE)
        assigned = sum(len(pattern.findall(blanked(content, _SILENT))) for content in self.files)
        return values[0] if len(values) == 1 and assigned == 1 else None

    def frame_data(self, name: str) -> FrameData | None:
        """What a ``DECL FDAT`` of that name says, where there is one."""
        places = self._places.get((name.upper(), None, ()), [])
        if len(places) != 1:
            return None
        file, start, end = places[0]
        said = {(m[1] or b"IPO").upper(): m[2] or m[3] for m in _FDAT.finditer(self.files[file], start, end)}
        if not {b"TOOL_NO", b"BASE_NO"} <= said.keys():
            return None
        stands = said.get(b"IPO", b"").upper() == b"#TCP"
        return FrameData(said[b"TOOL_NO"].decode(), said[b"BASE_NO"].decode(), stands)

    def blend_distance(self, name: str) -> float:
        """APO_DIST of a ``DECL LDAT`` of that name, mm; NaN where there is none."""
        places = self._places.get((name.upper(), None, ()), [])
        if len(places) != 1:
            return math.nan
        file, start, end = places[0]
        match = _LDAT.search(self.files[file], start, end)
        return float(match[1]) if match is not None else math.nan

    def __len__(self) -> int:
        return len(self._places)

    def find(self, at: int, key: Key, text: str) -> Aggregate:
        """The literal pose of the point that a motion goes to; `at` and `text` are where and how the motion names it.

        Raises
        ------
        Unreadable
            The point has no numbers here, more than one set of them, or no literal pose.
        """
        if key[1] == "":
            raise Unreadable(at, f"{text!r}: a named point or an expression: its index is not a literal number")
        places = self._places.get(key, [])
        if not places:
            hint = "" if len(self.files) > 1 else " (there is no .dat of its name beside it)"
            raise Unreadable(
                at, f"{text!r}: a named point or an expression, whose numbers are in no file of the program{hint}"
            )
        if len(places) > 1:
            raise Unreadable(at, f"{text!r}: a named point that is given numbers in {len(places)} places")
        if key[0] in self._uncertain:
            raise Unreadable(at, f"{text!r}: an element of an array that is also written to by a computed index")
        file, start, end = places[0]
        offset = self.offset[file]
        try:
            found = read_aggregate(self.files[file], start, end)
        except Unreadable as error:
            raise Unreadable(at, f"{text!r}: a named point that holds {error.found}") from None
        if not found.is_axes and None in found.tokens[:6]:
            raise Unreadable(at, f"{text!r}: a named point that does not write all of X, Y, Z, A, B, C")
        self._targets[at] = key
        spans = tuple(UNWRITTEN if a < 0 else (a + offset, b + offset) for a, b in found.spans)
        return found._replace(spans=spans, body=-1, point=key)

    def used_otherwise(self, keys: Iterable[Key]) -> dict[Key, int]:
        """Points that the source uses elsewhere than as the target of a motion: 1-based line of the first such use."""
        raw = self.files[0]
        names: dict[str, set[Key]] = {}
        for key in keys:
            names.setdefault(key[0], set()).add(key)
        known = {name.encode() for name in names}
        code = blanked(raw, _SILENT)
        found: dict[Key, int] = {}
        line, counted = 1, 0
        for match in REFERENCE.finditer(code):
            if match[1].upper() not in known or match.start() in self._targets or match.start() in self._declared:
                continue
            if _is_member(code, match.start()) or code[match.end() : match.end() + 9].lstrip(b" \t")[:1] == b"(":
                continue  # a name of something else: a member, a system variable, a subprogram
            begin = code.rfind(b"\n", 0, match.start()) + 1
            if _DECLARES.match(code, begin) is not None:
                continue
            line, counted = line + code.count(b"\n", counted, match.start()), match.start()
            use = key_of(match)
            for key in names[use[0]]:
                if key not in found and _touches(use, key):
                    found[key] = line
        return found


def _touches(use: Key, point: Key) -> bool:
    """Whether what one reference names is (part of) what the other names."""
    depth = min(len(use[2]), len(point[2]))
    same_element = use[1] is None or use[1] == "" or use[1] == point[1]
    return same_element and use[2][:depth] == point[2][:depth]


def _is_member(code: bytes, at: int) -> bool:
    return code[max(at - 2, 0) : at].rstrip(b" \t")[-1:] in (b".", b"$", b"#")


def naming_note(dat: bytes, stem: str, source: str) -> str | None:
    """What to say where a ``.dat`` is written under another name than its module's; the controller refuses such a file.

    Parameters
    ----------
    stem, source
        Names under which the file and the source are written, without suffix.
    """
    match = _MODULE.search(dat)
    if match is None or match[1].decode().lower() == stem.lower():
        return None
    name = match[1].decode()
    told = f"the .dat holds the module '{name}' but is written as '{stem}.dat'"
    if stem != source:
        return f"{told}: give it the name {name}.dat on the controller"
    return (
        f"{told}: give both files the name {name} on the controller (or choose an output named {name}.src), and see that DEF in "
        "the .src matches"
    )
