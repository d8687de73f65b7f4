"""A link that warms up: it grows, and bows because one side is warmer than the other."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from .beams import Array
from .course import Course


@dataclass(frozen=True)
class WarmLink:
    """Every element of a link grows by `growth` (m) and turns about its y by `bow` (rad) when fully warm.

    Warmth rises as 1 - exp(-t / warming) from the campaign's first moment.
    """

    link: int
    growth: float
    bow: float
    warming_s: float

    def bend(self, wrench: Array, q: Array, course: Course) -> Array:
        """See `physics.LinkPhysics`."""
        out = np.zeros_like(wrench)
        warmth = 1.0 - np.exp(-course.time_s / self.warming_s)
        out[self.link, :, :, 0] = self.growth * warmth
        out[self.link, :, :, 4] = self.bow * warmth
        return out
