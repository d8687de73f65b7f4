"""Which postures keep clear: floor, keep-out boxes, the arm's own body, the tracker's sight, singular postures.

The arm is a chain of sticks between its joint frames, with spokes from the flange to tool, load and reference points. It is a
rule of thumb for choosing measurement postures, no collision check: bodies have thickness, and cables hang.
"""

from __future__ import annotations

from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from drake_stiffness.arm import Arm, Poses, forward, joint_jacobian
from drake_stiffness.design.settings import Design, SightCone
from drake_stiffness.rotations import Array

# Points on every stick; a box thinner than a tenth of a stick can slip between.
_SAMPLES = 11
# Sticks that end nearer to the flange than this many clearances, along the chain, are always close to it: the wrist.
_APART = 2.0


def reach(arm: Arm) -> float:
    """Length of the stretched arm, m."""
    return float(np.linalg.norm(arm.p_PF, axis=1).sum())


def acceptable(arm: Arm, settings: Design, q: Array, p_EP: Array, p_ELoad: Array, p_ETip: Array) -> NDArray[np.bool_]:
    """(N,) which postures `q (n, N)` may be measured.

    Parameters
    ----------
    p_EP : (P, 3)
        Reference points; p_ELoad, p_ETip : (3,) load point and tool centre point; all in the flange frame, m.
    """
    poses = forward(arm, q)
    N = q.shape[1]
    frames = _frames(poses, N)
    tips = poses.points(np.vstack([p_EP, p_ELoad, p_ETip]))
    sticks = np.concatenate([_sampled(a, b) for a, b in pairwise(frames)])
    spokes = np.concatenate([_sampled(frames[-1], tip) for tip in tips])
    everything = np.concatenate([sticks, spokes])
    keep = np.ones(N, dtype=bool)
    for box in settings.keep_out_boxes:
        low, high = np.array(box.min_m)[:, None], np.array(box.max_m)[:, None]
        keep &= ~((everything >= low) & (everything <= high)).all(axis=1).any(axis=0)
    size = float(np.linalg.norm(arm.gravity))
    floor = settings.floor_m
    if floor is None and size > 0:
        # The plane the arm stands on; an arm that hangs or stands on a wall has none unless it is stated.
        floor = 0.0 if arm.gravity[2] < -0.9 * size else None
    if floor is not None:
        keep &= (np.concatenate([frames[1:], tips])[:, 2] >= floor).all(axis=0)
    clearance = 0.1 * reach(arm) if settings.clearance_m is None else settings.clearance_m
    if clearance > 0:
        to_flange = np.cumsum(np.linalg.norm(arm.p_PF, axis=1)[::-1])[::-1]
        behind = int((to_flange >= _APART * clearance).sum())
        keep &= _own_distance(frames[:behind], np.concatenate([frames[-1:], tips])) >= clearance
    if settings.tracker is not None:
        keep &= _in_sight(settings.tracker, tips[: p_EP.shape[0]])
    if settings.singular_margin > 0:
        J = joint_jacobian(arm, poses, poses.p_E).transpose(2, 1, 0).copy()
        J[:, 3:] *= arm.length_m
        J *= np.where(arm.prismatic, 1.0, 1.0 / arm.length_m)
        keep &= np.linalg.svd(J, compute_uv=False)[:, min(J.shape[1:]) - 1] >= settings.singular_margin
    return keep


def _frames(poses: Poses, N: int) -> Array:
    """Origins of base, all joint frames and flange, (n + 2, 3, N)."""
    origins = [np.zeros((3, N)), *(np.broadcast_to(p, (3, N)) for p in poses.p_J), poses.p_E]
    return np.stack(origins)


def _sampled(a: Array, b: Array) -> Array:
    """Points on the way from a to b, (samples, 3, N)."""
    share = np.linspace(0.0, 1.0, _SAMPLES)[:, None, None]
    return a + share * (b - a)


def _own_distance(behind: Array, points: Array) -> Array:
    """(N,) smallest distance of points (P, 3, N) from the sticks between frames (F, 3, N), m; infinite without sticks."""
    smallest = np.full(points.shape[2], np.inf)
    for a, b in pairwise(behind):
        along = b - a
        square = np.maximum((along**2).sum(axis=0), 1e-12)
        share = np.clip(((points - a) * along).sum(axis=1) / square, 0.0, 1.0)
        nearest = a + share[:, None] * along
        smallest = np.minimum(smallest, np.sqrt(((points - nearest) ** 2).sum(axis=1)).min(axis=0))
    return smallest


def _in_sight(tracker: SightCone, points: Array) -> NDArray[np.bool_]:
    """(N,) whether all points `(P, 3, N)` lie in the tracker's cone."""
    place = np.array(tracker.position_m)
    axis = np.array(tracker.towards_m) - place
    ray = points - place[:, None]
    cosine = np.einsum("c,pcn->pn", axis / np.linalg.norm(axis), ray) / np.maximum(np.linalg.norm(ray, axis=1), 1e-9)
    return np.asarray((cosine >= np.cos(np.radians(tracker.half_angle_deg))).all(axis=0))
