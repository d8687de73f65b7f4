"""What a plan is chosen from: candidates with their rows, the directions they can determine, what was measured already."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from drake_stiffness.base_parameters import base_of
from drake_stiffness.design.assumptions import Interest, parameters_of_interest
from drake_stiffness.design.candidates import Candidates, draw_candidates, effect_rows, spring_rows
from drake_stiffness.design.criteria import (
    Criterion,
    Determinant,
    MeanVariance,
    SmallestEigenvalue,
    Suspect,
    WorstRatio,
)
from drake_stiffness.design.information import Information, gather
from drake_stiffness.design.settings import Design
from drake_stiffness.effects import Effect
from drake_stiffness.effects.compliance import Spring
from drake_stiffness.effects.effect import Cases
from drake_stiffness.errors import InputError
from drake_stiffness.identifiability import Identifiability, analyse
from drake_stiffness.model import Model
from drake_stiffness.rotations import Array
from drake_stiffness.sensitivity import has_finite_differences, sensitivity

Progress = Callable[[str], None]

# Of a program, at most so many points, evenly spread, stand for the whole.
_PATH_POINTS = 500
# A suspect whose columns keep less than this outside the base model's is its double: difference quotients are good to 1e-9.
_DOUBLE_BELOW = 1e-6


@dataclass(frozen=True, eq=False)
class Measured:
    """What was measured already.

    Attributes
    ----------
    experiments : tuple of names
    R : (k, n)
        Rows whose R^T R is its information about the model's parameters, per unit of scale.
    """

    experiments: tuple[str, ...]
    R: Array


@dataclass(frozen=True, eq=False)
class Space:
    """What a plan is chosen from.

    Attributes
    ----------
    model : Model
        At the assumed values; a suspected effect stands last.
    settings : Design
    candidates : Candidates
    rows : (N, m, n)
        Whitened rows of every candidate, per unit of scale.
    view : Identifiability
        Of the cell's own model, by all candidates (as if n of them were done) and what is measured.
    basis : (n, r)
        Directions that are designed for; the last `suspected` belong to the suspected effect.
    information : Information
        Along the basis.
    suspected : int
    measured : Measured or None
    """

    model: Model
    settings: Design
    candidates: Candidates
    rows: Array
    view: Identifiability
    basis: Array
    information: Information
    suspected: int
    measured: Measured | None

    @property
    def base_model(self) -> Model:
        """Without the suspected effect."""
        return self.model.subset([True] * (len(self.model.effects) - 1) + [False]) if self.suspected else self.model

    def interest(self) -> Interest:
        """Base parameters whose ratios count."""
        model = self.base_model
        return parameters_of_interest(model, base_of(self.view, model), self.settings)


def prepare(
    model: Model,
    n: int,
    settings: Design,
    *,
    suspect: Effect | None = None,
    measured: Measured | None = None,
    progress: Progress = lambda text: None,
) -> Space:
    """Candidates, their rows, and the directions that can be determined.

    Parameters
    ----------
    model : Model
        At assumed values (`design_assumptions.assumed_model`), or what a campaign identified.
    n : int
        Postures of the plan.
    suspect : Effect, optional
        Not part of the model.
    measured : Measured, optional
        Its columns are the model's parameters.

    Raises
    ------
    InputError
        On settings that leave no candidates, or a suspect that nothing can show.
    """
    if n > settings.candidates:
        raise InputError(
            f"-n: found {n} postures, but there are {settings.candidates} candidates to choose from; raise candidates in "
            f"{settings.path}."
        )
    progress(f"drawing {settings.candidates} candidates")
    candidates = draw_candidates(model, settings)
    own = model.x.size
    if suspect is not None:
        x = np.concatenate([model.x, suspect.initial()])
        model = replace(model, effects=(*model.effects, suspect), x=x, statistics=None)
    progress("sensitivities of the candidates")
    springs = all(isinstance(effect, Spring) for effect in model.effects)
    noise = settings.noise
    rows = (spring_rows if springs else effect_rows)(
        model, candidates, noise.position_sigma_mm * 1e-3, noise.settling_sigma_mm * 1e-3
    )
    R = np.asarray(np.linalg.qr(rows.reshape(-1, rows.shape[2]), mode="r")) * np.sqrt(n / candidates.number)
    start = np.zeros((0, model.x.size))
    if measured is not None:
        start = np.hstack([measured.R, np.zeros((measured.R.shape[0], model.x.size - own))])
        R = np.asarray(np.linalg.qr(np.vstack([R, start]), mode="r"))
    progress("what they can determine")
    view = analyse(R[:, :own], coarse=has_finite_differences(model))
    if not view.fitted:
        raise InputError(
            f"{settings.path}: no reading of {n} such postures would show any compliance above the noise; raise loads (N) or check "
            "noise.position_sigma_mm."
        )
    basis, suspected = view.seen, 0
    if suspect is not None:
        seen = _seen_suspect(R[:, :own] @ view.seen, R[:, own:], suspect, settings)
        suspected = seen.shape[1]
        basis = np.zeros((model.x.size, view.fitted + suspected))
        basis[:own, : view.fitted], basis[own:, view.fitted :] = view.seen, seen
    information = gather(rows, basis, (start @ basis).T @ (start @ basis))
    return Space(model, settings, candidates, rows, view, basis, information, suspected, measured)


def _seen_suspect(base: Array, own: Array, suspect: Effect, settings: Design) -> Array:
    """Directions of the suspected effect that the base model does not explain, (s, seen)."""
    Q, _ = np.linalg.qr(base)
    rest = own - Q @ (Q.T @ own)
    length = np.linalg.norm(own, axis=0)
    if not length.any():
        raise InputError(
            f"--suspect {suspect.kind}:{suspect.where}: it moves no displacement under these loads, so no plan of them can show it. Change loads in "
            f"{settings.path} (levels, directions), or measure positions."
        )
    view = analyse(rest, coarse=True)
    share = np.linalg.norm(rest @ view.seen, axis=0) / np.maximum(np.linalg.norm(own @ view.seen, axis=0), 1e-300)
    seen = view.seen[:, share > _DOUBLE_BELOW]
    if not seen.shape[1]:
        raise InputError(
            f"--suspect {suspect.kind}:{suspect.where}: under these loads its effect on readings equals that of compliances (to {share.max(initial=0.0):.0e} of "
            f"its size), so no plan can tell it from them. Change loads in {settings.path}: more levels, other directions, moments."
        )
    return seen


def make_criterion(space: Space, name: str, path_rows: Array | None = None) -> Criterion:
    """The criterion by its name.

    Parameters
    ----------
    name : a, d, e, toolpath, ratio or ds
    path_rows : (T, 3, n)
        For toolpath: gradients of the displacement along the program, m per unit of scale (`path_gradients`).
    """
    r = space.basis.shape[1]
    if name == "d":
        return Determinant()
    if name == "a":
        return MeanVariance(np.eye(r) / r)
    if name == "e":
        return SmallestEigenvalue()
    if name == "ds":
        return Suspect(space.suspected)
    if name == "toolpath":
        assert path_rows is not None
        A = path_rows @ space.basis[: path_rows.shape[2]]
        return MeanVariance(np.einsum("tci,tcj->ij", A, A) / A.shape[0], "toolpath")
    interest = space.interest()
    u = interest.c @ space.basis[: interest.c.shape[1]] / interest.value[:, None]
    return WorstRatio(u)


def path_gradients(model: Model, q: Array, wrench: Array) -> Array:
    """How the displacement of the tool centre point changes with the parameters, (T, 3, n), m per unit of scale.

    Parameters
    ----------
    q : (joints, T), wrench : (6, T)
        Postures along a program and loads at the tool centre point, world axes.
    """
    some = np.unique(np.linspace(0, q.shape[1] - 1, min(q.shape[1], _PATH_POINTS)).astype(int))
    tip = "(tool centre point)"
    model = replace(model, points={tip: model.tcp[1]})
    cases = Cases(q[:, some], wrench[:, some], model.tcp[1])
    every, names = np.arange(some.size), np.full(some.size, tip)
    loaded = sensitivity(model, cases, every, names)[:, :3]
    return np.asarray(loaded - sensitivity(model, cases.unloaded(), every, names)[:, :3])


def unsupported_share(space: Space, path_rows: Array) -> float:
    """Share (0 .. 1, root mean square) of the gradients along a program that no candidate shows."""
    A = path_rows.reshape(-1, path_rows.shape[2])
    seen = A @ space.view.seen
    whole = float((A**2).sum())
    return float(np.sqrt(max(whole - float((seen**2).sum()), 0.0) / whole)) if whole > 0 else 0.0
