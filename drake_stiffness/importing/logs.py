"""Force logs and robot logs: one wrench and one posture per step, matched to the readings by columns, order or time."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from drake_stiffness.arm import Arm, forward
from drake_stiffness.cell import Cell
from drake_stiffness.errors import InputError
from drake_stiffness.importing.agreement import compare_with_plan
from drake_stiffness.importing.foreign_tables import check_column
from drake_stiffness.importing.map_file import ANGLES, FORCES, LENGTHS, MOMENTS, Forces, Joints, Match
from drake_stiffness.importing.matching import Steps, match_rows, nearest_names
from drake_stiffness.rotations import Array, cross, rotate, rpy_rotation
from drake_stiffness.tables import Table

# A load that changes by more than this share of itself while a step is read was not at rest.
_STEADY = 0.05
# Below this share of the largest force a step counts as unloaded.
_ZERO_SHARE = 0.02


@dataclass(frozen=True, eq=False)
class Readout:
    """What was read of the points: step and time of every sample, for logs that are matched by time."""

    case: NDArray[np.int_]
    time_s: Array
    where: str

    @property
    def used(self) -> NDArray[np.int_]:
        """Steps that have a reading."""
        return np.unique(self.case)


def rows_of_steps(
    table: Table, match: Match, steps: Steps, time_s: Array, readout: Readout, what: str
) -> list[NDArray[np.int_]]:
    """The rows of a log that belong to every step; empty for steps without a reading.

    By time, `nearest` takes the sample next to every reading of a step, `average` all samples from `window_s` before
    its first reading to `window_s` after its last.

    Raises
    ------
    InputError
        If a step has no row, a row would serve two steps, or two rows are equally near.
    """
    found: list[NDArray[np.int_]] = [np.zeros(0, dtype=int)] * steps.number
    if match.by == "time":
        by_time(table, match, steps, time_s, readout, found, what)
    else:
        case = match_rows(table, match, steps, time_s)
        for step in readout.used.tolist():
            found[step] = np.flatnonzero(case == step)
    missing = [c for c in readout.used.tolist() if not found[c].size]
    if missing:
        how = f"within {match.window_s:g} s" if match.by == "time" else f"matched by {match.by}"
        hint = " Are the clocks the same? Set time.offset_s or start." if match.by == "time" else ""
        raise InputError(f"{table.path}: no {what} for {steps.names(missing)} ({how}).{hint}")
    return found


def by_time(
    table: Table,
    match: Match,
    steps: Steps,
    time_s: Array,
    readout: Readout,
    found: list[NDArray[np.int_]],
    what: str,
) -> None:
    """Fill `found`; see `rows_of_steps`."""
    assert match.window_s is not None
    if np.isnan(readout.time_s).any():
        raise InputError(
            f"{table.path}: the {what} is matched by time, but {readout.where} has no times; give readings.time."
        )
    order = np.argsort(time_s, kind="stable")
    times = time_s[order]
    taken = np.full(times.size, -1)
    for step in readout.used.tolist():
        moments = readout.time_s[readout.case == step]
        if match.how == "nearest":
            found[step] = _nearest(table, match.window_s, steps.name(step), order, times, moments, what)
        else:
            start = np.searchsorted(times, moments.min() - match.window_s, side="left")
            end = np.searchsorted(times, moments.max() + match.window_s, side="right")
            found[step] = order[start:end]
        twice = found[step][taken[found[step]] >= 0]
        if twice.size:
            both = steps.names([int(taken[twice[0]]), step])
            raise InputError(
                f"{table.path}, line {table.lines[twice[0]]}: this {what} would serve {both}; make match.window_s "
                f"({match.window_s:g} s) smaller."
            )
        taken[found[step]] = step


def _nearest(
    table: Table, window_s: float, name: str, order: NDArray[np.int_], times: Array, moments: Array, what: str
) -> NDArray[np.int_]:
    right = np.clip(np.searchsorted(times, moments), 1, max(times.size - 1, 1))
    left = right - 1
    right = np.minimum(right, times.size - 1)
    to_left, to_right = np.abs(moments - times[left]), np.abs(moments - times[right])
    tied = (np.abs(to_left - to_right) < 1e-9) & (left != right) & (np.minimum(to_left, to_right) <= window_s)
    for moment in np.flatnonzero(tied).tolist():
        a, b = order[left[moment]], order[right[moment]]
        if table.rows[a] != table.rows[b] and to_left[moment] == 0:
            raise InputError(
                f"{table.path}, lines {table.lines[a]} and {table.lines[b]}: two different rows of the same time, "
                f"both the {what} of {name}; delete one, or use match.how: average."
            )
    pick = np.where(to_left <= to_right, left, right)
    if (np.minimum(to_left, to_right) > window_s).any():
        return np.zeros(0, dtype=int)
    return np.unique(order[pick])


def joints_of_steps(table: Table, spec: Joints, rows: list[NDArray[np.int_]], steps: Steps, arm: Arm) -> Array:
    """(n, N) joints, rad or m: the mean of a log over every experiment; NaN for experiments without readings.

    Raises
    ------
    InputError
        If a joint has no column, or the arm moved inside an experiment.
    """
    for joint in (*arm.joint_names, *spec.columns):
        if joint not in spec.columns or joint not in arm.joint_names:
            what = "has no column" if joint not in spec.columns else "is no joint of the arm"
            known = spec.columns if joint not in spec.columns else arm.joint_names
            raise InputError(f"joints.columns: '{joint}' {what}.{nearest_names([joint], list(known))}")
    unit = [LENGTHS[spec.length_unit] if prismatic else ANGLES[spec.unit] for prismatic in arm.prismatic]
    for joint in arm.joint_names:
        check_column(table, spec.columns[joint], f"joints.columns.{joint}")
    log = np.stack([table.numbers(spec.columns[name]) for name in arm.joint_names]) * np.array(unit)[:, None]
    q = np.full((arm.num_joints, steps.number), np.nan)
    for case, own in enumerate(rows):
        if own.size:
            q[:, case] = log[:, own].mean(axis=1)
    limit = np.where(arm.prismatic, 1e-3, 1.0) * np.where(arm.prismatic, 0.05, np.deg2rad(spec.same_within_deg))
    for name in dict.fromkeys(steps.experiment):
        own = np.array([c for c, e in enumerate(steps.experiment) if e == name and rows[c].size])
        if not own.size:
            continue
        mean = q[:, own].mean(axis=1, keepdims=True)
        off = np.abs(q[:, own] - mean) > limit[:, None]
        for joint, place in zip(*np.nonzero(off), strict=True):
            apart = np.rad2deg(abs(q[joint, own[place]] - mean[joint, 0]))
            raise InputError(
                f"{table.path}: experiment '{name}': joint '{arm.joint_names[joint]}' of step "
                f"{steps.step[own[place]]} is {apart:.3g} deg from the experiment's mean; an experiment is one "
                f"posture (joints.same_within_deg: {spec.same_within_deg:g})."
            )
        q[:, own] = mean
    return q


@dataclass(frozen=True, eq=False)
class Loads:
    """Wrenches (6, N) at the load point in world axes, and the largest standard deviation of a step's force, N."""

    wrench: Array
    unsteady_N: float
    notes: list[str]


