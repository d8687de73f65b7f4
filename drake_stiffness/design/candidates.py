"""Candidates of a measurement plan: random postures that keep clear, each with loads, and what each would tell.

A candidate is one experiment: unloaded, every load direction at rising levels, unloaded after each direction. Its information
is A^T A, A being the whitened rows it would add to the observation matrix (`observation`): the unloaded position of every point
is an unknown of the experiment, eliminated by taking the mean over its steps off.

Springs obey superposition in the linear theory, so a direction is evaluated once, at full load without weight, and the steps
enter through the Gram matrix of their centred levels, G = L L^T: the rows (L^T kron 1) a have the same A^T A.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from drake_stiffness.arm import Arm
from drake_stiffness.design.settings import Design, load_options, posture_ranges
from drake_stiffness.design.workspace import acceptable
from drake_stiffness.effects.compliance import Spring
from drake_stiffness.effects.effect import Cases
from drake_stiffness.errors import InputError
from drake_stiffness.model import Model
from drake_stiffness.rotations import Array
from drake_stiffness.sensitivity import sensitivity

# Random postures drawn at once, and how many rounds without enough of them before the space counts as too tight.
_DRAWN = 5000
_ROUNDS = 60
# Candidates whose sensitivities are held at once.
_CHUNK = 200


@dataclass(frozen=True, eq=False)
class Candidates:
    """N experiments that could be done.

    Attributes
    ----------
    q : (n, N)
        Joints as a plan prints them (a hundredth of a degree, a tenth of a millimetre), rad and m.
    full : (N, D, 6)
        The D loads of each at their full level, N and N m.
    pattern : (steps, D)
        Share of every load in every step; the same for all.
    share : float
        Of the random postures, how many kept clear.
    """

    q: Array
    full: Array
    pattern: Array
    share: float

    @property
    def number(self) -> int:
        return self.q.shape[1]

    @property
    def wrench(self) -> Array:
        """(N, steps, 6) load of every step."""
        return np.einsum("sd,ndw->nsw", self.pattern, self.full)

    def take(self, which: NDArray[np.int_]) -> Candidates:
        """Some of them, in the order given."""
        return replace(self, q=self.q[:, which], full=self.full[which])

    def cases(self, load_point: Array) -> Cases:
        """All steps as cases, one experiment each."""
        steps = self.pattern.shape[0]
        return Cases(
            np.repeat(self.q, steps, axis=1),
            self.wrench.reshape(-1, 6).T,
            load_point,
            np.repeat(np.arange(self.number), steps),
            np.tile(np.arange(steps), self.number),
            np.full(self.number * steps, np.nan),
        )


def step_pattern(directions: int, levels: tuple[float, ...]) -> Array:
    """Share of every load in every step, (steps, directions): unloaded, then each direction rising, then unloaded again."""
    rows = [np.zeros(directions)]
    for d in range(directions):
        rows += [level * np.eye(directions)[d] for level in levels]
        rows.append(np.zeros(directions))
    return np.array(rows)


def draw_candidates(model: Model, settings: Design) -> Candidates:
    """Random postures with loads, the same for the same seed.

    Raises
    ------
    InputError
        If almost no posture keeps clear, or there are fewer loads than `loads.per_posture`.
    """
    arm = model.arm
    always, options = load_options(settings, arm)
    drawn = settings.loads.per_posture - always.shape[1]
    if drawn < 0 or drawn > options.shape[1]:
        raise InputError(
            f"{settings.path}: loads.per_posture: found {settings.loads.per_posture}; {always.shape[1]} load (down) is hung on every "
            f"posture and {options.shape[1]} more are to choose from. Give a number between {max(always.shape[1], 1)} and "
            f"{always.shape[1] + options.shape[1]}."
        )
    rng = np.random.default_rng(settings.seed)
    q, share = _draw_postures(model, settings, rng)
    picks = rng.permuted(np.tile(np.arange(options.shape[1]), (q.shape[1], 1)), axis=1)[:, :drawn]
    full = np.concatenate([np.broadcast_to(always.T, (q.shape[1], *always.T.shape)), options.T[picks]], axis=1)
    return Candidates(q, full, step_pattern(full.shape[1], settings.loads.levels), share)


def _draw_postures(model: Model, settings: Design, rng: np.random.Generator) -> tuple[Array, float]:
    arm = model.arm
    lower, upper = posture_ranges(settings, arm)
    points = np.array(list(model.points.values()))
    kept, found = [], 0
    for drawn in range(1, _ROUNDS + 1):
        q = rounded(arm, rng.uniform(lower[:, None], upper[:, None], (arm.num_joints, _DRAWN)), lower, upper)
        good = q[:, acceptable(arm, settings, q, points, model.load_point, model.tcp[1])]
        kept.append(good)
        found += good.shape[1]
        if found >= settings.candidates:
            break
        if drawn >= 4 and found < 10:
            break
    if found < settings.candidates:
        raise InputError(
            f"{settings.path}: only {found} of {drawn * _DRAWN} random postures keep clear of floor, boxes, the arm itself and what "
            f"else is asked; {settings.candidates} candidates are wanted. Check keep_out_boxes, floor_m, clearance_m, joint_ranges and "
            "tracker (metres, world frame), or ask for fewer candidates."
        )
    return np.concatenate(kept, axis=1)[:, : settings.candidates], found / (drawn * _DRAWN)


def rounded(arm: Arm, q: Array, lower: Array, upper: Array) -> Array:
    """Joints as they will be printed - hundredths of a degree, tenths of a millimetre - inside the ranges."""
    digit = np.where(arm.prismatic, 1e-4, np.radians(0.01))[:, None]
    inside = np.clip(
        np.round(q / digit), np.ceil(lower[:, None] / digit - 1e-6), np.floor(upper[:, None] / digit + 1e-6)
    )
    return np.asarray(inside * digit)


def spring_rows(model: Model, candidates: Candidates, position_m: float, settling_m: float = 0.0) -> Array:
    """Rows (N, m, n) per unit of scale whose A^T A is the information of every candidate about linear springs.

    Parameters
    ----------
    model : Model
        Springs only; their values do not matter.
    position_m, settling_m : float
        One standard deviation of one coordinate of a reading, and of a step (the same for all points of the step), m.
    """
    assert all(isinstance(effect, Spring) for effect in model.effects)
    weightless = replace(model, arm=replace(model.arm, gravity=np.zeros(3)))
    centred = candidates.pattern - candidates.pattern.mean(axis=0)
    mix = np.linalg.cholesky(centred.T @ centred).T
    names = np.array(list(model.points))
    P, D = names.size, candidates.full.shape[1]
    parts = []
    for start in range(0, candidates.number, _CHUNK):
        some = candidates.take(np.arange(start, min(start + _CHUNK, candidates.number)))
        cases = Cases(np.repeat(some.q, D, axis=1), some.full.reshape(-1, 6).T, model.load_point)
        case, point = np.repeat(np.arange(cases.number), P), np.tile(names, cases.number)
        a = sensitivity(weightless, cases, case, point)[:, :3].reshape(some.number, D, P, 3, model.x.size)
        a = np.einsum("de,nepcx->ndpcx", mix, _whitened(a, position_m, settling_m))
        parts.append(a.reshape(some.number, -1, model.x.size))
    return np.concatenate(parts)


def effect_rows(model: Model, candidates: Candidates, position_m: float, settling_m: float = 0.0) -> Array:
    """The same for any effects, step by step with weight: differences of the loaded equilibrium do not superpose."""
    names = np.array(list(model.points))
    P, S = names.size, candidates.pattern.shape[0]
    parts = []
    for start in range(0, candidates.number, _CHUNK):
        some = candidates.take(np.arange(start, min(start + _CHUNK, candidates.number)))
        cases = some.cases(model.load_point)
        case, point = np.repeat(np.arange(cases.number), P), np.tile(names, cases.number)
        a = sensitivity(model, cases, case, point)[:, :3].reshape(some.number, S, P, 3, model.x.size)
        a = _whitened(a - a.mean(axis=1, keepdims=True), position_m, settling_m)
        a = a.reshape(some.number, -1, model.x.size)
        parts.append(np.linalg.qr(a, mode="r") if a.shape[1] > a.shape[2] else a)
    return np.concatenate(parts)


def _whitened(a: Array, position_m: float, settling_m: float) -> Array:
    """Rows (N, steps, P, 3, n) in units of their noise: what all points of a step share has position^2 + P settling^2."""
    shared = a.mean(axis=2, keepdims=True)
    common = np.hypot(position_m, np.sqrt(a.shape[2]) * settling_m)
    return (a - shared) / position_m + shared / common
