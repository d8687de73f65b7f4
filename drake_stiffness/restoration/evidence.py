"""What is known of the springs: the identified combinations and their noise, from a stored model or from the readings."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from drake_stiffness.identifiability import analyse
from drake_stiffness.model import Model
from drake_stiffness.observation import Observations, columns, measured, predicted
from drake_stiffness.rotations import Array
from drake_stiffness.semidefinite import spring_parameters
from drake_stiffness.sensitivity import has_finite_differences


@dataclass(frozen=True, eq=False)
class Evidence:
    """What is known of the springs, in units of their scales.

    Attributes
    ----------
    rows : (r, n)
        In units of noise: the identified combinations are rows @ (y - centre) ~ N(0, 1).
    centre : (n,)
    """

    rows: Array
    centre: Array


def evidence_of_statistics(model: Model) -> Evidence:
    """The identified combinations of springs and their covariance, as a stored model has them.

    Frames and geometry that were estimated along are free: what is known of springs whatever they are.
    """
    s = model.statistics
    assert s is not None
    cov = s.covariance / np.outer(model.scales, model.scales)
    seen = np.linalg.svd(s.null_space, full_matrices=True)[0][:, s.null_space.shape[1] :]
    inside = seen.T @ cov @ seen
    values, vectors = np.linalg.eigh(inside)
    live = values > 1e-14 * values.max(initial=0.0)
    rows = (vectors[:, live] / np.sqrt(values[live])).T @ (seen.T)
    return _springs_alone(model, rows, model.x / model.scales)


def evidence_of_readings(model: Model, o: Observations) -> Evidence:
    """The same from the readings, linearised at the model: seed eqs. (12), (14) on what the complete model is seen of."""
    view = analyse(A := columns(o, model), coarse=has_finite_differences(model))
    x = model.x / model.scales
    step = view.pseudo_inverse_seen(A, measured(o) - predicted(o, model))
    return _springs_alone(model, view.weight[:, None] * view.seen.T, x + view.seen @ step)


def _springs_alone(model: Model, rows: Array, x: Array) -> Evidence:
    """What combinations say of the springs when all else is free to take its best value."""
    springs = spring_parameters(model)
    others = rows[:, ~springs]
    if others.shape[1]:
        U, size, _ = np.linalg.svd(others, full_matrices=True)
        rank = int((size > 1e-9 * size.max(initial=0.0)).sum()) if size.size else 0
        rows = U[:, rank:].T @ rows
    _, w, Vt = np.linalg.svd(rows[:, springs], full_matrices=False)
    live = w > 1e-10 * w.max(initial=0.0)
    return Evidence(w[live, None] * Vt[live], x[springs])