def loads_of_steps(
    table: Table,
    spec: Forces,
    rows: list[NDArray[np.int_]],
    steps: Steps,
    q: Array,
    arm: Arm,
    cell: Cell,
    planned: Array | None,
) -> Loads:
    """What the sensor says of every step, turned into the world and moved to the load point.

    Parameters
    ----------
    q : (n, N) joints, for sensors that turn with the flange
    planned : (6, N), optional
        The plan's loads: they say which steps are unloaded, and are what the log is compared with.
    """
    sensor, spread = _sensor(table, spec, rows, cell)
    used = np.array([c for c in range(steps.number) if rows[c].size])
    notes: list[str] = []
    if spec.tare:
        assert planned is not None
        sensor = _tared(sensor, steps, planned, used)
    size = np.linalg.norm(sensor[:3], axis=0)
    for case in used[spread[used] > _STEADY * np.maximum(size[used], size[used].max() * _ZERO_SHARE)].tolist():
        notes.append(
            f"the force changed while {steps.name(case)} was read: {spread[case]:.3g} N about {size[case]:.4g} N"
        )
    R_axes = rpy_rotation(tuple(np.deg2rad(spec.rpy_deg)))[:, :, None]
    poses = forward(arm, np.nan_to_num(q))
    if spec.frame == "tool":
        R_axes = np.einsum("ij,jkl->ikl", rpy_rotation(tuple(np.deg2rad(cell.tool.tcp.rpy_deg))), R_axes)
    force, moment = rotate(R_axes, sensor[:3]), rotate(R_axes, sensor[3:])
    if spec.frame != "world":
        force, moment = rotate(poses.R_E, force), rotate(poses.R_E, moment)
    if spec.moments_at_m is not None:
        lever = np.array(spec.moments_at_m) - np.array(cell.load_point_m)
        moment = moment + cross(rotate(poses.R_E, lever[:, None]), force)
    wrench = np.concatenate([force, moment])
    limit = spec.zero_below_N if spec.zero_below_N is not None else _ZERO_SHARE * float(size[used].max(initial=0.0))
    small = size <= limit
    if planned is not None:
        notes += compare_with_plan(table, spec, steps, used, planned, wrench, small, limit, gravity_of(cell))
        small = small | (np.abs(planned).max(axis=0) == 0.0)
    wrench[:, small] = 0.0
    return Loads(wrench, float(spread[used].max(initial=0.0)), notes)


