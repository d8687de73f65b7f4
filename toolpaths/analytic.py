"""All branches of the inverse kinematics of six revolute joints, by eaik.

eaik solves arms whose axes meet or are parallel as those of industrial arms do. Joints before the six (a track, a turntable
that carries the arm) are driven by the program and move the six-joint arm as a whole.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from drake_stiffness.arm import Arm, Poses, forward
from drake_stiffness.rotations import logarithm, multiply

Floats = NDArray[np.float64]
Bools = NDArray[np.bool_]

# eaik returns nearest misses for poses out of reach; what it solves is good to well below this (m and rad).
_NEAR = 1e-5
# Poses at a time: their arrays stay in the processor's cache.
CHUNK = 5000


@dataclass(frozen=True, eq=False)
class SixAxes:
    """An arm of which six revolute joints are solved for.

    Attributes
    ----------
    arm : Arm
    free : list of int
        The six joints.
    solver : eaik robot
    R_zero, p_zero : (3, 3), (3,)
        Flange pose with all joints at zero.
    """

    arm: Arm
    free: list[int]
    solver: Any
    R_zero: Floats
    p_zero: Floats

    def branches(self, R_WE: Floats, p_WE: Floats, q: Floats) -> Floats:
        """All solutions (6, B, N) in (-pi, pi], NaN where fewer exist; parameters as for `candidates`."""
        return self.checked(self.candidates(R_WE, p_WE, q), R_WE, p_WE, q)

    def candidates(self, R_WE: Floats, p_WE: Floats, q: Floats) -> Floats:
        """What eaik returns (6, B, N): all solutions in (-pi, pi], and nearest misses where a pose is out of reach.

        Parameters
        ----------
        R_WE, p_WE : (N, 3, 3), (N, 3)
            Flange poses.
        q : (n, N)
            The driven joints; the rows of the six are not read.
        """
        N = len(p_WE)
        driven = q.copy()
        driven[self.free] = 0.0
        # Driven joints come first in the chain: they move the six-joint arm as a whole, by D(q) = X(q, 0) X(0, 0)^-1.
        moved = forward(self.arm, driven)
        R_D = np.einsum("ijn,kj->nik", moved.R_E, self.R_zero)
        p_D = moved.p_E.T - np.einsum("nij,j->ni", R_D, self.p_zero)
        poses = np.zeros((N, 4, 4))
        poses[:, :3, :3] = R_D.transpose(0, 2, 1) @ (R_WE @ self.R_zero.T)
        poses[:, :3, 3] = np.einsum("nji,nj->ni", R_D, p_WE - p_D)
        poses[:, 3, 3] = 1.0
        found = [s.Q for s in self.solver.IK_batched(poses, num_worker_threads=2)]
        counts = np.array([len(branch) for branch in found])
        most = int(counts.max(initial=1))
        out = np.full((6, max(most, 1), N), np.nan)
        full = np.flatnonzero(counts == most)
        if most and full.size:
            whole = found if full.size == N else [found[row] for row in full]
            out[:, :, full] = np.concatenate(whole).reshape(full.size, most, 6).transpose(2, 1, 0)
        for row in np.flatnonzero((counts > 0) & (counts < most)).tolist():
            out[:, : counts[row], row] = np.asarray(found[row]).T
        return out

    def checked(self, candidates: Floats, R_WE: Floats, p_WE: Floats, q: Floats) -> Floats:
        """Candidates (6, B, N) with NaN where one is no solution; parameters as for `candidates`."""
        out, R, p = candidates.copy(), along_last(R_WE), p_WE.T
        for start in range(0, len(p_WE), CHUNK):
            own = slice(start, start + CHUNK)
            trial = q[:, own].copy()
            for b in range(out.shape[1]):
                trial[self.free] = np.nan_to_num(out[:, b, own])
                wrong = ~near(pose_error(forward(self.arm, trial), R[:, :, own], p[:, own])[1])
                out[:, b, own][:, wrong] = np.nan
        return out


def six_axes(arm: Arm, fixed: list[int], free: list[int]) -> SixAxes | None:
    """The solver for an arm, or None where eaik does not know its geometry (or is not installed)."""
    if len(free) != 6 or sorted(fixed) != list(range(len(fixed))) or any(arm.prismatic[i] for i in free):
        return None
    try:
        from eaik.IK_HP import HPRobot
    except ImportError:
        return None
    zero = forward(arm, np.zeros((arm.num_joints, 1)))
    axes = np.stack([zero.axis[i][:, 0] for i in free])
    points = np.stack([zero.p_J[i][:, 0] for i in free] + [zero.p_E[:, 0]])
    solver = HPRobot(axes, np.diff(points, axis=0, prepend=np.zeros((1, 3))))
    if not solver.hasKnownDecomposition():
        return None
    return SixAxes(arm, free, solver, zero.R_E[:, :, 0], zero.p_E[:, 0])


def along_last(R: Floats) -> Floats:
    """Rotations (3, 3, N) of (N, 3, 3), in an order of memory that suits them."""
    return np.ascontiguousarray(R.transpose(1, 2, 0))


def near(error: Floats) -> Bools:
    """Whether a pose error is that of a solution of eaik's and not of a nearest miss."""
    return np.asarray(error < _NEAR)


def pose_error(poses: Poses, R_WE: Floats, p_WE: Floats) -> tuple[Floats, Floats]:
    """Twist (6, N) from the present to the wanted flange pose (3, 3, N), (3, N), and its size."""
    turn = logarithm(multiply(R_WE, poses.R_E.transpose(1, 0, 2)))
    twist = np.concatenate([p_WE - poses.p_E, turn])
    return twist, np.sqrt((twist**2).sum(axis=0))
