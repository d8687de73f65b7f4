"""Creep: a joint that goes on giving while it is loaded, and comes back slowly."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from .beams import Array
from .course import Course


@dataclass(frozen=True)
class Creep:
    """A Kelvin element: c' = (compliance tau - c) / relaxation, under the torque each step holds from its beginning on.

    Every experiment starts at rest under its first step (the arm has stood there long enough).
    """

    joint: int
    compliance: float
    relaxation_s: float

    def turn(self, torque: Array, q: Array, course: Course) -> Array:
        """See `physics.JointPhysics`."""
        out = np.zeros_like(torque)
        wanted = self.compliance * torque[self.joint]
        state = wanted[course.first()]
        for before, now in course.rows():
            # A reading is taken at the end of its step, as long after the step before as their times say.
            held = course.time_s[now] - course.time_s[before]
            state[now] = wanted[now] + (state[before] - wanted[now]) * np.exp(-held / self.relaxation_s)
        out[self.joint] = state
        return out
