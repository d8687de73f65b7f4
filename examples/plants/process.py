"""A milling job: tool frame, workpiece frame, posture, process force. Read from process.yaml and its cell.yaml."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
import yaml

from . import rotations
from .beams import Array
from .chain import RigidChain
from .krl_reader import Program, from_frames, to_frames
from .rigid_ik import ToolFrame, solve_path, tool_poses


@dataclass(frozen=True)
class Process:
    """A milling job.

    Attributes
    ----------
    tool
        Tool frame in the flange.
    workpiece_R, workpiece_p
        The program's base in the world, m.
    posture
        (n,) joint positions that pick the branch, rad.
    wrench, frame
        (6,) constant force and moment on the tool at the TCP (N, N m), axes of "tool", "workpiece" or "world".
    """

    tool: ToolFrame
    workpiece_R: Array
    workpiece_p: Array
    posture: Array
    wrench: Array
    frame: str

    @classmethod
    def from_file(cls, path: str | Path) -> Process:
        """Read a process.yaml that names its cell; revolute arms and constant forces only.

        Raises
        ------
        ValueError
            If the force is given in path axes.
        """
        path = Path(path)
        data = yaml.safe_load(path.read_text(encoding="utf-8"))
        cell = yaml.safe_load((path.parent / data["cell"]).read_text(encoding="utf-8"))
        tcp, force = cell["tool"]["tcp"], data["force"]["constant"]
        if force["frame"] not in ("tool", "workpiece", "world"):
            raise ValueError(f"{path}: force.constant.frame must be tool, workpiece or world, found {force['frame']!r}")
        names = ("fx_N", "fy_N", "fz_N", "mx_Nm", "my_Nm", "mz_Nm")
        return cls(
            tool=ToolFrame(rotations.from_rpy_deg(np.array(tcp["rpy_deg"])), np.array(tcp["position_m"], dtype=float)),
            workpiece_R=rotations.from_rpy_deg(np.array(data["workpiece"]["rpy_deg"])),
            workpiece_p=np.array(data["workpiece"]["position_m"], dtype=float),
            posture=np.deg2rad(np.array(data["posture_deg"], dtype=float)),
            wrench=np.array([float(force.get(name, 0.0)) for name in names]),
            frame=str(force["frame"]),
        )

    def joints(self, chain: RigidChain, program: Program, near: Array | None = None) -> Array:
        """Joints (N, n) of the linear and circular poses of a program, on the branch of `near` (N, n) or `posture`."""
        R, p = to_frames(program.poses[program.cutting])
        start = self.posture if near is None else near
        return solve_path(chain, self.workpiece_R @ R, self.workpiece_p + p @ self.workpiece_R.T, start, self.tool)

    def poses(self, chain: RigidChain, q: Array, near: Array) -> Array:
        """(N, 6) poses (mm, deg; program's base) that command the joints q (N, n), angles near `near`'s (N, 6)."""
        R, p = tool_poses(chain, q, self.tool)
        return from_frames(self.workpiece_R.T @ R, (p - self.workpiece_p) @ self.workpiece_R, near)

    def world_wrench(self, chain: RigidChain, q: Array) -> Array:
        """(N, 6) the process wrench in world axes at the commanded joints q (N, n), N and N m."""
        if self.frame == "tool":
            axes, _ = tool_poses(chain, q, self.tool)
        else:
            turn = self.workpiece_R if self.frame == "workpiece" else np.eye(3)
            axes = np.broadcast_to(turn, (len(q), 3, 3))
        return np.concatenate([axes @ self.wrench[:3], axes @ self.wrench[3:]], axis=1)
