"""How far a prediction is carried by what the campaign identified: its standard deviation, and its unsupported share.

A prediction depends on the parameters through its gradient a. The part of a along directions the campaign saw has the
variance a^T C a. The part along unseen directions is not evidence at all: the model fills it with its convention (springs of
least norm). Its share is measured against the whole gradient, each parameter weighted by the size it plausibly has - the
larger of its value and the typical size of identified compliances - so that a share of one means that nothing of the
predicted displacement was ever observed.

The interval of a prediction is centred at least squares without constraints, whose error is exactly Gaussian, and not at the model:
near an active constraint the model is the projection of least squares onto the cones, no sum of errors any more. Both differ by
the stored shift. So a +- 1.96 sigma around least squares keeps its coverage wherever the truth lies, at the rim of a cone too;
the interval reported is its hull with the prediction itself. It speaks of what the campaign saw and of nothing else.
"""

from __future__ import annotations

from dataclasses import dataclass, fields, replace

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
# Half a 95 % interval in standard deviations.
Z95 = 1.959963984540054
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
    low, high : (M, 3)
        Ends of the 95 % interval, m, counted from the prediction (low <= 0 <= high); NaN without statistics.
    """

    sigma: Array
    unsupported: Array
    low: Array
    high: Array


def displacement_support(model: Model, cases: Cases, case: NDArray[np.int_], point: NDArray[np.str_]) -> Support:
    """Support of predicted displacements (loaded minus unloaded at the same joints)."""
    parts = []
    for start in range(0, case.size, _CHUNK):
        own = slice(start, start + _CHUNK)
        parts.append(_support(model, displacement_gradient(model, cases, case[own], point[own])))
    return Support(*(np.concatenate([getattr(p, f.name) for p in parts]) for f in fields(Support)))


def displacement_gradient(model: Model, cases: Cases, case: NDArray[np.int_], point: NDArray[np.str_]) -> Array:
    """How displacements (loaded minus unloaded at the same joints) change with the parameters, (M, 3, n) per unit of scale."""
    used, here = np.unique(case, return_inverse=True)
    few, here = cases.take(used), here.reshape(-1)
    loaded, unloaded = sensitivity(model, few, here, point), sensitivity(model, few.unloaded(), here, point)
    return loaded[:, :3] - unloaded[:, :3]


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
        unknown = np.full((M, 3), np.nan)
        return Support(unknown, np.zeros(M), unknown, unknown)
    cov = s.covariance / np.outer(model.scales, model.scales)
    sigma = np.sqrt(np.maximum(np.einsum("mci,mci->mc", gradient @ cov, gradient), 0.0))
    centre = gradient @ (np.zeros(model.x.size) if s.shift is None else s.shift / model.scales)
    low, high = np.minimum(centre - Z95 * sigma, 0.0), np.maximum(centre + Z95 * sigma, 0.0)
    return Support(sigma, _unsupported(model, gradient, s.null_space), low, high)


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
