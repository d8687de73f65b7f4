"""What a campaign cannot show by its make: one posture, one load direction, joints that never moved, too few readings."""

from __future__ import annotations

import numpy as np

from drake_stiffness.hold_out import posture_groups
from drake_stiffness.model import Model
from drake_stiffness.observation import Observations
from drake_stiffness.rotations import Array

# Joints that stay within this (rad or m) did not move, and directions within this sine are one.
_STILL = 1e-6
_PARALLEL = 1e-3


def limits_of(o: Observations, model: Model) -> list[str]:
    """Sentences about what the plan of a campaign leaves open, most telling first."""
    cases = o.measurements.cases
    groups = posture_groups(cases)
    postures, experiments = int(groups.max()) + 1, groups.size
    lines = []
    if postures == 1:
        lines.append(
            "SINGLE POSTURE: all experiments have the same joint angles, so springs show only through the sums they make there; "
            "other postures are not supported."
        )
    elif experiments > postures:
        lines.append(
            f"REPEATED POSTURES: {experiments} experiments show {postures} postures only. Repeats average noise but bring no new "
            "information about the arm; they are kept together in hold-out and in clustered intervals."
        )
    names = model.arm.joint_names
    still = [name for name, span in zip(names, np.ptp(cases.q, axis=1), strict=True) if span < _STILL]
    if still and postures > 1:
        lines.append(
            f"NEVER MOVED: {', '.join(still)} kept {'its angle' if len(still) == 1 else 'their angles'}; springs on both sides of a joint "
            "that does not move cannot be told apart."
        )
    if _directions(cases.wrench) == 1:
        lines.append(
            "ONE LOAD DIRECTION: all applied loads act along one line; springs that they do not strain are not seen, and others "
            "merge. Add loads in other directions."
        )
    rows = o.rows - o.references
    if rows < model.x.size:
        lines.append(
            f"FEW READINGS: {rows} coordinates (references taken off) for {model.x.size} unknowns; whatever is fitted, most of them stay "
            "open."
        )
    return lines


def _directions(wrench: Array) -> int:
    """Dimension of the space that the applied wrenches (6, N) span, each force and each moment taken by itself; 0 without loads."""
    loaded = wrench[:, np.abs(wrench).max(axis=0) > 0]
    if not loaded.size:
        return 0
    singular = np.linalg.svd(loaded / np.linalg.norm(loaded, axis=0), compute_uv=False)
    return int((singular > _PARALLEL * singular[0]).sum())
