"""The whole job of `compensate`: program in, corrected program and an honest account out."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from drake_stiffness.effects.effect import Cases
from drake_stiffness.errors import InputError, NoEquilibriumError, UntrustworthyError
from drake_stiffness.model import Model
from drake_stiffness.support import REFUSE_ABOVE, WARN_ABOVE, tool_support
from toolpaths.compensation import Bench, Corrected, deviation, mirror, reach
from toolpaths.formats import read_again
from toolpaths.loaded_path import as_programmed, fail, loaded_path, targets
from toolpaths.postures import outside_limits
from toolpaths.process import Process, check_frames, check_model
from toolpaths.program import Program, Refusal, quantum_mm
from toolpaths.result import Compensation
from toolpaths.rewriting import Rewritten, rewrite

Floats = NDArray[np.float64]
Progress = Callable[[str, int, int], None]


def silent(what: str, done: int, total: int) -> None:
    """Progress that nobody watches."""


def compensate(
    program: Program,
    model: Model,
    process: Process,
    *,
    allow_insert: bool = False,
    keep_refused: bool = False,
    progress: Progress = silent,
) -> Compensation:
    """Correct a program.

    Parameters
    ----------
    allow_insert : bool
        Insert words that a correction needs and a line does not write.
    keep_refused : bool
        Leave motions that cannot be corrected as they are instead of refusing the program.

    Raises
    ------
    InputError
        If model, process and program do not fit each other, or a motion under force cannot be corrected safely.
    UntrustworthyError
        If points are out of reach, outside limits or at a singularity; if no equilibrium exists or the iteration does not
        contract; if the model's campaign does not support the prediction.
    """
    check_model(process, model)
    wrong = model.impossible()
    if wrong is not None:
        raise UntrustworthyError(
            f"the model must not be used to machine: {wrong}. Check signs and units of the campaign's loads."
        )
    check_frames(process, program, model)
    _refuse(program, program.refusals, keep_refused)
    path = loaded_path(program, model, process, progress)
    bench, rows, postures, wrench, only = path.bench, path.rows, path.postures, path.wrench, path.only
    try:
        result = mirror(
            bench, postures.q, wrench, only, postures.free, lambda done: progress("mirror iteration", done, rows.size)
        )
    except NoEquilibriumError as error:
        raise UntrustworthyError(f"{program.path}, line {program.line[rows[error.case]]}: {error.what}") from None
    _check_result(program, model, rows, result)
    written = _write(program, process, rows, result, allow_insert)
    _refuse(program, written.refusals, keep_refused)
    progress("reading back", rows.size, rows.size)
    after, correction = _read_back(
        program, process, bench, rows, written, result, wrench, path.R, path.p, only, postures.free
    )
    sigma, unsupported = _support(program, model, rows, postures.q, wrench)
    return Compensation(
        program=program,
        parts=written.parts,
        rows=rows,
        line=program.line[rows].astype(int),
        target_mm=program.position_mm[rows],
        correction_mm=correction,
        force_N=wrench[:3].T,
        before_mm=result.before * 1e3,
        one_shot_mm=result.one_shot * 1e3,
        after_mm=after * 1e3,
        process=process,
        sigma_mm=sigma * 1e3,
        unsupported=unsupported,
        contraction=float(result.contraction.max(initial=0.0)),
        steps=result.steps,
        quantum_mm=float(np.nanmax(quantum_mm(program)[rows])),
        method=postures.method,
        refusals=(*program.refusals, *written.refusals),
        insertions=written.insertions,
        notes=_notes(model.doubts(), program, process, rows, only, sigma, unsupported, after, correction),
    )


def _refuse(program: Program, refusals: tuple[Refusal, ...], keep: bool) -> None:
    """Raise InputError for motions under force that cannot be corrected, unless they may stay."""
    bad = [r for r in refusals if r.fatal or (r.carries_force and not keep)]
    if not bad:
        return
    lines = "\n".join(
        f"{r.path or program.path}, line {r.line}{f', column {r.column}' if r.column else ''}: {r.reason}"
        for r in bad[:20]
    )
    more = f"\n... and {len(bad) - 20} more" if len(bad) > 20 else ""
    fatal = any(r.fatal for r in bad)
    mend = "" if fatal else "\nMend these lines, or leave them uncorrected with --keep-refused"
    words = " (words that are missing can be inserted with --allow-insert)" if any(r.words for r in bad) else ""
    raise InputError(f"{lines}{more}{mend}{words}." if mend else f"{lines}{more}")


def _check_result(program: Program, model: Model, rows: NDArray[np.int_], result: Corrected) -> None:
    """Refuse corrections that did not converge or that leave the limits."""
    if not result.converged.all():
        worst = float(result.contraction.max())
        fail(
            program,
            rows[~result.converged],
            f"whose mirror iteration does not come to rest (steps shrink by {worst:.2g} only)",
        )
    outside = outside_limits(model.arm, result.q)
    if outside:
        fail(program, rows[sorted({row for row, _ in outside})], "outside the joint limits once corrected")


def _write(
    program: Program, process: Process, rows: NDArray[np.int_], result: Corrected, allow_insert: bool
) -> Rewritten:
    R_WB, p_WB = process.base
    position, orientation = program.position_mm.copy(), program.orientation.copy()
    position[rows] = (result.p.T - p_WB) @ R_WB * 1e3
    R = as_programmed(program, process, np.einsum("ji,jkn->nik", R_WB, result.R))
    near = program.orientation[rows]
    known = np.isfinite(near).all(axis=1)
    orientation[rows[known]] = program.convention.near(R[known], near[known])
    change = np.zeros(len(program), dtype=bool)
    change[rows] = True
    return rewrite(program, position, orientation, change, allow_insert=allow_insert)


def _read_back(
    program: Program,
    process: Process,
    bench: Bench,
    rows: NDArray[np.int_],
    written: Rewritten,
    result: Corrected,
    wrench: Floats,
    R0: Floats,
    p0: Floats,
    only: NDArray[np.bool_],
    free: list[int],
) -> tuple[Floats, Floats]:
    """Predicted distance from the wanted place with the numbers as printed (N,), and how far they moved (N, 3) mm."""
    printed = read_again(program, written.parts)
    R, p = targets(printed, process, bench, result.q[:, 0])
    R_goal = np.where(only, R0.transpose(1, 2, 0), R[rows].transpose(1, 2, 0))
    q = reach(bench, result.q, R_goal, p[rows].T, free)
    off, _ = deviation(bench, q, wrench, R0.transpose(1, 2, 0), p0.T, only)
    return np.sqrt((off[:3] ** 2).sum(axis=0)), printed.position_mm[rows] - program.position_mm[rows]


def _support(
    program: Program, model: Model, rows: NDArray[np.int_], q: Floats, wrench: Floats
) -> tuple[Floats, Floats]:
    """Sigma (m) and unsupported share of every point; refuse what the campaign does not support.

    Every point, because one motion that rests on nothing is one too many.
    """
    support = tool_support(model, Cases(q, wrench, model.tcp[1]))
    share = support.unsupported
    if (share > REFUSE_ABOVE).any():
        fail(
            program,
            rows[share > REFUSE_ABOVE],
            f"where the model's campaign does not support the prediction (up to {100 * share.max():.0f} % of it rests on "
            "compliances that its loads and postures never showed)",
        )
    return np.sqrt((support.sigma**2).sum(axis=1)), share


def _notes(
    doubts: list[str],
    program: Program,
    process: Process,
    rows: NDArray[np.int_],
    only: NDArray[np.bool_],
    sigma: Floats,
    unsupported: Floats,
    after: Floats,
    correction: Floats,
) -> list[str]:
    notes = [f"said of the model when it was identified: {line}" for line in doubts]
    notes += [f"line {n.line}: {n.reason}" for n in program.notes[:20]]
    notes += list(program.warnings)
    driven = [f"E{i + 1}" for i in range(6) if (np.nan_to_num(program.external[rows, i]) != 0).any()]
    loose = sorted(set(driven) - {word.upper() for word in process.external_axes})
    if loose:
        notes.append(
            f"{', '.join(loose)} is driven by the program but moves nothing here; a positioner would move the workpiece"
        )
    if only.any():
        notes.append(
            f"{int(only.sum())} of {rows.size} points write no orientation: only their positions were corrected"
        )
    share = float(unsupported.max(initial=0.0))
    if share > WARN_ABOVE:
        notes.append(f"up to {100 * share:.0f} % of the prediction is not supported by the model's campaign")
    if np.isnan(sigma).all():
        notes.append("the model carries no statistics: its own uncertainty is not known")
    if process.force.table is not None and process.force.frame is None:
        notes.append("the force table was read in tool axes unless its column 'frame' says otherwise")
    if process.reference == "rigid":
        notes.append(
            "sag under weight is corrected too (reference: rigid): the robot must not have its own sag compensation on"
        )
    coarse = float(np.nanmax(quantum_mm(program)[rows]))
    largest = float(np.linalg.norm(correction, axis=1).max())
    if coarse > 0.2 * max(largest, 1e-9):
        notes.append(
            f"the program prints to {2 * coarse:g} mm, while the largest correction is {largest:.3f} mm; print more decimals"
        )
    return notes
