"""A small reader of measurements.csv for the oracle: commanded joints in deg, forces in N, positions in mm."""

from __future__ import annotations

import csv
from collections.abc import Collection
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import numpy.typing as npt

from .beams import Array

Indices = npt.NDArray[np.intp]


@dataclass(frozen=True)
class Readings:
    """Readings, and the distinct loaded postures ("states") they were taken at.

    Attributes
    ----------
    q, wrench
        (K, n) rad and (K, 6) N, N m: the states.
    state, group
        (M,) which state a reading belongs to, and which free unloaded position (experiment and point) it shares.
    target
        (M, 3) reference point, flange frame, m.
    position
        (M, 3) reading, world, m.
    """

    q: Array
    wrench: Array
    state: Indices
    group: Indices
    target: Array
    position: Array


def read_measurements(
    path: str | Path,
    joint_names: Collection[str],
    points: dict[str, Array],
    *,
    experiments: Collection[str] | None = None,
) -> Readings:
    """Read a table; `experiments` keeps only the named ones (the rest are held out)."""
    with Path(path).open(encoding="utf-8", newline="") as file:
        rows = [row for row in csv.DictReader(file) if experiments is None or row["experiment"] in experiments]
    if not rows:
        raise ValueError(f"{path}: no reading left")
    loads = ("fx_N", "fy_N", "fz_N", "mx_Nm", "my_Nm", "mz_Nm")
    state_of: dict[tuple[float, ...], int] = {}
    group_of: dict[tuple[str, str], int] = {}
    state, group = [], []
    for row in rows:
        posture = [float(row[f"{name}_deg"]) for name in joint_names]
        key = (*posture, *(float(row.get(name) or 0.0) for name in loads))
        state.append(state_of.setdefault(key, len(state_of)))
        group.append(group_of.setdefault((row["experiment"], row["point"]), len(group_of)))
    states = np.array(list(state_of))
    return Readings(
        q=np.deg2rad(states[:, :-6]),
        wrench=states[:, -6:],
        state=np.array(state),
        group=np.array(group),
        target=np.array([points[row["point"]] for row in rows]),
        position=np.array([[float(row[f"{axis}_mm"]) for axis in "xyz"] for row in rows]) * 1e-3,
    )
