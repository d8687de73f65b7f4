"""What is wrong with a force sensor: the controller pulls until the sensor reads what is stated, so the true load is another."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from . import rotations
from .beams import Array


@dataclass(frozen=True)
class SensorErrors:
    """Errors of the sensor that states the load.

    Attributes
    ----------
    bias_world, bias_tool
        (3,) N: what the sensor reads too little, fixed in the world's axes or in the flange's.
    turn_world, turn_tool
        (3,) rad: by which the true wrench is turned against the stated one, about fixed axes of the world or the flange.
    scale
        The true wrench over the stated one.
    """

    bias_world: Array = field(default_factory=lambda: np.zeros(3))
    bias_tool: Array = field(default_factory=lambda: np.zeros(3))
    turn_world: Array = field(default_factory=lambda: np.zeros(3))
    turn_tool: Array = field(default_factory=lambda: np.zeros(3))
    scale: float = 1.0

    def true_wrench(self, stated: Array, R: Array) -> Array:
        """The wrench (N, 6) that acts where `stated` (N, 6) is read and the flange stands at R (N, 3, 3).

        Where nothing is stated nothing is attached, and nothing acts.
        """
        attached = np.abs(stated).max(axis=1) > 0
        turned = R @ _turn(self.turn_tool) @ np.swapaxes(R, 1, 2) @ _turn(self.turn_world)
        out = self.scale * np.concatenate(
            [np.einsum("nij,nj->ni", turned, stated[:, :3]), np.einsum("nij,nj->ni", turned, stated[:, 3:])], axis=1
        )
        out[attached, :3] += self.bias_world + (R @ self.bias_tool)[attached]
        return np.asarray(out)


def _turn(vector: Array) -> Array:
    angle = float(np.linalg.norm(vector))
    axis = vector / angle if angle > 0 else np.array([1.0, 0.0, 0.0])
    return rotations.about_axis(axis, np.array([angle]))[0]
