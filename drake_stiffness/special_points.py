"""Load and reference points that show less than points in general position, and why."""

from __future__ import annotations

import numpy as np

from drake_stiffness.arm import Arm, forward
from drake_stiffness.rotations import Array, cross

# Nearer than this to an axis counts as on it, m.
_ON_AXIS = 1e-9
_POSTURES = 5


def axes_through(arm: Arm, p_E: Array) -> tuple[str, ...]:
    """Revolute joints whose axis passes through a point of the flange in every posture, base to flange.

    Parameters
    ----------
    p_E : (3,)
        In the flange frame, m.
    """
    q = np.random.default_rng(0).uniform(-1.0, 1.0, (arm.num_joints, _POSTURES))
    poses = forward(arm, q)
    place = poses.points(np.asarray(p_E, dtype=float))[0]
    names = []
    for name, prismatic, axis, on_axis in zip(arm.joint_names, arm.prismatic, poses.axis, poses.p_J, strict=True):
        lever = np.linalg.norm(cross(place - on_axis, np.broadcast_to(axis, place.shape)), axis=0)
        if not prismatic and (lever < _ON_AXIS).all():
            names.append(name)
    return tuple(names)


def motion_read(points: Array) -> int:
    """How many of the six components of the flange's motion the positions of points (P, 3) show: 3, 5 or 6."""
    spread = np.linalg.svd(points - points.mean(axis=0), compute_uv=False)
    return (3, 5, 6, 6)[int((spread > _ON_AXIS).sum())]


def why_lower(arm: Arm, load_point: Array, points: Array, *, moments: bool) -> str:
    """A sentence for a rank below that of points in general position.

    Parameters
    ----------
    load_point : (3,)
    points : (P, 3)
        Reference points; all in the flange frame, m.
    moments : bool
        Whether moments act at the load point too (a full wrench has no special load point).
    """
    reasons = []
    read = motion_read(points)
    if read == 3:
        reasons.append("one place alone is read, so rotations of the flange are not seen")
        reasons += _on_axes("it", "is not moved by a turn about it", axes_through(arm, points[0]))
    elif read == 5:
        reasons.append("the reference points lie on one line, so a rotation about that line is not seen")
        shared = [axes_through(arm, point) for point in points]
        common = tuple(name for name in shared[0] if all(name in names for names in shared))
        reasons += _on_axes("the line", "is not moved by a turn about it", common)
    if not moments:
        through = axes_through(arm, load_point)
        reasons += _on_axes(
            "the load point", "is not moved by a turn about it, and a force there has no moment about it", through
        )
        if (np.abs(points - load_point).max(axis=1) < _ON_AXIS).any() and read == 3:
            reasons.append("it is read where the force acts, so force and reading have the same lever (reciprocity)")
    if not reasons:
        return "No reason known; joint limits that leave hardly any motion have this effect."
    text = "; ".join(reasons)
    return text[0].upper() + text[1:] + "."


def _on_axes(what: str, consequence: str, joints: tuple[str, ...]) -> list[str]:
    if not joints:
        return []
    if len(joints) == 1:
        return [f"{what} lies on the axis of {joints[0]} and {consequence}"]
    return [
        f"{what} lies on the axes of {', '.join(joints[:-1])} and {joints[-1]} and {consequence.replace(' it', ' them')}"
    ]
