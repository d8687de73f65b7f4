"""Compensation with a segmented arm itself: the perfect program if the arm were known. Serves the oracle."""

from __future__ import annotations

import numpy as np

from .beams import Array
from .krl_reader import Program, with_poses
from .process import Process
from .replay import tool_under_load
from .rigid_ik import ToolFrame, joint_step, tool_poses, twist
from .segmented_arm import EquilibriumError, SegmentedArm


def mirror_joints(
    arm: SegmentedArm, q: Array, wrench_world: Array, tool: ToolFrame, *, tolerance: float = 1e-10
) -> Array:
    """Joints (N, n) at which the loaded tool stands where the rigid tool stands at q (N, n), sag aside.

    Iterates q_c <- q_c + J(q_c)^+ (wanted - got(q_c)) with the rigid Jacobian until the twist is below `tolerance` (m, rad);
    `got` is `replay.tool_under_load`.

    Raises
    ------
    EquilibriumError
        If it does not converge.
    """
    at_point = ToolFrame(np.eye(3), tool.p)
    wanted_R, wanted_p = tool_poses(arm.chain, q, at_point)
    corrected = np.array(q, dtype=float)
    for _ in range(30):
        R, p = tool_under_load(arm, corrected, wrench_world, at_point)
        error = twist(wanted_R, wanted_p, R, p)
        if np.abs(error).max(initial=0.0) < tolerance:
            return corrected
        corrected += joint_step(arm.chain.jacobian(corrected, tool.p), error)
    raise EquilibriumError(f"the correction does not converge: {np.abs(error).max():.3g} m or rad remain")


def compensate(arm: SegmentedArm, program: Program, process: Process, *, decimals: int = 3) -> str:
    """The text of a program corrected with `arm`; its numbers are printed like those of any other corrected program."""
    q = process.joints(arm.chain, program)
    corrected = mirror_joints(arm, q, process.world_wrench(arm.chain, q), process.tool)
    poses = np.array(program.poses)
    poses[program.cutting] = process.poses(arm.chain, corrected, program.poses[program.cutting])
    return with_poses(program, poses, decimals=decimals)
