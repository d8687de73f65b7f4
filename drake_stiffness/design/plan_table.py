"""PLAN.csv: the columns of measurements.csv without readings, a row for every step of every experiment."""

from __future__ import annotations

import csv
import io

import numpy as np

from drake_stiffness.arm import Arm
from drake_stiffness.design.candidates import Candidates


def experiment_names(number: int, taken: tuple[str, ...] = ()) -> tuple[str, ...]:
    """E01, E02, ... going on where names already taken end."""
    digits = max(2, len(str(number + len(taken))))
    names: list[str] = []
    count = 0
    used = set(taken)
    start = max([int(name[1:]) for name in taken if name[:1] == "E" and name[1:].isdigit()], default=0)
    while len(names) < number:
        count += 1
        name = f"E{start + count:0{digits}d}"
        if name not in used:
            names.append(name)
    return tuple(names)


def plan_text(arm: Arm, plan: Candidates, names: tuple[str, ...]) -> str:
    """The table as text.

    Parameters
    ----------
    plan : Candidates
        Those that were chosen, in the order they shall be done.
    names : one per experiment
    """
    units = [("_mm", 1e3, 1) if p else ("_deg", 180 / np.pi, 2) for p in arm.prismatic]
    wrench = plan.wrench
    axes = ["fx_N", "fy_N", "fz_N"] + (["mx_Nm", "my_Nm", "mz_Nm"] if np.abs(wrench[:, :, 3:]).any() else [])
    out = io.StringIO(newline="")
    table = csv.writer(out, lineterminator="\n")
    table.writerow(["experiment", "step", *(n + u[0] for n, u in zip(arm.joint_names, units, strict=True)), *axes])
    for e, name in enumerate(names):
        joints = [f"{_plain(v * scale, digits)}" for v, (_, scale, digits) in zip(plan.q[:, e], units, strict=True)]
        for step, load in enumerate(wrench[e]):
            table.writerow([name, step, *joints, *(_plain(value, 3) for value in load[: len(axes)])])
    return out.getvalue()


def _plain(value: float, digits: int) -> str:
    # Adding 0.0 turns a rounded -0.0 into 0.0.
    return f"{round(float(value), digits) + 0.0:.{digits}f}"
