"""Why a program is not corrected: motions that cannot be, corrections that do not come to rest, predictions without support."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from drake_stiffness.errors import InputError
from drake_stiffness.model import Model
from drake_stiffness.support import REFUSE_ABOVE
from toolpaths.compensation import Corrected
from toolpaths.loaded_path import fail
from toolpaths.postures import outside_limits
from toolpaths.program import Program, Refusal, line_before

Floats = NDArray[np.float64]
Ints = NDArray[np.int_]


def refuse(program: Program, refusals: tuple[Refusal, ...], keep: bool) -> None:
    """Raise InputError for motions under force that cannot be corrected, unless they may stay."""
    bad = [r for r in refusals if r.fatal or (r.carries_force and not keep)]
    if not bad:
        return
    lines = "\n".join(
        f"{r.path or program.path}, line {r.line}{_as_it_was(program, r.line)}{f', column {r.column}' if r.column else ''}: {r.reason}"
        for r in bad[:20]
    )
    more = f"\n... and {len(bad) - 20} more" if len(bad) > 20 else ""
    fatal = any(r.fatal for r in bad)
    mend = "" if fatal else "\nMend these lines, or leave them uncorrected with --keep-refused"
    words = " (words that are missing can be inserted with --allow-insert)" if any(r.words for r in bad) else ""
    raise InputError(f"{lines}{more}{mend}{words}." if mend else f"{lines}{more}")


def _as_it_was(program: Program, line: int) -> str:
    before = line_before(program.replaced, line)
    return f" (line {before} before arcs were replaced)" if before != line else ""


def check_result(program: Program, model: Model, rows: Ints, result: Corrected) -> None:
    """Refuse corrections that did not converge or that leave the limits."""
    if not result.converged.all():
        worst = float(result.contraction.max())
        fail(
            program,
            rows[~result.converged],
            f"whose mirror iteration does not come to rest (steps shrink by {worst:.2g} only)",
            "The arm gives too much for this force there: cut with less force, or where it is stiffer (`drake-stiffness map`).",
        )
    outside = outside_limits(model.arm, result.q)
    if outside:
        fail(program, rows[sorted({row for row, _ in outside})], "outside the joint limits once corrected")


def check_support(program: Program, rows: Ints, share: Floats) -> None:
    """Refuse what the model's campaign does not support: every point, because one motion that rests on nothing is one too many."""
    if (share > REFUSE_ABOVE).any():
        fail(
            program,
            rows[share > REFUSE_ABOVE],
            f"where the model's campaign does not support the prediction (up to {100 * share.max():.0f} % of it rests on "
            "compliances that its loads and postures never showed)",
            "Measure postures and loads like those of this program (`drake-stiffness design CELL --criterion toolpath --program PROGRAM`).",
        )
