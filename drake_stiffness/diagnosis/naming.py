"""Which suspect is it: tests against noise, and evidence on unseen experiments."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Self

import numpy as np
from numpy.typing import NDArray

from drake_stiffness.diagnosis.classes import may_be
from drake_stiffness.diagnosis.evidence import (
    Tested,
    basis_of,
    cross_validated,
    folds_of,
    inside_cones,
    least_squares,
    left_over,
    level_of_smallest,
)
from drake_stiffness.diagnosis.signatures import Scene, signature
from drake_stiffness.diagnosis.suspects import Suspect
from drake_stiffness.effects import Effect
from drake_stiffness.hold_out import ordered_groups
from drake_stiffness.observation import columns
from drake_stiffness.rotations import Array

FOLDS = 5
_LEAST_DOF = 10
# Variants whose signatures correlate by less than this are of another shape; one of them explaining this share of the best
# means that the best is no discovery.
_ANOTHER_SHAPE, _NEARLY = 0.6, 0.6


@dataclass(frozen=True, eq=False)
class Round:
    """All suspects against one model.

    Attributes
    ----------
    passed : list of Tested
        Those that noise does not explain, most convincing first.
    failed : list of Tested
        The others, most significant first.
    faults : dict of name to reason
        Suspects that could not be tried.
    level : float
        What a p-value had to be below.
    rest_per_dof : float
        Squared residual per degree of freedom before anything is added.
    """

    passed: list[Tested]
    failed: list[Tested]
    faults: dict[str, str]
    level: float
    rest_per_dof: float


@dataclass(frozen=True, eq=False)
class Remaining:
    """What a fitted model leaves: its residual with its own columns projected out, and the projector.

    Attributes
    ----------
    scene : Scene
    Q : (rows, r)
        Orthonormal basis of the model's own columns.
    r : (rows,)
    dof : int
    """

    scene: Scene
    Q: Array
    r: Array
    dof: int

    @property
    def per_dof(self) -> float:
        return float(self.r @ self.r) / max(self.dof, 1)

    def beside(self, S: Array) -> Array:
        """What is left of further columns beside the model's own."""
        return left_over(S, self.Q)

    def rest(self, effect: Effect) -> Array:
        """What is left of an effect's columns beside the model's own."""
        return self.beside(self.columns_of(effect))

    def columns_of(self, effect: Effect) -> Array:
        """(rows, p) whitened, per unit of the effect's scales."""
        return signature(self.scene, effect)

    def with_columns(self, rest: Array) -> Self:
        """The same with further columns, of which this is what is left, projected out too."""
        Q = basis_of(rest)
        r = self.r - Q @ (Q.T @ self.r)
        return replace(self, Q=np.hstack([self.Q, Q]), r=r, dof=self.dof - Q.shape[1])

    def folds(self, seed: int) -> NDArray[np.int_]:
        """(rows,) which fold of whole experiments every row is in."""
        o = self.scene.o
        return folds_of(o.cluster, ordered_groups(o.measurements), FOLDS, seed)


def remaining(scene: Scene, residual: Array, seen: Array) -> Remaining:
    """Project the model's own parameters out of its residual.

    Parameters
    ----------
    residual : (rows,)
        Whitened residual of the fit.
    seen : (n, r)
        Directions of the model's own parameters that were fitted, in units of scale.
    """
    Q = basis_of(columns(scene.o, scene.model) @ seen)
    r = residual - Q @ (Q.T @ residual)
    return Remaining(scene, Q, r, scene.o.rows - scene.o.references - Q.shape[1])


def try_all(left: Remaining, found: list[Suspect], seed: int) -> Round:
    """Test every suspect against what a fitted model leaves."""
    faults: dict[str, str] = {}
    rests = {suspect.name: rests_of(left, suspect, faults) for suspect in found}
    if left.dof <= _LEAST_DOF:
        return Round([], [], faults, 0.0, left.per_dof)
    bases = {name: tuple(basis_of(S) for S in own) for name, own in rests.items()}
    sizes = [Q.shape[1] for own in bases.values() for Q in own if Q.shape[1]]
    if not sizes:
        return Round([], [], faults, 0.0, left.per_dof)
    level = level_of_smallest(np.hstack([Q for own in bases.values() for Q in own]), sizes, left.dof, seed)
    tested = [best_variant(left, suspect, rests[suspect.name], bases[suspect.name]) for suspect in found]
    able = [t for t in tested if t is not None]
    gain = Gain(left, seed)
    passed = [_with_gain(t, gain, rests[t.suspect.name]) for t in able if t.p_value < level]
    passed.sort(key=lambda t: -t.gain)
    failed = sorted((t for t in able if t.p_value >= level), key=lambda t: t.p_value)
    return Round(passed, failed, faults, level, left.per_dof)


class Gain:
    """Cross-validated gain of columns beside the model's own: by how much chi-square of unseen experiments falls."""

    def __init__(self, left: Remaining, seed: int) -> None:
        self.left = left
        self.fold = left.folds(seed)
        self.before = cross_validated(left.Q, [np.zeros((left.r.size, 0))], left.r, self.fold)

    def of(self, rests: Sequence[Array], effect: Effect | None = None) -> float:
        """Of the best of several variants, in units of the noise the data show; inside the cones of `effect`, if it has any."""
        fit = (inside_cones(effect) if effect and len(rests) == 1 else None) or least_squares
        after = cross_validated(self.left.Q, rests, self.left.r, self.fold, fit)
        return (self.before - after) / max(self.left.per_dof, 1e-300)


