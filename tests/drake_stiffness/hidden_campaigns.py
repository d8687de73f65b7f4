"""Small campaigns of the KR 270 with joints that bend and links that do not, from physics that shares no code with the program."""

from __future__ import annotations

import sys
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import lru_cache
from pathlib import Path

import numpy as np
import yaml

EXAMPLES = Path(__file__).parents[2] / "examples"
if str(EXAMPLES) not in sys.path:
    sys.path.insert(0, str(EXAMPLES))

from plants.course import Course  # noqa: E402
from plants.default_experiment import Experiment, Room, default_experiment  # noqa: E402
from plants.measured_world import MeasuredWorld  # noqa: E402
from plants.segmented_arm import SegmentedArm  # noqa: E402

HERE = EXAMPLES / "kr270"
SIGMA_M = 12e-6
# Of the default experiment: unloaded, two levels and half of it down, the same to one side, whole to the other, a torque.
STEPS = (0, 1, 3, 4, 8, 9, 13, 16)
LOWER_DEG = np.array([-55.0, -120.0, 10.0, -170.0, -110.0, -170.0])
UPPER_DEG = np.array([55.0, -25.0, 140.0, 170.0, 110.0, 170.0])
Change = Callable[[MeasuredWorld], MeasuredWorld]


@dataclass(frozen=True)
class Done:
    """An experiment and what was read, (N, P, 3) in m."""

    experiment: Experiment
    exact: np.ndarray


@lru_cache
def cell_content() -> dict:
    return yaml.safe_load((HERE / "cell_joints_only.yaml").read_text(encoding="utf-8"))


def points() -> dict[str, list[float]]:
    return cell_content()["reference_points_m"]


def untouched(world: MeasuredWorld) -> MeasuredWorld:
    return world


def with_physics(*physics) -> Change:
    """Something more in a joint."""
    return lambda world: world.with_arm(joint_physics=(*world.arm.joint_physics, *physics))


def softer(joint: int, factor: float) -> Change:
    """A joint of other compliance."""

    def change(world: MeasuredWorld) -> MeasuredWorld:
        k = world.arm.joint_compliance.copy()
        k[joint] *= factor
        return world.with_arm(joint_compliance=k)

    return change


def in_front(load: np.ndarray, flange: np.ndarray) -> np.ndarray:
    reach = np.hypot(load[:, 0], load[:, 1])
    return (load[:, 0] > 0.9) & (reach < 2.9) & (load[:, 2] > 0.35) & (load[:, 2] < 2.4) & (flange[:, 2] > 0.35)


def arm_and_room() -> tuple[SegmentedArm, Room]:
    arm = SegmentedArm.from_files(HERE / "kr270.urdf", HERE / "true_arm.yaml")
    arm = replace(arm, link_factors=np.full_like(arm.link_factors, 1e7))
    return arm, Room(
        LOWER_DEG, UPPER_DEG, np.array(cell_content()["load_point_m"], dtype=float), 2500.0, 500.0, in_front
    )


def draw(postures: int, seed: int, hold: dict[int, float] | None = None) -> Experiment:
    """Some steps of the default experiment; `hold` keeps joints at an angle (deg)."""
    arm, room = arm_and_room()
    lower, upper = room.lower_deg.copy(), room.upper_deg.copy()
    for joint, angle in (hold or {}).items():
        lower[joint], upper[joint] = angle - 1e-3, angle + 1e-3
    room = replace(room, lower_deg=lower, upper_deg=upper)
    done = default_experiment(arm.chain, room, postures, np.random.default_rng(seed))
    c = done.course
    keep = np.isin(c.step, STEPS)
    course = Course(c.experiment[keep], c.step[keep], c.time_s[keep])
    return Experiment(done.q_printed[keep], done.q[keep], done.wrench[keep], course)


def run(done: Experiment, change: Change = untouched) -> Done:
    """What the tracker would read without noise."""
    arm, room = arm_and_room()
    world = change(MeasuredWorld.of(arm, len(points())))
    targets = np.array(list(points().values()))
    return Done(done, world.read(done.q, done.wrench, done.course, room.load_point, targets))


def table(done: Done, seed: int, sigma_m: float = SIGMA_M) -> list[list[str]]:
    """Rows of measurements.csv, the header first."""
    e = done.experiment
    readings = done.exact + np.random.default_rng([seed, 1]).normal(scale=sigma_m, size=done.exact.shape)
    joints = [f"joint_{i + 1}_deg" for i in range(e.q.shape[1])]
    loads = ["fx_N", "fy_N", "fz_N", "mx_Nm", "my_Nm", "mz_Nm"]
    rows = [["experiment", "step", "point", "time_s", *joints, *loads, "x_mm", "y_mm", "z_mm"]]
    for k in range(len(e.q)):
        for p, name in enumerate(points()):
            rows.append(
                [
                    f"E{e.course.experiment[k] + 1:02d}",
                    str(e.course.step[k]),
                    name,
                    f"{e.course.time_s[k]:.0f}",
                    *(f"{v:.4f}" for v in e.q_printed[k]),
                    *(f"{v:.3f}" for v in e.wrench[k]),
                    *(f"{v * 1e3:.5f}" for v in readings[k, p]),
                ]
            )
    return rows


def write(folder: Path, rows: list[list[str]], **campaign) -> Path:
    """A campaign of such rows; returns campaign.yaml."""
    folder.mkdir(parents=True, exist_ok=True)
    cell = {**cell_content(), "robot": {**cell_content()["robot"], "model": str(HERE / "kr270.urdf")}}
    (folder / "cell.yaml").write_text(yaml.safe_dump(cell), encoding="utf-8")
    text = "\n".join(",".join(row) for row in rows) + "\n"
    (folder / "measurements.csv").write_text(text, encoding="utf-8")
    content = {
        "cell": "cell.yaml",
        "measurements": "measurements.csv",
        "noise": {"position_sigma_mm": SIGMA_M * 1e3},
        **campaign,
    }
    path = folder / "campaign.yaml"
    path.write_text(yaml.safe_dump(content), encoding="utf-8")
    return path
