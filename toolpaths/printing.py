"""Corrected poses as numbers of the program, and what those printed numbers really command."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from toolpaths.compensation import Corrected, deviation, reach
from toolpaths.formats import read_again
from toolpaths.loaded_path import LoadedPath, about, as_programmed, targets
from toolpaths.process import Process
from toolpaths.program import Program
from toolpaths.rewriting import Rewritten, rewrite

Floats = NDArray[np.float64]
Bools = NDArray[np.bool_]

# A pose as near as this to the computed one (m, rad) is that one as printed.
_PRINTED_M, _PRINTED_RAD = 5e-6, 5e-5
# A word that moves by less (mm; words of the orientation by as little) has not been corrected: only the way to the world and back rounds it.
_UNMOVED = 1e-9
# So many points are looked at anew, and found to agree to this (m).
_LOOKED_AT, _AGREES_M = 64, 1e-7


def write_poses(
    program: Program, process: Process, rows: NDArray[np.int_], result: Corrected, allow_insert: bool
) -> Rewritten:
    """The program with the corrected poses."""
    R_WB, p_WB = process.base
    position, orientation = program.position_mm.copy(), program.orientation.copy()
    position[rows] = (result.p.T - p_WB) @ R_WB * 1e3
    R = as_programmed(program, process, np.einsum("ji,jkn->nik", R_WB, result.R))
    near = program.orientation[rows]
    known = np.isfinite(near).all(axis=1)
    orientation[rows[known]] = program.convention.near(R[known], near[known])
    position = _kept(position, program.position_mm)
    orientation = _kept(orientation, program.orientation)
    change = np.zeros(len(program), dtype=bool)
    change[rows] = True
    return rewrite(program, position, orientation, change, allow_insert=allow_insert)


def _kept(words: Floats, before: Floats) -> Floats:
    """Words with the values they had where they differ by rounding alone: some programs print more digits than arithmetic holds."""
    return np.where(np.abs(words - before) < _UNMOVED, before, words)


def read_back(
    program: Program,
    process: Process,
    path: LoadedPath,
    written: Rewritten,
    result: Corrected,
    start: Floats,
    aim: Floats | None = None,
) -> tuple[Floats, Floats, Floats]:
    """What the printed numbers do.

    Parameters
    ----------
    start : (n,)
        The posture of process.yaml.
    aim : (3, N), optional
        Where the tool is to go instead of where the program says, less that, m, world.

    Returns
    -------
    residual : (3, N)
        Where the model puts the tool less where it is wanted, m, world.
    moved : (N, 3)
        How far the program's numbers moved, mm, its base frame.
    q : (n, N)
        Joints that the printed numbers command.
    """
    printed = read_again(program, written.parts)
    rows, bench = path.rows, path.bench
    R, p = targets(printed, process, bench, start)
    R_printed = R[rows]
    if path.spin is not None and program.convention.axis_only:  # the program does not print it
        R_printed = R_printed @ about(process.spindle_axis, path.spin.angle_rad)
    R0 = path.R.transpose(1, 2, 0)
    R_goal = np.where(path.only, R0, R_printed.transpose(1, 2, 0))
    p_goal = p[rows].T
    near = _near(result, R_goal, p_goal)
    q = reach(bench, result.q, R_goal, p_goal, path.postures.free, 1 if near.all() else 2)
    wanted = path.p.T if aim is None else path.p.T + aim
    residual = _residual(path, result, q, p_goal, R0, wanted, near)
    return residual, printed.position_mm[rows] - program.position_mm[rows], q


def _near(result: Corrected, R: Floats, p: Floats) -> Bools:
    """(N,) points whose printed pose is the computed one but for the printed digits."""
    off = np.sqrt(((p - result.p) ** 2).sum(axis=0))
    turn = np.sqrt(((R - result.R) ** 2).sum(axis=(0, 1)) / 2)
    return np.asarray((off < _PRINTED_M) & (turn < _PRINTED_RAD))


def _residual(
    path: LoadedPath, result: Corrected, q: Floats, p: Floats, R0: Floats, wanted: Floats, near: Bools
) -> Floats:
    """Where the model puts the tool less where it is wanted (3, N).

    A pose that is off by printed digits alone moves the tool by as much, and the deflection by less than a hundredth of that: there
    the equilibrium is not found anew. Some points are looked at all the same, and all where that shows that they should be.
    """
    bench = path.bench
    residual = p - result.p
    looked = np.arange(0, near.size, max(near.size // _LOOKED_AT, 1))
    seen = ~near
    seen[looked] = True
    if bench.order is not None:
        seen[:] = True
    for _ in range(2):
        rows = np.flatnonzero(seen)
        off, _ = deviation(bench, q[:, rows], path.wrench[:, rows], R0[:, :, rows], wanted[:, rows], path.only[rows])
        agrees = np.abs(residual[:, rows] + off[:3])[:, near[rows]].max(initial=0.0) < _AGREES_M
        residual[:, rows] = -off[:3]
        if agrees or seen.all():
            break
        seen[:] = True
    return residual
