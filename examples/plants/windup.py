"""Springs that harden: a gear that winds up softly at first, and curved bodies in contact."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from .beams import Array
from .course import Course


@dataclass(frozen=True)
class SoftStart:
    """Two slopes, as makers of strain-wave gears state them: up to the torque `knee` the joint gives `compliance` more.

    Half the knee wide the slope goes over (a smooth corner), since many teeth do not engage at one torque.
    """

    joint: int
    compliance: float
    knee: float

    def turn(self, torque: Array, q: Array, course: Course) -> Array:
        """See `physics.JointPhysics`: compliance times the torque, levelling off at the knee."""
        out = np.zeros_like(torque)
        tau = np.abs(torque[self.joint])
        width = 0.25 * self.knee
        # Smooth min(tau, knee), zero at zero.
        soft = -width * (np.logaddexp(-tau / width, -self.knee / width) - np.log1p(np.exp(-self.knee / width)))
        out[self.joint] = np.sign(torque[self.joint]) * self.compliance * soft
        return out


@dataclass(frozen=True)
class HertzContact:
    """Bearings and teeth that indent with the power 2/3 of the load: `indentation` (rad or m) at the torque `reference`."""

    joint: int
    indentation: float
    reference: float

    def turn(self, torque: Array, q: Array, course: Course) -> Array:
        """See `physics.JointPhysics`; below a hundredth of the reference the slope stays finite."""
        out = np.zeros_like(torque)
        ratio = torque[self.joint] / self.reference
        out[self.joint] = self.indentation * ratio * (ratio**2 + 1e-4) ** (-1.0 / 6.0)
        return out
