"""A simulated measurement campaign: plan and true arm in, tracker readings out as a measurements.csv."""

from __future__ import annotations

import csv
import io
from dataclasses import dataclass

import numpy as np

from .beams import Array
from .repeatability import joint_errors
from .segmented_arm import SegmentedArm


@dataclass(frozen=True)
class Plan:
    """What is done: E experiments (one posture each) of S load steps.

    Attributes
    ----------
    names
        E names.
    q_deg
        (E, n) commanded joints in deg (revolute arms), as printed.
    force_N
        (E, S, 3) forces at the load point, world axes, N, as printed.
    start_s
        (E,) when each experiment starts, s.
    """

    names: tuple[str, ...]
    q_deg: Array
    force_N: Array
    start_s: Array


@dataclass(frozen=True)
class Instruments:
    """What is looked at and how well.

    Attributes
    ----------
    points
        Reference points by name, flange frame, m.
    load_point
        (3,) where the force acts, flange frame, m.
    sigma_m
        Standard deviation of one coordinate of one reading, m.
    repeatability_m
        RMS displacement of the flange by the robot's random joint error, one draw per experiment (the robot stands
        still between load steps), m. The plan's joints stay the commanded ones.
    """

    points: dict[str, Array]
    load_point: Array
    sigma_m: float
    repeatability_m: float = 0.0


def rounded(plan: Plan) -> Plan:
    """The plan as it will be printed: joints to 1e-4 deg, forces to 1e-3 N, times to 1 s."""
    return Plan(plan.names, np.round(plan.q_deg, 4), np.round(plan.force_N, 3), np.round(plan.start_s))


def simulate(arm: SegmentedArm, plan: Plan, instruments: Instruments, rng: np.random.Generator) -> Array:
    """World positions (E, S, P, 3) of the points that the tracker reads, m: true equilibria plus noise."""
    experiments, steps, _ = plan.force_N.shape
    q = np.deg2rad(plan.q_deg)
    taken = q + joint_errors(arm.chain, q, instruments.repeatability_m, rng)
    wrench = np.concatenate([plan.force_N, np.zeros_like(plan.force_N)], axis=2).reshape(-1, 6)
    targets = np.array(list(instruments.points.values()))
    exact = arm.points(np.repeat(taken, steps, axis=0), wrench, instruments.load_point, targets)
    noise = rng.normal(scale=instruments.sigma_m, size=exact.shape)
    return (exact + noise).reshape(experiments, steps, len(targets), 3)


def to_csv(plan: Plan, joint_names: tuple[str, ...], point_names: tuple[str, ...], readings: Array, note: str) -> str:
    """The table as text: one row per reading, positions in mm with five decimals, a reading every 10 s."""
    out = io.StringIO()
    table = csv.writer(out, lineterminator="\n")
    joints = [f"{name}_deg" for name in joint_names]
    table.writerow(
        ["experiment", "step", "point", "time_s", *joints, *(f"f{a}_N" for a in "xyz"), "x_mm", "y_mm", "z_mm", "note"]
    )
    for e, name in enumerate(plan.names):
        posture = [f"{value:.4f}" for value in plan.q_deg[e]]
        for s, acting in enumerate(plan.force_N[e]):
            # Adding 0.0 turns a rounded -0.0 into 0.0.
            loads = [f"{value + 0.0:.3f}" for value in acting]
            for k, point in enumerate(point_names):
                time = plan.start_s[e] + 10 * (s * len(point_names) + k)
                position = [f"{value:.5f}" for value in readings[e, s, k] * 1e3]
                table.writerow([name, s, point, f"{time:.0f}", *posture, *loads, *position, note])
    return out.getvalue()
