"""Writes measurements.csv: a simulated campaign of 30 postures on the arm of true_arm.yaml. Same seed, same bytes.

Run: python examples/kr270/make_campaign.py
"""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
import yaml

HERE = Path(__file__).parent
sys.path.insert(0, str(HERE.parent))

from plants.campaign_maker import Instruments, Plan, rounded, simulate, to_csv  # noqa: E402
from plants.chain import RigidChain  # noqa: E402
from plants.postures import spread_postures  # noqa: E402
from plants.segmented_arm import SegmentedArm  # noqa: E402

SEED = 270
POSTURES = 30
SIGMA_M = 12e-6
NOTE = "simulated"
# The space in front of the robot that postures are drawn from, deg: within the limits, cables spared.
LOWER = np.deg2rad([-55.0, -120.0, 10.0, -170.0, -110.0, -170.0])
UPPER = np.deg2rad([55.0, -25.0, 140.0, 170.0, 110.0, 170.0])


def in_front(chain: RigidChain, load_point: np.ndarray, q: np.ndarray) -> np.ndarray:
    """Which postures (M, n) hold the tool in front of the robot, above the floor and clear of the column."""
    R, p = chain.flange(q)
    load = p + R @ load_point
    wrist = p - 0.24 * R[:, :, 2]
    reach = np.hypot(load[:, 0], load[:, 1])
    return (
        (load[:, 0] > 0.9)
        & (reach < 2.9)
        & (load[:, 2] > 0.35)
        & (load[:, 2] < 2.4)
        & (p[:, 2] > 0.35)
        & (np.hypot(wrist[:, 0], wrist[:, 1]) > 0.85)
        & (wrist[:, 2] > 0.4)
    )


def make_plan(chain: RigidChain, load_point: np.ndarray, seed: int = SEED, count: int = POSTURES) -> Plan:
    """Postures, load steps and a random order in time.

    Steps: 0 unloaded; 1, 2: 1.25 and 2.5 kN down; 3 unloaded; 4, 5: 1.75 and 3.5 kN horizontal; 6 unloaded. The
    horizontal direction goes outwards, left, inwards, right from posture to posture (as seen from the robot's column).
    """
    rng = np.random.default_rng(seed)
    q_deg = np.round(np.rad2deg(spread_postures(LOWER, UPPER, count, rng, lambda q: in_front(chain, load_point, q))), 4)
    R, p = chain.flange(np.deg2rad(q_deg))
    load = p + R @ load_point
    towards = np.arctan2(load[:, 1], load[:, 0]) + 0.5 * np.pi * np.arange(count)
    side = np.column_stack([np.cos(towards), np.sin(towards), np.zeros(count)])
    down, none = np.tile([0.0, 0.0, -1.0], (count, 1)), np.zeros((count, 3))
    force = np.stack([none, 1250 * down, 2500 * down, none, 1750 * side, 3500 * side, none], axis=1)
    # Seven steps of three readings take 210 s; five minutes from one experiment to the next.
    start = 300.0 * rng.permutation(count)
    return rounded(Plan(tuple(f"E{k:02d}" for k in range(1, count + 1)), q_deg, force, start))


def instruments(cell: str = "cell.yaml", sigma_m: float = SIGMA_M, repeatability_m: float = 0.0) -> Instruments:
    """Reference points and load point as the cell file states them."""
    stated = yaml.safe_load((HERE / cell).read_text(encoding="utf-8"))
    points = {name: np.array(value, dtype=float) for name, value in stated["reference_points_m"].items()}
    return Instruments(points, np.array(stated["load_point_m"], dtype=float), sigma_m, repeatability_m)


def make_table(arm: SegmentedArm, tools: Instruments, seed: int = SEED) -> str:
    """The campaign on an arm as the text of measurements.csv."""
    plan = make_plan(arm.chain, tools.load_point, seed)
    readings = simulate(arm, plan, tools, np.random.default_rng([seed, 1]))
    return to_csv(plan, arm.chain.joint_names, tuple(tools.points), readings, NOTE)


def main() -> None:
    """Write measurements.csv beside this file."""
    arm = SegmentedArm.from_files(HERE / "kr270.urdf", HERE / "true_arm.yaml")
    table = make_table(arm, instruments())
    (HERE / "measurements.csv").write_text(table, encoding="utf-8", newline="")
    print(f"measurements.csv: {len(table.splitlines()) - 1} readings (simulated)")


if __name__ == "__main__":
    main()
