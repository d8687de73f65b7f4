"""What neither model nor named causes explain of a cut part, as a campaign that `diagnose` reads.

Every probed place is an experiment of two steps: unloaded, where the tool stands at the pose that was commanded, and under the
process force, where the probe found it, the shift and turn of the workpiece that were found taken off. The tool centre point is load
point and reference point. The unloaded place is not measured but stated.
"""

from __future__ import annotations

import csv
import io

import numpy as np
import yaml

from drake_stiffness.errors import InputError
from drake_stiffness.model import Model
from toolpaths.loaded_path import LoadedPath
from toolpaths.probing.closed_loop import Learnt
from toolpaths.process import Process

POINT = "TCP"


def campaign_files(model: Model, process: Process, path: LoadedPath, learnt: Learnt) -> dict[str, str]:
    """Name to text of `campaign.yaml`, `cell.yaml` and `measurements.csv`.

    Raises
    ------
    InputError
        If deviations are known along normals only: a reading has three coordinates.
    """
    if learnt.probe.along_normal.all():
        raise InputError(
            f"{learnt.probe.path}: deviations along normals only cannot be handed to diagnose, whose readings have three coordinates; probe "
            "dx_mm, dy_mm, dz_mm."
        )
    sigma = round(max(learnt.noise_mm, 1e-4), 6)
    campaign = {
        "cell": "cell.yaml",
        "measurements": "measurements.csv",
        "noise": {"position_sigma_mm": sigma},
        "quantity": "displacement",
    }
    return {
        "campaign.yaml": yaml.safe_dump(campaign, sort_keys=False),
        "cell.yaml": yaml.safe_dump(_cell(model, process), sort_keys=False),
        "measurements.csv": _measurements(model, process, path, learnt),
    }


def _cell(model: Model, process: Process) -> dict[str, object]:
    tcp = [float(v) for v in model.tcp[1]]
    cell = {**model.cell, "load_point_m": tcp, "reference_points_m": {POINT: tcp}}
    if process.cell is not None:
        named = (process.path.parent / process.cell).parent / str(model.cell["robot"]["model"])
        robot = dict(model.cell["robot"])
        robot["model"] = str(named.resolve())
        cell["robot"] = robot
    plain: dict[str, object] = yaml.safe_load(yaml.safe_dump(_plain(cell)))
    return plain


def _plain(value: object) -> object:
    """Tuples as lists, for YAML."""
    if isinstance(value, dict):
        return {key: _plain(entry) for key, entry in value.items() if entry is not None}
    if isinstance(value, list | tuple):
        return [_plain(entry) for entry in value]
    return value


def _measurements(model: Model, process: Process, path: LoadedPath, learnt: Learnt) -> str:
    R_WB, _ = process.base
    places, probe = learnt.places, learnt.probe
    commanded = path.bench.commanded(learnt.cut_at)[1].T
    found = places.at(path.p) + (probe.deviation_mm - learnt.rigid_mm) * 1e-3 @ R_WB.T - places.at(commanded)
    q, wrench = places.at(learnt.cut_at.T), places.at(path.wrench.T)
    arm = model.arm
    scale = np.where(arm.prismatic, 1e3, np.degrees(1.0))
    joints = [
        f"{name}_{'mm' if slides else 'deg'}" for name, slides in zip(arm.joint_names, arm.prismatic, strict=True)
    ]
    stream = io.StringIO()
    table = csv.writer(stream, lineterminator="\n")
    loads = [f"f{a}_N" for a in "xyz"] + [f"m{a}_Nm" for a in "xyz"]
    table.writerow(["experiment", "step", "point", *joints, *loads, "dx_mm", "dy_mm", "dz_mm", "note"])
    for j in np.flatnonzero(~probe.along_normal).tolist():
        name = f"P{j + 1:04d}"
        posture = [f"{v:.6f}" for v in q[j] * scale]
        table.writerow([name, 0, POINT, *posture, *["0"] * 6, "0", "0", "0", "stated, not measured"])
        load = [f"{v:.4f}" for v in wrench[j]]
        moved = [f"{v * 1e3:.6f}" for v in found[j]]
        table.writerow([name, 1, POINT, *posture, *load, *moved, f"{probe.path.name} line {probe.table_line[j]}"])
    return stream.getvalue()
