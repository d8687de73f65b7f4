"""Staubli VAL3: a program ``.pgx`` with ``movel`` and ``movec`` to points of the ``.dtx`` data files beside it.

Decisions: give the ``.pgx``; what is corrected are the numbers in the ``.dtx``. Points of one array are points of their own:
``movel(p[3], ..)`` is read, ``p[i]`` and ``appro(p[3], ..)`` are refused. A point's frame and the tool come from the data files
where they are literal there, and must then agree with process.yaml and the cell.
"""

from __future__ import annotations

import math
import re
from collections.abc import Sequence
from pathlib import Path

from drake_stiffness.errors import InputError
from toolpaths.conventions import STAUBLI
from toolpaths.formats.reading import HEAD_BYTES, Reading, Unreadable, arguments, blanked, shown
from toolpaths.formats.val3_data import DATA_FILE, Data, in_root, read_data
from toolpaths.program import Program

_PROGRAM_FILE = re.compile(rb"<Programs?\b[^>]*VAL3/Program")
_CODE = re.compile(rb"<!\[CDATA\[(.*?)(?:\]\]>|\Z)", re.DOTALL)
_COMMENT_OR_STRING = re.compile(rb'"[^"\r\n]*"?|//[^\r\n]*')
_LOCAL = re.compile(rb"<(?:Local|Parameter)\s[^<>]*?name\s*=\s*\"(\w+)\"")
_MOTION = re.compile(rb"(?<![\w:.])(movel|movec|movej|movejs|movels|moveJSafe|moveLSafe)\s*\(")
_ELEMENT = re.compile(rb"([A-Za-z]\w*)\s*(?:\[\s*(\d{1,9})\s*\])?")
_USED = re.compile(rb"(?<![\w:.])([A-Za-z]\w*)\s*(?:\[\s*(\d{1,9})\s*\])?")
_BLOCK = re.compile(
    rb"\s*(?:while|endWhile|do|until|if|elseIf|else|endIf|for|endFor|switch|case|default|break|endSwitch|return|call|begin|end|resetMotion|taskCreate)\b"
)
_ASSIGNED = re.compile(
    rb"\s*([A-Za-z]\w*)\s*(?:\[[^\]]*\])?(?:\.\w+)*\s*=(?!=)|\s*(?:link|setFrame)\s*\(\s*([A-Za-z]\w*)"
)


class Val3:
    """VAL3 applications as a dialect."""

    name = "val3"

    def recognises(self, raw: bytes, suffix: str) -> bool:
        """The XML of a VAL3 program or data file."""
        return _PROGRAM_FILE.search(raw, 0, HEAD_BYTES) is not None or DATA_FILE.search(raw, 0, HEAD_BYTES) is not None

    def companions(self, path: Path) -> tuple[Path, ...]:
        """All data files of the application: they lie in one folder with the program."""
        return tuple(sorted(path.parent.glob("*.dtx"))) if path.suffix.lower() != ".dtx" else ()

    def parse(self, raw: bytes, path: str, others: Sequence[tuple[str, bytes]] = ()) -> Program:
        """Read a program and its data files; see ``toolpaths.formats.Dialect``.

        Raises
        ------
        InputError
            The file is a data file, or there is no motion in it.
        """
        if _PROGRAM_FILE.search(raw, 0, HEAD_BYTES) is None:
            raise InputError(
                f"{path}: this is a VAL3 data file: it holds points, but not the order in which they are gone to. Give the program "
                "(.pgx) with the movel instructions; the data files beside it are read and corrected with it"
            )
        offset, files = len(raw), []
        for _, content in others:
            files.append((offset, content))
            offset += len(content)
        reader = _Reader(raw, read_data(files))
        reader.read()
        if not reader.has_motion:
            raise InputError(
                f"{path}: found no motion; expected movel, movec or movej; give the program (.pgx) that holds the motions"
            )
        if not others:
            reader.warnings.append("no data file (.dtx) lies beside the program, so its points are not known")
        reader.compute_frames(reader.assigned)
        return reader.finish(self.name, path, others=others)


