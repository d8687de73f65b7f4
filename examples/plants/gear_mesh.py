"""Gears: teeth with play, a mesh whose stiffness varies with the angle, and an angle that is not transmitted truly."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from .beams import Array
from .course import Course


@dataclass(frozen=True)
class Backlash:
    """Contact with a dead band of full width `width` (rad or m).

    Inside the band only drag holds the joint: the gap is crossed as the torque goes from -drag to +drag. Outside, the teeth
    indent like curved bodies do (Hertz), by `indentation` of the width at the torque `reference`.
    """

    joint: int
    width: float
    drag: float
    indentation: float
    reference: float

    def turn(self, torque: Array, q: Array, course: Course) -> Array:
        """See `physics.JointPhysics`."""
        out = np.zeros_like(torque)
        tau = torque[self.joint]
        across = 0.5 * np.clip(tau / self.drag, -1.0, 1.0)
        beyond = np.maximum(np.abs(tau) - self.drag, 0.0) / self.reference
        out[self.joint] = self.width * (across + np.sign(tau) * self.indentation * beyond ** (2.0 / 3.0))
        return out


@dataclass(frozen=True)
class MeshStiffness:
    """A stiffness that varies over the teeth: 1 / C (1 + depth cos(harmonic q + phase)), part of a joint of compliance C.

    The angle is that of the loaded gear. `harmonic` counts periods a turn (a metre for a slide).
    """

    joint: int
    compliance: float
    depth: float
    harmonic: float
    phase: float
    prismatic: bool = False

    def turn(self, torque: Array, q: Array, course: Course) -> Array:
        """See `physics.JointPhysics`."""
        out = np.zeros_like(torque)
        tau = torque[self.joint]
        cycle = 2 * np.pi if self.prismatic else 1.0
        angle = q[:, self.joint] + self.compliance * tau
        wave = self.depth * np.cos(self.harmonic * cycle * angle + self.phase)
        out[self.joint] = self.compliance * tau * (1.0 / (1.0 + wave) - 1.0)
        return out


@dataclass(frozen=True)
class TransmissionError:
    """The joint stands beside the commanded angle: amplitude (sin(N q + phase) + overtone sin(2 N q + 2 phase))."""

    joint: int
    amplitude: float
    harmonic: float
    phase: float
    overtone: float = 0.1
    prismatic: bool = False

    def turn(self, torque: Array, q: Array, course: Course) -> Array:
        """See `physics.JointPhysics`."""
        out = np.zeros_like(torque)
        angle = self.harmonic * q[:, self.joint] * (2 * np.pi if self.prismatic else 1.0) + self.phase
        out[self.joint] = self.amplitude * (np.sin(angle) + self.overtone * np.sin(2 * angle))
        return out
