"""Arcs of G-code: their geometry from I, J, K or R, and the lines with G1 that replace them."""

from __future__ import annotations

import math
import re
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from toolpaths.arcs import Arc, NoArc, arc_about, center_of_radius
from toolpaths.formats.gcode_words import ARC_WORDS, AXES, Word, g_number

Floats = NDArray[np.float64]

_KEPT = frozenset((b"N", b"G", b"F", b"S"))
_FINEST, _COARSEST = 9, 3


@dataclass(frozen=True)
class FoundArc:
    """A line that runs as an arc: where it stands, its words, and its geometry or why there is none.

    Attributes
    ----------
    line, start, end
        1-based line and its bytes, line end included.
    words
        All words of the line.
    explicit
        Whether the line itself says G2 or G3.
    arc
        Geometry in mm, or the reason there is none.
    """

    line: int
    start: int
    end: int
    words: tuple[Word, ...]
    explicit: bool
    arc: Arc | str


def arc_of(
    values: dict[bytes, Word], start: Floats, end: Floats, left: bool, plane: tuple[int, int, int], unit_mm: float
) -> Arc:
    """The arc of a line.

    Parameters
    ----------
    values
        Words by letter; I, J, K are offsets of the center from the start.
    start, end
        (3,) mm; NaN where not known.
    left
        G3 instead of G2.
    plane
        First and second axis of the plane and the third one: the arc turns from the first to the second.

    Raises
    ------
    NoArc
        The words or points make no arc that can be relied on.
    """
    if not np.isfinite([start, end]).all():
        raise NoArc("where it starts or ends is not known")
    if b"P" in values:
        raise NoArc("P (turns) on an arc")
    normal = np.eye(3)[plane[2]]
    offsets = [letter for letter in ARC_WORDS[:3] if letter in values]
    if b"R" in values:
        if offsets:
            raise NoArc("R together with I, J or K")
        radius = float(values[b"R"].token) * unit_mm
        center = center_of_radius(start, end, radius, normal, left)
    else:
        if not offsets:
            raise NoArc("neither I, J, K nor R")
        if ARC_WORDS[plane[2]] in values and float(values[ARC_WORDS[plane[2]]].token) != 0:
            raise NoArc(f"{ARC_WORDS[plane[2]].decode()} is not in the plane of the arc")
        center = start.copy()
        for letter in offsets:
            center[ARC_WORDS.index(letter)] += float(values[letter].token) * unit_mm
        center[plane[2]] = start[plane[2]]
    return arc_about(start, end, center, normal, left)


def straight_lines(
    line: bytes, offset: int, words: Sequence[Word], arc: Arc, tolerance_mm: float, unit_mm: float, newline: bytes
) -> bytes:
    """The lines that replace an arc: the first keeps what else the line says, all write X, Y and Z.

    Parameters
    ----------
    line, offset
        The line with its end, and where it starts in the file.
    words
        Its words.

    Raises
    ------
    NoArc
        The line says things that belong to its end (M words), or the tolerance is too fine.
    """
    other = next(
        (w for w in words if w.letter not in _KEPT and w.letter not in AXES and w.letter not in ARC_WORDS), None
    )
    if other is not None:
        raise NoArc(f"{other.letter.decode()} on the line; write it on a line of its own")
    if line.lstrip().startswith(b"/"):
        raise NoArc("a line that may be skipped")
    places = decimals([w.token for w in words if w.letter in (*AXES, *ARC_WORDS)], tolerance_mm / unit_mm)
    points = arc.points(tolerance_mm - 10.0**-places * unit_mm) / unit_mm
    moving = [w for w in words if w.letter in AXES or w.letter in ARC_WORDS or _is_arc(w)]
    lower = line[moving[0].at - offset : moving[0].at - offset + 1].islower()
    ends = {w.letter: w.token for w in words if w.letter in AXES}
    texts = [_text(point, places, {}) for point in points[:-1]] + [_text(points[-1], places, ends)]
    texts = [text.lower() if lower else text for text in texts]
    body = line.rstrip(b"\r\n")
    end = line[len(body) :]
    begin = moving[0].at - offset
    rest, at = b"", begin
    for word in moving:  # what stands between the words of the arc (F, a comment) comes after the new words
        rest += body[at : word.at - offset].strip(b" \t") + b" "
        at = word.span[1] - offset
    rest = re.sub(rb"^[ \t]+(?=\S)", b" ", rest.rstrip(b" \t") + body[at:])
    first = body[:begin] + texts[0] + (rest if rest.strip() else rest.strip())
    if rest.strip() and not rest.startswith((b" ", b"\t")):
        first = body[:begin] + texts[0] + b" " + rest
    return newline.join([first, *texts[1:]]) + end


def decimals(tokens: Sequence[bytes], tolerance: float) -> int:
    """Decimals for new points: those of the line, and enough that rounding is a tenth of the tolerance at most."""
    most = max((len(token.partition(b".")[2]) for token in tokens), default=0)
    return min(max(most, _COARSEST, math.ceil(1 - math.log10(tolerance))), _FINEST)


def _is_arc(word: Word) -> bool:
    return word.letter == b"G" and g_number(word.token) in ("2", "3")


def _text(point: Floats, places: int, ends: dict[bytes, bytes]) -> bytes:
    values = (round(float(value), places) + 0.0 for value in point)  # no minus zero
    return b"G1 " + b" ".join(
        letter + ends.get(letter, b"%.*f" % (places, value)) for letter, value in zip(AXES, values, strict=True)
    )
