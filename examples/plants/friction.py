"""Friction that develops: a joint whose drive is held back by Dahl friction, followed along the load path.

Part of the joint's compliance lies behind a friction element. With the carried torque tau, the deflection x of that part, its
stiffness k and the friction force F,

    tau = k x + F,    dF / dx = sigma (1 - F / F_c sgn dx)^alpha

(Dahl 1968; alpha = 1 is LuGre without its rate terms). Every experiment starts with F = 0. Between two load steps the torque
goes one way, so that u = F sgn / F_c follows from the path's length without small increments: with s = sigma / k,

    d tau = k dx + dF    gives    u + H(u) / s = |tau - tau_0| / F_c + (the same at the start),    H(u) = int (1 - u)^-alpha du.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from .beams import Array
from .course import Course

_HALVINGS = 60


@dataclass(frozen=True)
class DahlFriction:
    """Friction in one joint.

    Attributes
    ----------
    joint
        Number of the joint.
    compliance
        1 / k, rad/(N m) or m/N: the part of the joint's compliance that lies behind the friction.
    breakaway
        F_c, N m or N.
    steepness
        s = sigma / k: how much stiffer that part is while the friction still develops.
    exponent
        alpha.
    """

    joint: int
    compliance: float
    breakaway: float
    steepness: float = 10.0
    exponent: float = 1.0

    def turn(self, torque: Array, q: Array, course: Course) -> Array:
        """See `physics.JointPhysics`: x - tau / k = -F / k, so what is left without friction is the linear spring."""
        out = np.zeros_like(torque)
        out[self.joint] = -self.compliance * self.force(torque[self.joint], course)
        return out

    def force(self, torque: Array, course: Course) -> Array:
        """Friction force (N,) at the end of every step."""
        force = np.zeros_like(torque)
        for before, now in course.rows():
            change = torque[now] - torque[before]
            direction = np.where(change < 0, -1.0, 1.0)
            u = direction * force[before] / self.breakaway
            path = np.abs(change) / self.breakaway + self._path(u)
            low, high = u, np.ones_like(u)
            for _ in range(_HALVINGS):
                middle = 0.5 * (low + high)
                short = self._path(middle) < path
                low, high = np.where(short, middle, low), np.where(short, high, middle)
            force[now] = direction * self.breakaway * low
        return force

    def _path(self, u: Array) -> Array:
        """u + H(u) / s; grows with u."""
        room = np.maximum(1.0 - u, 1e-15)
        power = 1.0 - self.exponent
        grown = -np.log(room) if power == 0.0 else (1.0 - room**power) / power
        return np.asarray(u + grown / self.steepness)
