"""A dress pack: a hose package between two links that pulls as it is stretched and turned by the wrist."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from .beams import Array
from .chain import RigidChain

if TYPE_CHECKING:
    from .deformation import Shape
    from .segments import Segments


@dataclass(frozen=True)
class DressPack:
    """A hose from link `first` to the last link; it pulls with `tension` (N) times (its length / `length`)^2.

    Attributes
    ----------
    first
        Number of the link where it is clamped.
    clamp, end
        (3,) on that link's first element and on the last link's, from the element's centre of mass, element's axes, m.
    tension, length
        N and m.
    """

    first: int
    clamp: Array
    end: Array
    tension: float
    length: float

    def pull(self, shape: Shape, segments: Segments, chain: RigidChain) -> tuple[tuple[int, Array, Array], ...]:
        """See `physics.Pull`."""
        last, pieces = chain.size, segments.masses.shape[1]
        ends = [shape.mass_p[k, 0] + shape.node_R[k, 0] @ at for k, at in ((self.first, self.clamp), (last, self.end))]
        line = ends[1] - ends[0]
        distance = np.linalg.norm(line, axis=1, keepdims=True)
        force = self.tension * (distance / self.length) ** 2 * line / distance
        return (self.first * pieces, ends[0], force), (last * pieces, ends[1], -force)
