"""Arcs replaced by straight moves within a tolerance: a first step on the text of a program, before it is corrected.

An arc's two ends and its center are bound to each other, so a correction that moves its ends would need another center; and
a deflection that changes along the arc bends it. Straight moves can each be corrected. Every replaced line is listed
(`Program.replaced`).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import NamedTuple

from drake_stiffness.errors import InputError
from toolpaths.arcs import Arc, NoArc
from toolpaths.formats import apt, dialect_of, gcode
from toolpaths.formats.apt_arcs import straight_points
from toolpaths.formats.gcode_arcs import straight_lines
from toolpaths.program import Program, Replacement

# Below this a tolerance is a slip of the unit: chords would be shorter than anything a controller resolves.
LEAST_TOLERANCE_MM = 1e-4


class Piece(NamedTuple):
    """Bytes of a program from `start` to `end` (its lines from `line` on), and what stands there instead."""

    start: int
    end: int
    line: int
    text: bytes


def linearise(program: Program, tolerance_mm: float) -> Program:
    """The program with its arcs replaced by straight moves whose chords stay within a tolerance of them.

    Parameters
    ----------
    program
        As read by ``toolpaths.formats.read_program``.
    tolerance_mm
        Greatest distance between an arc and the moves that replace it, rounding of their numbers included.

    Returns
    -------
    The program read again; `replaced` lists what changed. Arcs that are no known arcs stay as they are and stay refused.

    Raises
    ------
    InputError
        The tolerance is no positive length, the dialect has no arcs to replace, or an arc that must stay needs the G2 or G3 of a line
        that is replaced.
    """
    if not LEAST_TOLERANCE_MM <= tolerance_mm < float("inf"):
        raise InputError(
            f"--linearise: found {tolerance_mm:g}; expected the greatest distance from the arc in mm, at least {LEAST_TOLERANCE_MM:g}, "
            "for example 0.01"
        )
    find = _FIND.get(program.dialect)
    if find is None:
        raise InputError(
            f"{program.path}: --linearise replaces arcs of {' and '.join(_FIND)}; this program is {program.dialect}. Leave the option out"
        )
    raw = program.raw
    pieces = find(raw, tolerance_mm, program.path)
    new, replaced = _applied(raw, pieces)
    again = dialect_of(program).parse(new, program.path)
    return replace(again, replaced=replaced)


def _gcode(raw: bytes, tolerance_mm: float, path: str) -> list[Piece]:
    reader = gcode.read(raw)
    pieces: list[Piece] = []
    replaced_since = 0  # line of a replaced G2 or G3 that later lines without one may depend on
    for found in reader.arcs:
        why = found.arc
        if isinstance(why, Arc):
            line = raw[found.start : found.end]
            try:
                text = straight_lines(line, found.start, found.words, why, tolerance_mm, reader.modal.mm, _newline(raw))
            except NoArc as error:
                why = str(error)
            else:
                pieces.append(Piece(found.start, found.end, found.line, text))
                replaced_since = found.line if found.explicit or not replaced_since else replaced_since
                continue
        if not found.explicit and replaced_since:
            raise InputError(
                f"{path}, line {found.line}: this arc cannot be replaced ({why}), and the G2 or G3 it depends on (line {replaced_since}) "
                "would be. Write G2 or G3 on this line"
            )
        replaced_since = 0
    return pieces


def _apt(raw: bytes, tolerance_mm: float, path: str) -> list[Piece]:
    reader = apt.read(raw)
    pieces: list[Piece] = []
    for found in reader.arcs:
        try:
            text = straight_points(raw, found, tolerance_mm, reader.mm, _newline(raw))
        except NoArc:
            continue
        pieces.append(Piece(found.begin, found.end if found.whole else found.at, found.line, text))
    return pieces


def _applied(raw: bytes, pieces: Sequence[Piece]) -> tuple[bytes, tuple[Replacement, ...]]:
    out, listed = bytearray(), []
    done, line = 0, 1
    for piece in pieces:
        kept = raw[done : piece.start]
        out += kept
        line += kept.count(b"\n")
        before = raw[piece.start : piece.end]
        listed.append(Replacement(piece.line, _shown(before), line, _shown(piece.text)))
        out += piece.text
        line += piece.text.count(b"\n")
        done = piece.end
    out += raw[done:]
    return bytes(out), tuple(listed)


def _shown(text: bytes) -> str:
    return text.decode("utf-8", "backslashreplace").replace("\r\n", "\n").rstrip("\n")


def _newline(raw: bytes) -> bytes:
    return b"\r\n" if b"\r\n" in raw else b"\n"


_FIND: dict[str, Callable[[bytes, float, str], list[Piece]]] = {"gcode": _gcode, "apt": _apt}
