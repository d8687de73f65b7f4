"""What each suspect explains of the residuals after the base model's own parameters have been refitted.

All tests are linear algebra on one compressed system. With A the base model's columns, S those of a variant and r the whitened
residual, what is left of S and r after A is S' = S - A A^+ S and r' = r - A A^+ r. A variant explains f = ||Q^T r'||^2, Q an
orthonormal basis of S'. Against the noise the data show, F = (f / p) / (rest / dof) has an F distribution; its p-value counts
only after the search over all variants is paid for: the level that the smallest p-value of all falls below in a given share of noise
is found by simulation, correlations between variants included.

Evidence is what counts in the end: by how much readings of experiments that a fit did not see are predicted better, over
folds of whole experiments, in units of what the base model's own uncertainty may leave there.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from drake_stiffness.diagnosis.suspects import Suspect
from drake_stiffness.effects import Effect
from drake_stiffness.rotations import Array

# Of the 1 % that all of diagnosis may err by when nothing is missing; the rest is for outliers and for the whole fit.
FAMILY_WISE = 0.0075
_DRAWS = 4000
_JITTER = 1e-9
# What is left of a column after the base model's, as a share of it: below this the two cannot be told apart at all.
_NOTHING_LEFT = 1e-3
# On unseen experiments an effect's value is drawn to zero by a prior that says one part in so many of what all readings say.
_PRIOR = 20


@dataclass(frozen=True, eq=False)
class Tested:
    """A suspect's best variant and what speaks for it.

    Attributes
    ----------
    suspect : Suspect
    variant : int
    explained : float
        f, in squared sigma of the stated noise.
    p_value : float
        Of F, before the search is paid for.
    gain : float
        Cross-validated gain: by how much chi-square of unseen experiments falls, in units of the noise the data show and of what the
        base model may leave there. The variant is chosen anew in every fold.
    own_gain : float
        The same with this variant in every fold.
    coefficient : (p,)
        Least-squares values of its parameters in units of their scales.
    fit : (rows,)
        What it explains, Q Q^T r'.
    bases : one (rows, p) per variant
        Orthonormal bases of what is left of the variants' columns.
    """

    suspect: Suspect
    variant: int
    explained: float
    p_value: float
    gain: float
    own_gain: float
    coefficient: Array
    fit: Array
    bases: tuple[Array, ...]

    @property
    def effect(self) -> Effect:
        return self.suspect.variants[self.variant]

    @property
    def basis(self) -> Array:
        """Q of the best variant."""
        return self.bases[self.variant]


def basis_of(A: Array) -> Array:
    """Orthonormal basis of the columns of A, numerically dependent ones left out."""
    length = np.linalg.norm(A, axis=0)
    A = A[:, length > 0] / length[length > 0]
    if not A.shape[1]:
        return np.zeros((A.shape[0], 0))
    U, s, _ = np.linalg.svd(A, full_matrices=False)
    return np.asarray(U[:, s > 1e-9 * s[0]])


def left_over(S: Array, Q_base: Array) -> Array:
    """What is left of columns S after projecting the base model out; zeros where nothing to speak of is left."""
    rest = S - Q_base @ (Q_base.T @ S)
    rest -= Q_base @ (Q_base.T @ rest)
    nothing = np.linalg.norm(rest, axis=0) <= _NOTHING_LEFT * np.linalg.norm(S, axis=0)
    rest[:, nothing] = 0.0
    return rest


def score(explained: float, parameters: int, variants: int, noise: float) -> float:
    """Explained chi-square less the cost of freedom: 2 for a parameter, 2 log n for a choice of n constants."""
    return explained / max(noise, 1e-300) - 2 * parameters - 2 * float(np.log(max(variants, 1)))


def level_of_smallest(Q_all: Array, sizes: list[int], dof: int, seed: int) -> float:
    """The p-value that the smallest of all tests falls below with probability `FAMILY_WISE` when there is only noise.

    Parameters
    ----------
    Q_all : (rows, sum of sizes)
        Bases of all variants side by side; in noise Q^T r is normal with covariance Q_all^T Q_all.
    sizes : degrees of freedom of each variant
    """
    from scipy.special import fdtrc

    rng = np.random.default_rng(seed)
    # Any root of the covariance serves; single precision is plenty for a quantile.
    root = (
        Q_all.T
        if Q_all.shape[0] < Q_all.shape[1]
        else np.linalg.cholesky(Q_all.T @ Q_all + _JITTER * np.eye(Q_all.shape[1]))
    )
    root = root.astype(np.float32)
    starts = np.concatenate([[0], np.cumsum(sizes)[:-1]])
    smallest = []
    for _ in range(0, _DRAWS, 500):
        g = rng.standard_normal((500, root.shape[1]), dtype=np.float32) @ root.T
        f = np.add.reduceat(g**2, starts, axis=1)
        rest = rng.chisquare(dof, size=(500, 1)) / dof
        smallest.append(fdtrc(np.array(sizes)[None], dof, f / np.array(sizes) / rest).min(axis=1))
    return float(np.quantile(np.concatenate(smallest), FAMILY_WISE))


def folds_of(experiment: NDArray[np.int_], groups: NDArray[np.int_], number: int, seed: int) -> NDArray[np.int_]:
    """Which fold every row is in: whole experiments, those of one posture together."""
    postures = np.unique(groups)
    place = np.random.default_rng(seed).permutation(postures.size) % min(number, postures.size)
    fold = np.zeros(int(postures.max()) + 1, dtype=int)
    fold[postures] = place
    return fold[groups[experiment]]


Fit = Callable[[Array, Array], Array]


def least_squares(H: Array, b: Array) -> Array:
    """argmin x^T H x - 2 b^T x, the shortest."""
    return np.asarray(np.linalg.lstsq(H, b, rcond=1e-10)[0])


def inside_cones(effect: Effect) -> Fit | None:
    """The same with an effect's matrices positive semidefinite; None if it has none but single numbers."""
    blocks = [block for block in effect.cone_blocks if len(block) > 1]
    if not blocks:
        return None
    from drake_stiffness.intervals.cone_program import ConeLeastSquares

    def fit(H: Array, b: Array) -> Array:
        w, V = np.linalg.eigh(H)
        keep = w > 1e-10 * max(float(w[-1]), 1e-300)
        root = np.sqrt(w[keep])
        return np.asarray(ConeLeastSquares(root[:, None] * V[:, keep].T, blocks).solve(V[:, keep].T @ b / root))

    return fit


