"""The three arms that are tried: the KR 270, a light arm of other proportions, and an arm on a linear track."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import yaml
from plants.chain import RigidChain, read_chain
from plants.default_experiment import Room
from plants.truth import Truth, load_truth

HERE = Path(__file__).parent
Array = np.ndarray
#: Steel so thick that it does not bend: links of a truth whose base model has rigid links.
RIGID = 1e7
SIGMA_M = 12e-6


@dataclass(frozen=True)
class Stand:
    """An arm, what it holds, and where it may move.

    Attributes
    ----------
    points
        Reference points, flange frame, m.
    tcp
        Flange frame, m.
    compensated
        Joints that such arms have gravity compensators at.
    """

    name: str
    model: Path
    truth: Truth
    chain: RigidChain
    room: Room
    points: dict[str, tuple[float, float, float]]
    compensated: tuple[str, ...]

    @property
    def targets(self) -> Array:
        return np.array(list(self.points.values()))

    def cell(self, joints: list[str], links: list[str]) -> dict[str, Any]:
        """The content of cell.yaml for a model with springs in these joints and links."""
        return {
            "robot": {"model": self.model.name, "flange": self.truth.flange},
            "gravity_m_per_s2": self.truth.gravity.tolist(),
            "tool": {"mass_kg": self.truth.tool.mass, "center_of_mass_m": self.truth.tool.center_of_mass.tolist()},
            "load_point_m": self.room.load_point.tolist(),
            "reference_points_m": {name: list(p) for name, p in self.points.items()},
            "springs": {"joints": joints or "none", "links": links or "none", "template": "beam"},
        }


def _kr270() -> Stand:
    folder = HERE.parent / "kr270"
    cell = yaml.safe_load((folder / "cell.yaml").read_text(encoding="utf-8"))

    def accept(load: Array, flange: Array) -> Array:
        reach = np.hypot(load[:, 0], load[:, 1])
        return (load[:, 0] > 0.9) & (reach < 2.9) & (load[:, 2] > 0.35) & (load[:, 2] < 2.4) & (flange[:, 2] > 0.35)

    room = Room(
        np.array([-55.0, -120.0, 10.0, -170.0, -110.0, -170.0]),
        np.array([55.0, -25.0, 140.0, 170.0, 110.0, 170.0]),
        np.array(cell["load_point_m"], dtype=float),
        2500.0,
        500.0,
        accept,
    )
    points = {name: tuple(p) for name, p in cell["reference_points_m"].items()}
    truth = load_truth(folder / "true_arm.yaml")
    model = folder / "kr270.urdf"
    return Stand("kr270", model, truth, read_chain(model, truth.flange), room, points, ("joint_2",))


def _light_arm() -> Stand:
    def accept(load: Array, flange: Array) -> Array:
        reach = np.hypot(load[:, 0], load[:, 1])
        return (reach > 0.55) & (load[:, 0] > 0.3) & (load[:, 2] > 0.2) & (load[:, 2] < 1.5) & (flange[:, 2] > 0.2)

    room = Room(
        np.array([-70.0, -25.0, -100.0, -170.0, -110.0, -170.0]),
        np.array([70.0, 95.0, 60.0, 170.0, 110.0, 170.0]),
        np.array([0.09, 0.03, 0.16]),
        500.0,
        80.0,
        accept,
    )
    points = {"A": (0.14, 0.0, 0.06), "B": (-0.08, 0.12, 0.03), "C": (-0.06, -0.13, 0.10)}
    return _own("light_arm", room, points, ("axis_2",))


def _track_arm() -> Stand:
    def accept(load: Array, flange: Array) -> Array:
        return (load[:, 0] > 0.8) & (load[:, 2] > 0.4) & (load[:, 2] < 2.3) & (flange[:, 2] > 0.4)

    room = Room(
        np.array([-1400.0, -60.0, -20.0, -90.0, -170.0, -105.0, -170.0]),
        np.array([1400.0, 60.0, 90.0, 60.0, 170.0, 105.0, 170.0]),
        np.array([0.12, -0.05, 0.22]),
        1400.0,
        250.0,
        accept,
    )
    points = {"R1": (0.2, 0.05, 0.08), "R2": (-0.1, 0.18, 0.05), "R3": (-0.09, -0.19, 0.14)}
    return _own("track_arm", room, points, ("shoulder",))


def _own(name: str, room: Room, points: dict[str, tuple[float, float, float]], compensated: tuple[str, ...]) -> Stand:
    model, truth = HERE / "arms" / f"{name}.urdf", load_truth(HERE / "arms" / f"{name}_truth.yaml")
    return Stand(name, model, truth, read_chain(model, truth.flange), room, points, compensated)


@cache
def stand(name: str) -> Stand:
    """An arm by name."""
    return {"kr270": _kr270, "light_arm": _light_arm, "track_arm": _track_arm}[name]()


STANDS = ("kr270", "light_arm", "track_arm")
