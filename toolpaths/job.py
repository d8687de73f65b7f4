"""The whole job of `compensate`: program in, corrected program and an honest account out."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from drake_stiffness.errors import NoEquilibriumError, UntrustworthyError
from drake_stiffness.model import Model
from toolpaths.account.account import account_of
from toolpaths.account.causes import causes_of
from toolpaths.account.notes import notes_of
from toolpaths.compensation import Corrected, mirror
from toolpaths.linear import LOOKED_AT
from toolpaths.loaded_path import LoadedPath, SpinChoice, loaded_path
from toolpaths.preflight import check_cell, check_deflection, check_force
from toolpaths.printing import read_back, write_poses
from toolpaths.probing.closed_loop import Learnt, learn
from toolpaths.probing.probe import CutWith, Probe
from toolpaths.process import Process, check_frames, check_model, posture
from toolpaths.program import Program, quantum_mm
from toolpaths.refusals import check_result, check_support, refuse
from toolpaths.result import Compensation
from toolpaths.rewriting import Rewritten
from toolpaths.rotary import declare

Floats = NDArray[np.float64]
Progress = Callable[[str, int, int], None]


def silent(what: str, done: int, total: int) -> None:
    """Progress that nobody watches."""


@dataclass(frozen=True)
class Options:
    """How a program is corrected.

    Attributes
    ----------
    allow_insert : bool
        Insert words that a correction needs and a line does not write.
    keep_refused : bool
        Leave motions that cannot be corrected as they are instead of refusing the program.
    spin : 'keep' or 'stiffest'
        Whether the tool may be turned about its axis so that the arm bends least.
    cut_with : 'uncorrected' or 'corrected'
        What cut the part that a probe has measured: the program as given, or what this job makes of it.
    """

    allow_insert: bool = False
    keep_refused: bool = False
    spin: SpinChoice = "keep"
    cut_with: CutWith = "uncorrected"


def compensate(
    program: Program,
    model: Model,
    process: Process,
    *,
    allow_insert: bool = False,
    keep_refused: bool = False,
    spin: SpinChoice = "keep",
    probe: Probe | None = None,
    cut_with: CutWith = "uncorrected",
    lead: Floats | None = None,
    linear: bool = False,
    progress: Progress = silent,
) -> Compensation:
    """Correct a program.

    Parameters
    ----------
    allow_insert, keep_refused, spin, cut_with
        See `Options`.
    probe : Probe, optional
        What was measured on the part that was cut: its deviation is corrected too.
    lead : (n,), optional
        Posture that the branch goes on from, where this is a piece of a longer program; default that of process.yaml.
    linear : bool
        Superpose deflections instead of finding the loaded equilibrium; some points are looked at with it all the same.

    Raises
    ------
    InputError
        If model, process and program do not fit each other, or a motion under force cannot be corrected safely.
    UntrustworthyError
        If points are out of reach, outside limits or at a singularity; if no equilibrium exists or the iteration does not
        contract; if the model's campaign does not support the prediction.
    """
    options = Options(allow_insert, keep_refused, spin, cut_with)
    check_model(process, model)
    program = declare(program, process.gcode, process.path)
    wrong = model.impossible()
    if wrong is not None:
        raise UntrustworthyError(
            f"the model must not be used to machine: {wrong}. Check signs and units of the campaign's loads."
        )
    check_frames(process, program, model)
    refuse(program, program.refusals, keep_refused)
    odd = check_cell(process, program, model)
    path = loaded_path(program, model, process, progress, spin, lead, linear)
    odd += check_force(program, path.rows, path.wrench, model.arm)
    start = posture(process, model)
    first = _correct(program, model, process, path, start, options, None, progress)
    learnt = None
    if probe is not None:
        seen = first.residual if cut_with == "corrected" else first.result.deflection
        cut_at = first.q if cut_with == "corrected" else path.postures.q
        by_force = causes_of(path.bench, path.postures.q, path.wrench, first.result.deflection, "").by_force
        learnt = learn(program, process, path, probe, seen, by_force, cut_at, cut_with)
        first = _correct(program, model, process, path, start, options, learnt, progress)
    return _account(program, model, process, path, first, learnt, odd)


@dataclass(frozen=True, eq=False)
class _Done:
    """One correction: what was found, written, and what the printed numbers do (see `printing.read_back`)."""

    result: Corrected
    written: Rewritten
    residual: Floats
    correction_mm: Floats
    q: Floats


def _correct(
    program: Program,
    model: Model,
    process: Process,
    path: LoadedPath,
    start: Floats,
    options: Options,
    learnt: Learnt | None,
    progress: Progress,
) -> _Done:
    rows, aim = path.rows, None if learnt is None else learnt.aim
    try:
        result = mirror(
            path.bench,
            path.postures.q,
            path.wrench,
            path.only,
            path.postures.free,
            lambda done: progress("mirror iteration", done, rows.size),
            aim,
            path.load.milling.at if path.load is not None and path.load.milling is not None else None,
        )
    except NoEquilibriumError as error:
        raise UntrustworthyError(f"{program.path}, line {program.line[rows[error.case]]}: {error.what}") from None
    check_deflection(program, rows, result.deflection)
    check_result(program, model, rows, result)
    written = write_poses(program, process, rows, result, options.allow_insert)
    refuse(program, written.refusals, options.keep_refused)
    progress("reading back", rows.size, rows.size)
    return _Done(result, written, *read_back(program, process, path, written, result, start, aim))


def looked_at(path: LoadedPath, q: Floats) -> list[str]:
    """Of a job by superposition: how far the loaded equilibrium puts the tool elsewhere, at some points."""
    if not path.bench.linear:
        return []
    some = np.unique(np.linspace(0, q.shape[1] - 1, LOOKED_AT).astype(int))
    whole = replace(path.bench, linear=False)
    places = [bench.actual(q[:, some], path.wrench[:, some])[1] for bench in (path.bench, whole)]
    apart = np.sqrt(((places[0] - places[1]) ** 2).sum(axis=0)) * 1e3
    return [
        f"deflections were superposed (--linear), which leaves out what is of second order: at {some.size} points looked at with the loaded "
        f"equilibrium the tool stands up to {apart.max():.4f} mm elsewhere than said here"
    ]


def _account(
    program: Program,
    model: Model,
    process: Process,
    path: LoadedPath,
    done: _Done,
    learnt: Learnt | None,
    odd: list[str],
) -> Compensation:
    rows, result = path.rows, done.result
    odd = [*odd, *looked_at(path, done.q)]
    measured = None if learnt is None else learnt.sigma
    account = account_of(
        program, model, process, path, result.deflection, done.residual, done.correction_mm, done.q, measured
    )
    check_support(program, rows, account.interval.unsupported)
    notes = notes_of(program, model, process, path, account, result.before * 1e3)
    return Compensation(
        program=program,
        parts=done.written.parts,
        rows=rows,
        line=program.line[rows].astype(int),
        target_mm=program.position_mm[rows],
        correction_mm=done.correction_mm,
        force_N=path.wrench[:3].T,
        deflection_mm=result.deflection.T * 1e3,
        before_mm=result.before * 1e3,
        one_shot_mm=result.one_shot * 1e3,
        after_mm=np.sqrt((done.residual**2).sum(axis=0)) * 1e3,
        process=process,
        sigma_mm=account.interval.parameters_mm,
        unsupported=account.interval.unsupported,
        contraction=float(result.contraction.max(initial=0.0)),
        steps=result.steps,
        quantum_mm=float(np.nanmax(quantum_mm(program)[rows])),
        method=path.postures.method,
        refusals=(*program.refusals, *done.written.refusals),
        insertions=done.written.insertions,
        notes=[
            *([] if path.spin is None else path.spin.notes(program)),
            *odd,
            *([] if learnt is None else learnt.notes),
            *notes,
        ],
        account=account,
        path=path,
        learnt=learnt,
        spin=path.spin,
    )
