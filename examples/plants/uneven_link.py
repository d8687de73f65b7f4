"""A link that bends more in one direction than in the other: a flange joint that opens on one side."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from .beams import Array
from .course import Course


@dataclass(frozen=True)
class OpeningJoint:
    """At the root of a link's beam a bolted joint opens under a positive moment about `axis` (4: y, 5: z of the beam).

    It then turns by `compliance` (rad/(N m)) times the moment beyond `preload` (N m).
    """

    link: int
    axis: int
    compliance: float
    preload: float = 0.0

    def bend(self, wrench: Array, q: Array, course: Course) -> Array:
        """See `physics.LinkPhysics`."""
        out = np.zeros_like(wrench)
        beyond = np.maximum(wrench[self.link, 0, :, self.axis] - self.preload, 0.0)
        out[self.link, 0, :, self.axis] = self.compliance * beyond
        return out
