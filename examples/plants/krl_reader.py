"""A small reader of KRL motion lines by regular expression: poses out, poses in. Independent of `toolpaths` on purpose.

It knows `PTP`, `LIN` and `CIRC` (and their S... spline forms) with literal poses in braces, comments from `;` to the
end of the line, and that a component which is not written keeps its last value. Programs are text in which every byte
is one character.
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from . import rotations
from .beams import Array

WORDS = ("X", "Y", "Z", "A", "B", "C")
_MOTION = re.compile(r"^[ \t]*(S?PTP|S?LIN|S?CIRC)\b([^;\r\n]*)", re.MULTILINE | re.IGNORECASE)
_BRACES = re.compile(r"\{([^{}]*)\}")
_WORD = re.compile(r"\b([A-Z]+[0-9]*)([ \t]+)([-+]?(?:[0-9]+\.?[0-9]*|\.[0-9]+)(?:E[-+]?[0-9]+)?)", re.IGNORECASE)


@dataclass(frozen=True)
class Program:
    """The Cartesian poses of a program in the order they stand.

    Attributes
    ----------
    text
        The whole program.
    kinds
        Per pose the motion word, upper case; a CIRC gives two poses.
    poses
        (N, 6): X, Y, Z in mm and A, B, C in deg, in the program's base.
    spans
        Per pose, where its braces' content starts and ends in the text.
    """

    text: str
    kinds: tuple[str, ...]
    poses: Array
    spans: tuple[tuple[int, int], ...]

    @property
    def cutting(self) -> Array:
        """(N,) boolean: linear and circular poses; only these carry the process force."""
        return np.array(["PTP" not in kind for kind in self.kinds], dtype=bool)


def read_program(path: str | Path) -> Program:
    """Read a program file; bytes that are not ASCII are kept as they are."""
    return parse_program(Path(path).read_bytes().decode("latin-1"))


def parse_program(text: str) -> Program:
    """Collect the Cartesian poses of a program; joint poses ({A1 .., A2 ..}) are passed over."""
    kinds: list[str] = []
    poses: list[list[float]] = []
    spans: list[tuple[int, int]] = []
    state = dict.fromkeys(WORDS, 0.0)
    for motion in _MOTION.finditer(text):
        for braces in _BRACES.finditer(text, motion.start(2), motion.end(2)):
            words = {word[1].upper(): float(word[3]) for word in _WORD.finditer(braces[1])}
            if not any(name in words for name in WORDS):
                continue
            state.update({name: value for name, value in words.items() if name in state})
            kinds.append(motion[1].upper())
            poses.append([state[name] for name in WORDS])
            spans.append(braces.span(1))
    return Program(text, tuple(kinds), np.array(poses).reshape(-1, 6), tuple(spans))


def with_poses(program: Program, poses: Array, *, decimals: int = 3) -> str:
    """The program's text with new numbers for the words X .. C of its linear and circular poses, `decimals` printed."""
    text, pieces, done = program.text, [], 0
    for (start, end), moves, pose in zip(program.spans, program.cutting, poses, strict=True):
        if not moves:
            continue
        values = dict(zip(WORDS, pose, strict=True))

        def printed(word: re.Match[str], values: dict[str, float] = values) -> str:
            name = word[1].upper()
            return f"{word[1]}{word[2]}{values[name]:.{decimals}f}" if name in values else word[0]

        pieces += [text[done:start], _WORD.sub(printed, text[start:end])]
        done = end
    return "".join([*pieces, text[done:]])


def to_frames(poses: Array) -> tuple[Array, Array]:
    """(N, 6) poses in mm and deg -> R (N, 3, 3) = Rz(A) Ry(B) Rx(C) and p (N, 3) in m."""
    return rotations.from_zyx(np.deg2rad(poses[:, 3:])), poses[:, :3] * 1e-3


def from_frames(R: Array, p: Array, near: Array) -> Array:
    """R (N, 3, 3), p (N, 3) in m -> (N, 6) in mm and deg, every angle within half a turn of its value in `near` (N, 6).

    The other solution of the three angles, (A + 180, 180 - B, C + 180), is taken where it lies nearer.
    """
    first = np.rad2deg(rotations.to_zyx(R))
    other = first * [1.0, -1.0, 1.0] + 180.0
    nearest = [angles + 360.0 * np.round((near[:, 3:] - angles) / 360.0) for angles in (first, other)]
    distance = [np.abs(angles - near[:, 3:]).sum(axis=1) for angles in nearest]
    chosen = np.where((distance[0] <= distance[1])[:, None], nearest[0], nearest[1])
    return np.concatenate([p * 1e3, chosen], axis=1)


def read_axes(text: str) -> list[dict[str, float]]:
    """The joint targets of a program in the order they stand: A1 .. A6 in deg, E1 .. E6 in deg or mm, as printed."""
    found = []
    for motion in _MOTION.finditer(text):
        for braces in _BRACES.finditer(text, motion.start(2), motion.end(2)):
            words = {word[1].upper(): float(word[3]) for word in _WORD.finditer(braces[1])}
            if any(name in words for name in ("A1", "A2", "A3", "A4", "A5", "A6")):
                found.append(words)
    return found
