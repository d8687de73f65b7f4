"""Writes what the shop would bring back: a plan, then a tracker's export and a force log of a simulated arm. Same seed, same bytes.

Fourteen experiments, two of them at postures of others, on the arm of examples/kr270/true_arm.yaml, which comes back to a posture within
0.06 mm. The tracker writes decimal commas, the sensor reads reactions in kN on a clock of its own and is not at zero.

Run: python examples/shop/make_exports.py
"""

from __future__ import annotations

import datetime
import sys
from pathlib import Path

import numpy as np

HERE = Path(__file__).parent
sys.path[:0] = [str(HERE.parent), str(HERE.parent / "kr270")]

from make_campaign import instruments, make_plan  # noqa: E402
from plants.campaign_maker import Plan, simulate  # noqa: E402
from plants.segmented_arm import SegmentedArm  # noqa: E402

from drake_stiffness.shop.work import prepare  # noqa: E402

SEED, POSTURES, STEPS = 11, 12, (0, 2, 3, 5, 6)
REPEATABILITY_M, SIGMA_M, FORCE_SIGMA_N = 60e-6, 12e-6, 0.4
BEGIN = datetime.datetime(2026, 3, 2, 8, 15)
EXPERIMENT_S, STEP_S, POINT_S = 600, 90, 12
TARGETS = {"P1": "Refl_1", "P2": "Refl_2", "P3": "Refl_3"}


def planned(arm: SegmentedArm, load_point: np.ndarray) -> Plan:
    """Twelve postures, the first two of them twice."""
    plan = make_plan(arm.chain, load_point, SEED, POSTURES)
    again = [*range(POSTURES), 0, 1]
    names = tuple(f"E{k:02d}" for k in range(1, len(again) + 1))
    return Plan(names, plan.q_deg[again], plan.force_N[again][:, STEPS], np.zeros(len(again)))


def plan_text(plan: Plan, joints: tuple[str, ...]) -> str:
    """PLAN.csv: a row per step, no readings."""
    lines = [",".join(["experiment", "step", *(f"{j}_deg" for j in joints), "fx_N", "fy_N", "fz_N"])]
    for e, name in enumerate(plan.names):
        for s, force in enumerate(plan.force_N[e]):
            numbers = [f"{q:.4f}" for q in plan.q_deg[e]] + [f"{f + 0.0:.3f}" for f in force]
            lines.append(",".join([name, str(s), *numbers]))
    return "\n".join(lines) + "\n"


def clock(seconds: float) -> str:
    return (BEGIN + datetime.timedelta(seconds=float(seconds))).strftime("%H:%M:%S")


def main() -> None:
    """Write PLAN.csv, tracker.txt and force.log beside this file."""
    robot = HERE.parent / "kr270"
    arm = SegmentedArm.from_files(robot / "kr270.urdf", robot / "true_arm.yaml")
    tools = instruments("cell.yaml", SIGMA_M, REPEATABILITY_M)
    plan = planned(arm, tools.load_point)
    (HERE / "PLAN.csv").write_text(plan_text(plan, arm.chain.joint_names), encoding="utf-8", newline="")
    rng = np.random.default_rng(SEED)
    readings = simulate(arm, plan, tools, rng) * 1e3
    order = prepare(HERE / "PLAN.csv", HERE / "cell.yaml", name="measure", order="random", seed=7).experiments
    tracker, log = ["Export 2026-03-02;station 1", "Nr;Ziel;Zeit;X [mm];Y [mm];Z [mm]"], ["time,Fx,Fy,Fz"]
    offset = np.array([0.021, -0.013, 0.034])
    for place, name in enumerate(order):
        e = plan.names.index(name)
        for s, force in enumerate(plan.force_N[e]):
            start = EXPERIMENT_S * place + STEP_S * s + 40
            for k, point in enumerate(tools.points):
                xyz = [f"{value:.4f}".replace(".", ",") for value in readings[e, s, k]]
                tracker.append(";".join([str(len(tracker) - 1), TARGETS[point], clock(start + POINT_S * k), *xyz]))
            for late in range(-30, 51, 5):  # the load is put on 20 s before the first reading and stays for 50 s
                acting = force if late > -20 else np.zeros(3)
                read = offset - (acting + rng.normal(scale=FORCE_SIGMA_N, size=3)) / 1e3
                log.append(",".join([clock(start + late), *(f"{value:.4f}" for value in read)]))
    (HERE / "tracker.txt").write_text("\n".join(tracker) + "\n", encoding="utf-8", newline="")
    (HERE / "force.log").write_text("\n".join(log) + "\n", encoding="utf-8", newline="")


if __name__ == "__main__":
    main()
