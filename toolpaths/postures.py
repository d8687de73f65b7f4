"""Joint positions along a path: analytic inverse kinematics (eaik) with a Newton iteration on the arm's Jacobian behind it.

The arm a controller knows is the nominal rigid one, so that is what is inverted. Joints that the program drives by words of
its own (external axes), or that the posture fixes, are given; the other six are solved for. eaik knows all branches of six
revolute joints with the geometries that industrial arms have; everything else - other geometries, external axes inside the
chain, a prismatic wrist - is solved by damped Newton steps along the path.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from drake_stiffness.arm import Arm, forward, joint_jacobian
from toolpaths.analytic import CHUNK, along_last, near, pose_error, six_axes
from toolpaths.branches import continuous, sides_of
from toolpaths.damped import damped_step

Floats = NDArray[np.float64]
Bools = NDArray[np.bool_]

# An inverse is accepted when the pose comes back to this (m and rad).
_EXACT = 1e-8
# Poses per block of the Newton iteration: neighbours on a path are near enough to start from.
_BLOCK = 64
_NEWTON_STEPS = 30
# Of so many neighbours one singular value is known; those near zero are good to this.
_KNOWN, _ROUNDING = 16, 1e-7


@dataclass(frozen=True, eq=False)
class Postures:
    """Joint positions for N flange poses.

    Attributes
    ----------
    q : (n, N)
        rad and m; NaN where a pose is out of reach.
    reached : (N,) bool
    method : str
        'eaik' or 'newton'.
    free : list of int
        The joints that were solved for.
    """

    q: Floats
    reached: NDArray[np.bool_]
    method: str
    free: list[int]


def along_path(
    arm: Arm, R_WE: Floats, p_WE: Floats, posture: Floats, given: dict[int, Floats], flips: Bools | None = None
) -> Postures:
    """Joint positions along a path, on the branch nearest to `posture` at its start and continuous from there.

    Parameters
    ----------
    R_WE, p_WE : (N, 3, 3), (N, 3)
        Flange poses of the rigid arm.
    posture : (n,)
        Picks the branch; also the position of joints beyond the six that are solved for.
    given : dict of joint number to (N,)
        Joints that the program drives.
    flips : (3, N), optional
        Where the program says that shoulder, elbow or wrist change sides (`branches.flips_along`).
    """
    q, free = driven(arm, posture, given, len(p_WE))
    solver = six_axes(arm, [j for j in range(arm.num_joints) if j not in free], free)
    if solver is None:
        return _newton_path(arm, R_WE, p_WE, posture, q, free)
    candidates = solver.candidates(R_WE, p_WE, q)
    followed = _followed(arm, free, candidates, posture, q, flips)
    R, p = along_last(R_WE), p_WE.T
    q[free] = np.nan_to_num(followed)
    step, right = _polish(arm, q, R, p, free)
    if not (right | np.isnan(followed[0])).all():
        # A nearest miss came in between: only what is a solution is followed.
        followed = _followed(arm, free, solver.checked(candidates, R_WE, p_WE, q), posture, q, flips)
        q[free] = np.nan_to_num(followed)
        step, _ = _polish(arm, q, R, p, free)
    q[free] += step
    reached: Bools = np.asarray(np.isfinite(followed).all(axis=0))
    for own in _chunks(len(p_WE)):
        reached[own] &= pose_error(forward(arm, q[:, own]), R[:, :, own], p[:, own])[1] < _EXACT
    return Postures(np.where(reached, q, np.nan), reached, "eaik", free)


def _followed(arm: Arm, free: list[int], branches: Floats, posture: Floats, q: Floats, flips: Bools | None) -> Floats:
    """Joints (6, N) of the branch that goes on from `posture`; driven joints as in `q`."""
    sides = None
    if flips is not None and flips.any():
        sides = np.zeros((3, *branches.shape[1:]), dtype=bool)
        for b in range(branches.shape[1]):
            trial = q.copy()
            trial[free] = np.nan_to_num(branches[:, b])
            sides[:, b] = sides_of(arm, free, trial)
    return continuous(branches, posture[free], arm.lower[free], arm.upper[free], sides, flips)


def _polish(arm: Arm, q: Floats, R: Floats, p: Floats, free: list[int]) -> tuple[Floats, Bools]:
    """Step (f, N) of the free joints from micrometres to rounding, and where there were no more than micrometres."""
    step, right = np.empty((len(free), q.shape[1])), np.empty(q.shape[1], dtype=bool)
    for own in _chunks(q.shape[1]):
        step[:, own], error = _newton_step(arm, q[:, own], R[:, :, own], p[:, own], free)
        right[own] = near(error)
    return step, right


def driven(arm: Arm, posture: Floats, given: dict[int, Floats], number: int) -> tuple[Floats, list[int]]:
    """Joints (n, N) with those that are not solved for in place, and the list of those that are.

    An arm of more than six joints, not all driven by the program: slides keep the posture first, then joints from the base on.
    """
    fixed = dict(given)
    spare = arm.num_joints - 6
    for joint in [i for i in range(arm.num_joints) if i not in fixed]:
        slides_left = any(p for i, p in enumerate(arm.prismatic) if i not in fixed)
        if len(fixed) < spare and (arm.prismatic[joint] or not slides_left):
            fixed[joint] = np.full(number, posture[joint])
    q = np.zeros((arm.num_joints, number))
    for joint, values in fixed.items():
        q[joint] = values
    return q, [i for i in range(arm.num_joints) if i not in fixed]


def _newton_step(arm: Arm, q: Floats, R: Floats, p: Floats, free: list[int]) -> tuple[Floats, Floats]:
    """Damped Newton step (f, N) of the free joints towards poses (3, 3, N), (3, N), and the pose error before it."""
    poses = forward(arm, q)
    twist, error = pose_error(poses, R, p)
    return damped_step(joint_jacobian(arm, poses, poses.p_E)[free], twist), error


def _newton_path(arm: Arm, R_WE: Floats, p_WE: Floats, posture: Floats, q: Floats, free: list[int]) -> Postures:
    """Newton from the posture for the first pose, then block by block from the last pose solved."""
    N, R, p = p_WE.shape[0], along_last(R_WE), p_WE.T
    reached = np.zeros(N, dtype=bool)
    start = posture[free]
    blocks = [slice(0, 1), *(slice(a, min(a + _BLOCK, N)) for a in range(1, N, _BLOCK))]
    for block in blocks:
        if block.start >= N:
            break
        q[free, block] = start[:, None]
        for _ in range(_NEWTON_STEPS):
            step, error = _newton_step(arm, q[:, block], R[:, :, block], p[:, block], free)
            if (error < _EXACT * 1e-2).all():
                break
            # Steps of more than half a radian (or half a metre) would leave the branch.
            step *= np.minimum(1.0, 0.5 / np.maximum(np.abs(step).max(axis=0), 1e-12))
            q[free, block] += step
        reached[block] = pose_error(forward(arm, q[:, block]), R[:, :, block], p[:, block])[1] < _EXACT
        solved = np.flatnonzero(reached[block])
        if solved.size:
            start = q[free, block.start + solved[-1]]
    return Postures(np.where(reached, q, np.nan), reached, "newton", free)


def outside_limits(arm: Arm, q: Floats) -> list[tuple[int, int]]:
    """(row, joint) wherever a joint stands outside its limits."""
    outside = (q < arm.lower[:, None] - 1e-9) | (q > arm.upper[:, None] + 1e-9)
    return [(int(row), int(joint)) for joint, row in zip(*np.nonzero(outside), strict=True)]


def singularity_margin(arm: Arm, q: Floats) -> Floats:
    """(N,) smallest singular value of the rigid Jacobian with translations in units of the arm's mean link length.

    It falls to zero where the arm loses a direction: corrections then need unbounded joint motion.
    """
    margin = np.empty(q.shape[1])
    for own in _chunks(q.shape[1]):
        margin[own] = _smallest(_scaled_jacobian(arm, q[:, own]))
    return margin


def least_margin(arm: Arm, q: Floats) -> float:
    """The smallest of `singularity_margin` along a path (infinite for none), for which few of them need be known.

    Singular values of two Jacobians differ by no more than the Jacobians do (Weyl), and those of neighbours differ little.
    """
    least = np.inf
    for own in _chunks(q.shape[1]):
        J = _scaled_jacobian(arm, q[:, own])
        known, N = np.arange(0, J.shape[2], _KNOWN), J.shape[2]
        margin = _smallest(J[:, :, known])
        apart = np.sqrt(((J - np.repeat(J[:, :, known], _KNOWN, axis=2)[:, :, :N]) ** 2).sum(axis=(0, 1)))
        least = min(least, float(margin.min()))
        doubtful = np.repeat(margin, _KNOWN)[:N] - apart < least + _ROUNDING
        least = min(least, float(_smallest(J[:, :, doubtful]).min(initial=np.inf)))
    return least


def _scaled_jacobian(arm: Arm, q: Floats) -> Floats:
    """Rigid Jacobian (n, 6, N) without units."""
    poses = forward(arm, q)
    J = joint_jacobian(arm, poses, poses.p_E)
    J[:, :3] /= arm.length_m
    J[np.array(arm.prismatic)] *= arm.length_m
    return J


def _smallest(J: Floats) -> Floats:
    """Smallest singular value (N,) of Jacobians (n, 6, N)."""
    own = J.transpose(2, 1, 0).copy()
    smallest = np.linalg.eigvalsh(own @ own.transpose(0, 2, 1))[:, 0]  # half the time of singular values
    return np.asarray(np.sqrt(np.maximum(smallest, 0.0)))


def _chunks(number: int) -> Iterator[slice]:
    """Poses that are worked on at a time: their arrays stay in the processor's cache."""
    return (slice(start, start + CHUNK) for start in range(0, number, CHUNK))
