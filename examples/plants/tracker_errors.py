"""What is wrong with a tracker: it stands elsewhere than thought, its scale is off, and it wanders while it warms up."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from . import rotations
from .beams import Array


@dataclass(frozen=True)
class TrackerErrors:
    """Errors of the instrument.

    Attributes
    ----------
    shift, turn
        (3,) m and (3,) rad: where the tracker's frame stands in the world.
    drift
        (3,) m: how far readings wander from the first moment to the campaign's end.
    bend
        How much of the drift's course is curved: t (1 + bend (1 - t)) over the campaign's time, t from 0 to 1.
    scale
        Lengths read over true lengths, from the world's origin.
    """

    shift: Array = field(default_factory=lambda: np.zeros(3))
    turn: Array = field(default_factory=lambda: np.zeros(3))
    drift: Array = field(default_factory=lambda: np.zeros(3))
    bend: float = 0.15
    scale: float = 1.0

    def read(self, points: Array, time_s: Array) -> Array:
        """What it reads of world positions (N, P, 3) at times (N,)."""
        angle = float(np.linalg.norm(self.turn))
        axis = self.turn / angle if angle > 0 else np.array([1.0, 0.0, 0.0])
        R = rotations.about_axis(axis, np.array([angle]))[0]
        seen = self.scale * (points - self.shift) @ R
        span = float(np.ptp(time_s))
        passed = (time_s - time_s.min()) / span if span > 0 else np.zeros_like(time_s)
        return np.asarray(seen + (passed * (1.0 + self.bend * (1.0 - passed)))[:, None, None] * self.drift)
