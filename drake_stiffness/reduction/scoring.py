"""The score of a fitted model on held-out experiments, and what its error is made of.

The mean square of the held-out error is split into three parts:

    noise       3 sigma^2 (1 + 1 / n0): a reading and, in displacement mode, the mean of the n0 unloaded ones it refers to
    variance    trace of J C J^T: what the covariance C of the fitted parameters makes of these postures
    bias        the rest: what the model cannot say, however well it is measured (zero where noise and variance exceed the whole)

More parameters buy less bias for more variance; the best model is where the sum is least. C is that of the unconstrained fit.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from drake_stiffness import statistics as st
from drake_stiffness.campaign import Measurements
from drake_stiffness.model import Model
from drake_stiffness.observation import Observations
from drake_stiffness.reduction.elimination import Fall
from drake_stiffness.rotations import Array
from drake_stiffness.support import displacement_support, position_support


@dataclass(frozen=True, eq=False)
class Row:
    """One method's result.

    Attributes
    ----------
    method, label : str
    model : Model or None
        Fitted, with statistics; None where the method failed.
    parameters : int
        Compliances and other elastic parameters that are free.
    combinations : int
        How many combinations of all parameters were fitted.
    error_mm : (M,)
        Length of the 3-D error of every scored held-out reading.
    displacement_mm : (M,)
        The same without any spring: what there is to compensate.
    experiment : (M,)
        Which held-out experiment a reading belongs to.
    noise_mm, deviation_mm, bias_mm : float
        Root mean squares of the parts of the held-out error; bias 0 where the other two exceed the whole.
    chi2_per_dof : float
        Of the fit.
    kept, added, merged : tuple of names
    dropped : tuple of Fall
    note : str
        Why there is no model, or what is wrong with it.
    """

    method: str
    label: str
    model: Model | None
    parameters: int
    combinations: int
    error_mm: Array
    displacement_mm: Array
    experiment: NDArray[np.int_]
    noise_mm: float = float("nan")
    deviation_mm: float = float("nan")
    bias_mm: float = float("nan")
    chi2_per_dof: float = float("nan")
    kept: tuple[str, ...] = ()
    added: tuple[str, ...] = ()
    merged: tuple[str, ...] = ()
    dropped: tuple[Fall, ...] = ()
    note: str = ""

    @property
    def physical(self) -> bool:
        """Whether every compliance matrix is positive semidefinite."""
        return self.model is not None and self.model.fit["min_eigenvalue"] >= -1e-9

    @property
    def mean_mm(self) -> float:
        return float(self.error_mm.mean()) if self.error_mm.size else float("nan")

    @property
    def p95_mm(self) -> float:
        return float(np.quantile(self.error_mm, 0.95)) if self.error_mm.size else float("nan")

    @property
    def max_mm(self) -> float:
        return float(self.error_mm.max()) if self.error_mm.size else float("nan")

    @property
    def percent(self) -> float:
        """Compensated: 100 (1 - mean error / mean displacement)."""
        if not self.error_mm.size:
            return float("nan")
        return float(100.0 * (1.0 - self.error_mm.mean() / self.displacement_mm.mean()))


def scored(row: Row, model: Model, o: Observations, held: Measurements | None, displacement: bool) -> Row:
    """The row with its model and, where there are held-out readings, its score.

    Parameters
    ----------
    model : Model
        With statistics and `fit`.
    held : Measurements or None
        The held-out experiments.
    """
    row = replace(
        row,
        model=model,
        parameters=sum(len(e.parameters) for e in model.effects if e.station == "spring"),
        combinations=model.fit["rank"] - model.fit["hidden_by_noise"],
        chi2_per_dof=model.fit["chi2_per_dof"],
        note=model.impossible() or "",
    )
    if held is None:
        return row
    error = np.linalg.norm(st.held_out_errors(model, held, displacement), axis=0) * 1e3
    which, share = scored_readings(held, displacement)
    support = (displacement_support if displacement else position_support)(
        model, held.cases, held.case[which], held.point[which]
    )
    noise = 3.0 * (o.sigma_p * 1e3) ** 2 * float((1.0 + share).mean())
    variance = float((support.sigma**2).sum(axis=1).mean()) * 1e6
    bias = max(float((error**2).mean()) - noise - variance, 0.0)
    return replace(
        row,
        error_mm=error,
        noise_mm=float(np.sqrt(noise)),
        deviation_mm=float(np.sqrt(variance)),
        bias_mm=float(np.sqrt(bias)),
    )


def scored_readings(held: Measurements, displacement: bool) -> tuple[NDArray[np.int_], Array]:
    """Which readings `held_out_errors` scores, and what share of a reading's variance their reference adds (1 / readings in it)."""
    if not displacement:
        return np.arange(held.case.size), np.zeros(held.case.size)
    _, point = np.unique(held.point, return_inverse=True)
    key = held.cases.experiment[held.case] * (int(point.max()) + 1) + point.reshape(-1)
    _, group = np.unique(key, return_inverse=True)
    group, free = group.reshape(-1), held.unloaded[held.case]
    count = np.bincount(group[free], minlength=group.max() + 1)
    scored = np.flatnonzero(~free & (count[group] > 0))
    return scored, 1.0 / count[group[scored]]