def cross_validated(
    A: Array,
    variants: Sequence[Array],
    r: Array,
    fold: NDArray[np.int_],
    fit: Fit = least_squares,
) -> float:
    """Squares of what fits to the other folds leave of each fold, with columns [A, S], in units of what A alone may leave there.

    With P the covariance of a fit of A to the other folds, its error on a fold's rows X has covariance I + X P X^T, and e^T (I + X P X^T)^-1 e
    is summed. A direction that the other experiments hardly see weighs little, where plain squares would be all about it. By
    Woodbury this is e^T e - (X^T e)^T G^-1 (X^T e) with G = A^T A over all folds. S earns no such allowance: it has to predict.

    Parameters
    ----------
    A : (rows, n)
        Of full column rank.
    variants : one or more (rows, p)
        What is left of S beside A. Of all S the one that fits the other folds best is taken, fold by fold: the search over constants
        is paid for too. Values are drawn to zero by a prior of one part in `_PRIOR`, so that what the others hardly see of S
        is hardly claimed.
    fold : (rows,)
        Rows of a negative fold take part in every fit and are never left out.
    fit : callable
        Values of a variant's parameters, the base's eliminated.
    """
    X = np.hstack([A, *variants])
    base, ends = A.shape[1], A.shape[1] + np.cumsum([0, *(S.shape[1] for S in variants)])
    picks = [slice(a, b) for a, b in pairwise(ends.tolist())]
    G, b, total = X.T @ X, X.T @ r, 0.0
    for f in np.unique(fold[fold >= 0]):
        own = fold == f
        Xf, rf = X[own], r[own]
        G_rest, b_rest = G - Xf.T @ Xf, b - Xf.T @ rf
        # The base's columns are eliminated once for all variants.
        solved = np.linalg.lstsq(G_rest[:base, :base], np.column_stack([b_rest[:base], G_rest[:base]]), rcond=1e-10)[0]
        alone, mimic = solved[:, 0], solved[:, 1:]
        left = b_rest - G_rest[:, :base] @ alone
        inner = [G_rest[v, v] - G_rest[v, :base] @ mimic[:, v] + G[v, v] / _PRIOR for v in picks]
        fits = [fit(H, left[v]) for H, v in zip(inner, picks, strict=True)]
        best = max(range(len(picks)), key=lambda k: float(left[picks[k]] @ fits[k]))
        v, x = picks[best], fits[best]
        e = rf - Xf[:, :base] @ (alone - mimic[:, v] @ x) - Xf[:, v] @ x
        u = Xf[:, :base].T @ e
        total += float(e @ e) - float(u @ np.linalg.solve(G[:base, :base], u))
    return total