def _sensor(table: Table, spec: Forces, rows: list[NDArray[np.int_]], cell: Cell) -> tuple[Array, Array]:
    """(6, N) means of the log in the sensor's axes, N and N m, and (N,) the standard deviation of the force."""
    unit = gravity_of(cell) if spec.unit == "kg" else FORCES[spec.unit]
    log = np.zeros((6, len(table.rows)))
    if spec.along is not None:
        assert spec.column is not None
        check_column(table, spec.column, "forces.column")
        axis = "xyz".index(spec.along[-1])
        log[axis] = table.numbers(spec.column) * unit * (-1.0 if spec.along.startswith("-") else 1.0)
    for name, column in spec.columns.items():
        check_column(table, column, f"forces.columns.{name}")
        place = "xyz".index(name[1]) + (3 if name[0] == "m" else 0)
        log[place] = table.numbers(column) * (MOMENTS[spec.moment_unit] if place > 2 else unit)
    log *= spec.sign
    mean, spread = np.zeros((6, len(rows))), np.zeros(len(rows))
    for case, own in enumerate(rows):
        if own.size:
            mean[:, case] = log[:, own].mean(axis=1)
        if own.size > 1:
            spread[case] = float(np.linalg.norm(log[:3, own].std(axis=1, ddof=1)))
    return mean, spread


def gravity_of(cell: Cell) -> float:
    """What a kilogram weighs there, N; that of the earth for a cell without gravity."""
    return float(np.linalg.norm(cell.gravity_m_per_s2)) or 9.80665


def _tared(sensor: Array, steps: Steps, planned: Array, used: NDArray[np.int_]) -> Array:
    """What the sensor reads at the unloaded steps of an experiment is taken off all of its steps."""
    free = np.abs(planned).max(axis=0) == 0.0
    out = sensor.copy()
    names = np.array(steps.experiment)
    for name in dict.fromkeys(steps.experiment):
        own = used[names[used] == name]
        if own.size and not free[own].any():
            raise InputError(
                f"forces.tare: experiment '{name}' has no unloaded step in the plan, so nothing says the sensor's zero."
            )
        if own.size:
            out[:, own] = sensor[:, own] - sensor[:, own[free[own]]].mean(axis=1, keepdims=True)
    return out
