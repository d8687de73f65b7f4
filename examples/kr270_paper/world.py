"""The true KR 270 of the paper's application, on a plant that knows none of our formulas, and its campaigns.

Joint compliances are Table 1's (k1, which is not there, is 0.33 urad/(N m), ours), links those of ../kr270/true_arm.yaml (ours).
"""

from __future__ import annotations

import sys
from dataclasses import replace
from pathlib import Path

import numpy as np

HERE = Path(__file__).parent
KR270 = HERE.parent / "kr270"
sys.path[:0] = [str(HERE.parent), str(KR270)]

import make_campaign  # noqa: E402
from plants.campaign_maker import simulate, to_csv  # noqa: E402
from plants.compensator import PinSpring  # noqa: E402
from plants.segmented_arm import SegmentedArm  # noqa: E402

#: Table 1 as printed: value and what stands after the ± sign ("458+27" is read as ±). rad/(N m); m/N; m.
TABLE_1 = {
    "k_c": (0.144e-6, 0.031e-6),
    "s_0": (0.458, 0.027),
    "joint_2": (0.302e-6, 0.004e-6),
    "joint_3": (0.406e-6, 0.008e-6),
    "joint_4": (3.002e-6, 0.115e-6),
    "joint_5": (3.303e-6, 0.162e-6),
    "joint_6": (2.365e-6, 0.095e-6),
}
#: Absolute accuracy of the paper's tracker, taken as one standard deviation of a coordinate, m.
TRACKER_M = 10e-6
#: Published pins of the compensator: 685.93 mm behind and 120.30 mm below joint 2; 184.72 mm from joint 2 on the arm.
BEHIND = np.array([-0.68593, 0.0, -0.12030])
LEVER = 0.18472
#: A spring that carries about the weight of arm and tool, N/m.
BALANCING = 1.5e5
VARIANTS = ("stiffness", "spring", "none")


def true_arm(variant: str) -> SegmentedArm:
    """The plant with a compensator: `stiffness`, `spring` or `none`.

    `stiffness`: Table 1's spring along the arm, felt as a stiffness alone. `spring`: the pin on the arm is turned a right angle
    back, so that the spring is shortest when the arm stands upright, and it pulls.
    """
    arm = SegmentedArm.from_files(KR270 / "kr270.urdf", KR270 / "true_arm.yaml")
    s_0 = TABLE_1["s_0"][0]
    if variant == "stiffness":
        stiff = PinSpring(1, BEHIND, np.array([LEVER, 0.0, 0.0]), 1.0 / TABLE_1["k_c"][0], s_0)
        return replace(arm, stiffening=stiff)
    if variant == "spring":
        return replace(arm, compensator=PinSpring(1, BEHIND, np.array([0.0, 0.0, LEVER]), BALANCING, s_0))
    return arm


def write_campaign(
    folder: Path, variant: str, postures: int, seed: int = 270, *, noise_m: float = TRACKER_M, extra: str = ""
) -> Path:
    """A campaign of the paper's loads (2.5 kN down, 3.5 kN sideways, half of each too) on a true arm; its campaign.yaml.

    Parameters
    ----------
    noise_m
        Of the readings; the campaign states the tracker's either way.
    extra
        Further lines of campaign.yaml.
    """
    folder.mkdir(parents=True, exist_ok=True)
    arm = true_arm(variant)
    tools = make_campaign.instruments(sigma_m=noise_m)
    plan = make_campaign.make_plan(arm.chain, tools.load_point, seed, postures)
    readings = simulate(arm, plan, tools, np.random.default_rng([seed, postures]))
    name = f"{variant}_{postures}_{seed}" + ("" if noise_m else "_exact") + ("_positions" if extra else "")
    table = to_csv(plan, arm.chain.joint_names, tuple(tools.points), readings, "simulated")
    (folder / f"{name}.csv").write_text(table, encoding="utf-8", newline="")
    cell = (HERE / f"cell_{variant}.yaml").as_posix()
    text = f"cell: {cell}\nmeasurements: {name}.csv\nnoise: {{position_sigma_mm: {TRACKER_M * 1e3:g}}}\n{extra}"
    path = folder / f"{name}.yaml"
    path.write_text(text, encoding="utf-8")
    return path


def spring_in_readings(postures: int, seed: int = 270) -> tuple[np.ndarray, np.ndarray]:
    """What the real spring changes in the readings of a campaign: displacements under load and unloaded positions, lengths, m."""
    tools = make_campaign.instruments(sigma_m=0.0)
    plan = make_campaign.make_plan(true_arm("none").chain, tools.load_point, seed, postures)
    with_it, without = (simulate(true_arm(v), plan, tools, np.random.default_rng(0)) for v in ("spring", "none"))
    moved = (with_it - with_it[:, :1]) - (without - without[:, :1])
    return np.linalg.norm(moved[:, 1:], axis=-1).ravel(), np.linalg.norm((with_it - without)[:, 0], axis=-1).ravel()
