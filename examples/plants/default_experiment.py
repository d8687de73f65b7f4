"""The default experiment: every posture loaded and unloaded in three directions, three levels, and by one torque.

Steps of a posture: unloaded; per direction a third, two thirds, the whole, half of the load, unloaded; one torque; unloaded.
The first direction is down, the others are level and cross each other; their signs differ from posture to posture. Postures
are visited in random order.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from .beams import Array
from .chain import RigidChain
from .course import Course
from .postures import spread_postures

LEVELS = (1 / 3, 2 / 3, 1.0, 0.5, 0.0)
STEP_S = 25.0
BETWEEN_S = 600.0


@dataclass(frozen=True)
class Room:
    """Where an arm may stand and how hard it is pulled.

    Attributes
    ----------
    lower_deg, upper_deg
        (n,) ranges of the joints, deg or mm.
    load_point
        (3,) flange frame, m.
    force, torque
        Largest load, N and N m.
    accept
        Which positions of load point and flange, (M, 3) each, are reachable without harm, (M,).
    """

    lower_deg: Array
    upper_deg: Array
    load_point: Array
    force: float
    torque: float
    accept: Callable[[Array, Array], Array]


@dataclass(frozen=True)
class Experiment:
    """What is done: N = E S cases of E postures and S steps.

    Attributes
    ----------
    q_printed
        (N, n) deg or mm.
    q, wrench
        (N, n) rad or m, and (N, 6) N and N m as stated.
    course
        When.
    """

    q_printed: Array
    q: Array
    wrench: Array
    course: Course


def default_experiment(chain: RigidChain, room: Room, count: int, rng: np.random.Generator) -> Experiment:
    """Draw `count` postures and arrange the default experiment."""
    unit = np.where(chain.prismatic, 1e-3, np.deg2rad(1.0))

    def accept(q: Array) -> Array:
        R, p = chain.flange(q)
        return np.asarray(room.accept(p + R @ room.load_point, p))

    drawn = spread_postures(room.lower_deg * unit, room.upper_deg * unit, count, rng, accept)
    printed = np.round(drawn / unit, 4)
    steps = np.array([_steps(room, rng) for _ in range(count)])
    size = steps.shape[1]
    start = BETWEEN_S * rng.permutation(count)
    course = Course(
        np.repeat(np.arange(count), size),
        np.tile(np.arange(size), count),
        np.repeat(start, size) + np.tile(STEP_S * np.arange(size), count),
    )
    q_printed = np.repeat(printed, size, axis=0)
    return Experiment(q_printed, q_printed * unit, np.round(steps.reshape(-1, 6), 3), course)


def _steps(room: Room, rng: np.random.Generator) -> Array:
    """Wrenches (18, 6) of one posture."""
    towards = rng.uniform(0.0, 2 * np.pi)
    side = np.array([np.cos(towards), np.sin(towards), 0.0])
    across = np.array([-side[1], side[0], 0.0]) * rng.choice([-1.0, 1.0])
    rows = [np.zeros(6)]
    for direction in (np.array([0.0, 0.0, -1.0]), 0.8 * side, 0.8 * across):
        rows += [np.concatenate([level * room.force * direction, np.zeros(3)]) for level in LEVELS]
    twist = rng.normal(size=3)
    rows += [np.concatenate([np.zeros(3), room.torque * twist / np.linalg.norm(twist)]), np.zeros(6)]
    return np.array(rows)
