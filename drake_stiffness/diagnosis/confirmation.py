"""Proof on readings that took no part: the gap before and after, placebos, and what any model could still explain."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from drake_stiffness.diagnosis.evidence import left_over
from drake_stiffness.diagnosis.generic import Process
from drake_stiffness.diagnosis.naming import Remaining
from drake_stiffness.diagnosis.signatures import signature
from drake_stiffness.effects import Effect
from drake_stiffness.identification import Solution
from drake_stiffness.observation import Observations, columns, measured, predicted
from drake_stiffness.rotations import Array

PLACEBOS = 200


@dataclass(frozen=True)
class HeldOut:
    """Readings that neither chose nor fitted anything, under one model.

    Attributes
    ----------
    rms_mm : float
        Length of the 3-D residual, references taken off.
    chi2, dof : float, int
        Sum of squares in units of the stated noise; the variance of their own reference is in it.
    p_value : float
        That noise and the parameters' uncertainty leave as much; in units of the noise the data show where that is asked.
    surprise : float
        Twice the negative log density of the readings under noise and the parameters' uncertainty, but for a constant: what
        models are compared by.
    """

    rms_mm: float
    chi2: float
    dof: int
    p_value: float
    surprise: float

    @property
    def per_dof(self) -> float:
        return self.chi2 / self.dof if self.dof > 0 else float("nan")


def held_out(solution: Solution, o: Observations, noise_ratio: float = 1.0) -> tuple[HeldOut, Array]:
    """The gap on held-out observations, and the residual itself.

    The residual's covariance is I + A C A^T with C the parameters' covariance (seed eq. 14): its squared length in that
    metric is chi-square distributed where the model is true.
    """
    from scipy.special import chdtrc

    model, view = solution.model, solution.identifiability
    residual = measured(o) - predicted(o, model)
    A = columns(o, model) @ view.seen
    dof = o.rows - o.references
    part = A.T @ residual
    G = np.diag(view.weight**2) + A.T @ A
    inflated = float(residual @ residual) - float(part @ np.linalg.solve(G, part))
    spread = float(np.linalg.slogdet(G)[1]) - 2 * float(np.log(view.weight).sum())  # log |I + A C A^T|
    readings = o.measurements.case.size
    rms = float(np.sqrt((residual[: 3 * readings] ** 2).sum() / max(readings, 1))) * o.sigma_p * 1e3
    p_value = float(chdtrc(dof, inflated / noise_ratio**2)) if dof > 0 else float("nan")
    surprise = inflated / noise_ratio**2 + spread
    return HeldOut(rms, float(residual @ residual), dof, p_value, surprise), residual


def placebo_share(left: Remaining, effect: Effect, seed: int) -> tuple[float, int]:
    """How many placebos explain as much as the effect does, as a share, and how many were tried.

    A placebo is the effect with what drives it - angle, torque, time - taken from another experiment: the rows of its
    signature change places between experiments of equal shape.
    """
    o = left.scene.o
    S = signature(left.scene, effect)
    true = _explained(left, S)
    blocks = [np.flatnonzero(o.cluster == e) for e in np.unique(o.cluster)]
    by_size: dict[int, list[np.ndarray]] = {}
    for block in blocks:
        by_size.setdefault(block.size, []).append(block)
    movable = [group for group in by_size.values() if len(group) > 2]
    if not movable:
        return float("nan"), 0
    rng = np.random.default_rng(seed)
    as_good = 0
    for _ in range(PLACEBOS):
        other = _exchanged(S, movable, rng)
        if _same(other, S):
            # What drives it runs alike in every experiment, as time does: then it is the order of steps that is shuffled.
            other = _shuffled(S, o.cluster, o.measurements.case, rng)
        as_good += _explained(left, other) >= true
    return (1 + as_good) / (1 + PLACEBOS), PLACEBOS


def _exchanged(S: Array, movable: list[list[np.ndarray]], rng: np.random.Generator) -> Array:
    """Rows change places between experiments of equal shape."""
    other = S.copy()
    for group in movable:
        for place, source in enumerate(rng.permutation(len(group))):
            other[group[place]] = S[group[source]]
    return other


def _shuffled(S: Array, experiment: np.ndarray, case: np.ndarray, rng: np.random.Generator) -> Array:
    """Steps change places inside their experiment; rows of orientation, if any, stay."""
    other = S.copy()
    positions = 3 * case.size
    for e in np.unique(experiment[:positions]):
        rows = np.flatnonzero(experiment[:positions] == e).reshape(-1, 3)
        steps = [rows[case[rows[:, 0] // 3] == c] for c in np.unique(case[rows[:, 0] // 3])]
        if len({s.shape for s in steps}) > 1:
            continue
        for place, source in enumerate(rng.permutation(len(steps))):
            other[steps[place].ravel()] = S[steps[source].ravel()]
    return other


def _same(a: Array, b: Array) -> bool:
    return float((a * b).sum()) > 0.9 * float(np.linalg.norm(a) * np.linalg.norm(b))


def _explained(left: Remaining, S: Array) -> float:
    rest = left_over(S, left.Q)
    return float((rest.T @ left.r) @ np.linalg.lstsq(rest.T @ rest, rest.T @ left.r, rcond=1e-12)[0])


def still_explainable(process: Process, o: Observations, residual: Array) -> float:
    """Squared sigma of held-out readings that a Gaussian process of the remainder predicts; negative if it misleads."""
    return float(residual @ residual) - float(((residual - process.predict(o)) ** 2).sum())
