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
_CHUNK = 4000


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
    covariance, centre : (M, 3, 3), (M, 3)
        Of the error of least squares at the reading, m^2, and least squares minus the prediction, m; NaN without statistics.
    """

    sigma: Array
    unsupported: Array
    low: Array
    high: Array
    covariance: Array
    centre: Array


def displacement_support(model: Model, cases: Cases, case: NDArray[np.int_], point: NDArray[np.str_]) -> Support:
    """Support of predicted displacements (loaded minus unloaded at the same joints)."""
    parts, evidence = [], _Evidence.of(model)
    for start in range(0, case.size, _CHUNK):
        own = slice(start, start + _CHUNK)
        parts.append(_support(evidence, displacement_gradient(model, cases, case[own], point[own])))
    return Support(*(np.concatenate([getattr(p, f.name) for p in parts]) for f in fields(Support)))


def displacement_gradient(model: Model, cases: Cases, case: NDArray[np.int_], point: NDArray[np.str_]) -> Array:
    """How displacements (loaded minus unloaded at the same joints) change with the parameters, (M, 3, n) per unit of scale."""
    used, here = np.unique(case, return_inverse=True)
    few, here = cases.take(used), here.reshape(-1)
    if all(isinstance(effect, Spring) for effect in model.effects):
        # Columns of springs are linear in what they carry (seed eq. 23): weight drops out of the difference.
        weightless = replace(model, arm=replace(model.arm, gravity=np.zeros(3)))
        return sensitivity(weightless, few, here, point, turns=False)
    loaded, unloaded = (sensitivity(model, some, here, point, turns=False) for some in (few, few.unloaded()))
    return np.asarray(loaded - unloaded)


def position_support(model: Model, cases: Cases, case: NDArray[np.int_], point: NDArray[np.str_]) -> Support:
    """Support of predicted positions."""
    return _support(_Evidence.of(model), sensitivity(model, cases, case, point, turns=False))


@dataclass(frozen=True, eq=False)
class _Evidence:
    """What the campaign says of the parameters, per unit of scale, in the form that gradients are multiplied with.

    Attributes
    ----------
    root : (n, r)
        C = root root^T.
    shift : (n,)
        Least squares less the model.
    weight : (n,)
        Plausible size of every parameter.
    unseen : (n, k)
        |a unseen| is the weighted length of the part of a gradient that the campaign did not see.
    """

    root: Array
    shift: Array
    weight: Array
    unseen: Array

    @classmethod
    def of(cls, model: Model) -> _Evidence | None:
        """None where the model carries no statistics."""
        s = model.statistics
        if s is None or not model.x.size:
            return None
        shift = np.zeros(model.x.size) if s.shift is None else s.shift / model.scales
        weight = _plausible_size(model)
        # |a U U^T W| = |a U R^T| where W U = Q R: half the work, and nothing as wide as the gradients is made.
        triangle = np.asarray(np.linalg.qr(weight[:, None] * s.null_space, mode="r"))
        unseen = s.null_space @ triangle.T
        return cls(_root(s.covariance / np.outer(model.scales, model.scales)), shift, weight, unseen)


def _support(evidence: _Evidence | None, gradient: Array) -> Support:
    """From gradients (M, 3, n) per unit scale."""
    M = gradient.shape[0]
    if evidence is None:
        unknown = np.full((M, 3), np.nan)
        return Support(unknown, np.zeros(M), unknown, unknown, np.full((M, 3, 3), np.nan), unknown)
    # All readings side by side: products are few and long.
    a = np.ascontiguousarray(gradient.transpose(2, 1, 0)).reshape(gradient.shape[2], 3 * M)
    spread = (evidence.root.T @ a).reshape(evidence.root.shape[1], 3, M)
    covariance = np.empty((M, 3, 3))
    for i, j in ((0, 0), (0, 1), (0, 2), (1, 1), (1, 2), (2, 2)):
        covariance[:, i, j] = covariance[:, j, i] = (spread[:, i] * spread[:, j]).sum(axis=0)
    sigma = np.sqrt(np.einsum("mcc->mc", covariance))
    centre = (evidence.shift @ a).reshape(3, M).T
    low, high = np.minimum(centre - Z95 * sigma, 0.0), np.maximum(centre + Z95 * sigma, 0.0)
    return Support(sigma, _unsupported(evidence, a), low, high, covariance, centre)


def _root(C: Array) -> Array:
    """F (n, r) with F F^T = C, r its rank: fewer columns than C, so that the product with many gradients costs less."""
    values, vectors = np.linalg.eigh(C)
    kept = values > 1e-14 * values.max(initial=0.0)
    return np.asarray(vectors[:, kept] * np.sqrt(values[kept]))


def _plausible_size(model: Model) -> Array:
    """Of every parameter (n,), in units of scale: the larger of its value and the typical size of compliances."""
    size = np.abs(model.x / model.scales)
    springs = np.array([isinstance(e, Spring) for e in model.effects for _ in e.parameters], dtype=bool)
    # A model without any compliance, a campaign without load say, has no typical size: then one unit of scale is.
    typical = float(np.sqrt((size[springs] ** 2).mean())) if springs.any() else 0.0
    typical = typical if typical > _NOTHING else 1.0
    return np.where(springs, np.maximum(size, typical), 1.0)


def _unsupported(evidence: _Evidence, a: Array) -> Array:
    """Share (M,) of gradients (n, 3 M), coordinate by coordinate."""
    M = a.shape[1] // 3
    if not evidence.unseen.shape[1]:
        return np.zeros(M)
    blind = ((evidence.unseen.T @ a) ** 2).sum(axis=0).reshape(3, M).sum(axis=0)
    whole = (evidence.weight**2 @ a**2).reshape(3, M).sum(axis=0)
    return np.asarray(np.sqrt(blind / np.where(whole > 0, whole, 1.0)))
