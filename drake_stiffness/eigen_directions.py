"""Eigen-directions of the information on the base parameters: what marginal ratios hide, and pairs that hide each other.

A ratio (20) is marginal: two parameters with nearly parallel columns may each have a small one though their sum is known to a per
cent. The eigenvectors v of the information matrix M are the combinations that are estimated independently of each other, with
sigma_v = 1 / sqrt(lambda) and ratio |v^T b| / sigma_v.

Eigenvectors depend on units. `value` (the default) takes parameters per unit of their estimates: every parameter is +1 or -1,
a direction weighs relative errors, and its ratio says which relative changes are known. Its price: the noise of the estimates has a
say in the coordinates, and a parameter estimated near zero stands alone. `scale` takes parameters per unit of a typical
compliance, fixed before any reading, so that campaigns compare; but a direction then passes as soon as a little of one large
compliance is mixed into it: for the KR 270 example all 32 directions pass the threshold 5 that way, and 17 of them per value.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from drake_stiffness.identifiability import by_ratio, ratios
from drake_stiffness.rotations import Array
from drake_stiffness.thresholds import LOWER_RATIO, UPPER_RATIO

Per = Literal["scale", "value"]
# Estimates that correlate more than this are looked at as a pair.
CORRELATED = 0.9
# Parts of a direction smaller than this are not named.
NAMED_ABOVE = 0.2


@dataclass(frozen=True, eq=False)
class EigenDirections:
    """Directions, largest ratio first.

    Attributes
    ----------
    parts : (r, k)
        Column k is direction k, of unit length in the units chosen.
    value, sigma : (k,)
        v^T b and its standard deviation in those units.
    ratio : (k,)
    group : tuple of k of G1+ G1~ G1-
    """

    parts: Array
    value: Array
    sigma: Array
    ratio: Array
    group: tuple[str, ...]

    def named(self, k: int, names: tuple[str, ...]) -> dict[str, float]:
        """Which parameters take part in direction k, largest part first."""
        v = self.parts[:, k]
        order = np.argsort(-np.abs(v), kind="stable")
        return {names[i]: float(v[i]) for i in order.tolist() if abs(v[i]) >= NAMED_ABOVE}


@dataclass(frozen=True)
class CollinearPair:
    """Two base parameters that the campaign hardly tells apart.

    Attributes
    ----------
    first, second : int
        Places among the base parameters.
    correlation : float
        Of their estimates.
    ratios : (2,)
        Marginal.
    known_parts, known_ratio : the combination of the two (per unit of scale, unit length) that is known best
    other_ratio : float
        Ratio of the combination at right angles to it.
    says : str
        `sum known` if neither is known by itself though their combination is; `cancelling` if both pass by themselves though the
        combination that the readings see best is next to nothing: two large values that undo each other; else `correlated`.
    """

    first: int
    second: int
    correlation: float
    ratios: tuple[float, float]
    known_parts: tuple[float, float]
    known_ratio: float
    other_ratio: float
    says: str


def eigen_directions(
    value: Array,
    covariance: Array,
    unit: Array,
    per: Per = "value",
    *,
    usable: NDArray[np.bool_] | None = None,
    upper: float = UPPER_RATIO,
    lower: float = LOWER_RATIO,
) -> EigenDirections:
    """Eigen-directions of the inverse of a covariance, largest ratio first.

    Parameters
    ----------
    value, covariance, unit : (r,), (r, r), (r,)
        Estimates, their covariance, a typical size of each, SI.
    usable : (r,) bool
        Which parameters take part (those with a finite standard deviation); k of them give k directions.
    """
    own = np.ones(value.size, dtype=bool) if usable is None else usable
    own = own & (value != 0.0) if per == "value" else own
    size = unit[own] if per == "scale" else np.abs(value[own])
    b = value[own] / size
    # A covariance and its inverse have the same eigenvectors, and this one is at hand.
    variance, within = np.linalg.eigh(covariance[np.ix_(own, own)] / np.outer(size, size))
    sigma = np.sqrt(np.maximum(variance, 0.0))
    strongest = within[np.abs(within).argmax(axis=0), np.arange(b.size)] if b.size else np.zeros(0)
    within = within * np.where(strongest < 0, -1.0, 1.0)
    parts = np.zeros((value.size, b.size))
    parts[own] = within
    along = within.T @ b
    order = np.argsort(-ratios(along, sigma), kind="stable")
    parts, along, sigma = parts[:, order], along[order], sigma[order]
    groups = tuple(str(g) for g in by_ratio(along, sigma, upper=upper, lower=lower))
    return EigenDirections(parts, along, sigma, ratios(along, sigma), groups)


def collinear_pairs(
    value: Array,
    covariance: Array,
    unit: Array,
    hidden: NDArray[np.bool_],
    *,
    upper: float = UPPER_RATIO,
    lower: float = LOWER_RATIO,
) -> list[CollinearPair]:
    """Pairs whose estimates correlate above `CORRELATED`, strongest first; what the noise hides is left out."""
    sigma = np.sqrt(np.maximum(np.diag(covariance), 0.0))
    safe = np.where(sigma > 0, sigma, 1.0)
    correlation = covariance / np.outer(safe, safe)
    usable = (sigma > 0) & ~hidden
    pairs = []
    for i, j in zip(*np.triu_indices(value.size, 1), strict=True):
        if not (usable[i] and usable[j]) or abs(correlation[i, j]) < CORRELATED:
            continue
        two = [i, j]
        both = eigen_directions(value[two], covariance[np.ix_(two, two)], unit[two], "scale")
        marginal = np.abs(value[two]) / sigma[two]
        sharp = int(both.sigma.argmin())
        best, other = float(both.ratio[sharp]), float(both.ratio[1 - sharp])
        if marginal.max() < upper < best:
            says = "sum known"
        elif marginal.min() > upper and best < lower:
            says = "cancelling"
        else:
            says = "correlated"
        parts = both.parts[:, sharp]
        pairs.append(
            CollinearPair(
                int(i), int(j), float(correlation[i, j]), (float(marginal[0]), float(marginal[1])),
                (float(parts[0]), float(parts[1])), best, other, says,
            )
        )  # fmt: skip
    return sorted(pairs, key=lambda pair: -abs(pair.correlation))
