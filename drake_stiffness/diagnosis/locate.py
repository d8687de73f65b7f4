"""Where the gap is: residuals in units of their noise by experiment, joint, direction, level, branch, point, step and time."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from drake_stiffness.diagnosis.generic import Process
from drake_stiffness.diagnosis.signatures import Scene
from drake_stiffness.rotations import Array

_BINS = 6
# A place is told of from five sigma (squared) on, if it has this share of all; so many places at most.
_VISIBLE, _SHARE, _MOST_PLACES = 25.0, 0.05, 3
_IMPLAUSIBLE = 1e-3


@dataclass(frozen=True)
class Place:
    """A part of the readings: its name, the size of its residual and its chi-square per degree of freedom."""

    name: str
    rms_mm: float
    chi2_per_dof: float


def by_part(scene: Scene, residual: Array, dof: int) -> dict[str, list[Place]]:
    """Residuals by every way to part them.

    Parameters
    ----------
    residual : (rows,)
        Whitened.
    dof : int
        Of the whole; every part gets its share by its number of rows.
    """
    o, m = scene.o, scene.o.measurements
    cases, case = m.cases, m.case
    lost = dof / max(o.rows, 1)
    direction, level = _directions(cases.wrench)
    parts: dict[str, NDArray[np.str_]] = {
        "by_experiment": np.array(m.experiments)[cases.experiment[case]],
        "by_direction": direction[case],
        "by_level": level[case],
        "by_branch": _branches(scene)[case],
        "by_point": m.point,
        "by_step": np.char.mod("%d", cases.step)[case],
    }
    if np.isfinite(cases.time_s).all() and np.ptp(cases.time_s) > 0:
        parts["by_time"] = _time_bins(cases.time_s)[case]
    squares = (residual[: 3 * case.size].reshape(-1, 3) ** 2).sum(axis=1)
    rising = np.argsort(cases.step[case], kind="stable")
    out = {name: _table(labels[rising], squares[rising], lost, o.sigma_p) for name, labels in parts.items()}
    out["by_joint"] = _joints(scene, residual)
    return out


def _table(labels: NDArray[np.str_], squares: Array, lost: float, sigma: float) -> list[Place]:
    names, first, inverse, count = np.unique(labels, return_index=True, return_inverse=True, return_counts=True)
    total = np.bincount(inverse.reshape(-1), squares)
    return [
        Place(str(names[k]), float(np.sqrt(total[k] / count[k])) * sigma * 1e3, float(total[k] / (3 * count[k] * lost)))
        for k in np.argsort(first)
    ]


def _joints(scene: Scene, residual: Array) -> list[Place]:
    """The part of every step's residual that a deflection of each joint would make."""
    m, arm = scene.o.measurements, scene.model.structure.arm
    out = []
    for i, name in enumerate(arm.joint_names):
        raw = scene.joint_columns[i][:3].T
        r = residual[: 3 * m.case.size].reshape(-1, 3)
        along = np.bincount(m.case, (raw * r).sum(axis=1), minlength=m.cases.number)
        size = np.bincount(m.case, (raw**2).sum(axis=1), minlength=m.cases.number)
        points = np.bincount(m.case, minlength=m.cases.number)
        read = size > 0
        energy = along[read] ** 2 / size[read]
        rms = float(np.sqrt((energy / points[read]).mean())) * scene.o.sigma_p * 1e3
        out.append(Place(name, rms, float(energy.mean())))
    return out


def _directions(wrench: Array) -> tuple[NDArray[np.str_], NDArray[np.str_]]:
    """Words for the direction and the level of every case's load."""
    size_f, size_m = np.linalg.norm(wrench[:3], axis=0), np.linalg.norm(wrench[3:], axis=0)
    direction, level = [], []
    for k in range(wrench.shape[1]):
        if size_f[k] == 0 and size_m[k] == 0:
            direction.append("unloaded")
            level.append("unloaded")
            continue
        v, kind = (wrench[:3, k] / size_f[k], "force") if size_f[k] > 0 else (wrench[3:, k] / size_m[k], "torque")
        axis = int(np.abs(v).argmax())
        words = ("+x", "-x", "+y", "-y", "up", "down")[2 * axis + (0 if v[axis] > 0 else 1)]
        direction.append(f"{kind} {words}" if np.abs(v[axis]) > 0.9 else f"{kind} oblique, mostly {words}")
        level.append(f"{short(size_f[k])} N" if kind == "force" else f"{short(size_m[k])} N m")
    return np.array(direction), np.array(level)


