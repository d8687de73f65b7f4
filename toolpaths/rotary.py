"""Rotary words A, B, C of five-axis G-code: what they mean is nowhere in the program, so `process.yaml` declares it.

The angles must say where the tool's axis points in the program's frame, and X, Y, Z where the tool's tip is (RTCP, TCPC,
TRAORI: the control or the robot follows the tip). Programs in machine coordinates of one particular machine are another thing
and cannot be told from these; nothing here converts them.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path
from typing import Literal

import numpy as np
from numpy.typing import NDArray
from pydantic import Field, model_validator

from drake_stiffness.errors import InputError
from drake_stiffness.files import Document
from toolpaths.conventions import KUKA, Convention
from toolpaths.program import Program

Floats = NDArray[np.float64]

# Nearer than this to the pole, where the outer axis turns the tool about itself, a tilt is not made with the outer axis.
POLE_DEG = 1.0
_STEPS = 6

# The axes from the workpiece to the tool: direction of the tool = R(outer) R(inner) z. C turns about z: as the inner axis it
# would do nothing, so AC and CA are the same thing.
_ORDER = {"A": "A", "B": "B", "AB": "AB", "BA": "BA", "AC": "CA", "CA": "CA", "BC": "CB", "CB": "CB"}


class RotaryAxes(Document):
    """The key `gcode` of process.yaml."""

    rotary: Literal["A", "B", "AB", "BA", "AC", "CA", "BC", "CB", "ABC"]
    unit: Literal["deg", "rad"] = "deg"
    reversed: tuple[Literal["A", "B", "C"], ...] = ()
    zero_deg: dict[Literal["A", "B", "C"], float] = Field(default_factory=dict)

    @model_validator(mode="after")
    def _known_axes(self) -> RotaryAxes:
        spare = {*self.reversed, *self.zero_deg} - set(self.rotary)
        if spare:
            raise ValueError(
                f"reversed and zero_deg name {', '.join(sorted(spare))}, which rotary: {self.rotary} does not have"
            )
        if self.rotary == "ABC" and (self.reversed or self.zero_deg):
            raise ValueError("rotary: ABC means the angles Rz(A) Ry(B) Rx(C); it takes neither reversed nor zero_deg")
        return self

    def convention(self) -> Convention:
        """What the words mean."""
        if self.rotary == "ABC":
            return KUKA
        words = tuple(sorted(self.rotary))
        return Rotary(
            words=words,
            order=_ORDER[self.rotary],
            sign=tuple(-1.0 if word in self.reversed else 1.0 for word in words),
            zero_deg=tuple(dict(self.zero_deg).get(word, 0.0) for word in words),  # type: ignore[call-overload]
        )


@dataclass(frozen=True)
class Rotary:
    """One or two rotary axes that turn the tool's axis from the z of the program's frame.

    Attributes
    ----------
    words
        Letters in the order of the values.
    order
        The same letters from the workpiece to the tool: A turns about x, B about y, C about z.
    sign, zero_deg
        Of each word: the angle is ``sign * (word - zero_deg)``.
    """

    words: tuple[str, ...]
    order: str
    sign: tuple[float, ...]
    zero_deg: tuple[float, ...]
    name: str = "rotary axes"
    axis_only: bool = True
    degrees: float = 1.0

    def rotation(self, values: Floats) -> Floats:
        """Rotations (N, 3, 3) of angles (N, K), degrees; the third column is the tool's axis."""
        return self._turned(values)[0]

    def near(self, R: Floats, values: Floats) -> Floats:
        """Angles (N, K) whose axis is the third column of R, found by Newton's method from given ones.

        Within `POLE_DEG` of the pole the outer axis stays: there the smallest tilt would turn it by any angle. One axis comes
        as near as one axis can.
        """
        axis = R[:, :, 2]
        found = np.array(values, dtype=float)
        for _ in range(_STEPS):
            now, slope = self._turned(found)
            slope[
                np.broadcast_to(np.linalg.norm(slope, axis=1)[:, None] < np.sin(np.radians(POLE_DEG)), slope.shape)
            ] = 0.0
            normal = np.einsum("nij,nik->njk", slope, slope)
            normal += np.eye(len(self.words)) * (np.einsum("njj->nj", normal)[:, None] == 0)
            right = np.einsum("nij,ni->nj", slope, axis - now[:, :, 2])
            found += np.degrees(np.linalg.solve(normal, right[..., None])[..., 0])
        same = np.abs(axis - self.rotation(values)[:, :, 2]).max(axis=1, initial=0.0) <= 4e-15
        return np.where(same[:, None], values, found)

    def _turned(self, values: Floats) -> tuple[Floats, Floats]:
        """Rotations, and how the tool's axis moves with each word (N, 3, K), 1/rad."""
        angle = np.radians(np.array(self.sign) * (values - np.array(self.zero_deg)))
        R = np.broadcast_to(np.eye(3), (len(values), 3, 3))
        about = {}
        for letter in self.order:
            word = self.words.index(letter)
            about[word] = R[:, :, "ABC".index(letter)] * self.sign[word]
            R = R @ _turn("ABC".index(letter), angle[:, word])
        slope = np.stack([np.cross(about[word], R[:, :, 2]) for word in range(len(self.words))], axis=2)
        return R, slope


