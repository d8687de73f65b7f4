"""How far a prediction is carried by what the campaign identified: its standard deviation, and its unsupported share.

A prediction depends on the parameters through its gradient a. The part of a along directions the campaign saw has the
variance a^T C a. The part along unseen directions is not evidence at all: the model fills it with its convention (springs of
least norm). Its share is measured against the whole gradient, each parameter weighted by the size it plausibly has - the
larger of its value and the typical size of identified compliances - so that a share of one means that nothing of the
predicted displacement was ever observed.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from drake_stiffness.effects.compliance import Spring
from drake_stiffness.effects.effect import Cases
from drake_stiffness.model import Model
from drake_stiffness.rotations import Array
from drake_stiffness.sensitivity import sensitivity

# Beyond this share a prediction is refused (exit code 3); beyond the smaller one the user is warned.
REFUSE_ABOVE = 0.2
WARN_ABOVE = 0.02
# Compliances below this, in units of scale, are none.
_NOTHING = 1e-6
# Readings whose gradients are held at once.
_CHUNK = 2048


@dataclass(frozen=True, eq=False)
class Support:
    """Of M predicted readings.

    Attributes
    ----------
    sigma : (M, 3)
        Standard deviation of the predicted coordinates from the parameters' covariance, m; NaN without statistics.
    unsupported : (M,)
        Share (0 .. 1) of the prediction that rests on directions the campaign did not see.
    """

    sigma: Array
    unsupported: Array


def displacement_support(model: Model, cases: Cases, case: NDArray[np.int_], point: NDArray[np.str_]) -> Support:
    """Support of predicted displacements (loaded minus unloaded at the same joints)."""
    parts = []
    for start in range(0, case.size, _CHUNK):
        own = slice(start, start + _CHUNK)
        used, here = np.unique(case[own], return_inverse=True)
        few = cases.take(used)
        loaded = sensitivity(model, few, here.reshape(-1), point[own])[:, :3]
        unloaded = sensitivity(model, few.unloaded(), here.reshape(-1), point[own])[:, :3]
        parts.append(_support(model, loaded - unloaded))
    return Support(np.concatenate([p.sigma for p in parts]), np.concatenate([p.unsupported for p in parts]))


def tool_support(model: Model, cases: Cases) -> Support:
    """Support of the predicted displacement of the tool centre point, one reading per case."""
    tcp = "(tool centre point)"
    with_tcp = replace(model, points={**model.points, tcp: model.tcp[1]})
    return displacement_support(with_tcp, cases, np.arange(cases.number), np.full(cases.number, tcp))


def position_support(model: Model, cases: Cases, case: NDArray[np.int_], point: NDArray[np.str_]) -> Support:
    """Support of predicted positions."""
    return _support(model, sensitivity(model, cases, case, point)[:, :3])


def _support(model: Model, gradient: Array) -> Support:
    """From gradients (M, 3, n) per unit scale."""
    M = gradient.shape[0]
    s = model.statistics
    if s is None or not model.x.size:
        return Support(np.full((M, 3), np.nan), np.zeros(M))
    cov = s.covariance / np.outer(model.scales, model.scales)
    variance = np.einsum("mci,mci->mc", gradient @ cov, gradient)
    return Support(np.sqrt(np.maximum(variance, 0.0)), _unsupported(model, gradient, s.null_space))


def _unsupported(model: Model, gradient: Array, unseen: Array) -> Array:
    if not unseen.shape[1]:
        return np.zeros(gradient.shape[0])
    size = np.abs(model.x / model.scales)
    springs = np.array([isinstance(e, Spring) for e in model.effects for _ in e.parameters], dtype=bool)
    # A model without any compliance, a campaign without load say, has no typical size: then one unit of scale is.
    typical = float(np.sqrt((size[springs] ** 2).mean())) if springs.any() else 0.0
    typical = typical if typical > _NOTHING else 1.0
    weight = np.where(springs, np.maximum(size, typical), 1.0)
    blind = (gradient @ unseen) @ unseen.T
    whole = np.sqrt(((gradient * weight) ** 2).sum(axis=(1, 2)))
    return np.sqrt(((blind * weight) ** 2).sum(axis=(1, 2))) / np.where(whole > 0, whole, 1.0)
