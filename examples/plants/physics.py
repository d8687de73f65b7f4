"""What physics to hide in an arm has to offer: further deflections of joints or beams, or forces on links."""

from __future__ import annotations

from typing import TYPE_CHECKING, Protocol

from .beams import Array
from .chain import RigidChain
from .course import Course

if TYPE_CHECKING:
    from .deformation import Shape
    from .segments import Segments


class JointPhysics(Protocol):
    """Deflection of joints beyond their linear springs."""

    def turn(self, torque: Array, q: Array, course: Course) -> Array:
        """Further deflection (n, N) of the joints that carry `torque` (n, N) at commanded q (N, n), rad or m."""
        ...


class LinkPhysics(Protocol):
    """Deflection of beam elements beyond their linear compliance."""

    def bend(self, wrench: Array, q: Array, course: Course) -> Array:
        """Further deflection (L, S, N, 6) of the elements that carry `wrench` (L, S, N, 6), m and rad."""
        ...


class Pull(Protocol):
    """Forces on links that follow the deformed arm."""

    def pull(self, shape: Shape, segments: Segments, chain: RigidChain) -> tuple[tuple[int, Array, Array], ...]:
        """Per force: the number of the element it acts on, where (N, 3), and the force (N, 3), world, m and N."""
        ...
