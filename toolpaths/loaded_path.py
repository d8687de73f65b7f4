"""Where the arm stands along a program and what the tool carries there: poses, postures and wrenches of all corrected motions."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from drake_stiffness.errors import InputError, UntrustworthyError
from drake_stiffness.model import Model
from drake_stiffness.rotations import exponential
from toolpaths.branches import flips_along
from toolpaths.compensation import Bench, bench_of
from toolpaths.conventions import rotation_onto
from toolpaths.forces import Load, loads, wrenches
from toolpaths.history import begins, path_order
from toolpaths.linear import check_linear
from toolpaths.milling.coupling import depth_gain
from toolpaths.postures import Postures, along_path, least_margin, outside_limits, singularity_margin
from toolpaths.process import Process, external_positions, posture
from toolpaths.program import Program, line_before
from toolpaths.spin import Ride, Spin, stiffest

Floats = NDArray[np.float64]
Progress = Callable[[str, int, int], None]
SpinChoice = Literal["keep", "stiffest"]

# Below this the arm is at a singularity (see `singularity_margin`): about half a degree of a straight wrist.
SINGULAR_BELOW = 5e-3


@dataclass(frozen=True, eq=False)
class LoadedPath:
    """Attributes
    ----------
    bench : Bench
        The arm as the controller knows it.
    rows : (N,)
        Rows of the program that carry force.
    R, p : (N, 3, 3), (N, 3)
        TCP poses in the world, m.
    postures : Postures
    wrench : (6, N)
        At the TCP, world axes.
    only : (N,) bool
        Rows without an orientation of their own.
    spin : Spin, optional
        Turn of the tool about its axis, where it was chosen.
    load : Load, optional
        Where the wrench comes from, how sure it is, how it follows the depth of cut.
    depth_gain : (N,), optional
        Gain of the loop of depth and force, where there is one.
    """

    bench: Bench
    rows: NDArray[np.int_]
    R: Floats
    p: Floats
    postures: Postures
    wrench: Floats
    only: NDArray[np.bool_]
    spin: Spin | None = None
    load: Load | None = None
    depth_gain: Floats | None = None


def loaded_path(
    program: Program,
    model: Model,
    process: Process,
    progress: Progress,
    spin: SpinChoice = "keep",
    lead: Floats | None = None,
    linear: bool = False,
) -> LoadedPath:
    """Poses, postures and wrenches of all motions that carry force.

    Parameters
    ----------
    spin : 'keep' or 'stiffest'
        Whether the tool stays turned about its axis as the program says, or is turned so that the arm bends least.
    lead : (n,), optional
        Posture that the branch goes on from, where this is a piece of a longer program; default that of process.yaml.
    linear : bool
        See `compensation.Bench`.

    Raises
    ------
    InputError
        If no motion has a literal pose, or forces do not fit the program.
    UntrustworthyError
        If points are out of reach, outside limits or at a singularity.
    """
    rows = np.flatnonzero(program.corrected)
    if not rows.size:
        raise InputError(
            f"{program.path}: no linear or circular motion with a literal pose; there is nothing to correct."
        )
    start = posture(process, model)
    bench = bench_of(model, process.reference, process.geometry)
    if linear:
        check_linear(bench.loaded)
        bench = replace(bench, linear=True)
    R_all, p_all = targets(program, process, bench, start)
    given = external_positions(process, program, model, rows)
    chosen = None
    if spin == "stiffest":
        progress("choosing the turn of the tool", 0, rows.size)
        chosen = _stiffest(program, process, bench, rows, R_all, p_all, start, given)
        R_all[rows] = R_all[rows] @ about(process.spindle_axis, chosen.angle_rad)
    progress("inverse kinematics", 0, rows.size)
    begin = start if lead is None else lead
    postures = postures_on(program, model, bench, rows, R_all[rows], p_all[rows], begin, given)
    load = loads(process, program, rows, p_all, R_all[rows])
    gain = _depth_gain(program, bench, rows, postures.q, load)
    bench = bench.on_path(path_order(begins(program, rows)))
    only = _position_only(program)[rows]
    return LoadedPath(bench, rows, R_all[rows], p_all[rows], postures, load.wrench, only, chosen, load, gain)


def _depth_gain(program: Program, bench: Bench, rows: NDArray[np.int_], q: Floats, load: Load) -> Floats | None:
    """Gain (N,) of the loop of depth and force; None where the force does not follow the depth.

    Raises
    ------
    UntrustworthyError
        If the loop does not come to rest.
    """
    if load.milling is None:
        return None
    gain = depth_gain(bench.loaded, q, bench.p_ET, load.milling)
    if (gain >= 1.0).any():
        fail(
            program,
            rows[gain >= 1.0],
            f"where arm and cut drive each other: the force changes with the depth of cut by up to {gain.max():.4g} times what the arm "
            "gives back (less than 1 is needed)",
            "Cut less deep or with less feed, or where the arm is stiffer (`drake-stiffness map`).",
        )
    return gain


def _stiffest(
    program: Program,
    process: Process,
    bench: Bench,
    rows: NDArray[np.int_],
    R: Floats,
    p: Floats,
    start: Floats,
    given: dict[int, Floats],
) -> Spin:
    """The stiffest turn along the corrected motions.

    Raises
    ------
    InputError
        If lines write no orientation, so that a turn could not be printed.
    """
    only = rows[_position_only(program)[rows]]
    if only.size and not program.convention.axis_only:
        raise InputError(
            f"{program.path}, line {program.line[only[0]]}: --spin stiffest turns the tool, but {only.size} lines write no orientation of "
            "their own (this is the first); write it in every motion, or keep the spin."
        )
    axis = process.spindle_axis
    half_turn = R[rows] @ about(axis, np.full(rows.size, np.pi))
    return stiffest(
        Ride(
            bench=bench,
            R=R[rows],
            p=p[rows],
            axis=axis,
            wrench=wrenches(process, program, rows, p, R[rows]),
            wrench_turned=wrenches(process, program, rows, p, half_turn),
            start=start,
            given=given,
            flips=flips_along(program.status, rows),
        )
    )


def about(axis: Floats, angle: Floats) -> Floats:
    """Rotations (N, 3, 3) by angles (N,) about one axis (3,)."""
    return np.asarray(exponential(axis[:, None] * angle).transpose(2, 0, 1))


def targets(program: Program, process: Process, bench: Bench, start: Floats) -> tuple[Floats, Floats]:
    """TCP poses (P, 3, 3), (P, 3) in the world of all rows of the program, m.

    Where the program gives the tool's axis alone, the tool is turned about it as by the least turn from `start`.
    """
    R_WB, p_WB = process.base
    values = program.orientation
    known = np.asarray(np.isfinite(values).all(axis=1))
    R_start = bench.commanded(start[:, None])[0][:, :, 0]
    R = np.broadcast_to(R_start, (len(program), 3, 3)).copy()  # without any angles: the orientation of the posture
    R_B = program.convention.rotation(values[known])
    if program.convention.axis_only:
        axis = R_B[:, :, 2] @ R_WB.T
        turn = rotation_onto(axis) @ rotation_onto((R_start @ process.spindle_axis)[None])[0].T
        R[known] = turn @ R_start
    else:
        R[known] = R_WB @ R_B
    return R, program.position_mm * 1e-3 @ R_WB.T + p_WB


def as_programmed(program: Program, process: Process, R_BT: Floats) -> Floats:
    """Rotations (N, 3, 3) as the program's convention reads them, from those of the tool in the program's base frame."""
    if not program.convention.axis_only:
        return R_BT
    return rotation_onto(R_BT @ process.spindle_axis)


def _position_only(program: Program) -> NDArray[np.bool_]:
    return np.asarray(program.position_only | ~np.isfinite(program.orientation).all(axis=1))


def postures_on(
    program: Program,
    model: Model,
    bench: Bench,
    rows: NDArray[np.int_],
    R: Floats,
    p: Floats,
    start: Floats,
    given: dict[int, Floats],
) -> Postures:
    """Joints along the path, or the lines where there are none."""
    R_WE = R @ bench.R_ET.T
    p_WE = p - np.einsum("nij,j->ni", R_WE, bench.p_ET)
    postures = along_path(model.arm, R_WE, p_WE, start, given, flips_along(program.status, rows))
    if not postures.reached.all():
        fail(program, rows[~postures.reached], "out of reach of the arm")
    outside = outside_limits(model.arm, postures.q)
    if outside:
        joint = model.arm.joint_names[outside[0][1]]
        fail(program, rows[sorted({row for row, _ in outside})], f"outside the joint limits (first: joint '{joint}')")
    if least_margin(model.arm, postures.q) < SINGULAR_BELOW:
        margin = singularity_margin(model.arm, postures.q)
        fail(
            program,
            rows[margin < SINGULAR_BELOW],
            f"at a singularity (margin {margin.min():.2g}, at least {SINGULAR_BELOW:g} is needed)",
        )
    return postures


_ELSEWHERE = "Check workpiece, posture_deg and tool.tcp, or move the workpiece."


def fail(program: Program, rows: NDArray[np.int_], what: str, mend: str = _ELSEWHERE) -> None:
    """Refuse a program for what is wrong with some of its rows, and say how to mend it."""
    lines = list(dict.fromkeys(line_before(program.replaced, line) for line in program.line[rows].tolist()))
    shown = ", ".join(map(str, lines[:20])) + (f" and {len(lines) - 20} more" if len(lines) > 20 else "")
    raise UntrustworthyError(f"{program.path}: {len(lines)} line{'s' * (len(lines) > 1)} {what}: line {shown}. {mend}")
