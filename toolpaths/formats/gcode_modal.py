"""What G numbers leave in force for the lines after them: motion, plane, unit, zero point, and what stands in the way."""

from __future__ import annotations

from typing import NamedTuple

from toolpaths.formats import gcode_words as g
from toolpaths.program import FrameSetting

XYZ = (0, 1, 2)


class Loss(NamedTuple):
    """Words that are not known any more after a G number (None: all), and since when."""

    words: tuple[int, ...] | None
    since: str


class Modal:
    """The state of a control between lines.

    Attributes
    ----------
    mode
        0 to 3 for G0 to G3; None where `why_no_mode` says why axis words mean no such motion.
    plane
        First and second axis of the plane of arcs, and the third.
    unit_mm
        mm per unit of a coordinate; None where nothing has been said.
    blocked
        Why points are not where the words say, by G number (or another key).
    per_minute
        Whether F is a feed per minute.
    frames
        Zero points of the control, in order.
    """

    def __init__(self) -> None:
        self.mode: int | None = None
        self.why_no_mode = "no G0 or G1 before it"
        self.plane = (0, 1, 2)
        self.unit_mm: float | None = None
        self.blocked: dict[str, str] = {}
        self.per_minute = True
        self.frames: list[FrameSetting] = []

    @property
    def mm(self) -> float:
        """Mm per unit of a coordinate; metric where nothing has been said."""
        return self.unit_mm or 1.0

    def apply(self, number: str, line: int, *, started: bool, rotary: bool, table: bytes = b"") -> Loss | None:
        """What a G number changes, for its own line and those after it.

        Parameters
        ----------
        started, rotary
            Whether poses have been read already; whether the program has rotary axes.
        table
            The P of G54.1, as written.
        """
        if number in g.MOTIONS:
            self.mode = g.MOTIONS[number]
            return None
        if number in g.PLANES:
            self.plane = g.PLANES[number]
            return None
        if number in g.UNITS_MM:
            if started and g.UNITS_MM[number] != self.mm:
                self.blocked["unit"] = f"the unit changes in line {line}; split the program there"
            else:
                self.unit_mm = g.UNITS_MM[number]
            return None
        if number in g.OFFSETS:
            return self._zero_point(f"G{number}" + (f" P{table.decode()}" if table else ""), line)
        if number in ("93", "94", "95"):
            self.per_minute = number == "94"
        if number in g.CYCLES or number in g.PROBING:
            self._no_mode(f"{'a canned cycle' if number in g.CYCLES else 'probing'}, G{number} in line {line}")
        elif number == "80":
            self._no_mode(f"no G0 or G1 after G80 in line {line}")
        elif not g.known(number):
            self.blocked["?"] = f"what G{number} in line {line} does is not known here"
        return self._released(number, line) or self._length(number, line, rotary)

    def _no_mode(self, why: str) -> None:
        self.mode, self.why_no_mode = None, why

    def _zero_point(self, said: str, line: int) -> Loss | None:
        if self.frames and self.frames[-1].key == said:
            return None
        self.frames.append(FrameSetting(line, "base", "controller", None, said, key=said))
        return Loss(None, f"{said} in line {line}")

    def _released(self, number: str, line: int) -> Loss | None:
        """What stands in the way now, and what no longer does."""
        if number in g.BLOCKING:
            self.blocked[number] = f"{g.BLOCKING[number][1]}, G{number} since line {line}"
        ended = [key for key in self.blocked if key in g.BLOCKING and g.BLOCKING[key][0] == number]
        for key in ended:
            del self.blocked[key]
        return Loss(None, f"G{number} in line {line}") if ended else None

    def _length(self, number: str, line: int, rotary: bool) -> Loss | None:
        if number not in g.LENGTHS:
            return None
        # Along Z with three axes; with rotary axes X, Y, Z may change from the spindle's nose to the tip.
        along_z = number in ("43", "44", "49", "43.1") and not rotary
        return Loss((2,) if along_z else XYZ, f"G{number} in line {line}")
