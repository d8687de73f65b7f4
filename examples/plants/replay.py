"""What the tool of the true arm really does when it mills a program, and how far that is from what was wanted.

Wanted is the pose that the original program writes. The tool stands at the pose the corrected program writes, moved by the
deflection that the load adds: loaded minus unloaded-with-weight at the same commanded joints (the reference `unloaded`: sag
is the controller's business, or was accepted). Where the controller does not correct sag, sag itself changes a little over
the correction; `sag_moves` counts that too.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from . import rotations
from .beams import Array
from .krl_reader import read_program
from .process import Process
from .rigid_ik import ToolFrame, tool_poses
from .segmented_arm import SegmentedArm


@dataclass(frozen=True)
class PathError:
    """Errors of a milled program: `position` (N, 3) in m, `rotation` (N, 3) rotation vectors in rad, world axes."""

    position: Array
    rotation: Array

    @property
    def distance_mm(self) -> Array:
        """(N,) length of the position error of each waypoint, mm."""
        return np.linalg.norm(self.position, axis=1) * 1e3

    @property
    def mean_mm(self) -> float:
        """Mean length of the position error, mm."""
        return float(self.distance_mm.mean())

    @property
    def p95_mm(self) -> float:
        """95th percentile of the length of the position error, mm."""
        return float(np.percentile(self.distance_mm, 95))

    @property
    def max_mm(self) -> float:
        """Largest position error, mm."""
        return float(self.distance_mm.max())

    @property
    def rms_mm(self) -> float:
        """Root mean square length of the position error, mm."""
        return float(np.sqrt(np.mean(self.distance_mm**2)))

    @property
    def rotation_rms_mrad(self) -> float:
        """Root mean square of the rotation error, mrad."""
        return float(np.sqrt(np.mean(np.sum(self.rotation**2, axis=1))) * 1e3)

    def percent_compensated(self, uncompensated: PathError) -> float:
        """100 (1 - mean / mean of the uncompensated program)."""
        return 100.0 * (1.0 - self.mean_mm / uncompensated.mean_mm)


def replay(
    arm: SegmentedArm,
    q_original: Array,
    q_corrected: Array,
    wrench_world: Array,
    tcp_m: Array,
    *,
    force_scale: float = 1.0,
    joint_error: Array | None = None,
    sag_moves: bool = False,
) -> PathError:
    """Mill a program on the true arm.

    Parameters
    ----------
    arm
        The true arm.
    q_original, q_corrected
        (N, n) joints commanded by the original and by the corrected program; the same array gives the uncompensated
        error.
    wrench_world
        (N, 6) process wrench at the TCP, world axes, N and N m, as the correction assumed it.
    tcp_m
        (3,) TCP in the flange frame, m.
    force_scale
        Factor on the wrench that really acts.
    joint_error
        (N, n) errors the robot makes in taking its postures (see `repeatability.joint_errors`).
    sag_moves
        Whether the change of sag from the original to the corrected posture counts as an error.
    """
    tool = ToolFrame(np.eye(3), tcp_m)
    taken = q_corrected if joint_error is None else q_corrected + joint_error
    R_wanted, p_wanted = tool_poses(arm.chain, q_original, tool)
    R_got, p_got = tool_under_load(arm, taken, force_scale * wrench_world, tool)
    if sag_moves:
        R_sag, p_sag = tool_under_load(arm, q_original, 0 * wrench_world, tool, whole=True)
        R_got, p_got = tool_under_load(arm, taken, force_scale * wrench_world, tool, whole=True)
        R_wanted, p_wanted = R_sag, p_sag
    return PathError(p_got - p_wanted, rotations.rotation_vector(R_got @ np.swapaxes(R_wanted, 1, 2)))


def tool_under_load(
    arm: SegmentedArm, q: Array, wrench_world: Array, tool: ToolFrame, *, whole: bool = False
) -> tuple[Array, Array]:
    """Tool poses (N, 3, 3), (N, 3): the rigid pose moved by what the load adds to weight, or with `whole` the true pose."""
    R, p = arm.poses(q, wrench_world, tool.p)
    p = p + R @ tool.p
    if whole:
        return R @ tool.R, p
    R_weight, p_weight = arm.poses(q)
    R_rigid, p_rigid = tool_poses(arm.chain, q, tool)
    turn = R @ np.swapaxes(R_weight, 1, 2)
    return turn @ R_rigid, p_rigid + p - (p_weight + R_weight @ tool.p)


def replay_files(
    arm: SegmentedArm,
    original: str | Path,
    corrected: str | Path,
    process: str | Path,
    *,
    force_scale: float = 1.0,
    joint_error: Array | None = None,
    sag_moves: bool = False,
) -> PathError:
    """`replay` of two KRL programs: all linear and circular poses, the corrected on the branch of the original.

    Raises
    ------
    ValueError
        If the two programs do not have the same motions.
    """
    first, second = read_program(original), read_program(corrected)
    if first.kinds != second.kinds:
        raise ValueError(f"{original} and {corrected} differ in their motions, not only in their numbers")
    job = Process.from_file(process)
    q_original = job.joints(arm.chain, first)
    q_corrected = job.joints(arm.chain, second, near=q_original)
    wrench = job.world_wrench(arm.chain, q_original)
    return replay(
        arm,
        q_original,
        q_corrected,
        wrench,
        job.tool.p,
        force_scale=force_scale,
        joint_error=joint_error,
        sag_moves=sag_moves,
    )
