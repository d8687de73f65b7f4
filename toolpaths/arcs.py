"""Arcs and helices in space, and the straight moves that replace them within a tolerance."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]

# The radius at the end may differ from that at the start by this much of it, or by this much in mm: rounding in the program.
RADIUS_SHARE, RADIUS_MM = 2e-3, 0.02
MOST_SEGMENTS = 100_000
_SAME_POINT = 1e-9


class NoArc(Exception):
    """Why the numbers make no arc."""


@dataclass(frozen=True)
class Arc:
    """A turn about an axis, with a rise along it.

    Attributes
    ----------
    start, end
        Points, mm.
    center
        A point of the axis, mm.
    normal
        Unit direction of the axis; a positive sweep turns to the left about it.
    sweep
        Angle from start to end, rad; a full turn where they coincide.
    """

    start: Floats
    end: Floats
    center: Floats
    normal: Floats
    sweep: float

    @property
    def radius(self) -> float:
        """The larger of the radii at start and end, mm."""
        return max(float(np.linalg.norm(_across(p - self.center, self.normal))) for p in (self.start, self.end))

    def points(self, tolerance: float) -> Floats:
        """(M, 3) points after the start whose chords stay within `tolerance` (mm) of the arc; the last is the end.

        The chord of an angle w lies ``r (1 - cos(w/2))`` inside. Where program numbers give start and end radii that differ
        by their rounding, the radius changes evenly, as controls do it.
        """
        share = min(tolerance / self.radius, 1.0)
        step = min(2 * math.acos(1 - share), math.pi / 2)
        count = max(1, math.ceil(abs(self.sweep) / step - 1e-9))
        if count > MOST_SEGMENTS:
            raise NoArc(f"{count} straight moves would be needed; give a larger tolerance")
        t = np.arange(1, count + 1)[:, None] / count
        u = _across(self.start - self.center, self.normal)
        radius = np.linalg.norm(u)
        u = u / radius
        last = np.linalg.norm(_across(self.end - self.center, self.normal))
        foot = self.center + (self.start - self.center) @ self.normal * self.normal
        rise = float((self.end - self.start) @ self.normal)
        angle = self.sweep * t
        round_about = np.cos(angle) * u + np.sin(angle) * np.cross(self.normal, u)
        found = foot + (radius + (last - radius) * t) * round_about + t * rise * self.normal
        found[-1] = self.end
        return np.asarray(found)


def arc_about(start: Floats, end: Floats, center: Floats, normal: Floats, left: bool) -> Arc:
    """The arc from start to end about an axis; a full turn where they coincide across it.

    Raises
    ------
    NoArc
        The radius is zero, or differs between start and end by more than rounding.
    """
    normal = normal / np.linalg.norm(normal)
    u, v = _across(start - center, normal), _across(end - center, normal)
    first, last = float(np.linalg.norm(u)), float(np.linalg.norm(v))
    if min(first, last) < _SAME_POINT:
        raise NoArc("an arc of radius zero")
    if abs(first - last) > max(RADIUS_MM, RADIUS_SHARE * first):
        raise NoArc(f"the radius is {first:.4f} mm at its start and {last:.4f} mm at its end")
    sweep = math.atan2(float(np.cross(u, v) @ normal), float(u @ v))
    if np.linalg.norm(u - v) < _SAME_POINT:
        sweep = 2 * math.pi if left else -2 * math.pi
    elif left and sweep <= 0:
        sweep += 2 * math.pi
    elif not left and sweep >= 0:
        sweep -= 2 * math.pi
    return Arc(start, end, center, normal, sweep)


def center_of_radius(start: Floats, end: Floats, radius: float, normal: Floats, left: bool) -> Floats:
    """Center of the arc of a given radius; a negative one asks for the arc of more than half a turn.

    Raises
    ------
    NoArc
        Start and end coincide, or lie further apart than twice the radius.
    """
    chord = _across(end - start, normal)
    length = float(np.linalg.norm(chord))
    if length < _SAME_POINT:
        raise NoArc("an arc given by its radius must end elsewhere than it starts")
    height = radius * radius - length * length / 4
    if height < 0:
        if length / 2 - abs(radius) > max(RADIUS_MM, RADIUS_SHARE * abs(radius)):
            raise NoArc(f"its ends are {length:.4f} mm apart, more than twice the radius {abs(radius):.4f} mm")
        height = 0.0
    side = np.cross(normal, chord / length)
    sign = 1.0 if left == (radius > 0) else -1.0
    return np.asarray(start + chord / 2 + sign * math.sqrt(height) * side)


def _across(vector: Floats, normal: Floats) -> Floats:
    return np.asarray(vector - (vector @ normal) * normal)
