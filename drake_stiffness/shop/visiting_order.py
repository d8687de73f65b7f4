"""In which order a plan's experiments are driven: short travel, random in time, or as planned.

A short tour wears the robot and the day least, but it drives neighbouring postures one after the other: what drifts
in time (temperature, the tracker's stand) then looks like something that varies over the workspace. A random order
keeps the two apart and costs travel. Experiments that repeat a posture are kept apart in every order but the planned
one, because an arm that is not driven away and back shows nothing of its repeatability.
"""

from __future__ import annotations

from typing import Literal

import numpy as np
from numpy.typing import NDArray

from drake_stiffness.campaign import Measurements
from drake_stiffness.hold_out import posture_groups
from drake_stiffness.rotations import Array

Order = Literal["plan", "short", "random"]

# What a metre along a prismatic joint counts as, rad: a track takes as long for it as an axis for 60 degrees.
_RAD_PER_M = 1.0
_SHUFFLES = 200


def visiting_order(m: Measurements, prismatic: tuple[bool, ...], order: Order, seed: int = 0) -> NDArray[np.int_]:
    """The numbers of the experiments in the order they are driven.

    Parameters
    ----------
    order : 'plan', 'short' or 'random'
        `plan`: by `time_s` where every experiment has one, else as the rows stand. `short`: a tour of short travel
        through the distinct postures, then back through those that are repeated. `random`: drawn with `seed`.
    """
    q = postures(m)
    if order == "plan":
        _, first = np.unique(m.cases.experiment, return_index=True)
        time = m.cases.time_s[first]
        return np.arange(len(q)) if np.isnan(time).any() else np.argsort(time, kind="stable")
    group = posture_groups(m.cases)
    if order == "random":
        return _random(group, np.random.default_rng(seed))
    # The k-th visit of every posture makes the k-th round.
    visit = np.array([np.count_nonzero(group[:e] == group[e]) for e in range(len(q))])
    tour: list[int] = []
    for turn in range(int(visit.max()) + 1):
        tour += _tour(q, np.flatnonzero(visit == turn), prismatic, tour[-1] if tour else None)
    return np.array(tour)


def postures(m: Measurements) -> Array:
    """(experiments, n) commanded joints, rad or m."""
    _, first = np.unique(m.cases.experiment, return_index=True)
    return m.cases.q[:, first].T


def travel(q: Array, prismatic: tuple[bool, ...]) -> Array:
    """(len(q), len(q)) how far apart postures are: the way of the axis that moves most."""
    scaled = q * np.where(prismatic, _RAD_PER_M, 1.0)
    return np.abs(scaled[:, None] - scaled[None]).max(axis=2)


def total_travel(m: Measurements, prismatic: tuple[bool, ...], order: NDArray[np.int_]) -> float:
    """Travel of a whole tour, rad of the axis that moves most in every motion."""
    apart = travel(postures(m), prismatic)
    return float(apart[order[:-1], order[1:]].sum())


def _random(group: NDArray[np.int_], rng: np.random.Generator) -> NDArray[np.int_]:
    """A random order with, as far as a few hundred draws find one, no posture twice in a row."""
    drawn = [rng.permutation(group.size) for _ in range(_SHUFFLES)]
    return min(drawn, key=lambda order: np.count_nonzero(np.diff(group[order]) == 0))


def _tour(q: Array, members: NDArray[np.int_], prismatic: tuple[bool, ...], start: int | None) -> list[int]:
    """Nearest neighbour, then stretches turned round while that shortens the way (2-opt on an open tour)."""
    apart = travel(q, prismatic)
    left = [int(e) for e in members]
    if start is None:
        tour = [left.pop(0)]
    else:  # the round begins away from where the last one ended, else the arm would not move
        far = max(left, key=lambda e: apart[start, e]) if len(left) > 1 else left[0]
        left.remove(far)
        tour = [far]
    while left:
        nearest = min(left, key=lambda e: apart[tour[-1], e])
        left.remove(nearest)
        tour.append(nearest)
    improved = True
    while improved:
        improved = False
        for i in range(1, len(tour) - 1):
            for j in range(i + 1, len(tour)):
                after = tour[j + 1] if j + 1 < len(tour) else None
                before = apart[tour[i - 1], tour[i]] + (0.0 if after is None else apart[tour[j], after])
                then = apart[tour[i - 1], tour[j]] + (0.0 if after is None else apart[tour[i], after])
                if then < before - 1e-12:
                    tour[i : j + 1] = tour[i : j + 1][::-1]
                    improved = True
    return tour
