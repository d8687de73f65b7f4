"""The bench of a search: fits of a base model with further effects, rounds of suspects against them, each made once."""

from __future__ import annotations

from collections.abc import Callable, Collection, Sequence
from dataclasses import dataclass, field, replace
from typing import Self

import numpy as np

from drake_stiffness.diagnosis.evidence import Tested, basis_of, score
from drake_stiffness.diagnosis.growth import Further, further_suspects, grown, is_more_of, together
from drake_stiffness.diagnosis.naming import Remaining, Round, best_variant, refine, remaining, try_all
from drake_stiffness.diagnosis.sharpening import sharpened
from drake_stiffness.diagnosis.signatures import Scene, extended
from drake_stiffness.diagnosis.suspects import Suspect
from drake_stiffness.effects import Effect
from drake_stiffness.errors import InputError, UntrustworthyError
from drake_stiffness.identification import Solution, identify
from drake_stiffness.model import Model
from drake_stiffness.observation import Observations

# A further name must be this much surer than the first one had to be.
LATER = 0.5
# What is left is not noise below this probability; constants are then improved around the fitted model, so often at most.
_NOT_NOISE, _SHARPENINGS = 1e-3, 3
# Fits come to rest in three to eight iterations, a few in 30; after so many the suspect fails, says so, and the run goes on.
_MOST_ITERATIONS = 40


@dataclass(frozen=True, eq=False)
class Named:
    """An effect that joined the model.

    Attributes
    ----------
    effect : Effect
    tested : Tested
        The evidence for it with all other named effects in the model.
    confounded : tuple of Tested
        What this campaign cannot tell from it.
    level : float
        What its p-value had to be below.
    """

    effect: Effect
    tested: Tested
    confounded: tuple[Tested, ...]
    level: float


