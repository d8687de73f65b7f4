"""What thirty postures say of the KR 270: intervals of parameters, of base parameters, and of two deflections.

    python examples/paper/intervals.py [FOLDER]

writes `intervals.svg` (the figure of docs/intervals.md) to FOLDER, `out/paper` unless given, and prints the deflections.
"""

from __future__ import annotations

import base64
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np

from drake_stiffness.files import write_whole
from drake_stiffness.identification import identify
from drake_stiffness.intervals.deflection import deflection_intervals
from drake_stiffness.intervals.profile import base_combinations, profile_intervals
from drake_stiffness.report import figures as f
from drake_stiffness.report.intervals import interval_figure
from drake_stiffness.start import starting_model
from drake_stiffness.task import read_task

CAMPAIGN = Path(__file__).parents[1] / "kr270" / "campaign.yaml"
# A joint and all that it merges with, one by one and together; what the readings know and what only physics bounds.
SHOWN = ("joint_1", "base_link.k66", "joint_2", "link_1.k55", "joint_3", "link_2.k55", "link_2.k66", "link_6.k44")
SHOWN += ("base_link.k15", "base_link.k24", "link_1.k35", "link_2.k26", "link_6.k24")
TOGETHER = ("joint_1 ", "joint_2 ", "joint_3 ", "link_2.k66 ", "link_6.k44 ", "link_3.k26 ", "link_6.k15 ")


def main(folder: Path) -> None:
    """Identify, take intervals, draw."""
    task = read_task(CAMPAIGN)
    o = task.observations()
    solution = identify(starting_model(task.model, task.taking_part()), o)
    base = [c for c in base_combinations(solution) if c.name.startswith(TOGETHER)]
    some = (*profile_intervals(solution, o, SHOWN), *profile_intervals(solution, o, base))
    m = task.measurements
    cases = m.cases.take(np.array([0, 0]))
    wrench = np.zeros((6, 2))
    wrench[1, 0], wrench[5, 1] = 1000.0, 500.0  # the campaign only pulled; of a pure moment it still knows the effect
    cases = replace(cases, wrench=wrench)
    names = ["1 kN sideways", "500 Nm about z"]
    for one in deflection_intervals(solution, o, cases, np.arange(2), np.array(["P1", "P1"]), names):
        print(f"{one.name:18} {1e3 * one.value:+.4f} mm, {1e3 * one.low:+.4f} .. {1e3 * one.high:+.4f}: {one.status}")
    folder.mkdir(parents=True, exist_ok=True)
    drawing = base64.b64decode(f.uri(interval_figure(some)).split(",", 1)[1])
    write_whole(folder / "intervals.svg", drawing.decode())


if __name__ == "__main__":
    main(Path(sys.argv[1] if len(sys.argv) > 1 else "out/paper"))
