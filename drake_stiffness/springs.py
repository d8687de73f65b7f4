"""Six-by-six compliance templates of a link: which entries are unknowns, what they are called, where the cone acts.

A link's spring maps the wrench it carries, `(fx, fy, fz, mx, my, mz)`, to its deflection `(dx, dy, dz, rx, ry, rz)` by a
compliance matrix `k`. How many of its 36 entries are independent unknowns is the template:

- `full`: all 36, as the seed's first model has it; not a physical matrix unless it happens to be symmetric;
- `symmetric`: the 21 that remain after M1 (seed eq. 21);
- `beam`: the 8 that remain after M2 for a prismatic beam (seed eq. 24), written for a long axis x and permuted cyclically
  to y or z;
- a mask: the entries of the upper triangle that somebody lists, the rest zero. What a reduction (M3) leaves is one.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from functools import lru_cache
from typing import Literal

import numpy as np
from numpy.typing import NDArray

Template = Literal["full", "symmetric", "beam"]
TEMPLATES: tuple[Template, ...] = ("full", "symmetric", "beam")
COMPONENTS = ("dx", "dy", "dz", "rx", "ry", "rz")

# Seed eq. (24): upper-triangle entries of a beam along x, zero-based.
_BEAM_X = ((0, 0), (1, 1), (2, 2), (3, 3), (4, 4), (5, 5), (1, 5), (2, 4))


@dataclass(frozen=True)
class SpringTemplate:
    """The unknowns of one 6x6 compliance matrix.

    Attributes
    ----------
    entries : tuple of (row, column)
        Zero-based position of every unknown; for symmetric templates `row <= column` and the unknown stands at both
        places (the matrices omega of seed eq. 23 have their ones at ij *and* ji).
    symmetric : bool
        Whether the matrix is symmetric by construction.
    """

    entries: tuple[tuple[int, int], ...]
    symmetric: bool

    @property
    def names(self) -> tuple[str, ...]:
        """`k11` ... `k66`, one-based as in the seed."""
        return tuple(f"k{i + 1}{j + 1}" for i, j in self.entries)

    @property
    def units(self) -> tuple[str, ...]:
        """SI unit of every unknown: m/N, m/(N m) = rad/N, rad/(N m)."""
        return tuple(_UNITS[(i >= 3) + (j >= 3)] for i, j in self.entries)

    @property
    def basis(self) -> NDArray[np.float64]:
        """The binary matrices omega of seed eq. (23), shape (unknowns, 6, 6)."""
        omega = np.zeros((len(self.entries), 6, 6))
        for number, (i, j) in enumerate(self.entries):
            omega[number, i, j] = 1.0
            if self.symmetric:
                omega[number, j, i] = 1.0
        return omega

    def matrix(self, values: NDArray[np.float64]) -> NDArray[np.float64]:
        """The 6x6 compliance matrix that has these values."""
        return np.einsum("l,lij->ij", values, self.basis)

    def values(self, matrix: NDArray[np.float64]) -> NDArray[np.float64]:
        """The unknowns read off a 6x6 matrix (entries outside the template are not looked at)."""
        return np.array([matrix[i, j] for i, j in self.entries])

    @property
    def cone_blocks(self) -> tuple[NDArray[np.int_], ...]:
        """Which unknowns form the positive-semidefinite blocks.

        A sparse symmetric matrix is positive semidefinite exactly when each connected block of its pattern is, so a beam
        needs two 1x1 and two 2x2 cones instead of one 6x6. Each block is a square array of numbers of unknowns; -1 marks
        a structural zero. Empty for the `full` template, for which no cone exists.
        """
        if not self.symmetric:
            return ()
        number = -np.ones((6, 6), dtype=int)
        for unknown, (i, j) in enumerate(self.entries):
            number[i, j] = number[j, i] = unknown
        blocks, seen = [], set()
        for start in range(6):
            if start in seen or (number[start] < 0).all():
                continue
            members, frontier = {start}, [start]
            while frontier:
                here = frontier.pop()
                for there in map(int, np.flatnonzero(number[here] >= 0)):
                    if there not in members:
                        members.add(there)
                        frontier.append(there)
            seen |= members
            order = sorted(members)
            blocks.append(number[np.ix_(order, order)])
        return tuple(blocks)

    @property
    def unsupported(self) -> tuple[str, ...]:
        """Diagonal entries that a positive-semidefinite matrix of this pattern needs and has not.

        A zero on the diagonal of such a matrix makes its whole row and column zero, so an off-diagonal unknown without both
        its diagonal ones could only be zero. Empty for every named template; a mask may have some.
        """
        if not self.symmetric:
            return ()
        own = {i for i, j in self.entries if i == j}
        lacking = sorted({d for i, j in self.entries if i != j for d in (i, j)} - own)
        return tuple(f"k{d + 1}{d + 1}" for d in lacking)


_UNITS = ("m/N", "rad/N", "rad/(N m)")


@lru_cache
def spring_template(template: Template, beam_axis: str = "x") -> SpringTemplate:
    """The template of that name; `beam_axis` ('x', 'y' or 'z') matters for `beam` only.

    Raises
    ------
    ValueError
        If the template or the axis is unknown.
    """
    if template == "full":
        return SpringTemplate(tuple((i, j) for i in range(6) for j in range(6)), symmetric=False)
    if template == "symmetric":
        return SpringTemplate(tuple((i, j) for i in range(6) for j in range(i, 6)), symmetric=True)
    if template == "beam":
        shift = "xyz".index(beam_axis)

        def turn(i: int) -> int:
            return (i % 3 + shift) % 3 + 3 * (i // 3)

        pairs = sorted((min(turn(i), turn(j)), max(turn(i), turn(j))) for i, j in _BEAM_X)
        return SpringTemplate(tuple(pairs), symmetric=True)
    raise ValueError(f"unknown spring template {template!r}; expected one of {', '.join(TEMPLATES)}")


@lru_cache
def masked_template(names: tuple[str, ...]) -> SpringTemplate:
    """A symmetric template that has the named entries only, in row-major order.

    Parameters
    ----------
    names : tuple of str
        Entries as `mask_entries` hands them back.
    """
    return SpringTemplate(tuple((int(name[1]) - 1, int(name[2]) - 1) for name in mask_entries(names)), symmetric=True)


def mask_entries(names: Iterable[str]) -> tuple[str, ...]:
    """Entries of the upper triangle in row-major order; `k62` is `k26`.

    Raises
    ------
    ValueError
        If a name is none of k11 .. k66, stands twice, or nothing is named.
    """
    known = {f"k{i}{j}": f"k{min(i, j)}{max(i, j)}" for i in range(1, 7) for j in range(1, 7)}
    found: list[str] = []
    for name in names:
        if name not in known:
            raise ValueError(
                f"found '{name}'; expected entries of the 6x6 compliance matrix, k11 .. k66 (1 to 3 translations, 4 to 6 "
                "rotations of the spring frame)"
            )
        if known[name] in found:
            raise ValueError(f"'{name}' stands twice (the matrix is symmetric: k26 and k62 are one unknown)")
        found.append(known[name])
    if not found:
        raise ValueError("found no entry; expected at least one of k11 .. k66, or leave the link out of springs.links")
    return tuple(sorted(found))


def symmetrisation_map() -> NDArray[np.float64]:
    """The binary map of M1 (seed eq. 21), shape (36, 21): all entries from the symmetric ones, row-major."""
    return spring_template("symmetric").basis.reshape(21, 36).T


def sparsing_map(beam_axis: str = "x") -> NDArray[np.float64]:
    """The binary map of M2 (seed eq. 24), shape (21, 8): the symmetric entries from those a beam keeps."""
    symmetric, beam = spring_template("symmetric").entries, spring_template("beam", beam_axis).entries
    return np.array([[float(entry == kept) for kept in beam] for entry in symmetric])


def parameter_counts(joints: int) -> dict[str, int]:
    """Unknowns of the complete model of an arm with that many joints: (joints + 1) links and every joint spring.

    For six joints 258 (full), 153 (after M1) and 62 (after M2); the seventh link is the base.
    """
    links = joints + 1
    sizes = {"complete": 36, "symmetric": 21, "beam": 8}
    return {name: links * size + joints for name, size in sizes.items()}
