"""A stored model as a prior: readings of a short campaign beside what its own campaign left uncertain.

The stored parameters are x = x_0 + B z with z ~ N(0, I) and B B^T their covariance; what that campaign did not see stays as
stored. As rows this is [A B; I] z against [r; 0], with A the observation matrix at x_0 and r the whitened residual there: its sum of
squares after the fit is r^T (I + A C A^T)^-1 r, and projections, F-tests and evidence on unseen postures work as on any fit.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from drake_stiffness.diagnosis.evidence import basis_of, left_over
from drake_stiffness.diagnosis.naming import Remaining
from drake_stiffness.diagnosis.signatures import Scene
from drake_stiffness.effects import Effect
from drake_stiffness.effects.effect import Parameter
from drake_stiffness.identifiability import HIDDEN_BELOW
from drake_stiffness.model import Model
from drake_stiffness.observation import Observations, columns, measured, predicted
from drake_stiffness.rotations import Array

_ROUNDS = 10
_STANDS = 1e-3


class Changed(Effect):
    """An effect of the stored model whose values may have changed since: it starts at the stored ones.

    Parameters
    ----------
    effect : Effect
    number : int
        Its place in the model.
    value : Array
        As stored.
    """

    station = "arm"

    def __init__(self, effect: Effect, number: int, value: Array) -> None:
        super().__init__(effect.where)
        self.kind, self.needs = effect.kind, effect.needs  # type: ignore[misc]
        self.effect, self.number, self.value = effect, number, value

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        return self.effect.parameters

    def initial(self) -> Array:
        return self.value


@dataclass(frozen=True, eq=False)
class WithPrior(Remaining):
    """What a stored model leaves of readings beside its own uncertainty; rows of the prior come last.

    Attributes
    ----------
    A : (rows, n)
        Of the stored model, whitened, per unit of scale.
    prior : int
        Rows of the prior.
    """

    A: Array
    prior: int

    def beside(self, S: Array) -> Array:
        return left_over(np.vstack([S, np.zeros((self.prior, S.shape[1]))]), self.Q)

    def columns_of(self, effect: Effect) -> Array:
        if isinstance(effect, Changed):
            return self.A[:, self.scene.model.slices[effect.number]]
        return super().columns_of(effect)

    def folds(self, seed: int) -> NDArray[np.int_]:
        return np.concatenate([super().folds(seed), np.full(self.prior, -1)])


def prior_root(model: Model, fresh: Sequence[int]) -> Array:
    """B (n, k) in units of scale, B B^T the covariance of the stored parameters; effects that are set up anew have no part."""
    assert model.statistics is not None
    C = model.statistics.covariance / np.outer(model.scales, model.scales)
    sigma = np.sqrt(np.maximum(np.diag(C), 0.0))
    unit = np.where(sigma > 0, sigma, 1.0)
    values, vectors = np.linalg.eigh(C / np.outer(unit, unit))
    keep = values > 1e-12 * max(float(values[-1]), 1e-300)
    B = unit[:, None] * vectors[:, keep] * np.sqrt(values[keep])
    for number in fresh:
        B[model.slices[number]] = 0.0
    return np.asarray(B)


def with_prior(model: Model, o: Observations, root: Array, free: Sequence[int]) -> WithPrior:
    """What a stored model leaves, the unknowns `free` fitted and the others carried with their uncertainty."""
    A = columns(o, model)
    r = np.concatenate([measured(o) - predicted(o, model), np.zeros(root.shape[1])])
    Q = basis_of(stored_columns(A, root, free))
    r = r - Q @ (Q.T @ r)
    dof = o.rows - o.references + root.shape[1] - Q.shape[1]
    return WithPrior(Scene(model, o), Q, r, dof, A, root.shape[1])


def stored_columns(A: Array, root: Array, free: Sequence[int]) -> Array:
    """[A D; I 0]: what the stored parameters' uncertainty and the free unknowns do to the readings, above the rows of the prior."""
    return np.vstack([A @ _directions(root, free), np.eye(root.shape[1], root.shape[1] + len(free))])


@dataclass(frozen=True, eq=False)
class Settled:
    """A model after a short campaign: most probable values, and their covariance in units of scale, (n, n)."""

    model: Model
    covariance: Array


def settle(model: Model, o: Observations, root: Array, free: Sequence[int]) -> Settled:
    """Most probable values under prior and readings, around the loaded equilibrium (Gauss-Newton).

    Parameters
    ----------
    root : (n, k)
        B, in units of scale; rows of zeros for unknowns that the stored model has not.
    free : numbers of unknowns without a prior
    """
    D, prior = _directions(root, free), np.eye(root.shape[1], root.shape[1] + len(free))
    lower = np.array([p.lower for p in model.parameters]) / model.scales
    upper = np.array([p.upper for p in model.parameters]) / model.scales
    start, y = model.x / model.scales, measured(o)
    z = np.zeros(D.shape[1])
    inverse = np.zeros((D.shape[1], 0))
    for _ in range(_ROUNDS):
        X = stored_columns(columns(o, model), root, free)
        inverse = _inverse(X)
        step = inverse @ np.concatenate([y - predicted(o, model), -(prior @ z)])
        z = z + step
        # A free unknown stops at its bound; the stored ones keep to where their own fit, constraints included, put them.
        x = start + D @ z
        x[list(free)] = np.clip(x, lower, upper)[list(free)]
        model = model.with_x(x * model.scales)
        if np.linalg.norm(X @ step) < _STANDS:
            break
    half = D @ inverse
    return Settled(model, half @ half.T)


def _inverse(X: Array) -> Array:
    """Pseudo-inverse on what the readings and the prior see; a free direction that noise hides stays where it is."""
    U, s, Vt = np.linalg.svd(X, full_matrices=False)
    keep = s > HIDDEN_BELOW
    return np.asarray((Vt[keep].T / s[keep]) @ U[:, keep].T)


def _directions(root: Array, free: Sequence[int]) -> Array:
    return np.hstack([root, np.eye(root.shape[0])[:, list(free)]])
