"""Milling by brute force in time: every tooth on its true path, the chip between it and what the tooth before has left.

A tooth of an edge disc of radius r follows x = v t + r sin(theta), y = r cos(theta), theta growing clockwise (seen from the spindle, x
along the feed, y to its left, z to the spindle). Along the ray from the axis through the tooth, the surface is where the tooth before
crossed that ray: the chip is what lies between. Material is a wall in y; there is no closed form and no averaging in here.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from .beams import Array


@dataclass(frozen=True)
class TurningCutter:
    """A cutter with a spherical corner (none: a cylinder; all of it: a ball), SI.

    Attributes
    ----------
    radius, corner, teeth, helix
        m, m, number, rad.
    per_area, per_length
        Tangential, radial, axial force per chip area (Pa) and per length of edge (N/m).
    """

    radius: float
    corner: float
    teeth: int
    helix: float
    per_area: tuple[float, float, float]
    per_length: tuple[float, float, float]

    def discs(self, depth: float, number: int) -> tuple[Array, Array, Array, Array]:
        """Radius, height, slope (angle of the profile's normal from the axis, tip side) and edge length of thin discs."""
        low, high = np.linspace(0, depth, number + 1)[:-1], np.linspace(0, depth, number + 1)[1:]

        def polar(z: Array) -> Array:
            return (
                np.arccos(1 - np.minimum(z, self.corner) / self.corner) if self.corner else np.full(z.shape, np.pi / 2)
            )

        on_corner = self.corner * (polar(high) - polar(low)) if self.corner else 0 * low
        length = on_corner + np.maximum(high - np.maximum(low, self.corner), 0)
        slope = np.where(low < self.corner, 0.5 * (polar(low) + polar(high)), np.pi / 2)
        r = self.radius - self.corner + self.corner * np.sin(slope)
        return r, 0.5 * (low + high), slope, length

    def forces(
        self, depth: float, wall: tuple[float, float], feed_per_tooth: float, angles: Array, number: int = 120
    ) -> Array:
        """Force on the tool and torque about its axis (A, 4) at angles of rotation, all teeth and discs summed.

        Parameters
        ----------
        wall
            The material fills wall[0] < y < wall[1], m (y to the left of the feed).
        feed_per_tooth
            m.
        """
        r, z, slope, length = self.discs(depth, number)
        out = np.zeros((len(angles), 4))
        pitch = 2 * np.pi / self.teeth
        drift = feed_per_tooth / pitch  # feed per radian
        for tooth in range(self.teeth):
            theta = (angles[:, None] + tooth * pitch - z * np.tan(self.helix) / self.radius) % (2 * np.pi)
            place = r * np.cos(theta)
            chip = r - self._surface(theta, r, drift, pitch)
            cuts = (np.sin(theta) > 0) & (place > wall[0]) & (place < wall[1]) & (chip > 0)
            h = np.where(cuts, chip, 0) * np.sin(slope)
            t, radial, axial = (
                length * (area * h + edge * cuts) for area, edge in zip(self.per_area, self.per_length, strict=True)
            )
            inward = radial * np.sin(slope) + axial * np.cos(slope)
            out[:, 0] += (-t * np.cos(theta) - inward * np.sin(theta)).sum(axis=1)
            out[:, 1] += (t * np.sin(theta) - inward * np.cos(theta)).sum(axis=1)
            out[:, 2] += (radial * np.cos(slope) - axial * np.sin(slope)).sum(axis=1)
            out[:, 3] += (t * r).sum(axis=1)
        return out

    @staticmethod
    def _surface(theta: Array, r: Array, drift: float, pitch: float) -> Array:
        """Distance from the axis, along the ray at theta, of the path of the tooth before."""
        # It was on this ray at an earlier angle `turn` of its own: its axis was then `drift * (theta + pitch - turn)` further back.
        turn = theta.copy()
        for _ in range(4):
            back = drift * (theta + pitch - turn)
            turn = theta + np.arcsin(np.clip(back * np.cos(theta) / np.maximum(r, 1e-12), -1, 1))
        back = drift * (theta + pitch - turn)
        return r * np.cos(turn - theta) - back * np.sin(theta)
