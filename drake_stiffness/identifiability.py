"""What a campaign can and cannot see: rank, unseen directions, groups G1, G2, G3 (seed 4.1).

Ranks are decided by a singular-value gap on columns of unit length; the groups then follow from the unseen directions:

- G2: a column of zeros, the parameter has no influence on any reading;
- G3: the parameter takes part in an unseen direction, so only its combination with others is determined;
- G1: determined by itself, and then G1+, G1~ or G1- by the ratio of value to standard deviation (seed eq. 20).
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from drake_stiffness.rotations import Array

UPPER_RATIO, LOWER_RATIO = 5.0, 2.0

# A direction is hidden when one unit of scale (a typical compliance, a millimetre, a milliradian) moves all readings together
# by less than this many standard deviations: twenty units would still be hidden in the noise. A fit that follows such a
# direction may take any value, and springs a thousand times too soft have no loaded equilibrium to linearise at.
HIDDEN_BELOW = 0.05
# Below this a column or direction counts as zero: ten thousand units would be hidden.
ZERO_BELOW = 1e-4


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
    blind : (n, n - r - h)
        Directions without influence.
    gap : float
        Smallest seen over largest unseen singular value of the unit-length columns.
    zero : (n,) bool
        Columns of zeros (G2).
    merged : tuple of n tuples of int
        For every parameter the others it cannot be told from.
    """

    seen: Array
    weight: Array
    hidden: Array
    hidden_weight: Array
    blind: Array
    gap: float
    zero: NDArray[np.bool_]
    merged: tuple[tuple[int, ...], ...]

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

    The rank is where the largest drop is, among places where what follows is negligible beside the first.
    """
    if not singular.size or singular[0] == 0:
        return 0, float("inf")
    floor = np.finfo(float).eps * singular.size
    relative = np.maximum(singular / singular[0], floor)
    limit = 1e-8 if coarse else 1e-10
    below = np.append(relative[1:], floor)
    places = np.flatnonzero(below < limit)
    if not places.size:
        return singular.size, float("inf")
    best = int(places[np.argmax(relative[places] / below[places])])
    rank = best + 1
    if rank == singular.size:
        return rank, float("inf")
    return rank, float(relative[best] / below[best])


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
    _, s, Vt = np.linalg.svd(unit, full_matrices=True)
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
        blind=np.hstack([unseen, seen[:, nothing]]),
        gap=gap,
        zero=zero,
        merged=_merged(unit, zero, rank),
    )


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


def _merged(unit: Array, zero: NDArray[np.bool_], rank: int) -> tuple[tuple[int, ...], ...]:
    """Who merges with whom: dependent columns as sparse combinations of a base chosen joints first."""
    n = unit.shape[1]
    if rank == n - int(zero.sum()):
        return ((),) * n
    base: list[int] = []
    partners: list[set[int]] = [set() for _ in range(n)]
    Q = np.zeros((unit.shape[0], 0))
    dependent = []
    for i in np.flatnonzero(~zero).tolist():
        rest = unit[:, i] - Q @ (Q.T @ unit[:, i])
        rest -= Q @ (Q.T @ rest)
        size = float(np.linalg.norm(rest))
        if size > 1e-7 and len(base) < rank:
            Q = np.column_stack([Q, rest / size])
            base.append(i)
        else:
            dependent.append(i)
    for i in dependent:
        share, *_ = np.linalg.lstsq(unit[:, base], unit[:, i], rcond=None)
        for member in (base[b] for b in np.flatnonzero(np.abs(share) > 1e-6)):
            partners[i].add(member)
            partners[member].add(i)
    return tuple(tuple(sorted(p)) for p in partners)


def classify(view: Identifiability, value: Array, sigma: Array) -> tuple[str, ...]:
    """Groups G1+, G1~, G1-, G2, G3 of all parameters (seed 4.1, thresholds 5 and 2).

    Parameters
    ----------
    value, sigma : (n,)
        In any common unit; sigma of an undetermined parameter is not looked at.
    """
    groups = []
    known = determined(view)
    for i in range(value.size):
        if view.zero[i]:
            groups.append("G2")
        elif not known[i]:
            groups.append("G3")
        else:
            ratio = abs(value[i]) / sigma[i] if sigma[i] > 0 else np.inf
            groups.append("G1+" if ratio > UPPER_RATIO else "G1-" if ratio < LOWER_RATIO else "G1~")
    return tuple(groups)


def determined(view: Identifiability) -> NDArray[np.bool_]:
    """(n,) whether a parameter by itself is determined: no unseen direction has a part in it."""
    if not view.blind.shape[1]:
        return np.ones(view.blind.shape[0], dtype=bool)
    return np.asarray(np.linalg.norm(view.blind, axis=1) < 1e-6)
