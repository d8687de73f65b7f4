"""The oracle: the true structure with unknown numbers, fitted to the same readings.

It is about the best that any model could do with these data.

It knows what no identification can know (three tapered beams to a link, where every mass sits) and estimates the joint
compliances and, per link, four stiffness factors (bending about y, about z, torsion, axial).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.optimize import least_squares

from .beams import Array
from .readings import Indices, Readings
from .segmented_arm import SegmentedArm
from .sensitivity import compliance_columns

#: Stands for "rigid" when links are left out.
RIGID = 1e6


@dataclass(frozen=True)
class Oracle:
    """A fitted arm and how well it fits.

    Attributes
    ----------
    arm
        The arm with the fitted values; predicts and compensates like any other.
    chi2_per_dof, residual_rms_mm
        Fit of the data; RMS of the 3-D residual. Parameters that the prior holds count as fitted.
    log_sigma
        One standard deviation of each logarithm (joint compliances, then link factors row by row), the prior included:
        a value near `prior_log_sigma` says that the data do not speak.
    evaluations
        How often the equilibria of all readings were computed.
    """

    arm: SegmentedArm
    chi2_per_dof: float
    residual_rms_mm: float
    log_sigma: Array
    evaluations: int


def wrong_start(arm: SegmentedArm, factor: float = 2.0) -> SegmentedArm:
    """The arm with every compliance multiplied by `factor`: started there, the fit cannot live off the truth."""
    return arm.with_values(joint_compliance=arm.joint_compliance * factor, link_factors=arm.link_factors / factor)


def fit(
    start: SegmentedArm,
    readings: Readings,
    load_point: Array,
    sigma_m: float,
    *,
    links: bool = True,
    prior_log_sigma: float = 2.0,
    max_steps: int = 100,
) -> Oracle:
    r"""Gauss-Newton (in scipy's trust region) on the logarithms x of all compliances over their start values.

    Minimizes

    .. math:: \sum_m |y_m - f_m(x) - c_{g(m)}|^2 / \sigma^2 + |x|^2 / s^2

    with f the point's position at the loaded equilibrium and c free per experiment and point: only displacements are
    evidence, c is eliminated by taking group means off. The weak prior (s = 2: a factor of 7 is one standard deviation)
    around the *start*, not the truth, decides where the data do not (axial stiffness, neighbours that twist alike).

    Parameters
    ----------
    start
        Start values; see `wrong_start`.
    load_point
        (3,) where the wrench acts, flange frame, m.
    sigma_m
        Standard deviation of one coordinate of one reading, m.
    links
        False holds the links rigid and fits joints only.

    Raises
    ------
    ArithmeticError
        If it does not converge.
    """
    if not links:
        start = start.with_values(link_factors=np.full_like(start.link_factors, RIGID))
    joints = start.chain.size
    size = joints + (start.link_factors.size if links else 0)
    observed = _centered(readings.position[..., None] / sigma_m, readings.group)[..., 0]

    def arm_at(x: Array) -> SegmentedArm:
        factors = np.zeros(start.link_factors.size)
        factors[: size - joints] = x[joints:]
        return start.with_values(
            joint_compliance=start.joint_compliance * np.exp(x[:joints]),
            link_factors=start.link_factors * np.exp(-factors.reshape(start.link_factors.shape)),
        )

    def residual(x: Array) -> Array:
        points = _predict(arm_at(x), readings, load_point)[0] / sigma_m
        misfit = _centered(points[..., None], readings.group)[..., 0] - observed
        return np.concatenate([misfit.reshape(-1), x / prior_log_sigma])

    def jacobian(x: Array) -> Array:
        columns = _predict(arm_at(x), readings, load_point)[1][..., :size] / sigma_m
        return np.vstack([_centered(columns, readings.group).reshape(-1, size), np.eye(size) / prior_log_sigma])

    found = least_squares(residual, np.zeros(size), jac=jacobian, ftol=1e-8, xtol=1e-8, gtol=None, max_nfev=max_steps)
    if found.status <= 0:
        raise ArithmeticError(f"the oracle does not converge in {max_steps} steps: {found.message}")
    data = found.fun[: observed.size].reshape(-1, 3)
    free = 3 * (len(readings.state) - (readings.group.max() + 1)) - size
    return Oracle(
        arm=arm_at(found.x),
        chi2_per_dof=float(np.sum(data**2) / free),
        residual_rms_mm=float(np.sqrt(np.mean(np.sum(data**2, axis=1))) * sigma_m * 1e3),
        log_sigma=np.sqrt(np.diag(np.linalg.inv(found.jac.T @ found.jac))),
        evaluations=int(found.nfev + found.njev),
    )


def _predict(arm: SegmentedArm, readings: Readings, load_point: Array) -> tuple[Array, Array]:
    """Positions (M, 3) of all readings at the loaded equilibrium, and their columns (M, 3, n + 4 L); m."""
    shape, _ = arm.equilibrium(readings.q, readings.wrench, load_point)
    loads = arm.generalized_forces(shape, readings.wrench, load_point, arm.gravity)
    names, which = np.unique(readings.target, axis=0, return_inverse=True)
    positions, columns = np.empty((len(which), 3)), np.empty((len(which), 3, arm.chain.size + arm.link_factors.size))
    for k, name in enumerate(names):
        points = shape.p + shape.R @ name
        rows = which.reshape(-1) == k
        positions[rows] = points[readings.state[rows]]
        columns[rows] = compliance_columns(arm, shape, loads, points)[readings.state[rows]]
    return positions, columns


def _centered(values: Array, group: Indices) -> Array:
    """Values (M, 3, ...) with the mean of their group taken off: what a free offset per group leaves."""
    total = np.zeros((int(group.max()) + 1, *values.shape[1:]))
    np.add.at(total, group, values)
    count = np.bincount(group).astype(float)
    mean: Array = total / count.reshape(-1, *([1] * (values.ndim - 1)))
    return values - mean[group]
