"""What a campaign can and cannot see: rank, unseen directions, groups G1, G2, G3 (seed 4.1).

Ranks are decided by a singular-value gap on columns of unit length; the groups then follow from the unseen directions:

- G2: a column of zeros, the parameter has no influence on any reading;
- G3: the parameter takes part in an unseen direction, so only its combination with others is determined;
- G1: determined by itself, and then G1+, G1~ or G1- by the ratio of value to standard deviation (seed eq. 20).

Who merges with whom, and how, is in `base_parameters`.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from drake_stiffness.rotations import Array
from drake_stiffness.thresholds import LOWER_RATIO, UPPER_RATIO

# A direction is hidden when one unit of scale (a typical compliance, a millimetre, a milliradian) moves all readings together
# by less than this many standard deviations: twenty units would still be hidden in the noise. A fit that follows such a
# direction may take any value, and springs a thousand times too soft have no loaded equilibrium to linearise at.
HIDDEN_BELOW = 0.05
# Below this a column or direction counts as zero: ten thousand units would be hidden.
ZERO_BELOW = 1e-4


# Singular values of unit columns, beside the first, that may be zeros: of analytic columns, and of difference quotients.
_NEGLIGIBLE, _NEGLIGIBLE_COARSE = 1e-7, 1e-6


@dataclass(frozen=True, eq=False)
class Identifiability:
    """Seen and unseen directions of a whitened observation matrix, in units of the parameters' scales.

    Attributes
    ----------
    seen : (n, r)
        Directions that are fitted: right singular vectors of the compressed system, orthonormal.
    weight : (r,)
        Their singular values: by how many standard deviations all readings together move per unit along a direction.
    hidden, hidden_weight : (n, h), (h,)
        Directions with an influence that the noise hides; they are not fitted, but they have a standard deviation.
    null : (n, n - r)
        Directions without influence behind the singular-value gap, columns of zeros included; r is the algebraic rank.
    faint : (n, f)
        Directions before the gap whose influence is below `ZERO_BELOW`: neither fitted nor given a standard deviation.
    singular : (live columns,)
        Singular values of the columns of unit length, largest first.
    gap : float
        Smallest seen over largest unseen of them.
    tolerance : float
        Half way (geometrically) down that gap: what is smaller counts as zero among unit columns.
    length : (n,)
        Lengths of the columns, per unit of scale.
    unit : (at most n, n)
        The compressed columns brought to unit length; zero columns stay zero.
    zero : (n,) bool
        Columns of zeros (G2).
    """

    seen: Array
    weight: Array
    hidden: Array
    hidden_weight: Array
    null: Array
    faint: Array
    singular: Array
    gap: float
    tolerance: float
    length: Array
    unit: Array
    zero: NDArray[np.bool_]

    @property
    def blind(self) -> Array:
        """Directions with no influence that counts, (n, n - rank), orthonormal."""
        return np.hstack([self.null, self.faint])

    @property
    def algebraic_rank(self) -> int:
        """Rank by the singular-value gap alone: the number of base parameters."""
        return self.length.size - self.null.shape[1]

    @property
    def unseen(self) -> Array:
        """All directions that are not fitted, (n, n - r), orthonormal."""
        return np.hstack([self.blind, self.hidden])

    @property
    def fitted(self) -> int:
        """How many combinations are fitted."""
        return self.weight.size

    @property
    def rank(self) -> int:
        """Rank of the observation matrix, hidden directions included."""
        return self.weight.size + self.hidden_weight.size

    def pseudo_inverse_seen(self, A: Array, r: Array) -> Array:
        """Coordinates along the seen directions of the least-squares step for residual r (seed eq. 12)."""
        return (self.seen.T @ (A.T @ r)) / self.weight**2

    def covariance(self) -> Array:
        """Pseudo-inverse of the information (seed eq. 14) on what is fitted, in units of scale."""
        half = self.seen / self.weight
        return half @ half.T

    def hidden_covariance(self) -> Array:
        """The same on what the noise hides."""
        half = self.hidden / self.hidden_weight
        return half @ half.T


def numerical_rank(singular: Array, coarse: bool) -> tuple[int, float]:
    """Rank and gap of a matrix with unit columns from its singular values, largest first.

    The rank is where the largest drop is, among places where what follows is negligible beside the first. Robot descriptions print
    right angles with seven digits or so; that lifts exact zeros to about 1e-8, which must not pass for something seen.
    """
    if not singular.size or singular[0] == 0:
        return 0, float("inf")
    floor = np.finfo(float).eps * singular.size
    relative = np.maximum(singular / singular[0], floor)
    below = np.append(relative[1:], floor)
    places = np.flatnonzero(below < (_NEGLIGIBLE_COARSE if coarse else _NEGLIGIBLE))
    if not places.size:
        return singular.size, float("inf")
    best = int(places[np.argmax(relative[places] / below[places])])
    rank = best + 1
    if rank == singular.size:
        return rank, float("inf")
    return rank, float(relative[best] / below[best])


def _right_singular(A: Array) -> tuple[Array, Array]:
    """Singular values and all right singular vectors (rows) of a matrix.

    LAPACK's divide and conquer, which numpy uses, fails to come to rest on a rare matrix of exact redundancies; its older QR iteration
    does not.
    """
    try:
        _, s, Vt = np.linalg.svd(A, full_matrices=True)
    except np.linalg.LinAlgError:
        from scipy.linalg import svd

        _, s, Vt = svd(A, full_matrices=True, lapack_driver="gesvd")
    return np.asarray(s), np.asarray(Vt)


def analyse(A: Array, *, coarse: bool) -> Identifiability:
    """Seen and unseen directions of `A (rows, n)`, which is per unit scale.

    Parameters
    ----------
    coarse : bool
        Whether columns are difference quotients, good to about 1e-9.
    """
    n = A.shape[1]
    R = np.asarray(np.linalg.qr(A, mode="r")) if A.shape[0] > n else A
    length = np.linalg.norm(R, axis=0)
    zero = length <= max(ZERO_BELOW, 1e-11 * float(length.max(initial=0.0)))
    unit = np.where(zero, 0.0, R / np.where(zero, 1.0, length))
    s, Vt = _right_singular(unit)
    full = np.zeros(n)
    full[: s.size] = s
    live = n - int(zero.sum())
    rank, gap = numerical_rank(full[:live], coarse)
    # Unseen directions of the unit columns, back in units of scale, made orthonormal there.
    unseen = np.where(zero[:, None], Vt[rank:].T, Vt[rank:].T / np.where(zero, 1.0, length)[:, None])
    unseen = (
        np.linalg.qr(unseen / np.maximum(np.linalg.norm(unseen, axis=0), 1e-300))[0] if rank < n else np.zeros((n, 0))
    )
    basis = np.linalg.qr(np.hstack([unseen, np.eye(n)]))[0][:, n - rank : n] if rank < n else np.eye(n)
    seen, weight = _principal(R, basis)
    nothing, hidden = weight < ZERO_BELOW, (weight >= ZERO_BELOW) & (weight < HIDDEN_BELOW)
    fitted = ~nothing & ~hidden
    return Identifiability(
        seen=seen[:, fitted],
        weight=weight[fitted],
        hidden=seen[:, hidden],
        hidden_weight=weight[hidden],
        null=unseen,
        faint=seen[:, nothing],
        singular=full[:live],
        gap=gap,
        tolerance=_half_way(full[:live], rank),
        length=length,
        unit=unit,
        zero=zero,
    )


def _half_way(singular: Array, rank: int) -> float:
    """Geometric middle between the last singular value before the cut and the first behind it (or rounding)."""
    if not rank:
        return 1.0
    floor = np.finfo(float).eps * singular.size * singular[0]
    behind = float(singular[rank]) if rank < singular.size else 0.0
    return float(np.sqrt(singular[rank - 1] * max(behind, floor)))


def _principal(R: Array, basis: Array) -> tuple[Array, Array]:
    """Right singular vectors inside the span of `basis (n, rank)`, and the singular values."""
    _, weight, Wt = np.linalg.svd(R @ basis, full_matrices=False)
    return basis @ Wt.T, weight


def relinearised(view: Identifiability, A: Array) -> Identifiability:
    """The same seen and unseen spaces with the weights of another linearisation.

    What is seen is decided once, at the start: away from it, nearly parallel axes and the like make directions look
    seen that only curvature reveals, and an iteration that follows them wanders off.
    """
    R = np.asarray(np.linalg.qr(A @ view.seen, mode="r"))
    seen, weight = _principal(R @ view.seen.T, view.seen)
    return replace(view, seen=seen, weight=weight)


def classify(
    view: Identifiability, value: Array, sigma: Array, *, upper: float = UPPER_RATIO, lower: float = LOWER_RATIO
) -> tuple[str, ...]:
    """Groups G1+, G1~, G1-, G2, G3 of all parameters (seed 4.1).

    What the noise hides is not fitted, so its value is no estimate, whatever it is: G1-.

    Parameters
    ----------
    value, sigma : (n,)
        In any common unit; sigma of an undetermined parameter is not looked at.
    upper, lower : float
        Thresholds of the ratio (20).
    """
    known, hidden = determined(view), hidden_by_noise(view)
    one = np.where(hidden, "G1-", by_ratio(value, sigma, upper=upper, lower=lower))
    return tuple(str(g) for g in np.where(view.zero, "G2", np.where(known, one, "G3")))


def by_ratio(value: Array, sigma: Array, *, upper: float = UPPER_RATIO, lower: float = LOWER_RATIO) -> NDArray[np.str_]:
    """G1+ above the upper threshold of |value| / sigma (seed eq. 20), G1- below the lower, G1~ between."""
    ratio = ratios(value, sigma)
    return np.where(ratio > upper, "G1+", np.where(ratio < lower, "G1-", "G1~"))


def ratios(value: Array, sigma: Array) -> Array:
    """|value| / sigma (seed eq. 20); infinite where sigma is zero, zero where it is infinite."""
    return np.abs(value) / np.where(sigma > 0, sigma, 1e-300)


def hidden_by_noise(view: Identifiability) -> NDArray[np.bool_]:
    """(n,) whether most of a parameter's variance comes from directions that the noise hides."""
    if not view.hidden_weight.size:
        return np.zeros(view.length.size, dtype=bool)
    return np.asarray(np.diag(view.hidden_covariance()) > np.diag(view.covariance()))


def determined(view: Identifiability) -> NDArray[np.bool_]:
    """(n,) whether a parameter by itself is determined: no unseen direction has a part in it."""
    if not view.blind.shape[1]:
        return np.ones(view.blind.shape[0], dtype=bool)
    return np.asarray(np.linalg.norm(view.blind, axis=1) < 1e-6)
