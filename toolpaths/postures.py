"""Joint positions along a path: analytic inverse kinematics (eaik) with a Newton iteration on the arm's Jacobian behind it.

The arm a controller knows is the nominal rigid one, so that is what is inverted. Joints that the program drives by words of
its own (external axes), or that the posture fixes, are given; the other six are solved for. eaik knows all branches of six
revolute joints with the geometries that industrial arms have; everything else - other geometries, external axes inside the
chain, a prismatic wrist - is solved by damped Newton steps along the path.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from drake_stiffness.arm import Arm, forward, joint_jacobian
from drake_stiffness.rotations import logarithm, multiply

Floats = NDArray[np.float64]

# An inverse is accepted when the pose comes back to this (m and rad).
_EXACT = 1e-8
_NEAR = 1e-5
# Poses per block of the Newton iteration: neighbours on a path are near enough to start from.
_BLOCK = 64
_NEWTON_STEPS = 30


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


def along_path(arm: Arm, R_WE: Floats, p_WE: Floats, posture: Floats, given: dict[int, Floats]) -> Postures:
    """Joint positions along a path, on the branch nearest to `posture` at its start and continuous from there.

    Parameters
    ----------
    R_WE, p_WE : (N, 3, 3), (N, 3)
        Flange poses of the rigid arm.
    posture : (n,)
        Picks the branch; also the position of joints beyond the six that are solved for.
    given : dict of joint number to (N,)
        Joints that the program drives.
    """
    N = p_WE.shape[0]
    fixed = dict(given)
    spare = arm.num_joints - 6
    for joint in [i for i in range(arm.num_joints) if i not in fixed]:
        # More than six joints and not all driven by the program: slides first, then from the base on, as they stand.
        if len(fixed) < spare and (arm.prismatic[joint] or not any(_slides_left(arm, fixed))):
            fixed[joint] = np.full(N, posture[joint])
    free = [i for i in range(arm.num_joints) if i not in fixed]
    analytic = _analytic(arm, R_WE, p_WE, posture, fixed, free)
    if analytic is not None:
        return analytic
    return _newton_path(arm, R_WE, p_WE, posture, fixed, free)


def _slides_left(arm: Arm, fixed: dict[int, Floats]) -> list[bool]:
    return [p for i, p in enumerate(arm.prismatic) if i not in fixed and p]


def _analytic(
    arm: Arm, R_WE: Floats, p_WE: Floats, posture: Floats, fixed: dict[int, Floats], free: list[int]
) -> Postures | None:
    """All branches by eaik, then the continuous one; None where eaik does not know this arm."""
    prefix = sorted(fixed) == list(range(len(fixed)))
    if len(free) != 6 or not prefix or any(arm.prismatic[i] for i in free):
        return None
    try:
        from eaik.IK_HP import HPRobot
    except ImportError:
        return None

    N = p_WE.shape[0]
    zero = forward(arm, np.zeros((arm.num_joints, 1)))
    axes = np.stack([zero.axis[i][:, 0] for i in free])
    points = np.stack([zero.p_J[i][:, 0] for i in free] + [zero.p_E[:, 0]])
    robot = HPRobot(axes, np.diff(points, axis=0, prepend=np.zeros((1, 3))))
    if not robot.hasKnownDecomposition():
        return None
    # Driven joints come first in the chain: they move the six-joint arm as a whole, by D(q) = X(q, 0) X(0, 0)^-1.
    q = np.zeros((arm.num_joints, N))
    for joint, values in fixed.items():
        q[joint] = values
    moved = forward(arm, q)
    R0 = zero.R_E[:, :, 0]
    R_D = np.einsum("ijn,kj->nik", moved.R_E, R0)
    p_D = moved.p_E.T - np.einsum("nij,j->ni", R_D, zero.p_E[:, 0])
    poses = np.zeros((N, 4, 4))
    poses[:, :3, :3] = np.einsum("nji,njk,lk->nil", R_D, R_WE, R0)
    poses[:, :3, 3] = np.einsum("nji,nj->ni", R_D, p_WE - p_D)
    poses[:, 3, 3] = 1.0
    solutions = robot.IK_batched(poses, num_worker_threads=2)
    branches = _branches(arm, R_WE, p_WE, q, free, [s.Q for s in solutions])
    chosen = _continuous(branches, posture[free], arm.lower[free], arm.upper[free])
    q[free] = np.nan_to_num(chosen)
    q[free] += _newton_step(arm, q, R_WE, p_WE, free)[0]  # from micrometres to rounding
    reached = np.isfinite(chosen).all(axis=0) & (_pose_error(arm, q, R_WE, p_WE)[1] < _EXACT)
    return Postures(np.where(reached, q, np.nan), reached, "eaik", free)


def _branches(arm: Arm, R_WE: Floats, p_WE: Floats, q: Floats, free: list[int], found: list[Floats]) -> Floats:
    """Branches (6, B, N), NaN where fewer exist; only those that give the pose."""
    N = len(found)
    most = max((len(branch) for branch in found), default=0)
    out = np.full((6, max(most, 1), N), np.nan)
    for row, branch in enumerate(found):
        if len(branch):
            out[:, : len(branch), row] = np.asarray(branch).T
    for b in range(out.shape[1]):
        trial = q.copy()
        trial[free] = np.nan_to_num(out[:, b])
        # eaik also returns nearest misses for poses out of reach; what it solves is good to well below a micrometre.
        out[:, b, ~(_pose_error(arm, trial, R_WE, p_WE)[1] < _NEAR)] = np.nan
    return out


def _continuous(branches: Floats, start: Floats, lower: Floats, upper: Floats) -> Floats:
    """Row after row the branch nearest to the one before, turns chosen inside the limits where possible."""
    turn = 2 * np.pi
    out = np.full((branches.shape[0], branches.shape[2]), np.nan)
    here = start.copy()
    all_branches = np.ascontiguousarray(branches.transpose(2, 1, 0))
    low, high = lower - 1e-9, upper + 1e-9
    for row, candidates in enumerate(all_branches):
        near = candidates - turn * np.round((candidates - here) / turn)
        if row == 0:
            # Nobody starts on a turn that leaves the limits; on the way a joint cannot jump a turn, and limits are reported.
            near = np.where(near > high, near - turn * np.ceil((near - high) / turn), near)
            near = np.where(near < low, near + turn * np.ceil((low - near) / turn), near)
        distance = np.abs(near - here).sum(axis=1)
        if np.isnan(distance).all():
            continue
        here = near[np.nanargmin(distance)]
        out[:, row] = here
    return out


def _pose_error(arm: Arm, q: Floats, R_WE: Floats, p_WE: Floats) -> tuple[Floats, Floats]:
    """Twist (6, N) from the present to the wanted flange pose, and its size."""
    poses = forward(arm, q)
    turn = logarithm(multiply(R_WE.transpose(1, 2, 0), poses.R_E.transpose(1, 0, 2)))
    twist = np.concatenate([p_WE.T - poses.p_E, turn])
    return twist, np.sqrt((twist**2).sum(axis=0))


def _newton_step(arm: Arm, q: Floats, R_WE: Floats, p_WE: Floats, free: list[int]) -> tuple[Floats, Floats]:
    """Damped Newton step (f, N) of the free joints, and the pose error before it."""
    twist, error = _pose_error(arm, q, R_WE, p_WE)
    poses = forward(arm, q)
    J = joint_jacobian(arm, poses, poses.p_E)[free].transpose(2, 1, 0)
    step = solve_damped(J, twist.T)
    return step.T, error


def solve_damped(J: Floats, twist: Floats) -> Floats:
    """J^T (J J^T + d I)^-1 twist for (N, 6, f) and (N, 6), with a damping that matters at singularities only."""
    gram = J @ J.transpose(0, 2, 1)
    size = np.einsum("nii->n", gram)
    gram += (1e-12 * size)[:, None, None] * np.eye(J.shape[1])
    return np.einsum("nif,ni->nf", J, np.linalg.solve(gram, twist[:, :, None])[:, :, 0])


def _newton_path(
    arm: Arm, R_WE: Floats, p_WE: Floats, posture: Floats, fixed: dict[int, Floats], free: list[int]
) -> Postures:
    """Newton from the posture for the first pose, then block by block from the last pose solved."""
    N = p_WE.shape[0]
    q = np.repeat(posture[:, None], N, axis=1)
    for joint, values in fixed.items():
        q[joint] = values
    reached = np.zeros(N, dtype=bool)
    start = posture[free]
    blocks = [slice(0, 1), *(slice(a, min(a + _BLOCK, N)) for a in range(1, N, _BLOCK))]
    for block in blocks:
        if block.start >= N:
            break
        q[free, block] = start[:, None]
        for _ in range(_NEWTON_STEPS):
            step, error = _newton_step(arm, q[:, block], R_WE[block], p_WE[block], free)
            if (error < _EXACT * 1e-2).all():
                break
            # Steps of more than half a radian (or half a metre) would leave the branch.
            step *= np.minimum(1.0, 0.5 / np.maximum(np.abs(step).max(axis=0), 1e-12))
            q[free, block] += step
        reached[block] = _pose_error(arm, q[:, block], R_WE[block], p_WE[block])[1] < _EXACT
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
    poses = forward(arm, q)
    J = joint_jacobian(arm, poses, poses.p_E).transpose(2, 1, 0).copy()
    J[:, :3] /= arm.length_m
    for joint, prismatic in enumerate(arm.prismatic):
        if prismatic:
            J[:, :, joint] *= arm.length_m
    return np.asarray(np.linalg.svd(J, compute_uv=False)[:, 5])
