"""Loads in the words of the people who hang them: newtons, kilograms, up, down and sideways."""

from __future__ import annotations

import math

import numpy as np

from drake_stiffness.rotations import Array

NO_LOAD = "no load"
# Directions closer than this to an axis are named after it, rad (0.6 degrees).
_NEAR_AXIS = 0.01


def load_words(wrench: Array, gravity: Array) -> str:
    """A wrench (6,) in one line, `2500 N (254.8 kg) down, 120 N m about +z`; `no load` where it is zero.

    Parameters
    ----------
    gravity : (3,)
        Of the cell, m/s^2: says what down is, and how many kilograms hang for a force.
    """
    parts = []
    size = float(np.linalg.norm(wrench[:3]))
    if size > 0.0:
        parts.append(f"{size_words(size)} N ({kilograms(size, gravity)}) {direction_words(wrench[:3], gravity)}")
    moment = float(np.linalg.norm(wrench[3:]))
    if moment > 0.0:
        parts.append(f"{size_words(moment)} N m about {direction_words(wrench[3:], np.zeros(3))}")
    return ", ".join(parts) or NO_LOAD


def size_words(size: float) -> str:
    """A force or moment to the hundredth: a plan writes components to the thousandth, so 60 N at 45 degrees come back as 59.9994."""
    hundredths = f"{size:.2f}".rstrip("0").rstrip(".")
    return hundredths if size >= 0.1 else f"{size:.3g}"


def kilograms(force_N: float, gravity: Array) -> str:
    """The mass whose weight a force is, `254.8 kg`; with 9.81 m/s^2 where the cell has no gravity."""
    g = float(np.linalg.norm(gravity)) or 9.81
    return f"{force_N / g:.4g} kg"


def direction_words(vector: Array, gravity: Array) -> str:
    """`down`, `up`, `+x` .. `-z`, `level, 30 deg from +x to +y`, or how far above or below level and which way."""
    unit = vector / np.linalg.norm(vector)
    pull = float(np.linalg.norm(gravity))
    down = gravity / pull if pull > 0.0 else np.zeros(3)
    if pull > 0.0 and abs(unit @ down) > math.cos(_NEAR_AXIS):
        return "down" if unit @ down > 0 else "up"
    axis = int(np.abs(unit).argmax())
    if abs(unit[axis]) > math.cos(_NEAR_AXIS):
        return f"{'+' if unit[axis] > 0 else '-'}{'xyz'[axis]}"
    vertical = pull > 0.0 and abs(down[2]) > math.cos(_NEAR_AXIS)
    if not vertical:  # nothing is level without gravity along z: the components say it
        return "along (" + ", ".join(f"{c + 0.0:.3f}" for c in unit) + ")"
    slope = math.degrees(math.asin(float(np.clip(unit @ down, -1.0, 1.0))))
    level = "level" if abs(slope) < 0.5 else f"{abs(slope):.0f} deg {'below' if slope > 0 else 'above'} level"
    return f"{level}, {_heading(unit)}"


def _heading(unit: Array) -> str:
    """The way a vector points in the world's xy plane: `+x`, or `30 deg from +x to +y`."""
    azimuth = math.degrees(math.atan2(unit[1], unit[0])) % 360.0
    names = ("+x", "+y", "-x", "-y")
    quarter = int(azimuth // 90.0) % 4
    rest = azimuth - 90.0 * quarter
    if rest < 0.5:
        return names[quarter]
    if rest > 89.5:
        return names[(quarter + 1) % 4]
    return f"{rest:.0f} deg from {names[quarter]} to {names[(quarter + 1) % 4]}"
