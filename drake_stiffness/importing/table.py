"""Imported readings as the rows of a measurements.csv, and what is said of them: gaps, the scatter of repeats."""

from __future__ import annotations

import csv
import io

import numpy as np
from numpy.typing import NDArray

from drake_stiffness.arm import Arm
from drake_stiffness.campaign import Measurements
from drake_stiffness.importing.map_file import ImportMap
from drake_stiffness.importing.matching import Steps
from drake_stiffness.importing.samples import Averaged
from drake_stiffness.rotations import Array


def repeat_sigma(readings: Averaged, steps: Steps, wrench: Array) -> float:
    """Standard deviation of a coordinate over steps of one experiment with the same load, m."""
    experiment = np.unique(np.array(steps.experiment), return_inverse=True)[1].reshape(-1)[readings.case]
    load = np.round(wrench[:, readings.case].T, 6)
    point = np.unique(readings.point, return_inverse=True)[1].reshape(-1)
    keys = np.column_stack([experiment, point, load])
    _, group, counts = np.unique(keys, axis=0, return_inverse=True, return_counts=True)
    group = group.reshape(-1)
    mean = np.stack([np.bincount(group, weights=readings.p[:, c]) for c in range(3)], axis=1) / counts[:, None]
    freedom = 3 * int((counts - 1).sum())
    return float(np.sqrt(((readings.p - mean[group]) ** 2).sum() / freedom)) if freedom else float("nan")


def missing_readings(readings: Averaged, steps: Steps, points: tuple[str, ...]) -> list[str]:
    """Steps without a reading, and points that are read elsewhere but not in a step."""
    present = {(int(c), str(p)) for c, p in zip(readings.case, readings.point, strict=True)}
    seen = [name for name in points if (readings.point == name).any()]
    out = []
    for case in range(steps.number):
        lacking = [name for name in seen if (case, name) not in present]
        if lacking:
            out.append(
                f"{steps.name(case)}: " + ("no reading" if len(lacking) == len(seen) else f"no {', '.join(lacking)}")
            )
    return out


def table_text(
    readings: Averaged,
    steps: Steps,
    q: Array,
    wrench: Array,
    arm: Arm,
    plan: Measurements | None,
    content: ImportMap,
    relative: bool,
) -> str:
    """measurements.csv; what stands in the plan is written as it stands there."""
    timed, kept = not np.isnan(readings.time_s).any(), content.samples == "keep"
    joints = _plan_cells(plan, [f"{n}{u}" for n in arm.joint_names for u in ("_deg", "_rad", "_mm", "_m")])
    if content.joints is not None or joints is None:
        units = np.where(arm.prismatic, 1e3, 180 / np.pi)
        names = [f"{n}{'_mm' if p else '_deg'}" for n, p in zip(arm.joint_names, arm.prismatic, strict=True)]
        joints = names, [[_plain(v, 6) for v in column] for column in (q * units[:, None]).T]
    stems = [f"f{a}{u}" for a in "xyz" for u in ("_N", "_kN")] + [f"m{a}{u}" for a in "xyz" for u in ("_Nm", "_kNm")]
    loads = _plan_cells(plan, stems)
    if content.forces is not None or loads is None:
        axes = 6 if np.nan_to_num(wrench[3:]).any() else 3
        names = ["fx_N", "fy_N", "fz_N", "mx_Nm", "my_Nm", "mz_Nm"][:axes]
        loads = names, [[_plain(v, 4) for v in column[:axes]] for column in wrench.T]
    letter = "d" if relative else ""
    out = io.StringIO(newline="")
    writer = csv.writer(out, lineterminator="\n")
    warmth = not np.isnan(readings.temperature).all()
    head = ["experiment", "step", "point", *(["time_s"] if timed else []), *(["temperature_degC"] if warmth else [])]
    head += ["repeat"] if kept else []
    writer.writerow([*head, *joints[0], *loads[0], *(f"{letter}{a}_mm" for a in "xyz")])
    for r, case in enumerate(readings.case.tolist()):
        row = [steps.experiment[case], str(steps.step[case]), str(readings.point[r])]
        row += [_plain(readings.time_s[r], 3)] if timed else []
        degrees = readings.temperature[r]
        row += ["" if np.isnan(degrees) else _plain(degrees, 2)] if warmth else []
        row += [str(readings.repeat[r])] if kept else []
        writer.writerow([*row, *joints[1][case], *loads[1][case], *(_plain(v * 1e3, 6) for v in readings.p[r])])
    return out.getvalue()


def _plan_cells(plan: Measurements | None, names: list[str]) -> tuple[list[str], list[list[str]]] | None:
    """The columns of a plan that are among some names, a row per step, cells untouched."""
    if plan is None:
        return None
    columns = [name for name in plan.table.header if name in names]
    first: NDArray[np.int_] = np.unique(plan.case, return_index=True)[1]
    rows = [plan.table.rows[plan.row[reading]] for reading in first]
    places = [plan.table.column(name) for name in columns]
    return columns, [[row[place].strip() for place in places] for row in rows]


def _plain(value: float, decimals: int) -> str:
    """A number without trailing zeros, and without a negative zero."""
    text = f"{value:.{decimals}f}"
    text = text.rstrip("0").rstrip(".") if "." in text else text
    return "0" if text in ("-0", "") else text
