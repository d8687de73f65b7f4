"""Which names do not stand: where a form does not fit its place, or stands in for something that the catalogue lacks."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from drake_stiffness.diagnosis.bench import Named
from drake_stiffness.diagnosis.confirmation import HeldOut
from drake_stiffness.diagnosis.evidence import basis_of, left_over, score
from drake_stiffness.diagnosis.generic import Process
from drake_stiffness.diagnosis.naming import Remaining, best_variant, rests_of
from drake_stiffness.diagnosis.outliers import Outlier
from drake_stiffness.diagnosis.search import MOST_EFFECTS, Search
from drake_stiffness.diagnosis.strangers import Likeness, Stranger, likeness, strangers
from drake_stiffness.diagnosis.suspects import Suspect
from drake_stiffness.diagnosis.verdict import closed_share, p_of_fit
from drake_stiffness.effects import Effect
from drake_stiffness.effects.compliance import Spring
from drake_stiffness.effects.geometry import JointZeroOffset, LinkGeometry
from drake_stiffness.effects.hardening import JointHardening
from drake_stiffness.effects.harmonics import JointPeriodicError
from drake_stiffness.errors import UntrustworthyError

# A form is wrong when its own place still explains this share of what it explained, and more than five sigma (at each of two places).
_WRONG_FORM, _LEAST_REST = 0.35, 25.0
# A form that the catalogue lacks does clearly better from this much of chi-square on; it is a hint below this probability.
_CLEARLY, _HINT = 9.0, 1e-6
# What is left is not noise below this probability; forms are then believed only where they close this much of the gap.
_NOT_NOISE, _MOSTLY = 1e-3, 0.75
# What carries no load: a hose that pulls is no better form of a spring, but it may be of these.
_OF_ANGLES = (JointPeriodicError, LinkGeometry, JointZeroOffset)
_SURE = 0.0005  # of the 1 % that all of diagnosis may err by


def stand_ins(found: Search, left_base: Remaining) -> tuple[dict[str, str], dict[str, str]]:
    """Names that stand in for a form that the catalogue lacks: alone it explains more than all of them, or than one beside the others.

    Nothing that cannot be told from a name may do as well as that form either: then the class holds the answer.

    Returns
    -------
    withdrawn : dict of name to reason
    as_good : dict of name to the form that does about as well; the name stands, with a warning
    """
    if not found.named:
        return {}, {}
    noise, forms = found.left.per_dof, strangers(left_base.scene)
    all_of_them = float(left_base.r @ left_base.r) - float(found.left.r @ found.left.r)
    names = [n.tested.suspect.name for n in found.named]
    out: dict[str, str] = {}
    as_good: dict[str, str] = {}
    if len(names) > 1:
        best = likeness(left_base, _against(forms, found.named), noise)[0]
        together = all_of_them / noise - sum(found.bench.cost(n.tested) for n in found.named)
        if best.score > together + _CLEARLY:
            return dict.fromkeys(names, _why(best, all_of_them, len(names))), {}
        if best.score > together - _CLEARLY:
            as_good = dict.fromkeys(names, f"{best.what}, in place of {' and '.join(names)} together")
    for n, name in zip(found.named, names, strict=True):
        others = [m for m in found.named if m is not n]
        best = likeness(without(left_base, others) if others else left_base, _against(forms, [n]), noise)[0]
        own = max(t.explained / noise - found.bench.cost(t) for t in (n.tested, *n.confounded))
        # A strong effect explains more once it is fitted than to first order.
        own = max(own, (_squares(found, others) - _squares(found, found.named)) / noise - found.bench.cost(n.tested))
        if best.score > own + _CLEARLY:
            out[name] = _why(best, n.tested.explained, 1)
            as_good.pop(name, None)
        elif best.score > own - _CLEARLY:
            as_good[name] = best.what
        elif like := pull_like(n.effect):
            as_good[name] = like
    return out, as_good


def pull_like(effect: Effect) -> str:
    """What turns a joint just as its periodic error does; empty if nothing.

    A spring without free length between the two links of a joint, and a hose nearly, brings a torque that goes with the sine
    and cosine of the angle, and so does the angle that the joint gives by: an error of one period a turn.
    """
    if not isinstance(effect, JointPeriodicError) or effect.prismatic or 1.0 not in effect.harmonics:
        return ""
    part = "" if len(effect.harmonics) == 1 else ", for its part of one period a turn"
    return f"a hose or a spring that pulls across {effect.where}{part}"


def _against(forms: Sequence[Stranger], named: Sequence[Named]) -> list[Stranger]:
    """Forms that may speak against names: what goes with angles as weight does, only where nothing but errors of angles or lengths may be meant."""
    of_angles = all(isinstance(t.effect, _OF_ANGLES) for n in named for t in (n.tested, *n.confounded))
    return [f for f in forms if of_angles or not f.like_weight]


def _squares(found: Search, named: Sequence[Named]) -> float:
    """Squared sigma that the model with some of the names leaves."""
    r = found.bench.left([n.effect for n in named]).r
    return float(r @ r)


def without(left: Remaining, named: Sequence[Named]) -> Remaining:
    """What named effects leave, to first order."""
    Q = basis_of(left_over(np.hstack([left.columns_of(n.effect) for n in named]), left.Q))
    return replace(left, Q=np.hstack([left.Q, Q]), r=left.r - Q @ (Q.T @ left.r), dof=left.dof - Q.shape[1])


def _why(best: Likeness, explained: float, names: int) -> str:
    who = "it does" if names == 1 else "all names together do"
    return (
        f"stands in for something that the catalogue lacks: {best.what} explains more ({best.explained:.0f} squared sigma) than {who} "
        f"({explained:.0f})"
    )


@dataclass(frozen=True)
class Hint:
    """A form that the catalogue lacks and that explains what is left.

    Attributes
    ----------
    words : str
        Empty where none does.
    sure : bool
        Whether noise does not look like any of these forms so much, all that were tried paid for.
    """

    words: str
    sure: bool


def hint(left: Remaining) -> Hint:
    """What is left looks most like this."""
    forms = strangers(left.scene)
    best = likeness(left, forms, max(left.per_dof, 1.0))[0]
    tried = sum(len(form.variants) for form in forms)
    if best.p_value > _HINT:
        return Hint("", False)
    words = f"of forms that are no effect of the catalogue it looks most like this one: {best.what} ({np.sqrt(best.explained):.0f} sigma)"
    return Hint(words, best.p_value * tried < _SURE)


def sticks_out(left: Remaining, outlier: Outlier) -> bool:
    """Whether what looks like an outlier is where something that the catalogue lacks shows most: few unknowns explain as much.

    A flange that opens under a moment of one sign may open in a single step of a single posture.
    """
    m = left.scene.o.measurements
    forms = strangers(left.scene)
    best = likeness(left, forms, outlier.noise)[0].score - 2 * float(np.log(len(forms)))
    places = 2 * (len(m.experiments) + m.cases.number)
    return best > score(outlier.excess + outlier.unknowns, outlier.unknowns, places, 1.0)


def effects_behind(left: Remaining, found: Sequence[Suspect], outlier: Outlier) -> tuple[str, ...]:
    """Suspects that explain, over all experiments together, as much as calling one of them an outlier does; best first.

    A joint that hardens may show in the single posture that loads it most, play in the single step that reverses a torque.

    Parameters
    ----------
    left : Remaining
        What the model leaves of all readings, those of the outlier included.
    """
    m = left.scene.o.measurements
    present = {(e.kind, e.where) for e in left.scene.model.effects}
    places = 2 * (len(m.experiments) + m.cases.number)
    enough, out = score(outlier.excess + outlier.unknowns, outlier.unknowns, places, 1.0), []
    for suspect in found:
        if (suspect.kind, suspect.where) in present or not suspect.makes_sense_beside(present):
            continue
        rests = rests_of(left, suspect, {})
        t = best_variant(left, suspect, rests, [basis_of(S) for S in rests])
        if t is not None:
            out.append((score(t.explained, t.basis.shape[1], len(rests), outlier.noise), suspect.name))
    return tuple(name for worth, name in sorted(out, reverse=True) if worth > enough)


def own_rest(found: Search) -> list[Named]:
    """Named effects whose place holds nothing else: where the search stopped at its most, what is left there may be what it did not name."""
    if len(found.named) < MOST_EFFECTS:
        return list(found.named)
    more = {place for t in found.last.passed if t.gain > 0 for place in t.suspect.where.split("+")}
    return [n for n in found.named if not more & set(n.effect.where.split("+"))]


def wrong_forms(named: Sequence[Named], process: Process) -> dict[str, str]:
    """Names that do not stand: where an effect was named, smooth functions of the same joint still explain much of the rest.

    What the true form leaves is noise. A form that merely resembles the truth leaves a good part of it in the same place.
    """
    out = {}
    for n in named:
        driven_by = sorts(n.effect)
        if isinstance(n.effect, JointPeriodicError | JointHardening):
            continue  # what other harmonics, or another law of the same spring, leave does not speak against this one
        places = [p for p in dict.fromkeys(f.where for f in process.families) if p in n.effect.where.split("+")]
        rest = sum(process.at(p, driven_by) for p in places)
        if rest > max(_WRONG_FORM * n.tested.explained, _LEAST_REST * len(places) * max(process.floor, 1.0)):
            out[n.tested.suspect.name] = (
                f"its form does not fit: with it in the model, smooth functions of the {' and '.join(sorted(driven_by))} of "
                f"{', '.join(places)} still explain {100 * rest / n.tested.explained:.0f} % of what it explains"
            )
    return out


def sorts(effect: Effect) -> set[str]:
    """What drives an effect, in the terms of the generic families."""
    if "time" in effect.needs:
        return {"time"}
    if "unloading" in effect.needs:
        return {"branch", "load"}
    return {"angle"} if "positions" in effect.needs else {"load"}


def standing(found: Search, withdrawn: dict[str, str]) -> tuple[Search, dict[str, str]]:
    """The search without the names that do not stand, refitted."""
    if not withdrawn:
        return found, {}
    kept = tuple(n for n in found.named if n.tested.suspect.name not in withdrawn)
    effects = [n.effect for n in kept]
    try:
        solution = found.bench.fit(effects)
    except UntrustworthyError as error:
        names = {n.tested.suspect.name: f"without the others the model cannot be fitted: {error}" for n in kept}
        return standing(found, withdrawn | names)
    return replace(found, named=kept, solution=solution, left=found.bench.left(effects)), withdrawn


def doubtful_names(found: Search, before: HeldOut, after: HeldOut, noise_ratio: float) -> dict[str, str]:
    """Names that stand for something else: where most of the gap remains, only a missing spring is still believed.

    What is no form of the catalogue is soaked up by several forms that each resemble a part of it, and the gap stays open. A
    spring that a model lacks is real beside whatever else is missing.
    """
    closed = closed_share(before, after, noise_ratio)
    if min(p_of_fit(found.left, noise_ratio), after.p_value) > _NOT_NOISE or closed >= _MOSTLY:
        return {}
    return {
        n.tested.suspect.name: f"with it only {100 * max(closed, 0.0):.0f} % of the gap on unseen experiments closes; something else is there"
        for n in found.named
        if not isinstance(n.effect, Spring)
    }
