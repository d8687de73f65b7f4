"""Arcs of APT: ``CIRCLE`` before the GOTO to its end, and CATIA's circle up to a line; the GOTOs that replace them."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from toolpaths.arcs import RADIUS_MM, RADIUS_SHARE, Arc, NoArc, arc_about
from toolpaths.formats.gcode_arcs import decimals
from toolpaths.formats.reading import NUMBER

Floats = NDArray[np.float64]

_HINT = "an arc, whose ends cannot move without it: --linearise TOL replaces arcs by straight moves"
_N = rb"\s*(%s)\s*" % NUMBER
_CONTOUR = re.compile(
    rb"\s*TLON\s*,\s*GOFWD\s*/\s*\(\s*CIRCLE\s*/"
    + b",".join([_N] * 4)
    + rb"\)\s*,\s*(?:1\s*,\s*INTOF\s*,\s*)?(?:ON|TO|PAST)\s*,\s*"
    rb"\(\s*LINE\s*/" + b",".join([_N] * 6) + rb"\)\s*\Z",
    re.IGNORECASE,
)
_STYLE = re.compile(rb"[ \t]*GOTO[ \t]*/[ \t]*", re.IGNORECASE)
_COMMA = re.compile(rb"\d\.?([ \t]*,[ \t]*)")


@dataclass(frozen=True)
class FoundArc:
    """An arc: where it stands, and its geometry or why there is none.

    Attributes
    ----------
    line, begin, end
        1-based line and bytes of the record that describes it.
    values, start
        Numbers of CIRCLE; where the tool stood, program units.
    at
        Where the GOTO to its end starts; where the record starts if `whole`.
    tokens
        Numbers of that GOTO.
    whole
        Whether the record is the whole motion, with no GOTO to its end.
    arc
        In mm, or the reason there is none.
    """

    line: int
    begin: int
    end: int
    values: list[float] | None = None
    start: Floats | None = None
    at: int = -1
    tokens: tuple[bytes | None, ...] = ()
    whole: bool = False
    arc: Arc | str = "no GOTO to its end"

    def ended(self, at: int, tokens: Sequence[bytes | None], arc: Arc | str) -> FoundArc:
        """With the GOTO to its end."""
        return replace(self, at=at, tokens=tuple(tokens), arc=arc)

    def reason(self, what: str) -> str:
        """Why it cannot be corrected."""
        return f"{what}: {_HINT}" if isinstance(self.arc, Arc) else f"{what}: {self.arc}"


def circle_arc(values: list[float] | None, start: Floats | None, end: Floats, mm: float) -> Arc | str:
    """The arc of ``CIRCLE/x,y,z,i,j,k[,r ..]`` from where the tool stands to the next GOTO: to the left about i, j, k."""
    if values is None or len(values) < 6:
        return "its numbers are not literal, or fewer than 6"
    if start is None:
        return "where it starts is not known"
    normal = np.array(values[3:6])
    if not normal.any():
        return "its axis has no direction (0, 0, 0)"
    try:
        arc = arc_about(start * mm, end * mm, np.array(values[:3]) * mm, normal, left=True)
    except NoArc as error:
        return str(error)
    if len(values) > 6 and abs(values[6] * mm - arc.radius) > max(RADIUS_MM, RADIUS_SHARE * arc.radius):
        return f"its radius is {values[6] * mm:g} mm and its ends are {arc.radius:g} mm from its center"
    return arc


def contour_arc(code: bytes, direction: tuple[float, ...], start: Floats | None, mm: float) -> Arc | str:
    """The arc of CATIA's ``TLON,GOFWD/(CIRCLE/x,y,z,r),ON,(LINE/center, end)`` in a plane normal to z, begun along INDIRV."""
    match = _CONTOUR.match(code)
    if match is None:
        return "not of a known form (TLON,GOFWD/(CIRCLE/x,y,z,r),ON,(LINE/..))"
    if start is None or len(direction) != 3:
        return "where it starts, or INDIRV, is not known"
    values = [float(token) * mm for token in match.groups()]
    center, radius, first, second = np.array(values[:3]), values[3], np.array(values[4:7]), np.array(values[7:10])
    along = second - first
    if np.linalg.norm(first - center) > RADIUS_MM or not along.any():
        return "the line that ends it does not start at its center"
    end = center + along / np.linalg.norm(along) * radius
    here = start * mm
    normal = np.array([0.0, 0.0, 1.0])
    side = float(np.cross(normal, here - center) @ np.array(direction))
    if abs(here[2] - center[2]) > RADIUS_MM or abs(along[2]) > RADIUS_MM or side == 0:
        return "it is not in a plane normal to z, or INDIRV does not say which way it goes"
    try:
        arc = arc_about(here, end, center, normal, left=side > 0)
    except NoArc as error:
        return str(error)
    if abs(radius - arc.radius) > max(RADIUS_MM, RADIUS_SHARE * arc.radius):
        return f"its radius is {radius:g} mm and it starts {arc.radius:g} mm from its center"
    return arc


def straight_points(raw: bytes, found: FoundArc, tolerance_mm: float, mm: float, newline: bytes) -> bytes:
    """What stands instead of the bytes from the arc's record to its GOTO (or to its own end): GOTOs along the arc.

    Raises
    ------
    NoArc
        The tool's axis is written at the end, or the tolerance is too fine.
    """
    if not isinstance(found.arc, Arc):
        raise NoArc(found.arc)
    written = [token for token in found.tokens if token is not None]
    style = _STYLE.match(raw, found.at)
    head = style[0] if style else b"GOTO/"
    line = raw[found.at : found.at + 200].split(b"\n")[0]
    comma = _COMMA.search(line) if style else None
    separator = comma[1] if comma else b","
    places = decimals(written[:3], tolerance_mm / mm)
    points = found.arc.points(tolerance_mm - 10.0**-places * mm) / mm
    inner = points if found.whole else points[:-1]
    axis = b"".join(separator + token for token in written[3:])
    texts = [
        head + separator.join(b"%.*f" % (places, round(float(v), places) + 0.0) for v in point) + axis + newline
        for point in inner
    ]
    between = b"" if found.whole else raw[found.end : found.at]
    return between + b"".join(texts)
