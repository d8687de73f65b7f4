"""Writes measurements.csv: the default experiment at 20 postures on an arm that hides something. Same seed, same bytes.

The arm is that of ../kr270/true_arm.yaml (tapered links of three segments each). Hidden in it: friction at joint 3 that develops
like Dahl's, so that a third of the joint's compliance follows the load late. The program on trial knows hysteresis as a play
operator: it must recognise it in another form.

Run: python examples/kr270_hidden/make_campaign.py
"""

from __future__ import annotations

import csv
import io
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import yaml

HERE = Path(__file__).parent
sys.path.insert(0, str(HERE.parent))

from plants.default_experiment import Experiment, Room, default_experiment  # noqa: E402
from plants.friction import DahlFriction  # noqa: E402
from plants.measured_world import MeasuredWorld  # noqa: E402
from plants.physics import JointPhysics  # noqa: E402
from plants.segmented_arm import SegmentedArm  # noqa: E402

SEED = 271
POSTURES = 20
SIGMA_M = 12e-6
FORCE_N, TORQUE_NM = 2500.0, 500.0
LOWER_DEG = np.array([-55.0, -120.0, 10.0, -170.0, -110.0, -170.0])
UPPER_DEG = np.array([55.0, -25.0, 140.0, 170.0, 110.0, 170.0])
# So much thicker is a link that does not bend.
RIGID = 1e7
# Joint 3: a third of its compliance of 0.406 urad/(N m) lies behind friction that breaks away at 400 N m.
HIDDEN = DahlFriction(joint=2, compliance=0.135e-6, breakaway=400.0, steepness=20.0, exponent=1.0)


def in_front(load: np.ndarray, flange: np.ndarray) -> np.ndarray:
    """Load points and flanges (M, 3) in front of the robot and above the floor."""
    reach = np.hypot(load[:, 0], load[:, 1])
    return (load[:, 0] > 0.9) & (reach < 2.9) & (load[:, 2] > 0.35) & (load[:, 2] < 2.4) & (flange[:, 2] > 0.35)


def make_table(
    hidden: tuple[JointPhysics, ...] = (HIDDEN,),
    postures: int = POSTURES,
    seed: int = SEED,
    *,
    cell_file: Path = HERE / "cell.yaml",
    rigid_links: bool = False,
) -> str:
    """The campaign as the text of measurements.csv; with `rigid_links` only joints bend."""
    cell = yaml.safe_load(cell_file.read_text(encoding="utf-8"))
    points = {name: np.array(value, dtype=float) for name, value in cell["reference_points_m"].items()}
    load_point = np.array(cell["load_point_m"], dtype=float)
    arm = SegmentedArm.from_files(HERE.parent / "kr270" / "kr270.urdf", HERE.parent / "kr270" / "true_arm.yaml")
    if rigid_links:
        arm = replace(arm, link_factors=np.full_like(arm.link_factors, RIGID))
    room = Room(LOWER_DEG, UPPER_DEG, load_point, FORCE_N, TORQUE_NM, in_front)
    rng = np.random.default_rng(seed)
    done = default_experiment(arm.chain, room, postures, rng)
    world = MeasuredWorld.of(replace(arm, joint_physics=hidden), len(points))
    exact = world.read(done.q, done.wrench, done.course, load_point, np.array(list(points.values())))
    readings = exact + np.random.default_rng([seed, 1]).normal(scale=SIGMA_M, size=exact.shape)
    return to_csv(done, arm.chain.joint_names, tuple(points), readings)


def to_csv(done: Experiment, joints: tuple[str, ...], points: tuple[str, ...], readings: np.ndarray) -> str:
    """A row per reading; readings (N, P, 3) in m."""
    out = io.StringIO()
    table = csv.writer(out, lineterminator="\n")
    loads = ("fx_N", "fy_N", "fz_N", "mx_Nm", "my_Nm", "mz_Nm")
    head = (
        "experiment",
        "step",
        "point",
        "time_s",
        *(f"{name}_deg" for name in joints),
        *loads,
        "x_mm",
        "y_mm",
        "z_mm",
    )
    table.writerow(head)
    for k in range(len(done.q)):
        start = (f"E{done.course.experiment[k] + 1:02d}", done.course.step[k])
        # Adding 0.0 turns a rounded -0.0 into 0.0.
        done_to_it = (*(f"{v:.4f}" for v in done.q_printed[k]), *(f"{v + 0.0:.3f}" for v in done.wrench[k]))
        for p, name in enumerate(points):
            position = (f"{v:.5f}" for v in readings[k, p] * 1e3)
            table.writerow((*start, name, f"{done.course.time_s[k]:.0f}", *done_to_it, *position))
    return out.getvalue()


def main() -> None:
    """Write measurements.csv beside this file."""
    table = make_table()
    (HERE / "measurements.csv").write_text(table, encoding="utf-8", newline="")
    print(f"measurements.csv: {len(table.splitlines()) - 1} readings (simulated)")


if __name__ == "__main__":
    main()
