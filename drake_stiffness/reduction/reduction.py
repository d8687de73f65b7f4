"""Reduced models: neglecting M3 as the seed prints it (4.3), and dropping in turn. M1 and M2 are in `patterns`.

A reduced model is a model in which some compliances are free and the rest are zero: joints that are not kept have no spring, links
have the template "mask". So it is stored, predicts and compensates like any other.

M3 as printed fits a complete non-redundant model once (12), (14), takes the ratios (20), and deletes everything below the upper
threshold v0+ together. Two collinear parameters have small ratios both, so both are deleted though one of them is needed; `sequential`
drops only the worst, fits again, and repeats. The class G1~ and the lower threshold v0-, which the seed defines, play no part in
M3: what lies between the thresholds is deleted like the rest. Here v0- only sorts what was deleted.

Ratios are those of least squares: the covariance (14) is not that of a constrained estimate. The reduced model is fitted by least
squares too, which knows no limit to patterns. With fit "sdp" a kept entry off the diagonal gets both its diagonal entries back,
because no positive-semidefinite matrix has it without them.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from typing import Literal

import numpy as np

from drake_stiffness.effects.compliance import LinkCompliance, Spring
from drake_stiffness.errors import InputError, UntrustworthyError
from drake_stiffness.identification import Method, Solution, identify
from drake_stiffness.model import Model
from drake_stiffness.observation import Observations
from drake_stiffness.reduction.elimination import Fall, base, candidates, drop_at_once, drop_in_turn, ratios
from drake_stiffness.reduction.patterns import keep_only, symmetrised
from drake_stiffness.rotations import Array
from drake_stiffness.statistics import goodness
from drake_stiffness.thresholds import LOWER_RATIO, UPPER_RATIO

Progress = Callable[[str], None]
How = Literal["m3", "sequential", "base"]
# A parameter that falls only after the last refit on the loaded equilibrium is rare; more rounds than this mean a fault.
_ROUNDS = 10


@dataclass(frozen=True, eq=False)
class Reduction:
    """What a reduction left.

    Attributes
    ----------
    how : 'm3', 'sequential' or 'base' (redundant parameters only are taken away)
    solution : Solution
        Of the reduced model, fitted at the loaded equilibrium.
    kept : tuple of names
        Parameters (or whole effects) that stayed, those always kept included.
    ratio : (kept,)
        Their ratios (20) in the reduced model; NaN for what is always kept.
    dropped : tuple of Fall
        What fell, in order, with the ratio at which it fell.
    merged : tuple of names
        Redundant from the start (G3, G2): what the kept ones stand for as well.
    added : tuple of names
        Diagonal entries given back for the cone.
    inflation : float
        Factor on every sigma: root of chi-square per degree of freedom where the stated noise is rejected, else 1.
    """

    how: How
    solution: Solution
    kept: tuple[str, ...]
    ratio: Array
    dropped: tuple[Fall, ...]
    merged: tuple[str, ...]
    added: tuple[str, ...]
    inflation: float

    @property
    def model(self) -> Model:
        """The reduced model with its values."""
        return self.solution.model

    def between(self, lower: float = LOWER_RATIO, upper: float = UPPER_RATIO) -> tuple[str, ...]:
        """What was dropped out of class G1~: could become identifiable with more postures or less noise."""
        return tuple(fall.name for fall in self.dropped if lower <= fall.ratio < upper)


def neglecting(
    model: Model,
    o: Observations,
    upper: float = UPPER_RATIO,
    *,
    protect: Iterable[str] = (),
    fit: Method = "least-squares",
    complete: Solution | None = None,
    progress: Progress = lambda text: None,
) -> Reduction:
    """M3 exactly as printed (seed 4.3, steps 1 to 3): one fit, then everything below the threshold goes together."""
    return _reduce(model, o, "m3", upper, tuple(protect), fit, complete, progress)


def sequential(
    model: Model,
    o: Observations,
    upper: float = UPPER_RATIO,
    *,
    protect: Iterable[str] = (),
    fit: Method = "least-squares",
    complete: Solution | None = None,
    progress: Progress = lambda text: None,
) -> Reduction:
    """Drop the parameter of the smallest ratio, fit again, until every ratio is above the threshold.

    Parameters
    ----------
    model : Model
        With start values. Elastic effects that are no springs stand and fall as a whole; frames and geometry are always kept.
    o : Observations
    upper : float
        v0+ of the seed.
    protect : iterable of names
        Parameters, or kinds of effects, that are kept whatever their ratio.
    fit : how the reduced model is fitted; see the head of this file.
    complete : Solution, optional
        Of the complete model, where somebody has it already (`fit_complete`).

    Raises
    ------
    InputError
        If a protected name is none of the model's, or the threshold is not positive.
    UntrustworthyError
        If nothing is left, or a fit does not come to rest.
    """
    return _reduce(model, o, "sequential", upper, tuple(protect), fit, complete, progress)


def non_redundant(
    model: Model,
    o: Observations,
    *,
    fit: Method = "least-squares",
    complete: Solution | None = None,
    progress: Progress = lambda text: None,
) -> Reduction:
    """All of a complete non-redundant set (algebraic reduction alone), joints first."""
    return _reduce(model, o, "base", 0.0, (), fit, complete, progress)


def fit_complete(model: Model, o: Observations, progress: Progress = lambda text: None) -> Solution:
    """The fit of all parameters that reductions start from.

    It is the semidefinite one, so that the linearisation is taken where all compliances are physical and the loaded equilibrium
    exists; the ratios are those of least squares all the same. Patterns that no cone holds are fitted by least squares.
    """
    holdable = not any(isinstance(e, LinkCompliance) and e.template.unsupported for e in model.effects)
    return identify(model, o, "sdp" if holdable else "least-squares", progress)


def _reduce(
    model: Model,
    o: Observations,
    how: How,
    upper: float,
    protect: tuple[str, ...],
    fit: Method,
    complete: Solution | None,
    progress: Progress,
) -> Reduction:
    if not (np.isfinite(upper) and (upper > 0 or how == "base")):
        raise InputError(f"upper threshold: found {upper}; expected a number above 0 (the paper takes 5).")
    if complete is None:
        progress("fitting the complete model")
        complete = fit_complete(symmetrised(model), o, progress)
    inflation = _inflation(complete, o)
    system = candidates(complete, o, protect)
    start, redundant = base(system)
    merged = tuple(system.names[i] for i in redundant)
    falls: list[Fall] = []
    kept = start
    for _ in range(_ROUNDS):
        if how == "m3":
            kept, new = drop_at_once(system, kept, upper, inflation)
        elif how == "sequential":
            kept, new = drop_in_turn(system, kept, upper, inflation, progress)
        else:
            new = []
        falls += new
        names = [system.names[i] for i in kept] + list(system.always)
        solution, added = _fitted(complete.model, names, o, fit, how, bool(merged), progress)
        system = candidates(solution, o, protect)
        kept = [i for i, name in enumerate(system.names) if name not in added]
        ratio = ratios(system, kept) / inflation
        # The refit on the loaded equilibrium may take a parameter that just passed below the threshold.
        if how != "sequential" or (ratio >= upper).all():
            break
    shown = tuple(system.names[i] for i in kept)
    return Reduction(
        how=how,
        solution=solution,
        kept=(*system.always, *shown),
        ratio=np.concatenate([np.full(len(system.always), np.nan), ratio]),
        dropped=tuple(falls),
        merged=merged,
        added=added,
        inflation=inflation,
    )


def _fitted(
    complete: Model, names: list[str], o: Observations, fit: Method, how: How, combined: bool, progress: Progress
) -> tuple[Solution, tuple[str, ...]]:
    reduced, added = keep_only(complete, names, closed=fit == "sdp", combined=combined and fit != "sdp")
    if not any(isinstance(effect, Spring) for effect in reduced.effects):
        raise UntrustworthyError(
            f"reduction '{how}' leaves nothing: no compliance is above the threshold in this campaign. Measure more postures, lower the "
            "threshold, or protect what must stay."
        )
    progress(f"fitting {reduced.x.size} parameters")
    return identify(reduced, o, fit, progress), added


def _inflation(solution: Solution, o: Observations) -> float:
    """Root of chi-square per degree of freedom where it rejects the stated noise, else 1."""
    fit = goodness(solution, o)
    return float(np.sqrt(fit.chi2_per_dof)) if fit.rejected else 1.0