def short(value: float, digits: int = 3) -> str:
    """A number with so many significant digits, and no exponent where it is of a usual size."""
    return f"{float(f'{value:.{digits}g}'):g}"


def _branches(scene: Scene) -> NDArray[np.str_]:
    """Whether a step's load grew or fell against the step before."""
    c = scene.cases
    order = np.lexsort((c.step, c.experiment))
    size = np.linalg.norm(c.wrench, axis=0)[order]
    change = np.diff(size, prepend=0.0)
    change[np.diff(c.experiment[order], prepend=-1) != 0] = 0.0
    words = np.empty(size.size, dtype="<U10")
    words[order] = np.where(change > 0, "loading", np.where(change < 0, "unloading", "level"))
    return words


def _time_bins(time: Array) -> NDArray[np.str_]:
    edges = np.linspace(time.min(), time.max(), _BINS + 1)
    place = np.clip(np.digitize(time, edges) - 1, 0, _BINS - 1)
    return np.array([f"{edges[k] / 3600:.2f} to {edges[k + 1] / 3600:.2f} h" for k in range(_BINS)])[place]


def in_words(process: Process, rest_per_dof: float, sigma_mm: float) -> str:
    """Where the remainder lives and of what shape it is, in one sentence; sigma are those of the noise beside what is explained."""
    noise = max(process.floor, 1e-12)
    shares = {name: process.at(name) for name in dict.fromkeys(f.where for f in process.families)}
    total = sum(shares.values())
    if total < _VISIBLE * noise or rest_per_dof < noise:
        return "nowhere in particular: the residual looks like noise"
    lines = []
    for name in sorted(shares, key=lambda name: -shares[name])[:_MOST_PLACES]:
        share = shares[name]
        if share < max(_VISIBLE * noise, _SHARE * total):
            break
        rms = float(np.sqrt(share / process.families[0].columns.shape[0] * 3)) * sigma_mm
        lines.append(f"{name}, {_shape(process, name)}; {rms:.3f} mm rms, {np.sqrt(share / noise):.0f} sigma")
        total -= share
    rest = "; elsewhere noise" if lines and total < _VISIBLE * noise else ""
    return (" and ".join(lines) or "spread over several places") + rest


def floor_in_words(process: Process, sigma_mm: float) -> str:
    """Where nothing else shows the noise: whether any smooth function gets down to the stated one; empty if it does."""
    from scipy.special import chdtrc

    if process.dof <= 1 or chdtrc(process.dof, process.floor * process.dof) > _IMPLAUSIBLE:
        return ""
    stated, left = np.sqrt(3) * sigma_mm, np.sqrt(3 * process.floor) * sigma_mm
    return (
        f"; no smooth function of angles, torques and time gets below {left:.3f} mm rms, while the stated noise is {stated:.3f}: it is "
        "too small, or the arm does not come back to a posture so exactly (repeated readings and several points would tell)"
    )


def _shape(process: Process, name: str) -> str:
    """The shape that carries most of what is explained at a place."""
    energy: dict[str, float] = {}
    start = 0
    for family in process.families:
        weight = process.weight[start : start + family.columns.shape[1]]
        start += weight.size
        if family.where != name:
            continue
        for shape, w, length in zip(family.shapes, weight, np.linalg.norm(family.columns, axis=0), strict=True):
            energy[shape] = energy.get(shape, 0.0) + float((w * length) ** 2)
    return max(energy, key=lambda s: energy[s])