@dataclass(frozen=True, eq=False)
class Bench:
    """Fits of a base model with further effects, and rounds against them, each made once.

    Attributes
    ----------
    base : Solution
    o : Observations
    found : list of Suspect
    seed : int
    progress : callable
    """

    base: Solution
    o: Observations
    found: list[Suspect]
    seed: int
    progress: Callable[[str], None]
    _fits: dict[tuple[int, ...], Solution] = field(default_factory=dict)
    _left: dict[tuple[int, ...], Remaining] = field(default_factory=dict)
    _rounds: dict[tuple[tuple[int, ...], tuple[str, ...]], Round] = field(default_factory=dict)

    def fit(self, effects: Sequence[Effect]) -> Solution:
        """The base model and further effects, all parameters together under their constraints."""
        key = tuple(sorted(id(e) for e in effects))
        if key not in self._fits:
            # The fit that shares most effects is a near start.
            own = {id(e) for e in effects}
            near = max((self.base, *self._fits.values()), key=lambda f: sum(id(e) in own for e in f.model.effects))
            self._fits[key] = refit(self.base.model, self.o, effects, near.model) if effects else self.base
        return self._fits[key]

    def left(self, effects: Sequence[Effect]) -> Remaining:
        """What that fit leaves; where it does not come to rest, what the effects leave of the base model's rest to first order."""
        key = tuple(sorted(id(e) for e in effects))
        if key not in self._left:
            try:
                self._left[key] = leaves(self.fit(effects), self.o)
            except UntrustworthyError:
                left = self.left(())
                self._left[key] = left.with_columns(np.hstack([left.rest(e) for e in effects]))
        return self._left[key]

    def sensible(self, suspects: Sequence[Suspect], effects: Sequence[Effect]) -> list[Suspect]:
        """Those that make sense beside the base model and further effects."""
        present = {(e.kind, e.where) for e in (*self.base.model.effects, *effects)}
        return [s for s in suspects if s.makes_sense_beside(present)]

    def round(self, effects: Sequence[Effect], barred: set[str]) -> Round:
        """All suspects that are not barred against what that fit leaves."""
        able = self.sensible([s for s in (*self.found, *further_suspects(effects)) if s.name not in barred], effects)
        key = tuple(sorted(id(e) for e in effects)), tuple(s.name for s in able)
        if key not in self._rounds:
            self.progress(f"trying {sum(len(s.variants) for s in able)} variants of {len(able)} suspects")
            self._rounds[key] = try_all(self.left(effects), able, self.seed)
        return self._rounds[key]

    def without(self, names: Collection[str]) -> Self:
        """The same, its fits too, with these suspects out of question."""
        return replace(self, found=[s for s in self.found if s.name not in names])

    def cost(self, t: Tested) -> float:
        """Of an effect's freedom, the choice of its constants included, in chi-square."""
        variants = next((len(s.variants) for s in self.found if s.name == t.suspect.name), 1)
        return -score(0.0, t.basis.shape[1], variants, 1.0)

    def join(self, named: Sequence[Named], t: Tested, around: Round) -> Named | str:
        """One more effect beside the named ones, constants refined; or why the model with it cannot be fitted."""
        left = self.left(effects_of(named))
        others = [n.effect for n in named if not is_more_of(t, n.effect)]
        old = next((n for n in named if is_more_of(t, n.effect)), None)
        effect = refine(left, t) if old is None else grown(left, t, LATER * around.level)
        self.progress(f"adding {t.suspect.name}")
        try:
            effect = self._sharpened(others, effect)
        except (InputError, UntrustworthyError) as error:
            return f"the model with it cannot be fitted: {error}"
        return Named(effect, t if old is None else together(old.tested, t, effect), (), around.level)

    def stays(self, t: Tested, named: Sequence[Named], last: Round) -> bool:
        """Whether a suspect at the place of a named effect is beyond doubt also beside every other form of that effect."""
        if isinstance(t.suspect, Further) or t.p_value > LATER * last.level:
            return False
        left = self.left(effects_of(named))
        own = [n.effect for n in named if n.effect.where == t.suspect.where]
        forms = [e for s in self.found for e in s.variants if any((e.kind, e.where) == (o.kind, o.where) for o in own)]
        if not own or len(forms) < 2:
            return False
        beside = left.with_columns(np.hstack([left.rest(e) for e in forms]))
        rest = beside.rest(t.effect)
        again = best_variant(beside, Suspect(t.suspect.kind, t.suspect.where, (t.effect,)), (rest,), (basis_of(rest),))
        return again is not None and again.p_value < LATER * last.level

    def _sharpened(self, others: Sequence[Effect], effect: Effect) -> Effect:
        """An effect fitted beside others, its constants improved as long as what is left is no noise and they take off of it."""
        from scipy.special import chdtrc

        self.fit([*others, effect])
        for _ in range(_SHARPENINGS):
            left = self.left([*others, effect])
            if chdtrc(left.dof, left.r @ left.r) > _NOT_NOISE:
                break
            other = sharpened(self.fit([*others, effect]), self.o, effect)
            if other is effect:
                break
            try:
                self.fit([*others, other])
            except (InputError, UntrustworthyError):
                break
            after = self.left([*others, other])
            if after.r @ after.r >= left.r @ left.r:
                break
            effect = other
        return effect


def leaves(solution: Solution, o: Observations) -> Remaining:
    """What a fit leaves of the readings."""
    return remaining(Scene(solution.model, o), solution.residual, solution.identifiability.seen)


def refit(base: Model, o: Observations, effects: Sequence[Effect], near: Model | None = None) -> Solution:
    """The base model and further effects, all parameters together under their constraints; `near` has some of them fitted."""
    known = {} if near is None else {id(e): x for e, x in zip(near.effects, near.values, strict=True)}
    model = base if near is None else base.with_x(np.concatenate([known[id(e)] for e in base.effects]))
    for effect in effects:
        model = extended(model, effect, known.get(id(effect)))
    return identify(model, o, "sdp", most_iterations=_MOST_ITERATIONS)


def effects_of(named: Sequence[Named]) -> list[Effect]:
    """The effects that are named, as the bench fits them."""
    return [n.effect for n in named]
