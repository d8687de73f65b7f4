"""How far an identified model can be trusted: chi-square, covariances, groups, held-out error, what to warn of."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from drake_stiffness.base_parameters import base_of
from drake_stiffness.campaign import Measurements
from drake_stiffness.effects.compliance import JointCompliance, Spring
from drake_stiffness.hold_out import posture_groups
from drake_stiffness.identifiability import classify, determined
from drake_stiffness.identification import Solution
from drake_stiffness.model import Model, Statistics
from drake_stiffness.observation import Observations
from drake_stiffness.rotations import Array
from drake_stiffness.simulation import simulate_readings
from drake_stiffness.thresholds import LOWER_RATIO, UPPER_RATIO

# The stated noise counts as rejected below this probability.
REJECTED_BELOW = 1e-3


@dataclass(frozen=True)
class GoodnessOfFit:
    """Chi-square of the fit against the stated noise.

    Attributes
    ----------
    residual_rms_mm : float
        Root mean square over readings of the length of the 3-D residual.
    chi2_per_dof, p_value : float
    dof : int
    rejected : bool
        Whether the stated noise cannot explain the residuals.
    """

    residual_rms_mm: float
    chi2_per_dof: float
    dof: int
    p_value: float
    rejected: bool


def goodness(solution: Solution, o: Observations) -> GoodnessOfFit:
    """Chi-square of whitened residuals; eliminated references and the rank count as fitted."""
    r = solution.residual
    dof = o.rows - o.references - solution.identifiability.fitted
    total = float(r @ r)
    readings = o.measurements.case.size
    rms = float(np.sqrt((r[: 3 * readings] ** 2).sum() / max(readings, 1))) * o.sigma_p * 1e3
    if dof <= 0:
        return GoodnessOfFit(rms, float("nan"), dof, float("nan"), False)
    from scipy.special import chdtrc  # the survival function of chi-square; scipy.stats takes half a second to import

    p = float(chdtrc(dof, total))
    return GoodnessOfFit(rms, total / dof, dof, p, p < REJECTED_BELOW)


def covariance(solution: Solution, o: Observations, fit: GoodnessOfFit) -> tuple[Array, str]:
    """Covariance of the determined combinations in units of scale, and how it was got.

    With the stated noise accepted this is seed eq. (14). Where chi-square rejects it, the sandwich of seed eq. (13) with the
    residuals of whole postures as its middle, so that readings of one posture need not be independent, however many experiments
    they were taken in; with fewer than two postures per combination the middle is too poor, and eq. (14) is scaled by
    chi-square instead.
    """
    view = solution.identifiability
    plain, hidden = view.covariance(), view.hidden_covariance()
    if not fit.rejected:
        return plain + hidden, "stated noise, eq. (14)"
    cluster = posture_of_rows(o)
    postures = int(cluster.max()) + 1
    if postures < 2 * view.fitted:
        return (
            plain + hidden
        ) * fit.chi2_per_dof, "eq. (14) scaled by chi-square per degree of freedom (stated noise rejected)"
    scores = (solution.A @ view.seen) * solution.residual[:, None] / view.weight**2
    order = np.argsort(cluster, kind="stable")
    starts = np.flatnonzero(np.diff(cluster[order], prepend=-1))
    sums = np.add.reduceat(scores[order], starts, axis=0)
    inflation = postures / (postures - 1) * (o.rows - 1) / max(o.rows - o.references - view.fitted, 1)
    middle = inflation * sums.T @ sums
    clustered = view.seen @ middle @ view.seen.T + fit.chi2_per_dof * hidden
    return clustered, "sandwich, eq. (13), clustered by posture (stated noise rejected)"


def posture_of_rows(o: Observations) -> NDArray[np.int_]:
    """(rows,) number of the posture of every scalar row; experiments of one posture share it."""
    return posture_groups(o.measurements.cases)[o.cluster]


def statistics(
    solution: Solution,
    o: Observations,
    fit: GoodnessOfFit,
    *,
    upper: float = UPPER_RATIO,
    lower: float = LOWER_RATIO,
) -> tuple[Statistics, str]:
    """Sigmas, groups and relations of all parameters, in SI; and how the covariance was got.

    Parameters
    ----------
    upper, lower : float
        Thresholds of the ratio (20) between G1+, G1~ and G1-.
    """
    scaled, how = covariance(solution, o, fit)
    model, view = solution.model, solution.identifiability
    known = determined(view)
    sigma = np.sqrt(np.maximum(np.diag(scaled), 0.0))
    groups = classify(view, model.x / model.scales, sigma, upper=upper, lower=lower)
    merged = tuple(
        tuple(model.names[j] for j in partners) if group == "G3" else ()
        for partners, group in zip(base_of(view, model).partners(), groups, strict=True)
    )
    cov = scaled * np.outer(model.scales, model.scales)
    shift = view.seen @ view.pseudo_inverse_seen(solution.A, solution.residual) * model.scales
    return Statistics(np.where(known, sigma * model.scales, np.nan), groups, merged, cov, view.unseen, shift), how


def held_out_errors(model: Model, measurements: Measurements, displacement: bool) -> Array:
    """Errors (3, M) in metres of predictions for readings that took no part in the fit.

    In displacement mode a held-out experiment's own unloaded readings fix its reference, and only loaded readings count;
    a point that was not read unloaded has no reference and is left out.
    """
    m = measurements
    assert m.position is not None
    error = m.position.T - simulate_readings(model, m.cases, m.case, m.point).p
    if not displacement:
        return error
    _, point = np.unique(m.point, return_inverse=True)
    key = m.cases.experiment[m.case] * (int(point.max()) + 1) + point.reshape(-1)
    _, group = np.unique(key, return_inverse=True)
    group = group.reshape(-1)
    free = m.unloaded[m.case]
    count = np.bincount(group[free], minlength=group.max() + 1)
    sums = [np.bincount(group[free], weights=error[c, free], minlength=group.max() + 1) for c in range(3)]
    mean = np.stack(sums) / np.maximum(count, 1)
    scored = ~free & (count[group] > 0)
    return (error - mean[:, group])[:, scored]


def rms_mm(error: Array) -> float:
    """Root mean square over readings of the length of the 3-D error, mm."""
    return float(np.sqrt((error**2).sum(axis=0).mean()) * 1e3) if error.size else float("nan")


def warnings_of(solution: Solution, statistics: Statistics, fit: GoodnessOfFit, o: Observations, how: str) -> list[str]:
    """What a user must be told: unseen effects, merged parameters, impossible signs, noise that does not fit."""
    model = solution.model
    lines = []
    for effect, own in zip(model.effects, model.slices, strict=True):
        groups, names = statistics.group[own], effect.names
        blind = [n for n, g in zip(names, groups, strict=True) if g == "G2"]
        if names and len(blind) == len(names):
            lines.append(
                f"NOT SEEN: no reading depends on {effect.kind} at '{effect.where}'; its value is not evidence."
            )
        elif blind:
            lines.append(f"NOT SEEN: no reading depends on {', '.join(blind)} ({effect.kind} at '{effect.where}').")
        weak = [n for n, g in zip(names, groups, strict=True) if g == "G1-"]
        if weak and isinstance(effect, JointCompliance):
            i = own.start
            lines.append(
                f"NOT REVEALED: {names[0]} = {model.x[i]:.3g} +- {statistics.sigma[i]:.2g} {effect.unit} cannot be told from zero "
                "by this campaign."
            )
        if isinstance(effect, Spring):
            lines += _signs(effect, model.x[own], names, groups, statistics.sigma[own])
    merged = [n for n, g in zip(model.names, statistics.group, strict=True) if g == "G3"]
    if merged:
        lines.append(
            f"MERGED: {len(merged)} of {model.x.size} parameters are determined in combination only (rank "
            f"{solution.identifiability.rank}); their separate values are a convention, predictions use the combinations."
        )
    if solution.active:
        lines.append(
            f"BOUNDED: the positive-semidefinite constraint is active for {', '.join(solution.active)} and moves the fit by "
            f"{solution.departure:.2g} sigma of all readings together; there the stated sigma is that of the unconstrained fit."
        )
    if not solution.identifiability.fitted:
        lines.insert(
            0,
            "NOTHING SEEN: no reading depends on anything that was to be identified; the model holds no evidence at all.",
        )
    if fit.dof <= 0:
        lines.append(
            f"NO CHECK: {o.rows} readings leave no degree of freedom for {solution.identifiability.rank} unknowns."
        )
    elif fit.rejected:
        lines.append(
            f"NOISE REJECTED: chi-square per degree of freedom is {fit.chi2_per_dof:.3g}; the stated noise does not explain the "
            f"residuals (something is missing in the model, or the noise is larger). Intervals: {how}."
        )
    elif fit.p_value > 1 - REJECTED_BELOW:
        lines.append(
            f"NOISE TOO LARGE: chi-square per degree of freedom is {fit.chi2_per_dof:.3g}; the stated noise is larger than what the "
            "readings show, so intervals are too wide."
        )
    return lines


def _signs(effect: Spring, x: Array, names: tuple[str, ...], groups: tuple[str, ...], sigma: Array) -> list[str]:
    """Compliances that no passive structure can have; rounding of what is not seen or hidden by the noise is none."""
    if x.size == 1 and (groups[0] == "G2" or -1e-3 * sigma[0] < x[0] < 0):
        return []
    matrix = effect.matrix(x)
    if np.abs(matrix - matrix.T).max() > 1e-9 * max(np.abs(matrix).max(), 1e-300):
        return [f"NOT PHYSICAL: the compliance matrix of '{effect.where}' is not symmetric."]
    d = np.sqrt(np.maximum(np.abs(np.diag(matrix)), 1e-300))
    smallest = float(np.linalg.eigvalsh(matrix / np.outer(d, d))[0])
    if smallest >= -1e-9:
        return []
    if matrix.size == 1:
        return [f"NOT PHYSICAL: {names[0]} = {x[0]:.3g} is negative; a spring gives way in the direction of the load."]
    return [f"NOT PHYSICAL: the compliance matrix of '{effect.where}' is not positive semidefinite."]


def fit_entry(
    solution: Solution, fit: GoodnessOfFit, held_out: float, method: str, eigenvalue: float, how: str
) -> dict:
    """The `fit` part of `model.json`."""
    view = solution.identifiability
    return {
        "residual_rms_mm": fit.residual_rms_mm,
        "chi2_per_dof": fit.chi2_per_dof,
        "dof": fit.dof,
        "p_value": fit.p_value,
        "noise_rejected": fit.rejected,
        "held_out_rms_mm": held_out,
        "method": method,
        "solver": solution.solver,
        "min_eigenvalue": eigenvalue,
        "rank": view.rank,
        "hidden_by_noise": view.rank - view.fitted,
        "unknowns": int(view.seen.shape[0]),
        "singular_gap": view.gap,
        "outer_iterations": solution.iterations,
        "active_constraints": list(solution.active),
        "constraint_departure_sigma": solution.departure,
        "covariance": how,
    }


def attach(solution: Solution, statistics: Statistics, entry: dict, provenance: dict) -> Model:
    """The identified model with all that is known about it."""
    return replace(solution.model, statistics=statistics, fit=entry, provenance=provenance)
