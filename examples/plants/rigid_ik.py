"""Inverse kinematics of the rigid chain by Newton's method, for whole arrays of tool poses."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from . import rotations
from .beams import Array
from .chain import RigidChain


class UnreachableError(ArithmeticError):
    """A pose that the rigid arm does not reach from the given start."""


@dataclass(frozen=True)
class ToolFrame:
    """The tool's frame T in the flange frame F: rotation (3, 3), position (3,) in m."""

    R: Array
    p: Array


def tool_poses(chain: RigidChain, q: Array, tool: ToolFrame) -> tuple[Array, Array]:
    """Tool poses of the rigid arm at q (N, n): R (N, 3, 3), p (N, 3) in m."""
    rotation, position = chain.flange(q)
    return rotation @ tool.R, position + rotation @ tool.p


def twist(R_to: Array, p_to: Array, R_from: Array, p_from: Array) -> Array:
    """World twist (dp; rotation vector) that leads from one pose to another, arrays of N poses -> (N, 6), m and rad."""
    turn = np.einsum("nij,nj->ni", R_from, rotations.rotation_vector(np.swapaxes(R_from, 1, 2) @ R_to))
    return np.concatenate([p_to - p_from, turn], axis=1)


def joint_step(jacobian: Array, error: Array) -> Array:
    """Smallest joint step with J dq = error, J^T (J J^T + d^2)^-1 e: (N, 6, n), (N, 6) -> (N, n).

    The damping d = 1e-4 is felt only at a singularity, such as a start with a straight wrist.
    """
    transposed = np.swapaxes(jacobian, 1, 2)
    solved = np.linalg.solve(jacobian @ transposed + 1e-8 * np.eye(6), error[..., None])
    return np.asarray((transposed @ solved)[..., 0], dtype=float)


def newton(
    chain: RigidChain,
    R: Array,
    p: Array,
    start: Array,
    tool: ToolFrame,
    *,
    tolerance: float = 1e-12,
    max_iterations: int = 60,
) -> tuple[Array, Array]:
    """Newton's iteration q <- q + J^+ e (`joint_step`) from `start` (N, n), a step held below 0.3 rad (m).

    Returns
    -------
    q (N, n) and the size of the last remaining error (N,), m or rad.
    """
    q = np.array(np.broadcast_to(start, (len(p), chain.size)), dtype=float)
    size = np.full(len(p), np.inf)
    for _ in range(max_iterations):
        R_now, p_now = tool_poses(chain, q, tool)
        error = twist(R, p, R_now, p_now)
        size = np.abs(error).max(axis=1)
        if size.max(initial=0.0) < tolerance:
            break
        step = joint_step(chain.jacobian(q, tool.p), error)
        q += step * np.minimum(1.0, 0.3 / np.maximum(np.abs(step).max(axis=1), 1e-300))[:, None]
    return q, size


def solve_path(
    chain: RigidChain, R: Array, p: Array, start: Array, tool: ToolFrame, *, tolerance: float = 1e-11, jump: float = 0.5
) -> Array:
    """Joint positions along a path of tool poses, on the branch that `start` (n,) or (N, n) picks.

    With one start posture all poses are tried from the solution of the first; those that fail, or lie more than `jump`
    (rad or m) from their predecessor, are solved again one after the other from the predecessor.

    Returns
    -------
    q (N, n).

    Raises
    ------
    UnreachableError
        If a pose cannot be reached, naming its index (from 0) and what remained.
    """
    start = np.asarray(start, dtype=float)
    alone = start.ndim == 1
    if alone:
        start, _ = newton(chain, R[:1], p[:1], start, tool)
    q, size = newton(chain, R, p, start, tool)
    for k in range(len(p)):
        jumps = alone and k > 0 and np.abs(q[k] - q[k - 1]).max() > jump
        if k > 0 and (size[k] > tolerance or jumps):
            q[k], size[k] = (value[0] for value in newton(chain, R[k : k + 1], p[k : k + 1], q[k - 1], tool))
        if size[k] > tolerance:
            raise UnreachableError(f"pose {k} is out of reach: {size[k]:.3g} m or rad remain at q = {q[k]}")
    return q
