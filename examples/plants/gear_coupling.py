"""Two neighbouring drives that share an elastic shaft."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from .beams import Array
from .course import Course


@dataclass(frozen=True)
class SharedShaft:
    """Joints `joint` and `joint + 1` turn a common shaft of `compliance` (by the first joint's unit) through the `ratio`.

    The shaft carries tau_i + ratio tau_j and stores compliance (tau_i + ratio tau_j)^2 / 2: both joints give, and each
    gives under the torque of the other.
    """

    joint: int
    compliance: float
    ratio: float

    def turn(self, torque: Array, q: Array, course: Course) -> Array:
        """See `physics.JointPhysics`."""
        out = np.zeros_like(torque)
        twist = self.compliance * (torque[self.joint] + self.ratio * torque[self.joint + 1])
        out[self.joint], out[self.joint + 1] = twist, self.ratio * twist
        return out
