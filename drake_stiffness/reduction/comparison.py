"""Reductions held against each other on held-out experiments; the recommendation follows the table.

Every method is fitted on the same experiments and scored (`scoring`) on the others, which neither chose a parameter nor fitted one.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass, replace
from functools import cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from drake_stiffness import statistics as st
from drake_stiffness.campaign import Measurements
from drake_stiffness.effects.compliance import LinkCompliance
from drake_stiffness.errors import InputError, UntrustworthyError
from drake_stiffness.identification import Method, Solution, identify
from drake_stiffness.model import Model
from drake_stiffness.observation import Observations
from drake_stiffness.reduction import patterns
from drake_stiffness.reduction import reduction as red
from drake_stiffness.reduction.beam_prior import fit_with_prior
from drake_stiffness.reduction.scoring import Row, scored, scored_readings
from drake_stiffness.rotations import Array
from drake_stiffness.start import starting_model
from drake_stiffness.task import Task
from drake_stiffness.thresholds import LOWER_RATIO, UPPER_RATIO

METHODS = {
    "joints": "joints only",
    "m1": "M1: symmetric matrices, cone",
    "m2": "M1 and M2: beam matrices, cone",
    "m3": "M3 as printed: all below v0+ at once",
    "sequential": "M3 in turn: the worst, refit, repeat",
    "base": "all non-redundant, least squares",
    "none": "all of the cell's, cone",
    "prior": "all of the cell's, cone and beam prior",
}
# Two methods tie when their held-out errors differ by less than this many standard errors of the paired difference.
_TIE = 2.0
RULE = (
    "Smallest mean held-out error wins; methods whose paired difference to it over held-out experiments is within two standard errors "
    "tie with it. Of those the one that fits the fewest combinations is recommended; where that is equal, one whose compliance matrices "
    "are positive semidefinite. A model with a compliance that is negative beyond doubt is never recommended."
)


@dataclass(frozen=True, eq=False)
class Comparison:
    """All methods on one campaign.

    Attributes
    ----------
    rows : tuple of Row
    upper, lower : float
        Thresholds v0+ and v0-.
    fitted, held : int
        Experiments that were fitted, and that scored.
    recommended : str
        Method, empty where nothing was scored.
    tied : tuple of methods
        Those within noise of the best, the best first.
    """

    rows: tuple[Row, ...]
    upper: float
    lower: float
    fitted: int
    held: int
    recommended: str
    tied: tuple[str, ...]

    def row(self, method: str) -> Row:
        """The row of a method."""
        return next(row for row in self.rows if row.method == method)

    def to_dict(self) -> dict[str, Any]:
        """What `reduce --json` writes."""
        uncompensated = self.rows[0].displacement_mm if self.rows else np.zeros(0)
        return {
            "thresholds": {"upper": self.upper, "lower": self.lower},
            "experiments": {"fitted": self.fitted, "held_out": self.held},
            "uncompensated_mean_mm": float(uncompensated.mean()) if uncompensated.size else float("nan"),
            "methods": [self._entry(row) for row in self.rows],
            "recommended": self.recommended or None,
            "within_noise_of_the_best": list(self.tied),
            "rule": RULE,
        }

    def _entry(self, row: Row) -> dict[str, Any]:
        return {
            "method": row.method,
            "label": row.label,
            "parameters": row.parameters,
            "combinations_fitted": row.combinations,
            "held_out_error_mm": {"mean": row.mean_mm, "p95": row.p95_mm, "max": row.max_mm},
            "percent_compensated": row.percent,
            "held_out_rms_mm": {"noise": row.noise_mm, "variance": row.deviation_mm, "bias": row.bias_mm},
            "chi2_per_dof": row.chi2_per_dof,
            "physical": row.physical,
            "note": row.note,
            **self.choice(row),
        }

    def choice(self, row: Row) -> dict[str, Any]:
        """Which parameters a method kept, and what became of the others."""
        return {
            "kept": list(row.kept),
            "dropped": [{"name": f.name, "ratio": f.ratio, "group": self.group(f.ratio)} for f in row.dropped],
            "merged": list(row.merged),
            "added_for_the_cone": list(row.added),
        }

    def group(self, ratio: float) -> str:
        """Class of the seed (4.1) by its two thresholds."""
        return "G1+" if ratio > self.upper else "G1-" if ratio < self.lower else "G1~"


def compare_reductions(
    task: Task,
    methods: Iterable[str] = tuple(METHODS),
    upper: float = UPPER_RATIO,
    lower: float = LOWER_RATIO,
    *,
    fit: Method = "least-squares",
    spread: float = 0.5,
    progress: Callable[[str], None] = lambda text: None,
) -> Comparison:
    """Fit every method on the experiments that take part, score it on those that do not.

    Parameters
    ----------
    methods : names of `METHODS`
        A template that is the cell's own already is left out (it is "none").
    fit : how models reduced by M3, in turn, or to a base are fitted.
    spread : float
        Of the beam prior.

    Raises
    ------
    InputError
        If a method is unknown or thresholds are not in order.
    """
    methods = tuple(methods)
    for method in methods:
        if method not in METHODS:
            raise InputError(f"method: found '{method}'; expected some of {', '.join(METHODS)}.")
    if not 0 < lower <= upper < np.inf:
        raise InputError(
            f"thresholds: found lower {lower}, upper {upper}; expected 0 < lower <= upper (the paper: 2, 5)."
        )
    o = task.observations()
    model = patterns.symmetrised(starting_model(task.model, task.taking_part()))
    held = task.held_out() if task.held.any() else None
    without, experiment = _uncompensated(model, o, held, task.displacement)
    rows: list[Row] = []

    @cache
    def complete() -> Solution:
        return red.fit_complete(model, o, progress)

    for method in methods:
        start = _start(model, method)
        if method in ("m1", "m2") and start.names == model.names:
            continue
        progress(METHODS[method])
        blank = Row(method, METHODS[method], None, 0, 0, np.zeros(0), without, experiment)
        try:
            rows.append(_row(blank, start, complete, o, held, task.displacement, upper, fit, spread, progress))
        except UntrustworthyError as error:
            rows.append(replace(blank, note=str(error)))
    recommended, tied = recommend(rows)
    number = int(task.held.sum())
    return Comparison(tuple(rows), upper, lower, task.held.size - number, number, recommended, tied)


def _start(model: Model, method: str) -> Model:
    """The model a method starts from."""
    if method == "joints":
        return patterns.joints_only(model)
    if method == "m1":
        return patterns.widened(model)
    return patterns.sparsed(model) if method == "m2" else model


def _row(
    blank: Row,
    start: Model,
    complete: Callable[[], Solution],
    o: Observations,
    held: Measurements | None,
    displacement: bool,
    upper: float,
    fit: Method,
    spread: float,
    progress: Callable[[str], None],
) -> Row:
    method = blank.method
    if method in ("m3", "sequential", "base"):
        if method == "base":
            found = red.non_redundant(start, o, fit=fit, complete=complete(), progress=progress)
        else:
            reduce = red.neglecting if method == "m3" else red.sequential
            found = reduce(start, o, upper, fit=fit, complete=complete(), progress=progress)
        solution, how = found.solution, fit
        blank = replace(blank, kept=found.kept, added=found.added, merged=found.merged, dropped=found.dropped)
    else:
        if method == "joints" and not start.x.size:
            raise UntrustworthyError("the cell has no joint springs")
        solution = complete() if method in ("none", "prior") else identify(start, o, "sdp", progress)
        how = "sdp"
        if method == "prior":
            solution = fit_with_prior(solution, o, spread, progress)
        blank = replace(blank, kept=solution.model.names)
    return scored(blank, _finished(solution, o, held, displacement, how), o, held, displacement)


def _finished(solution: Solution, o: Observations, held: Measurements | None, displacement: bool, how: str) -> Model:
    """The model with statistics and the `fit` part of model.json."""
    from drake_stiffness.semidefinite import smallest_eigenvalue

    fit = st.goodness(solution, o)
    numbers, covariance = st.statistics(solution, o, fit)
    score = float("nan") if held is None else st.rms_mm(st.held_out_errors(solution.model, held, displacement))
    entry = st.fit_entry(solution, fit, score, how, smallest_eigenvalue(solution.model), covariance)
    entry["quantity"] = "displacement" if displacement else "position"
    entry["warnings"] = _said_of_combinations(solution.model, st.warnings_of(solution, numbers, fit, o, covariance))
    return st.attach(solution, numbers, entry, {})


def _said_of_combinations(model: Model, lines: list[str]) -> list[str]:
    """Matrices whose entries stand for combinations need not be positive: that is said instead of "not physical"."""
    for effect in model.effects:
        if isinstance(effect, LinkCompliance) and effect.combined:
            found = [line for line in lines if line.startswith("NOT PHYSICAL") and f"'{effect.where}'" in line]
            lines = [line for line in lines if line not in found]
            if found:
                lines.append(
                    f"COMBINED: the entries of '{effect.where}' stand for combinations with parameters that the reduction took away as "
                    "redundant; by themselves they are no compliance matrix. Predictions use the combinations."
                )
    return lines


def _uncompensated(
    model: Model, o: Observations, held: Measurements | None, displacement: bool
) -> tuple[Array, NDArray[np.int_]]:
    """Held-out error without any spring (frames and geometry fitted), and the experiment of every scored reading."""
    if held is None:
        return np.zeros(0), np.zeros(0, dtype=int)
    alone = patterns.rigid(model)
    if alone.x.size and not displacement:
        alone = identify(alone, o, "least-squares").model
    error = np.linalg.norm(st.held_out_errors(alone, held, displacement), axis=0) * 1e3
    scored, _ = scored_readings(held, displacement)
    return error, held.cases.experiment[held.case[scored]]


def recommend(rows: Iterable[Row]) -> tuple[str, tuple[str, ...]]:
    """The recommended method and those within noise of the best (`RULE`)."""
    good = sorted((r for r in rows if r.model is not None and r.error_mm.size and not r.note), key=lambda r: r.mean_mm)
    if not good:
        return "", ()
    best = good[0]
    tied = [best] + [row for row in good[1:] if _ties(row, best)]
    order = list(METHODS)
    chosen = min(tied, key=lambda r: (r.combinations, not r.physical, order.index(r.method)))
    return chosen.method, tuple(row.method for row in tied)


def _ties(row: Row, best: Row) -> bool:
    """Paired over held-out experiments: readings of one posture are not independent."""
    number = np.bincount(best.experiment).astype(float)
    some = number > 0
    difference = np.bincount(best.experiment, weights=row.error_mm - best.error_mm)[some] / number[some]
    if difference.size < 2:
        return bool(difference.mean() <= 0)
    return bool(difference.mean() <= _TIE * difference.std(ddof=1) / np.sqrt(difference.size))
