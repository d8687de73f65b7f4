"""What goes wrong once: a reflector that is bumped, a posture or a load that is not the one written down."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from .beams import Array
from .course import Course


@dataclass(frozen=True)
class Bump:
    """All reflectors read wrongly by `shift` (m) in one step: somebody leant on the tool."""

    experiment: int
    step: int
    shift: Array

    def on_readings(self, readings: Array, course: Course) -> Array:
        """Readings (N, P, 3), m."""
        out = readings.copy()
        out[(course.experiment == self.experiment) & (course.step == self.step)] += self.shift
        return out


@dataclass(frozen=True)
class WrongPosture:
    """One experiment was done at joints that are off by `error` (n,), rad or m."""

    experiment: int
    error: Array

    def on_posture(self, q: Array, course: Course) -> Array:
        """Commanded joints (N, n)."""
        return np.where((course.experiment == self.experiment)[:, None], q + self.error, q)


@dataclass(frozen=True)
class WrongLoad:
    """In one experiment the load was `factor` times the stated one."""

    experiment: int
    factor: float

    def on_wrench(self, wrench: Array, course: Course) -> Array:
        """Stated wrenches (N, 6)."""
        return np.where((course.experiment == self.experiment)[:, None], self.factor * wrench, wrench)


Mishap = Bump | WrongPosture | WrongLoad