@dataclass(frozen=True)
class Undeclared:
    """Rotary words whose meaning is not known yet; see `declare`."""

    words: tuple[str, ...]
    name: str = "undeclared rotary axes"
    axis_only: bool = True
    degrees: float = 1.0

    def rotation(self, values: Floats) -> Floats:
        """NaN (N, 3, 3)."""
        return np.full((len(values), 3, 3), np.nan)

    def near(self, R: Floats, values: Floats) -> Floats:
        """The values."""
        return values


def declare(program: Program, axes: RotaryAxes | None, where: Path) -> Program:
    """A program whose rotary words mean what the key `gcode` of process.yaml (the file `where`) says.

    Raises
    ------
    InputError
        The program writes rotary words that the key does not declare, or never writes one that it declares.
    """
    written = program.convention.words
    if not isinstance(program.convention, Undeclared):
        return program
    first = int(program.line[np.flatnonzero(program.written[:, 3:].any(axis=1))[0]])
    found = f"{program.path}, line {first}: found the rotary words {', '.join(written)}"
    if axes is None:
        raise InputError(
            f"{found}, whose meaning {where} does not declare; expected for example gcode: {{rotary: AC, unit: deg}} "
            "(AC, BC, AB, BA, A or B: rotary axes; ABC: the angles of a robot, Rz(A) Ry(B) Rx(C))"
        )
    if set(written) != set(axes.rotary):
        missing = sorted(set(axes.rotary) - set(written))
        what = (
            f"never writes {', '.join(missing)}, so where it points is not known"
            if missing
            else "writes more than that"
        )
        raise InputError(
            f"{found}, but {where} declares gcode: {{rotary: {axes.rotary}}}; the program {what}. Make the two agree"
        )
    unit = 1.0 if axes.unit == "deg" else float(np.degrees(1.0))
    return with_meaning(program, axes.convention(), np.full(len(written), unit))


def with_meaning(program: Program, convention: Convention, unit: Floats) -> Program:
    """The program with another meaning of its orientation words: a convention, and its units (K,) per unit of each token."""
    if convention == program.convention and np.array_equal(unit, program.unit[3:]):
        return program
    return replace(
        program,
        convention=convention,
        orientation=program.orientation * (unit / program.unit[3:]),
        unit=np.concatenate([program.unit[:3], unit]),
    )


def _turn(axis: int, angle: Floats) -> Floats:
    """Rotations (N, 3, 3) about x, y or z (0, 1, 2) by angles (N,), rad."""
    c, s = np.cos(angle), np.sin(angle)
    R = np.zeros((len(angle), 3, 3))
    i, j = (axis + 1) % 3, (axis + 2) % 3
    R[:, axis, axis] = 1.0
    R[:, i, i] = R[:, j, j] = c
    R[:, i, j], R[:, j, i] = -s, s
    return R
