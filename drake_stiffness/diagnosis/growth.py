"""More of a named effect at its own place: the further harmonics of a gear that already shows one.

A gear repeats with its eccentricity, its lobes and its teeth. Once one harmonic of a joint has its name, the others of the same
joint are no further effects and need no further names; they join the one that is there.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

from drake_stiffness.diagnosis.evidence import Tested, basis_of, left_over
from drake_stiffness.diagnosis.naming import Remaining, best_variant
from drake_stiffness.diagnosis.suspects import Suspect
from drake_stiffness.effects import Effect


@dataclass(frozen=True)
class Further(Suspect):
    """What a named effect may have besides.

    Attributes
    ----------
    of : Effect
        The named one.
    """

    of: Effect

    @property
    def name(self) -> str:
        return f"more of {super().name}"


def further_suspects(effects: Sequence[Effect]) -> list[Suspect]:
    """What each of some named effects may have besides."""
    found = [(effect, tuple(effect.further())) for effect in effects]
    return [Further(effect.kind, effect.where, variants, effect) for effect, variants in found if variants]


def is_more_of(t: Tested, effect: Effect) -> bool:
    """Whether what was tested is more of this effect."""
    return isinstance(t.suspect, Further) and t.suspect.of is effect


def may_grow(t: Tested, passed: Sequence[Tested]) -> bool:
    """Whether a named effect may take up what was found at its place: no other suspect there says more of it."""
    return not any(
        x.suspect.where == t.suspect.where and not isinstance(x.suspect, Further) and x.gain > t.gain for x in passed
    )


def together(old: Tested, t: Tested, effect: Effect) -> Tested:
    """The evidence for a named effect and for what joined it, until all of it is weighed again."""
    return replace(
        t,
        suspect=Suspect(effect.kind, effect.where, (effect,)),
        variant=0,
        bases=(t.basis,),
        explained=old.explained + t.explained,
        gain=old.gain + t.gain,
        fit=old.fit + t.fit,
    )


def grown(left: Remaining, t: Tested, level: float) -> Effect:
    """The named effect with what was found besides: the best variant, then others as long as one is beyond doubt beside it.

    Parameters
    ----------
    left : Remaining
        What the model leaves, the named effect in it.
    t : Tested
        Of a `Further`.
    level : float
        What a p-value has to be below.
    """
    assert isinstance(t.suspect, Further)
    effect, chosen = t.suspect.of.joined(t.effect), t.variant
    variants = list(t.suspect.variants)
    rests = [left.rest(variant) for variant in variants]
    while any(True for _ in effect.further()):
        Q = basis_of(rests[chosen])
        left = replace(left, r=left.r - Q @ (Q.T @ left.r), dof=left.dof - Q.shape[1])
        del variants[chosen], rests[chosen]
        rests = [left_over(S, Q) for S in rests]
        best = best_variant(left, replace(t.suspect, variants=tuple(variants)), rests, [basis_of(S) for S in rests])
        if best is None or best.p_value >= level:
            break
        effect, chosen = effect.joined(best.effect), best.variant
    return effect