def _with_gain(t: Tested, gain: Gain, rests: Sequence[Array]) -> Tested:
    # A matrix that is not positive semidefinite is no spring, however well it fits: it soaks up what else is missing.
    searched = gain.of(rests, t.effect)
    return replace(t, gain=searched, own_gain=searched if len(rests) == 1 else gain.of([rests[t.variant]]))


def rests_of(left: Remaining, suspect: Suspect, faults: dict[str, str]) -> tuple[Array, ...]:
    """What is left of every variant's columns; nothing, and the reason in `faults`, if it cannot be tried."""
    out = []
    for effect in suspect.variants:
        try:
            rest = left.rest(effect) if left.scene.shows(effect) else np.zeros((left.r.size, len(effect.parameters)))
        except Exception as error:
            # A candidate is anybody's code: it fails alone, the run goes on, and the report says so.
            faults[suspect.name] = f"{type(error).__name__}: {error}"
            return ()
        out.append(rest if np.isfinite(rest).all() else np.zeros_like(rest))
    return tuple(out)


def best_variant(left: Remaining, suspect: Suspect, rests: Sequence[Array], bases: Sequence[Array]) -> Tested | None:
    """The most significant variant whose signs its bounds allow; None if there is none."""
    from scipy.special import fdtrc

    total, best = float(left.r @ left.r), None
    for number, (S, Q) in enumerate(zip(rests, bases, strict=True)):
        if not Q.shape[1]:
            continue
        part = Q.T @ left.r
        coefficient = _within_bounds(suspect.variants[number], Q.T @ S, part)
        fit = S @ coefficient
        explained, p = total - float(((left.r - fit) ** 2).sum()), Q.shape[1]
        if explained <= 0:
            continue
        rest_dof = max(left.dof - p, 1)
        p_value = float(fdtrc(p, rest_dof, explained / p / (max(total - explained, 1e-300) / rest_dof)))
        if best is None or (p_value, -explained) < (best.p_value, -best.explained):
            best = Tested(suspect, number, explained, p_value, 0.0, 0.0, coefficient, fit, tuple(bases))
    return best


def _within_bounds(effect: Effect, S: Array, r: Array) -> Array:
    """Least-squares values of an effect's parameters in units of their scales, its bounds respected (from its own start)."""
    coefficient = np.asarray(np.linalg.lstsq(S, r, rcond=1e-9)[0], dtype=float)
    start = effect.initial()
    lower = np.array([(p.lower - s) / p.scale for p, s in zip(effect.parameters, start, strict=True)])
    upper = np.array([(p.upper - s) / p.scale for p, s in zip(effect.parameters, start, strict=True)])
    if ((coefficient >= lower) & (coefficient <= upper)).all():
        return coefficient
    from scipy.optimize import lsq_linear

    return np.asarray(lsq_linear(S, r, (lower, upper)).x, dtype=float)


def refine(left: Remaining, t: Tested) -> Effect:
    """The chosen variant with its nonlinear constants improved; where one that stays bounded fits as well within noise, that one.

    Readings that took no part may be of larger loads: there a form that grows without bound is wrong by much.
    """
    best = _improved(left, t)
    bounded = [e for e in t.suspect.variants if e.bounded]
    if best.effect.bounded or not bounded:
        return best.effect
    rests = rests_of(left, replace(t.suspect, variants=tuple(bounded)), {})
    found = best_variant(left, replace(t.suspect, variants=tuple(bounded)), rests, [basis_of(S) for S in rests])
    if found is None:
        return best.effect
    found = _improved(left, found)
    return found.effect if may_be(found, best, left.per_dof) else best.effect


def _improved(left: Remaining, t: Tested) -> Tested:
    """The same with its nonlinear constants improved: neighbours are tried with ever smaller steps."""
    for step in (0.5, 0.25, 0.12, 0.06):
        for other in t.effect.neighbours(step):
            if not left.scene.shows(other):
                continue
            rest = left.rest(other)
            suspect = Suspect(t.suspect.kind, t.suspect.where, (other,))
            found = best_variant(left, suspect, (rest,), (basis_of(rest),))
            if found is not None and found.explained > t.explained:
                t = found
    return t


def is_sponge(r: Array, t: Tested) -> bool:
    """Whether variants of quite another shape do nearly as well: then none of them is the physics, and all soak up something else.

    Parameters
    ----------
    r : (rows,)
        What the model leaves.
    """
    size = max(float(np.linalg.norm(t.fit)), 1e-300)
    others = [Q for Q in t.bases if Q.shape[1] and float(np.linalg.norm(Q.T @ t.fit)) < _ANOTHER_SHAPE * size]
    by_chance = 3 * np.log(len(t.bases))  # what noise may add to the best of so many
    return any(float(((Q.T @ r) ** 2).sum()) > _NEARLY * t.explained + by_chance for Q in others)
