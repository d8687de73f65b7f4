"""The figure of docs/ur10_diagnosis.md: by how much each joint would have to turn to explain the residuals, before and after; and transfer."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from drake_stiffness.diagnosis.signatures import Scene
from drake_stiffness.model import Model
from drake_stiffness.observation import residual_m
from drake_stiffness.task import Task

_BINS = 36


def turn_urad(task: Task, model: Model, joint: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Mean turn of a joint that would explain the residuals, its standard error (urad), over bins of its angle (deg)."""
    o = task.observations(task.held)
    m = o.measurements
    J, r = Scene(model, o).joint_columns[joint][:3].T, residual_m(o, model).T
    turn = (J * r).sum(axis=1) / np.maximum((J**2).sum(axis=1), 1e-9) * 1e6
    weight = (J**2).sum(axis=1)
    q = np.degrees(m.cases.q[joint, m.case])
    edges = np.linspace(q.min(), q.max(), _BINS + 1)
    place = np.clip(np.digitize(q, edges) - 1, 0, _BINS - 1)
    total = np.bincount(place, weight, _BINS)
    mean = np.bincount(place, weight * turn, _BINS) / np.maximum(total, 1e-12)
    spread = np.bincount(place, (weight * (turn - mean[place])) ** 2, _BINS)
    return (edges[1:] + edges[:-1]) / 2, np.where(total > 0, mean, np.nan), np.sqrt(spread) / np.maximum(total, 1e-12)


def draw(task: Task, before: Model, after: Model, rows: list[tuple[str, float]], path: Path) -> None:
    """Three joints' held-out residuals over their angle, and the other series' held-out RMS as bars."""
    import matplotlib

    matplotlib.use("svg")
    matplotlib.rcParams["svg.hashsalt"] = "ur10"
    import matplotlib.pyplot as plt

    names = after.arm.joint_names
    fig, axes = plt.subplots(2, 2, figsize=(10, 6.5), layout="constrained")
    for ax, joint in zip(axes.flat, range(3), strict=False):
        for model, color, label in ((before, "0.6", "geometry alone"), (after, "tab:blue", "with what was named")):
            angle, mean, error = turn_urad(task, model, joint)
            ax.errorbar(angle, mean, error, fmt=".-", color=color, linewidth=0.8, label=label)
        ax.axhline(0.0, color="black", linewidth=0.5)
        ax.set(title=names[joint], xlabel="angle, deg", ylabel="turn that residuals ask for, urad")
    axes[0, 0].legend(fontsize="small")
    labels, rms = zip(*rows, strict=True)
    axes[1, 1].barh(labels, rms, color="tab:blue")
    axes[1, 1].set(title="the other series, held-out half", xlabel="3-D RMS, mm", xlim=(0.0, 1.05 * max(rms)))
    axes[1, 1].tick_params(axis="y", labelsize="small")
    axes[1, 1].invert_yaxis()
    fig.savefig(path, metadata={"Date": None})
