"""The continuous relaxation of a plan: weights instead of choices, and the bound that no plan can exceed.

A plan of n out of N candidates is x in {0, 1}^N with sum n. The relaxation admits 0 <= x <= 1; its optimum bounds every plan. It is
found by mirror ascent, the multiplicative rule of optimal design kept inside the box: x_i grows by (g_i / mean g)^step, g_i = <Z, F_i>,
and is scaled and cut at one until the sum is n (the Kullback-Leibler projection). Steps grow while the criterion does.

Every Z met on the way is a certificate (see `design_criteria`): phi of any plan <= <Z, M_0> + the n largest <Z, F_i>. The best of
them is handed back, so that the bound holds however early the ascent stops. `relaxed_by_cvxpy` states the same problem as a convex
program for small sizes: the check.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from drake_stiffness.design.criteria import (
    Criterion,
    Determinant,
    MeanVariance,
    SmallestEigenvalue,
    Suspect,
    WorstRatio,
    smooth_value,
)
from drake_stiffness.design.information import Information
from drake_stiffness.rotations import Array

# The ascent stops when the relaxed plan is proven to be this good, or after so many steps.
_CLOSE = 0.998
_STEPS = 600
# Without a better bound or value for so many steps, criteria with kinks are followed more sharply.
_PATIENCE = 20
_SHARPEST = 2000.0
# Weights below this are as good as none but can come back.
_FLOOR = 1e-9


@dataclass(frozen=True, eq=False)
class Relaxation:
    """Attributes
    ----------
    x : (N,)
        Weights, 0 .. 1, of sum n.
    value : float
        phi of the weights.
    bound : float
        What phi of no plan of n candidates exceeds.
    """

    x: Array
    value: float
    bound: float


def upper_bound(information: Information, Z: Array, n: int) -> float:
    """<Z, M_0> plus the n largest <Z, F_i>."""
    gains = information.inner(Z)
    largest = np.partition(gains, gains.size - n)[gains.size - n :] if n < gains.size else gains
    return float((Z * information.start).sum() + largest.sum())


def relax(information: Information, criterion: Criterion, n: int) -> Relaxation:
    """Weights of n postures over all candidates, and the bound."""
    x = np.full(information.number, n / information.number)
    M = information.total(x)
    sharpness, step, bound, best = criterion.sharpness, 0.5, np.inf, (0.0, x)
    smooth, waited = smooth_value(criterion, M, sharpness), 0
    for _ in range(_STEPS):
        gain = information.inner(criterion.ascent(M, sharpness))
        new = upper_bound(information, criterion.dual(M, sharpness), n)
        value = float(criterion.value(M))
        progress = new < bound * (1 - 1e-4) or value > best[0] * (1 + 1e-4)
        waited = 0 if progress else waited + 1
        bound = min(bound, new)
        best = max(best, (value, x), key=lambda pair: pair[0])
        if best[0] >= _CLOSE * bound:
            break
        if waited > _PATIENCE:
            if sharpness is None or sharpness > _SHARPEST:
                break
            sharpness, step, waited = 2 * sharpness, 0.5, 0
            smooth = smooth_value(criterion, M, sharpness)
        growth = np.maximum(gain, 0.0) / (x @ gain / n)
        while True:
            y = capped(np.maximum(x, _FLOOR) * growth**step, n)
            M_new = information.total(y)
            smooth_new = smooth_value(criterion, M_new, sharpness)
            if smooth_new > smooth * (1 - 1e-12) or step < 1e-3:
                break
            step *= 0.5
        x, M, smooth, step = y, M_new, smooth_new, min(1.25 * step, 50.0)
    return Relaxation(best[1], best[0], bound)


def capped(y: Array, n: int) -> Array:
    """min(c y, 1) with c such that the sum is n, for positive y."""
    full = np.zeros(y.size, dtype=bool)
    while True:
        c = (n - full.sum()) / max(y[~full].sum(), 1e-300)
        over = ~full & (c * y > 1.0)
        if not over.any():
            return np.where(full, 1.0, c * y)
        full |= over


def relaxed_by_cvxpy(information: Information, criterion: Criterion, n: int) -> tuple[float, Array]:
    """Optimum and weights of the same relaxation as a convex program (for up to a few hundred candidates)."""
    import cvxpy as cp

    x = cp.Variable(information.number, nonneg=True)
    F = information.of(np.arange(information.number))
    r = information.size
    # Matrices over many decades hinder the solver: a congruence that makes the mean matrix one.
    half = np.linalg.inv(np.linalg.cholesky(information.total(np.full(information.number, n / information.number))))
    M: Any = half @ information.start @ half.T
    M = M + cp.reshape((half @ F @ half.T).reshape(information.number, r * r).T @ x, (r, r), order="C")
    M = (M + M.T) / 2
    constraints: list[Any] = [x <= 1, cp.sum(x) == n]
    unit = 1.0
    if isinstance(criterion, Determinant):
        objective: Any = cp.log_det(M)
    elif isinstance(criterion, MeanVariance):
        root = half @ _root(criterion.C)
        objective = -_trace_inverse(cp, M, root, constraints)
    elif isinstance(criterion, Suspect):
        s = criterion.s
        S = cp.Variable((s, s), symmetric=True)
        E = half @ np.eye(r)[:, r - s :]
        # M - E S E^T >= 0 says that S is at most the Schur complement of M.
        constraints.append(M - E @ S @ E.T >> 0)
        objective = cp.log_det(S)
    elif isinstance(criterion, SmallestEigenvalue | WorstRatio):
        t = cp.Variable()
        vectors = criterion.u.T[None] if isinstance(criterion, WorstRatio) else np.eye(r)[None]
        columns = (
            [half @ vectors[0]]
            if isinstance(criterion, SmallestEigenvalue)
            else [half @ u[:, None] for u in criterion.u]
        )
        unit = max(
            float(criterion.value(information.total(np.full(information.number, n / information.number)))), 1e-300
        )
        constraints += [M - t * unit * (c @ c.T) >> 0 for c in columns]
        objective = t
    else:
        raise TypeError(f"no convex program for {type(criterion).__name__}")
    cp.Problem(cp.Maximize(objective), constraints).solve(solver=cp.CLARABEL)
    weights = np.clip(np.asarray(x.value), 0.0, 1.0)
    return float(criterion.value(information.total(weights))), weights


def _trace_inverse(cp: Any, M: Any, root: Array, constraints: list[Any]) -> Any:
    """tr(root^T M^-1 root) as the least trace of X with [[M, root], [root^T, X]] >= 0."""
    k = root.shape[1]
    size = float((root**2).sum())
    X = cp.Variable((k, k), symmetric=True)
    constraints.append(cp.bmat([[M, root / np.sqrt(size)], [root.T / np.sqrt(size), X]]) >> 0)
    return cp.trace(X)


def _root(C: Array) -> Array:
    values, V = np.linalg.eigh(C)
    keep = values > 1e-12 * values[-1]
    return np.asarray(V[:, keep] * np.sqrt(values[keep]))
