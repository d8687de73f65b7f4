"""Name, add, refit, repeat: effects join the model one at a time until nothing passes, and each must hold to the end.

After every addition the effects named before are held up again: each is taken out, all suspects are tried against what the
rest leaves, and a better one takes its place. So an early guess that stood in for two true effects does not survive them.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from drake_stiffness.diagnosis.bench import LATER, Bench, Named, effects_of
from drake_stiffness.diagnosis.classes import confounded_with
from drake_stiffness.diagnosis.evidence import Tested, basis_of, left_over
from drake_stiffness.diagnosis.growth import Further, is_more_of, may_grow
from drake_stiffness.diagnosis.naming import (
    Remaining,
    Round,
    best_variant,
    is_sponge,
    refine,
    rests_of,
    try_all,
)
from drake_stiffness.diagnosis.signatures import signature
from drake_stiffness.diagnosis.suspects import Suspect
from drake_stiffness.effects import Effect
from drake_stiffness.identification import Solution
from drake_stiffness.rotations import Array

# More effects than this at once were never told apart; what is left then is said to be unexplained.
MOST_EFFECTS = 5
# The simplest suspect that gains this share of what the best one gains goes first: what it misses shows in the next round. But where much is
# explained a fifth of it is much: what it misses may be no more than these squared sigma, or this share, and so many for each parameter that
# it has less (which soak up some of whatever else is missing).
_NEARLY_AS_GOOD, _MISSES, _MISSED_SHARE, _A_PARAMETER = 0.8, 25.0, 0.01, 5.0
# At the place of a named effect: signatures as like as this, and explaining less than this share, are a rest of it.
_SAME_PHYSICS, _WEAKER = 0.4, 0.3
# A suspect of the named kind elsewhere that explains this share of it is a rival.
_RIVAL = 0.5
# One of a class leads it where it gains this much more on unseen experiments than the one that joined first, and explains this much
# more, its freedom paid for.
_LEADS = 6.0
# Effects whose signatures have a correlation above this are held up again once both are there.
_ALIKE_ABOVE = 0.2


@dataclass(frozen=True, eq=False)
class Search:
    """What was found.

    Attributes
    ----------
    bench : Bench
        Fits of the model before and with named effects.
    solution : Solution
        The model with the named effects.
    named : tuple of Named
    last : Round
        All suspects against the final model.
    first : Round
        All suspects against the base model.
    left : Remaining
        What the final model leaves.
    faults : dict of name to reason
    """

    bench: Bench
    solution: Solution
    named: tuple[Named, ...]
    first: Round
    last: Round
    left: Remaining
    faults: dict[str, str]

    @property
    def base(self) -> Solution:
        """The model before."""
        return self.bench.base

    @property
    def tried(self) -> list[Suspect]:
        """All that were held against the base model or a later one."""
        return self.bench.found


def search(bench: Bench, known: Sequence[Named] = (), barred: frozenset[str] = frozenset()) -> Search:
    """Find what is missing in the model of a fit; it starts from `known`, and names nothing that is barred."""
    faults: dict[str, str] = {}
    named = list(known)
    first = bench.round((), set())
    while True:
        last = bench.round(effects_of(named), names_of(named) | set(faults))
        faults |= last.faults
        able = [t for t in last.passed if t.suspect.name not in barred]
        able = [t for t in able if may_join(t, named, first, last) or bench.stays(t, named, last)]
        if len(named) == MOST_EFFECTS:  # what is named may still be completed
            able = [t for t in able if isinstance(t.suspect, Further)]
        chosen = most_convincing(able, bench.left(effects_of(named)))
        if chosen is None:
            break
        joined = bench.join(named, chosen, last)
        if isinstance(joined, str):
            faults[chosen.suspect.name] = joined
            continue
        named = [n for n in named if not is_more_of(chosen, n.effect)]
        doubtful = any(_alike(n.tested, chosen) for n in named)
        named.append(joined)
        if doubtful:
            named = _hold_up_again(bench, named, barred | set(faults))
    effects = effects_of(named)
    return Search(bench, bench.fit(effects), tuple(named), first, last, bench.left(effects), faults)


def weighed(found: Search, known: Sequence[Named] = (), barred: frozenset[str] = frozenset()) -> Search:
    """The evidence for every name beside the others; a name that the others have made needless goes, and the search goes on without it.

    Where one that was found with an outlier among the readings does not stand, all starts anew.
    """
    named = _evidence_of_each(found.bench, list(found.named), barred)
    weak = [n for n in named if n.tested.p_value >= n.level]
    if not weak:
        bench, effects = found.bench, effects_of(named)
        last = bench.round(effects, names_of(named) | set(found.faults))
        return replace(found, named=tuple(named), solution=bench.fit(effects), left=bench.left(effects), last=last)
    if known:
        return weighed(search(found.bench))
    worst = max(weak, key=lambda n: n.tested.p_value)
    barred |= {worst.tested.suspect.name}
    return weighed(search(found.bench, [n for n in named if n is not worst], barred), (), barred)


def most_convincing(passed: Sequence[Tested], left: Remaining) -> Tested | None:
    """The simplest of those that gain nearly as much as the best; None if nothing gains.

    Parameters
    ----------
    left : Remaining
        What the model leaves. A weak effect with a constant to search - which of 60 harmonics? -
        is significant before four fifths of the experiments agree on that constant. So where nothing gains with the constant
        chosen fold by fold, one that gains with its own counts, unless other constants do nearly as well.
    """
    able = [t for t in passed if t.gain > 0]
    if not able:
        able = sorted((t for t in passed if t.own_gain > 0 and not is_sponge(left.r, t)), key=lambda t: t.p_value)
        return able[0] if able else None
    near = [t for t in able if t.gain >= _NEARLY_AS_GOOD * able[0].gain and _misses_little(t, able[0], left.per_dof)]
    return min(near, key=lambda t: (len(t.effect.parameters), -t.gain))


def _misses_little(t: Tested, best: Tested, noise: float) -> bool:
    fewer = max(len(best.effect.parameters) - len(t.effect.parameters), 0)
    return (
        best.explained - t.explained
        <= max(_MISSES * noise, _MISSED_SHARE * best.explained) + _A_PARAMETER * fewer * noise
    )


def may_join(t: Tested, named: Sequence[Named], first: Round | None, last: Round) -> bool:
    """Whether a further effect is one of its own.

    What a named form misses of its truth looks like a weaker effect in the same joint: backlash beside hardening, friction
    beside play. A suspect at the place of a named effect, of like signature and far weaker, is that rest and no effect. And
    after something was named the search goes on only for what is beyond doubt, so that all rounds together keep the level.
    """
    if named and t.p_value > LATER * last.level:
        return False
    if isinstance(t.suspect, Further):
        return may_grow(t, last.passed)
    before = {} if first is None else {x.suspect.name: x for x in (*first.passed, *first.failed)}
    for n in named:
        own, other = before.get(n.tested.suspect.name), before.get(t.suspect.name)
        if n.effect.where != t.suspect.where or own is None or other is None:
            continue
        alike = float(np.linalg.norm(own.basis.T @ other.basis, 2))
        if alike > _SAME_PHYSICS and t.explained < _WEAKER * n.tested.explained:
            return False
    return True


def what_may_be(named: Sequence[Named]) -> set[str]:
    """Names and all that their classes hold: none of it is ruled out."""
    return {t.suspect.name for n in named for t in (n.tested, *n.confounded)}


def names_of(named: Sequence[Named]) -> set[str]:
    """What is named, without what cannot be told from it."""
    return {n.tested.suspect.name for n in named}


def _hold_up_again(bench: Bench, named: list[Named], barred: frozenset[str]) -> list[Named]:
    """Take every earlier effect out in turn; what is then most convincing takes its place, or nothing if nothing passes."""
    for old in list(named[:-1]):
        rest = [n for n in named if n is not old]
        around = bench.round(effects_of(rest), names_of(rest) | barred)
        best = most_convincing(around.passed, bench.left(effects_of(rest)))
        if best is None:
            named = rest
            continue
        own = next((t for t in around.passed if t.suspect.name == old.tested.suspect.name and t.gain > 0), None)
        if own is not None and not _alike(own, best):
            continue  # what would go first now is another effect, and its turn comes
        if best.suspect.name == old.tested.suspect.name:
            continue
        joined = bench.join(rest, best, around)
        if not isinstance(joined, str):
            named = [*rest, joined]
    return named


def _alike(a: Tested, b: Tested) -> bool:
    """Whether one may have stood in for the other."""
    size = float(np.linalg.norm(a.fit) * np.linalg.norm(b.fit))
    return abs(float(a.fit @ b.fit)) > _ALIKE_ABOVE * size


def _evidence_of_each(bench: Bench, named: list[Named], barred: frozenset[str], leads: bool = True) -> list[Named]:
    """The evidence for each named effect with all the others in the model, and its class; strongest first.

    With `leads` the best of a class that is not barred may take the lead; then all are weighed once more beside it.
    """
    out, changed = list(named), False
    per_dof = bench.left(effects_of(named)).per_dof
    for k, n in enumerate(named):
        bench.progress(f"weighing {n.tested.suspect.name} beside the others")
        others = [m for m in out if m is not n]
        left = bench.left(effects_of(others))
        found = [s for s in bench.found if s.name not in names_of(others)]
        found = [_fixed(s, n) for s in bench.sensible(found, effects_of(others))]
        around = try_all(left, found, bench.seed)
        able = [*around.passed, *around.failed]
        own = next((t for t in able if t.suspect.name == n.tested.suspect.name), n.tested)
        searched = {t.suspect.name: t.bases for t in able} | {own.suspect.name: _searched(bench, left, own)}
        same = confounded_with(own, [_refined(left, t, own) for t in able], left.r, per_dof, searched)
        able = [t for t in same if t.suspect.name not in barred]
        leader = _leader(bench, own, able, around, per_dof) if leads else None
        if leader is not None and not any(_refines(m.effect, n.effect) for m in others):
            joined = bench.join(others, leader, around)
            if not isinstance(joined, str):
                out[k], changed = joined, True
                continue
        out[k] = replace(n, tested=own, confounded=tuple(same), level=around.level)
    return _evidence_of_each(bench, out, barred, leads=False) if changed else sorted(out, key=lambda n: -n.tested.gain)


def _leader(bench: Bench, own: Tested, same: Sequence[Tested], around: Round, per_dof: float) -> Tested | None:
    """One of a class that does clearly better than the one that joined first, on unseen experiments and with its freedom paid for."""
    able = [t for t in same if t.p_value < around.level]
    best = max(able, key=lambda t: t.gain, default=own)
    more = (best.explained - own.explained) / per_dof - bench.cost(best) + bench.cost(own)
    return best if min(best.gain - own.gain, more) > _LEADS else None


def _refines(effect: Effect, other: Effect) -> bool:
    return (effect.refines, effect.where) == (other.kind, other.where)


def _searched(bench: Bench, left: Remaining, own: Tested) -> list[Array]:
    """What a named effect's constants were searched among."""
    whole = next((s for s in bench.found if s.name == own.suspect.name), own.suspect)
    return [basis_of(S) for S in rests_of(left, whole, {})]


def _refined(left: Remaining, t: Tested, own: Tested) -> Tested:
    """A rival of the named kind, its constants as good as they can be: the named one had its refined too."""
    if t.suspect.kind != own.suspect.kind or t is own or t.explained < _RIVAL * own.explained:
        return t
    effect = refine(left, t)
    rest = left_over(signature(left.scene, effect), left.Q)
    again = best_variant(left, Suspect(t.suspect.kind, t.suspect.where, (effect,)), (rest,), (basis_of(rest),))
    return t if again is None else replace(again, suspect=again.suspect, gain=t.gain)


def _fixed(suspect: Suspect, n: Named) -> Suspect:
    """The named suspect has its refined constants from now on."""
    if suspect.name != n.tested.suspect.name:
        return suspect
    return Suspect(suspect.kind, suspect.where, (n.effect,))
