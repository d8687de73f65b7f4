"""A gravity compensator on a plant: a spring between pins on the two links that a joint connects.

The plant pulls along the line between the two pins where they really are. Where the spring only stands for a stiffness that
varies with posture, that stiffness is the second derivative of its energy, taken by differences of distances between the pins.
Neither uses a formula for torque or stiffness.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from . import rotations
from .beams import Array
from .chain import RigidChain

if TYPE_CHECKING:
    from .deformation import Shape
    from .segments import Segments


@dataclass(frozen=True)
class PinSpring:
    """A linear spring across a revolute joint.

    Attributes
    ----------
    joint
        Number of the joint.
    before, after
        (3,) pins: on the link before the joint, in the joint's parent-side frame; on the link after it, in its child-side
        frame; m.
    stiffness, free_length
        N/m and m; pulled longer than `free_length` it pulls.
    """

    joint: int
    before: Array
    after: Array
    stiffness: float
    free_length: float

    def energy(self, chain: RigidChain, q: Array) -> Array:
        """Energy (N,) at angles q (N,) of its own joint, J: stiffness / 2 (distance of the pins - free length)^2."""
        turned = rotations.about_axis(chain.axes[self.joint], q) @ self.after
        distance = np.linalg.norm(turned - self.before, axis=1)
        return np.asarray(0.5 * self.stiffness * (distance - self.free_length) ** 2)

    def stiffness_about_joint(self, chain: RigidChain, q: Array) -> Array:
        """Second derivative of the energy (N,) over the joint's angle, N m/rad, by a difference of fourth order."""
        h = 1e-2
        e = [self.energy(chain, q + k * h) for k in (-2, -1, 0, 1, 2)]
        return np.asarray((-e[0] + 16 * e[1] - 30 * e[2] + 16 * e[3] - e[4]) / (12 * h * h))

    def pull(self, shape: Shape, segments: Segments, chain: RigidChain) -> tuple[tuple[int, Array, Array], ...]:
        """Where and how it pulls at N postures: per end the element's number, the pin (N, 3) and the force (N, 3), world, m and N.

        The first pin stands on the first element of the link before the joint, so its force passes through that link's beam;
        the second on the first element of the link after the joint.
        """
        k, pieces = self.joint, segments.masses.shape[1]
        in_link = chain.end_p[k] + chain.end_R[k] @ self.before
        ends = []
        for link, point in ((k, in_link), (k + 1, self.after)):
            local = segments.beam_R[link].T @ point - segments.centers[link, 0]
            ends.append(shape.mass_p[link, 0] + shape.node_R[link, 0] @ local)
        line = ends[1] - ends[0]
        length = np.linalg.norm(line, axis=1, keepdims=True)
        force = self.stiffness * (length - self.free_length) * line / length
        return (k * pieces, ends[0], force), ((k + 1) * pieces, ends[1], -force)
