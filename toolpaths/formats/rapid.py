r"""ABB RAPID ``.mod``, ``.prg``: linear and circular moves to robtargets that are written in the move or declared in the file.

Every robtarget is a whole pose, so no move keeps words of another. Decisions: targets that are computed (``Offs``,
``RelTool``, array elements) are refused; so is a declared point that something else than a move uses too, because a
correction would reach that as well. Points may be declared in other modules of the program, which a ``.pgf`` lists or the user
gives; their own motions stay as they are. ``9E9`` means that an external axis is not there. Tools and work
objects come from the controller by name; where the module holds them as literals they must agree with process.yaml.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import replace
from itertools import pairwise
from pathlib import Path

import numpy as np

from drake_stiffness.errors import InputError
from toolpaths.formats import rapid_pieces
from toolpaths.formats import rapid_words as words
from toolpaths.formats.rapid_reader import Reader
from toolpaths.formats.reading import HEAD_BYTES, Continued, NeedsWhole, Target, blanked
from toolpaths.program import Program

_LISTED = re.compile(rb"<Module>\s*([^<>]{1,255}?)\s*</Module>", re.IGNORECASE)


class Rapid:
    """RAPID modules as a dialect."""

    name = "rapid"

    def recognises(self, raw: bytes, suffix: str) -> bool:
        """A line ``MODULE name``, a declared robtarget, tool or work object, or a move with speed, zone and tool."""
        return words.RECOGNISED.search(raw, 0, HEAD_BYTES) is not None

    def companions(self, path: Path) -> tuple[Path, ...]:
        """The other modules of the programs (``.pgf``) in the folder that this one belongs to."""
        found: dict[Path, None] = {}
        for listing in sorted(path.parent.glob("*.pgf")) if path.parent.is_dir() else ():
            raw = listing.read_bytes()[:HEAD_BYTES] if listing.is_file() else b""
            names = [name.decode("latin-1") for name in _LISTED.findall(raw)]
            if path.name.lower() in (name.lower() for name in names):
                found.update(dict.fromkeys(path.parent / name for name in names if name.lower() != path.name.lower()))
        return tuple(found)

    def parse(self, raw: bytes, path: str, others: Sequence[tuple[str, bytes]] = ()) -> Program:
        """Read a module; see ``toolpaths.formats.Dialect``.

        Raises
        ------
        InputError
            There is no motion in it.
        """
        files = [raw, *(content for _, content in others)]
        ends = np.cumsum([0, *map(len, files)]).tolist()
        code = b"".join(blanked(content, words.COMMENT_OR_STRING) for content in files)
        whole = b"".join(files) if others else raw
        reader, *modules = (Reader(whole, code, start, end) for start, end in pairwise(ends))
        for module, (name, _) in zip(modules, others, strict=True):
            module.read()
            _see(reader, module, Path(name).name)
        reader.read()
        if not reader.has_motion:
            raise InputError(
                f"{path}: found no motion; expected MoveL, MoveC or MoveJ; give the module that holds the motions"
            )
        reader.settle()
        reader.raw = raw
        return reader.finish(self.name, path, others=others)

    def cut(self, raw: bytes) -> int:
        """Where the last place is at which a module may be cut in two; see ``toolpaths.formats.InPieces``."""
        return rapid_pieces.cut(raw)

    def parse_piece(
        self, raw: bytes, path: str, resume: object, others: Sequence[tuple[str, bytes]] = (), last: bool = False
    ) -> tuple[Program, object]:
        """See ``toolpaths.formats.InPieces``; NeedsWhole where moves along a path go to declared points, here or in other files."""
        assert resume is None or isinstance(resume, Continued)
        if others:
            raise NeedsWhole
        reader = Reader(raw, blanked(raw, words.COMMENT_OR_STRING), 0, len(raw))
        if resume is not None:
            reader.take_over(resume)
        reader.read()
        reader.settle()
        return replace(reader.finish(self.name, path), resume=resume), reader.hand_on()


def _see(reader: Reader, module: Reader, name: str) -> None:
    """What a module sees of another: points, frames and speeds declared for all, and the uses of points in it."""
    for (routine, point), target in module.points.items():
        if point in module.local:
            reader.outside.setdefault(point, f"which {name} declares for itself alone (LOCAL)")
        elif not routine:
            twice = isinstance(reader.outside.get(point), Target)
            reader.outside[point] = f"which is declared twice (again in {name})" if twice else target
    tables = ((reader.frame_data, module.frame_data), (reader.speeds, module.speeds), (reader.zones, module.zones))
    for mine, other in tables:
        for key in other.keys() - mine.keys() - module.local:
            mine[key] = other[key]  # type: ignore[assignment]
    reader.assigned |= module.assigned - module.local
    reader.mention_elsewhere(module, name)
    if module.has_motion:
        reader.warnings.append(
            f"{name} holds motions of its own, which stay as they are; correct it as a program too if they machine"
        )