class _Reader(Reading):
    """Goes through the code line by line, on a copy whose comments and strings are blanks."""

    def __init__(self, raw: bytes, data: Data) -> None:
        super().__init__(raw, STAUBLI)
        self.data = data
        self.assigned: set[bytes] = set()
        self.code = b""

    def read(self) -> None:
        raw = self.raw
        for local in _LOCAL.finditer(raw):
            self.to(local.start())
            self.mention([local[1]], "a variable of the program itself")
        for section in _CODE.finditer(raw):
            start, end = section.span(1)
            self.code = raw[:start] + blanked(raw[start:end], _COMMENT_OR_STRING) + raw[end:]
            at = start
            while at < end:
                newline = self.code.find(b"\n", at, end)
                stop = end if newline < 0 else newline
                text = self.code[at:stop]
                if text.strip():
                    self.to(at + len(text) - len(text.lstrip()))
                    self.statement(at, stop)
                at = stop + 1

    def called(self, point: object) -> tuple[object, ...]:
        """The element itself and its array."""
        assert isinstance(point, bytes)
        return point, point.partition(b"[")[0]

    def names(self, start: int, end: int) -> list[object]:
        """Elements that a piece of code uses; a whole array where the index is computed."""
        code = self.code
        found: list[object] = []
        for used in _USED.finditer(code, start, end):
            computed = used[2] is None and code[used.end() : end].lstrip()[:1] == b"["
            found.append(used[1] if computed else b"%s[%s]" % (used[1], used[2] or b"0"))
        return found

    def statement(self, start: int, end: int) -> None:
        motion = _MOTION.search(self.code, start, end)
        if motion is None:
            self.mention(self.names(start, end), shown(self.raw, start, end))
            assigned = _ASSIGNED.match(self.code, start, end)
            if assigned is not None:
                self.assigned.add(assigned[1] or assigned[2])
        else:
            self.has_motion = True
            try:
                self.motion(motion, end)
            except Unreadable as error:
                self.mention(self.names(motion.end(), end), shown(self.raw, start, end))
                self.refuse(error.at, error.found, force=not motion[1].startswith(b"movej"))
        if _BLOCK.match(self.code, start, end) is not None:
            self.rows.forget()

    def motion(self, match: re.Match[bytes], end: int) -> None:
        """One motion with its points, its tool and its speed."""
        code, kind = self.code, match[1].decode()
        close = code.rfind(b")", match.end(), end)
        pieces = arguments(code, match.end(), close if close >= 0 else end)
        arc = kind == "movec"
        if kind not in ("movel", "movec", "movej") or len(pieces) != 3 + arc or close < 0:
            raise Unreadable(
                match.start(),
                f"{shown(self.raw, match.start(), end)!r}, not a motion with {'two points' if arc else 'a point'}, tool and speed",
            )
        targets = []
        for piece in pieces[: 1 + arc]:
            element = self.element(piece)
            target = self.data.points.get(element or b"", "whose numbers are in no data file (.dtx) beside the program")
            if element is None:
                target = "which is computed while the program runs"
            if isinstance(target, str):
                if kind == "movej":
                    self.mention(self.names(*piece), shown(self.raw, *match.span()))
                    self.rows.forget()
                    return
                raise Unreadable(piece[0], f"the point {shown(self.raw, *piece)!r}, {target}")
            targets.append(target)
        self.set_tool(pieces[-2])
        description = self.element(pieces[-1]) or b""
        self.rows.feed_mm_per_min = self.data.feeds.get(description, math.nan)
        self.rows.blend_mm = self.data.blends.get(description, math.nan)
        if len({target.frame for target in targets}) > 1:
            raise Unreadable(match.start(), "an arc between points of two frames")
        for role, target in zip(("via", "end") if arc else ("point",), targets, strict=True):
            self.set_base(target.frame[0][1])
            self.add(kind.upper(), role, target, force=kind != "movej")

    def element(self, piece: tuple[int, int]) -> bytes | None:
        match = _ELEMENT.fullmatch(self.code, *piece)
        return b"%s[%s]" % (match[1], match[2] or b"0") if match is not None else None

    def set_base(self, name: str) -> None:
        pose = in_root(self.data.frames, name.encode(), b"world[0]") if name != "world[0]" else None
        self.set_frame("base", name, f"frame {name}", pose, convention=STAUBLI)

    def set_tool(self, piece: tuple[int, int]) -> None:
        element = self.element(piece)
        name = shown(self.raw, *piece) if element is None else element.decode("ascii", "backslashreplace")
        pose = in_root(self.data.tools, element, b"flange[0]") if element not in (None, b"flange[0]") else None
        self.set_frame("tool", name, f"tool {name}", pose, convention=STAUBLI)
