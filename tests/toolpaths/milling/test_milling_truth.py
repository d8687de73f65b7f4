"""Averages against teeth on their true paths (`examples/plants/turning_teeth.py`, which shares nothing with the package)."""

from __future__ import annotations

import numpy as np
import pytest
from plants.turning_teeth import TurningCutter

from toolpaths.milling.cutters import Cutter
from toolpaths.milling.engagement import Engagement
from toolpaths.milling.laws import linear_edge
from toolpaths.milling.mechanistic import average_wrench, wrench_over_turn

LAW = linear_edge((767.01, 168.8, 222.0), (27.7, 26.6, 0.7))
R, DEPTH, HELIX = 0.01, 3e-3, np.radians(30)


def truth(corner, wall, chip, angles):
    cutter = TurningCutter(R, corner, 4, HELIX, (767.01e6, 168.8e6, 222e6), (27.7e3, 26.6e3, 0.7e3))
    return cutter.forces(DEPTH, wall, chip, angles)


def cut(width, side) -> Engagement:
    return Engagement(np.array([DEPTH]), np.array([width]), np.array([side]))


def gap(corner, width, side, wall, chip) -> float:
    true = truth(corner, wall, chip, np.linspace(0, np.pi / 2, 180, endpoint=False)).mean(axis=0)
    got = average_wrench(Cutter(R, corner, 4, HELIX), LAW, cut(width, side), np.array([chip]))[[0, 1, 2, 5], 0]
    assert got[3] == pytest.approx(true[3], rel=0.01)
    return float(np.abs(got - true)[:3].max() / np.linalg.norm(true[:3]))


@pytest.mark.parametrize(
    ("corner", "width", "side", "wall"),
    [
        (0.0, 0.020, 0, (-1, 1)),
        (0.003, 0.020, 0, (-1, 1)),
        (0.010, 0.020, 0, (-1, 1)),
        (0.0, 0.004, 1, (0.006, 1)),
        (0.0, 0.004, -1, (-1, -0.006)),
    ],
    ids=["cylinder", "bull-nose", "ball", "wall on the left: up", "wall on the right: down"],
)
def test_teeth_on_their_true_paths_agree_and_the_gap_closes_with_the_feed(corner, width, side, wall):
    """The chip c sin(phi) neglects c against the radius: 0.5 % of the force at 0.1 mm, and falling faster than the feed."""
    wide, narrow = (gap(corner, width, side, wall, chip) for chip in (1e-4, 5e-5))
    assert wide < 0.006
    assert narrow < 0.5 * wide


def test_tooth_by_tooth_the_force_is_that_of_the_true_paths():
    """A side cut: entry, rise and exit at the same angles of rotation."""
    angles = np.linspace(0, np.pi / 2, 90, endpoint=False)
    true = truth(0.0, (-1, -0.006), 1e-4, angles)[:, :3].T
    got = wrench_over_turn(Cutter(R, 0.0, 4, HELIX), LAW, cut(0.004, -1), 1e-4, angles).sum(axis=0)[:3]
    assert np.sqrt(((got - true) ** 2).mean()) < 0.02 * np.abs(true).max()
