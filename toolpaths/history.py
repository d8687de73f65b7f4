"""The order of a path, for what remembers: play and friction see the points of a program as one history.

Every corrected point is a load step, in the order in which the program runs. Where a cut ends and another begins - rows that
carry no force, or a start from elsewhere, lie between them - the tool is lifted off: two states without process force stand
in between, at the posture the cut ends in and at the one the next begins in. What the way between them does is not known.
Without process force (`Cases.unloaded`) the arm takes the same postures in the same order under its weight.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from drake_stiffness.effects.effect import Cases
from drake_stiffness.structure import Structure
from toolpaths.program import Program

Floats = NDArray[np.float64]
Ints = NDArray[np.int_]
Bools = NDArray[np.bool_]

# An effect that needs these to be seen in a campaign remembers.
_REMEMBERING = ("unloading", "time")


@dataclass(frozen=True, eq=False)
class PathOrder:
    """Where the states of a path's equilibria come from.

    Attributes
    ----------
    point : (S,)
        The path's point of every state, in the order in which they are met.
    loaded : (S,) bool
        Whether the process force acts; false where the tool is lifted off.
    """

    point: Ints
    loaded: Bools

    def cases(self, q: Floats, wrench: Floats, p_ET: Floats) -> Cases:
        """All states of the path as one history.

        Parameters
        ----------
        q, wrench : (n, N), (6, N)
            Joints and process wrench at the path's points.
        """
        S = self.point.size
        return Cases(
            q[:, self.point],
            wrench[:, self.point] * self.loaded,
            p_ET,
            np.zeros(S, dtype=int),
            np.arange(S),
            np.full(S, np.nan),
        )


def begins(program: Program, rows: Ints) -> Bools:
    """(N,) corrected rows at which a cut begins anew: the first, and those whose row before carries no force or is not near."""
    out = np.ones(rows.size, dtype=bool)
    out[1:] = (np.diff(rows) != 1) | ~program.follows[rows[1:]]
    return out


def path_order(begin: Bools) -> PathOrder:
    """The order of a path whose cuts begin where `begin (N,)` says."""
    N = begin.size
    lifts = np.flatnonzero(begin[1:]) + 1  # the tool lifts off after lifts - 1 and comes down at lifts
    point = np.concatenate([np.arange(N), lifts - 1, lifts])
    place = np.concatenate([np.arange(N, dtype=float), lifts - 0.7, lifts - 0.3])
    loaded = np.arange(point.size) < N
    order = np.argsort(place, kind="stable")
    return PathOrder(point[order], loaded[order])


def remembers(structure: Structure) -> bool:
    """Whether some effect depends on what came before: then a path cannot be cut into pieces."""
    return any(set(effect.needs) & set(_REMEMBERING) for effect, _ in structure.others)
