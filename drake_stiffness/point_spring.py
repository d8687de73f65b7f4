"""A spring between two points of an arm, as a plant takes it."""

from __future__ import annotations

from dataclasses import dataclass

from drake_stiffness.rotations import Array


@dataclass(frozen=True, eq=False)
class PointSpring:
    """A spring across a joint of the arm, from a point before it to a point after it.

    Attributes
    ----------
    joint : str
    p_FA, p_MB : (3,)
        Its ends, in the joint's parent-side and child-side frame, m.
    stiffness : float
        N/m, positive.
    free_length : float
        m, positive.
    """

    joint: str
    p_FA: Array
    p_MB: Array
    stiffness: float
    free_length: float
