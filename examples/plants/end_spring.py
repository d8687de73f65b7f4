"""A 6x6 spring at the end of a link: what identified models put there, as a further deflection of the last element."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from .beams import Array
from .course import Course


@dataclass(frozen=True)
class EndSpring:
    """Deflects by `compliance` (6, 6) times what the link's end carries, both in the frame of the end.

    `end_R` (3, 3) is that frame in the link's beam frame.
    """

    link: int
    compliance: Array
    end_R: Array

    def bend(self, wrench: Array, q: Array, course: Course) -> Array:
        """See `physics.LinkPhysics`."""
        out = np.zeros_like(wrench)
        into_end = np.kron(np.eye(2), self.end_R.T)
        out[self.link, -1] = wrench[self.link, -1] @ (into_end.T @ self.compliance @ into_end).T
        return out
