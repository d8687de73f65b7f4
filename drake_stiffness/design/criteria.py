"""What makes a plan good: criteria of the information matrix M, all to be maximised.

Every criterion is written as an information function phi: concave, increasing, and homogeneous of degree one, so that twice the
value means half the number of readings for the same variance. Its `dual` at any M is a positive semidefinite Z with

    phi(X) <= <Z, X>   for every information matrix X,      with equality at X = M where phi is smooth.

That inequality is the equivalence theorem's certificate: no plan of n candidates F_i on top of M_0 can be better than <Z, M_0> plus
the sum of the n largest <Z, F_i>, whatever M the Z was taken at.

| criterion | phi | good for |
|---|---|---|
| d | det(M)^(1/r) | the volume of the confidence ellipsoid |
| a | r / tr(M^-1) | the mean variance of all combinations, in units of scale |
| e | smallest eigenvalue | the worst-known combination |
| ratio | min of (pi / sigma)^2 | the worst ratio (20) of a parameter of interest |
| toolpath | 1 / tr(C M^-1), C = mean A_t^T A_t | the variance of the displacement along a program |
| ds | det(S)^(1/s), S = M_ss - M_sb M_bb^-1 M_bs | a suspected effect, base parameters projected out |
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass

import numpy as np

from drake_stiffness.rotations import Array

# How sharply a criterion with kinks is followed at first: as the mean of power -16 of its terms.
_SHARPNESS = 16.0
_TINY = 1e-300


class Criterion(ABC):
    """An information function of symmetric positive definite matrices (..., r, r)."""

    name: str
    # None where phi is smooth; else the power that its terms are first averaged with.
    sharpness: float | None = None

    @abstractmethod
    def value(self, M: Array) -> Array:
        """phi(M), (...); zero where M is singular."""

    @abstractmethod
    def dual(self, M: Array, sharpness: float | None = None) -> Array:
        """Z (r, r) with phi(X) <= <Z, X> for all X (equality at M where phi is smooth)."""

    def ascent(self, M: Array, sharpness: float | None = None) -> Array:
        """Direction of growth, up to a factor: the dual itself unless phi has kinks."""
        return self.dual(M, sharpness)

    def terms(self, M: Array) -> Array:
        """The values whose smallest phi is, (..., K)."""
        return self.value(M)[..., None]


class Determinant(Criterion):
    """det(M)^(1/r); dual phi/r M^-1 (arithmetic against geometric mean)."""

    name = "d"

    def value(self, M: Array) -> Array:
        sign, logarithm = np.linalg.slogdet(M)
        return np.where(sign > 0, np.exp(logarithm / M.shape[-1]), 0.0)

    def dual(self, M: Array, sharpness: float | None = None) -> Array:
        return float(self.value(M)) / M.shape[-1] * np.linalg.inv(M)


@dataclass(frozen=True, eq=False)
class MeanVariance(Criterion):
    """1 / tr(C M^-1); dual phi^2 M^-1 C M^-1. C = 1/r is the A-criterion, C of a program the toolpath criterion."""

    C: Array
    name: str = "a"

    def value(self, M: Array) -> Array:
        return 1.0 / np.einsum("ij,...ji->...", self.C, np.linalg.inv(M))

    def dual(self, M: Array, sharpness: float | None = None) -> Array:
        V = np.linalg.inv(M)
        return float(self.value(M)) ** 2 * V @ self.C @ V


class SmallestEigenvalue(Criterion):
    """lambda_min(M); dual sum mu_k v_k v_k^T over eigenvectors with any weights mu of sum one; here mu ~ lambda^-sharpness."""

    name = "e"
    sharpness = _SHARPNESS

    def value(self, M: Array) -> Array:
        return self.terms(M)[..., 0]

    def terms(self, M: Array) -> Array:
        return np.maximum(np.linalg.eigvalsh(M), _TINY)

    def dual(self, M: Array, sharpness: float | None = None) -> Array:
        values, V = np.linalg.eigh(M)
        return np.asarray((V * _weights(values, sharpness or _SHARPNESS)) @ V.T)

    def ascent(self, M: Array, sharpness: float | None = None) -> Array:
        values, V = np.linalg.eigh(M)
        return np.asarray((V * _weights(values, (sharpness or _SHARPNESS) + 1)) @ V.T)


@dataclass(frozen=True, eq=False)
class WorstRatio(Criterion):
    """min over k of pi_k^2 / (c_k^T M^-1 c_k): the square of the worst ratio (seed eq. 20) of the combinations of interest.

    With u_k = c_k / pi_k and V = M^-1, each term has the gradient N_k = phi_k^2 V u_k u_k^T V; the dual is a mean of them.

    Attributes
    ----------
    u : (K, r)
        Combinations over their assumed values.
    """

    u: Array
    name: str = "ratio"
    sharpness: float | None = _SHARPNESS

    def terms(self, M: Array) -> Array:
        """Squares of all ratios, (..., K)."""
        half = self.u @ np.linalg.inv(M)
        return 1.0 / (half * self.u).sum(axis=-1)

    def value(self, M: Array) -> Array:
        return self.terms(M).min(axis=-1)

    def dual(self, M: Array, sharpness: float | None = None) -> Array:
        return self._mean(M, sharpness or _SHARPNESS)

    def ascent(self, M: Array, sharpness: float | None = None) -> Array:
        return self._mean(M, (sharpness or _SHARPNESS) + 1)

    def _mean(self, M: Array, sharpness: float) -> Array:
        half = np.linalg.solve(M, self.u.T)
        phi = 1.0 / (self.u.T * half).sum(axis=0)
        return (half * (_weights(phi, sharpness) * phi**2)) @ half.T


@dataclass(frozen=True, eq=False)
class Suspect(Criterion):
    """det(S)^(1/s) of the last s parameters with all others projected out; dual phi/s (M^-1 - diag(M_bb^-1, 0))."""

    s: int
    name: str = "ds"

    def value(self, M: Array) -> Array:
        b = M.shape[-1] - self.s
        sign, whole = np.linalg.slogdet(M)
        sign_b, base = np.linalg.slogdet(M[..., :b, :b]) if b else (np.ones(M.shape[:-2]), np.zeros(M.shape[:-2]))
        return np.where((sign > 0) & (sign_b > 0), np.exp((whole - base) / self.s), 0.0)

    def dual(self, M: Array, sharpness: float | None = None) -> Array:
        b = M.shape[-1] - self.s
        Z: Array = np.asarray(np.linalg.inv(M), dtype=float)
        Z[:b, :b] -= np.linalg.inv(M[:b, :b])
        return float(self.value(M)) / self.s * Z


def smooth_value(criterion: Criterion, M: Array, sharpness: float | None) -> float:
    """phi, or the mean of power -sharpness of its terms, which the ascent follows instead of the kinks."""
    if sharpness is None:
        return float(criterion.value(M))
    terms = criterion.terms(M)
    least = float(terms.min())
    return float(least * np.mean((terms / least) ** -sharpness) ** (-1.0 / sharpness))


def _weights(values: Array, sharpness: float) -> Array:
    """values^-sharpness, of sum one."""
    values = np.maximum(values, _TINY)
    w = (values / values.min()) ** -sharpness
    return np.asarray(w / w.sum())
