"""Is last month's model still true? A few postures against a stored model, and which effect changed if it is not.

No parameter is fitted: the stored values stand, with the uncertainty they were stored with (`prior`). Suspects are a change of an
effect that the model has, its own columns freed from what is stored, and an effect that it has not; the search over all of them
is paid for as everywhere (`naming.try_all`).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from drake_stiffness.campaign import Measurements
from drake_stiffness.diagnosis.bench import Named
from drake_stiffness.diagnosis.classes import confounded_with
from drake_stiffness.diagnosis.detection import Limit, detection_limits
from drake_stiffness.diagnosis.evidence import Tested
from drake_stiffness.diagnosis.naming import Round, refine, try_all
from drake_stiffness.diagnosis.prior import Changed, Settled, WithPrior, prior_root, settle, stored_columns, with_prior
from drake_stiffness.diagnosis.search import MOST_EFFECTS, may_join, most_convincing
from drake_stiffness.diagnosis.signatures import extended
from drake_stiffness.diagnosis.suspects import Suspect, Untestable, separate_untestable, suspects
from drake_stiffness.effects import Effect
from drake_stiffness.effects.compliance import Spring
from drake_stiffness.hold_out import posture_groups
from drake_stiffness.identifiability import HIDDEN_BELOW
from drake_stiffness.model import Model
from drake_stiffness.observation import Observations, measured, predicted
from drake_stiffness.rotations import Array

# Evidence on unseen postures needs about this many; with fewer, p-values decide alone.
ENOUGH_POSTURES = 8
# Leaving one posture out needs this many, so that something is left to fit.
FEWEST_TO_LEAVE_OUT = 4
# All readings together, and all suspects together: half of the error rate each.
_LEVEL = 0.005
_EXPLAINED, _PARTLY = 0.9, 0.1
_NOTHING_SHOWN = "readings that depend on it"
_EMPTY = "fitted together with the others, all its values are zero"


@dataclass(frozen=True, eq=False)
class Change:
    """An effect that changed, or appeared.

    Attributes
    ----------
    named : Named
        Its effect is the stored one, or the new one with its constants refined.
    number : int
        Its place in the model of now.
    appeared : bool
        Whether the stored model has it not.
    """

    named: Named
    number: int
    appeared: bool


@dataclass(frozen=True)
class Unseen:
    """Readings that a prediction did not see: rms of the 3-D residual, chi-square by its variance, p-value."""

    rms_mm: float
    chi2_per_dof: float
    p_value: float


@dataclass(frozen=True, eq=False)
class Recheck:
    """Whether a stored model still holds.

    Attributes
    ----------
    verdict : str
    settled : Settled
        Values of now, changes included.
    changes : tuple of Change
        Strongest first.
    first, last : Round
        Before anything was named, and after the changes.
    untestable : list of Untestable
    left, left_after : WithPrior
        Before and after the changes.
    before : Unseen
        All readings by the stored model, which saw none of them.
    after : Unseen or None
        Every posture by the others, changes included; None with too few postures.
    postures : int
    noise_ratio : float
        Noise of the stored model's own fit over the stated one; readings are held against it.
    limits : list of Limit
        How large a change must be to be found.
    """

    verdict: Literal["consistent", "explained", "partly_explained", "unexplained"]
    settled: Settled
    changes: tuple[Change, ...]
    first: Round
    last: Round
    untestable: list[Untestable]
    left: WithPrior
    left_after: WithPrior
    before: Unseen
    after: Unseen | None
    postures: int
    noise_ratio: float
    limits: list[Limit]


def recheck(
    model: Model, fresh: Sequence[int], m: Measurements, o: Observations, seed: int, progress: Callable[[str], None]
) -> Recheck:
    """Hold a stored model against a short campaign.

    Parameters
    ----------
    model : Model
        As stored, with statistics.
    fresh : numbers of effects that the campaign sets up anew
        Free, without a prior: the tracker's frame, the reflectors' places.
    """
    assert model.statistics is not None
    ratio = _noise_ratio(model)
    o = replace(o, sigma_p=o.sigma_p * ratio, sigma_r=o.sigma_r * ratio)
    root = prior_root(model, fresh)
    free = [i for k in fresh for i in range(model.slices[k].start, model.slices[k].stop)]
    progress("holding the stored model against the readings")
    start = replace(settle(model, o, root, free).model, statistics=None) if free else model
    left = with_prior(_anew(model, start, free), o, root, free)
    testable, untestable = _suspects(left, fresh, m)
    postures = int(np.unique(posture_groups(m.cases)).size)
    empty: dict[str, str] = {}
    while True:
        able = [s for s in testable if s.name not in empty]
        changes, after, first, last, found = _search(left, able, seed, postures, progress)
        verdict = _judge(left, after, changes)
        if verdict == "unexplained":
            # What passes its test and leaves nearly all of the gap soaks up a little of something else: it is no answer.
            changes, after, last, found = [], left, first, found[:, :0]
        settled = _settle(left.scene.model, o, root, free, changes)
        gone = [c for c in changes if c.appeared and not settled.model.values[c.number].any()]
        if not gone:
            break
        empty |= {c.named.tested.suspect.name: _EMPTY for c in gone}
    last = replace(last, faults=last.faults | empty)
    named = {c.named.tested.suspect.name for c in changes}
    tried = {t.suspect.name for t in (*last.passed, *last.failed)} | set(last.faults)
    hidden = [s for s in testable if s.name not in named | tried and _hidden(left, s.variants)]
    untestable += [Untestable(s.kind, s.where, _NOTHING_SHOWN) for s in hidden]
    unnamed = [s for s in testable if s.name not in named and s not in hidden]
    return Recheck(
        verdict=verdict,
        settled=settled,
        changes=tuple(changes),
        first=first,
        last=last,
        untestable=untestable,
        left=left,
        left_after=after,
        before=_all_at_once(left),
        after=_leave_one_out(left, found, root, free) if postures >= FEWEST_TO_LEAVE_OUT else None,
        postures=postures,
        noise_ratio=ratio,
        limits=detection_limits(after, last, unnamed),
    )


def _noise_ratio(model: Model) -> float:
    """How much more noise than stated the model's own campaign showed, if its stated noise was rejected."""
    fit = model.fit
    per_dof = fit.get("chi2_per_dof")
    return float(np.sqrt(per_dof)) if fit.get("noise_rejected") and per_dof else 1.0


def _anew(model: Model, settled: Model, free: Sequence[int]) -> Model:
    """The stored model with what is set up anew where it now stands."""
    x = model.x.copy()
    x[list(free)] = settled.x[list(free)]
    return replace(model, x=x)


def _suspects(left: WithPrior, fresh: Sequence[int], m: Measurements) -> tuple[list[Suspect], list[Untestable]]:
    """A change of everything the model has, and everything that it has not, as far as these readings can show it."""
    model = left.scene.model
    found = [
        Suspect(e.kind, e.where, (Changed(e, k, model.values[k]),))
        for k, e in enumerate(model.effects)
        if k not in fresh
    ]
    # The compliances are known from elsewhere here: a common factor is a change like any other.
    springless = model.subset([not isinstance(e, Spring) for e in model.effects])
    testable, untestable = separate_untestable(found + suspects(model), springless, m, left.scene.o.displacement)
    blind = [s for s in testable if isinstance(s.variants[0], Changed) and not left.rest(s.variants[0]).any()]
    untestable += [Untestable(s.kind, s.where, _NOTHING_SHOWN) for s in blind]
    return [s for s in testable if s not in blind], untestable


def _hidden(left: WithPrior, variants: Sequence[Effect]) -> bool:
    """Whether these readings hide an effect of any usual size: a joint that carries nothing shows no compliance, whatever the
    pattern of the nothing that it carries."""
    return all(float(np.linalg.norm(left.columns_of(v))) < HIDDEN_BELOW for v in variants)


def _search(
    left: WithPrior, able: list[Suspect], seed: int, postures: int, progress: Callable[[str], None]
) -> tuple[list[Change], WithPrior, Round, Round, Array]:
    """Changes one after the other until nothing passes; what they leave, the first and the last round, and their columns side by side."""
    changes: list[Change] = []
    rests = [np.zeros((left.r.size, 0))]
    places = len(left.scene.model.effects)
    present = {(e.kind, e.where) for e in left.scene.model.effects}
    first, whole = None, left
    while True:
        named = [c.named for c in changes]
        barred = {n.tested.suspect.name for n in named}
        trying = [s for s in able if s.name not in barred and s.makes_sense_beside(present)]
        progress(f"trying {sum(len(s.variants) for s in trying)} variants of {len(trying)} suspects")
        last = try_all(left, trying, seed)
        last = replace(last, passed=[t for t in last.passed if not _hidden(left, [t.effect])])
        if postures < ENOUGH_POSTURES:
            last = _by_p_value(last)
        first = first or last
        chosen = most_convincing([t for t in last.passed if may_join(t, named, first, last)], left)
        # A few postures hold no more: what is left of a gap that is closed may be what the first name's form misses.
        closed = bool(changes) and _closed(whole, left) >= _EXPLAINED
        if chosen is None or closed or len(changes) == MOST_EFFECTS:
            return changes, left, first, last, np.hstack(rests)
        change = _change(left, chosen, last, places)
        places += change.appeared
        effect = change.named.effect
        rests.append(left.rest(effect if change.appeared else chosen.effect))
        left = left.with_columns(rests[-1])
        present.add((effect.kind, effect.where))
        changes.append(change)


def _by_p_value(around: Round) -> Round:
    """With too few postures to leave any out, what is explained beyond its number of parameters stands for the evidence."""
    passed = [replace(t, gain=t.explained / max(around.rest_per_dof, 1.0) - t.basis.shape[1]) for t in around.passed]
    return replace(around, passed=sorted(passed, key=lambda t: -t.gain))


def _change(left: WithPrior, chosen: Tested, around: Round, places: int) -> Change:
    able = [*around.passed, *around.failed]
    same = tuple(confounded_with(chosen, able, left.r, left.per_dof, {}))
    if isinstance(chosen.effect, Changed):
        return Change(Named(chosen.effect.effect, chosen, same, around.level), chosen.effect.number, False)
    return Change(Named(refine(left, chosen), chosen, same, around.level), places, True)


def _settle(model: Model, o: Observations, root: Array, free: Sequence[int], changes: Sequence[Change]) -> Settled:
    """Values of now: the changed effects freed from what was stored, the new ones added."""
    for change in changes:
        if change.appeared:
            model = extended(model, change.named.effect)
    wide = np.vstack([root, np.zeros((model.x.size - root.shape[0], root.shape[1]))])
    numbers = list(free)
    for change in changes:
        own = model.slices[change.number]
        wide[own] = 0.0
        numbers += range(own.start, own.stop)
    return settle(model, o, wide, numbers)


def _chi2_p(total: float, dof: int) -> float:
    from scipy.special import chdtrc

    return float(chdtrc(dof, total)) if dof > 0 else 1.0


def _closed(left: WithPrior, after: WithPrior) -> float:
    """Share of what is beyond noise that the changes take away."""
    total = float(left.r @ left.r)
    return (total - float(after.r @ after.r)) / max(total - left.dof, 1e-300)


def _judge(
    left: WithPrior, after: WithPrior, changes: Sequence[Change]
) -> Literal["consistent", "explained", "partly_explained", "unexplained"]:
    if _chi2_p(float(after.r @ after.r), after.dof) > _LEVEL:
        return "explained" if changes else "consistent"
    closed = _closed(left, after)
    if not changes or closed < _PARTLY:
        return "unexplained"
    return "explained" if closed >= _EXPLAINED else "partly_explained"


def _all_at_once(left: WithPrior) -> Unseen:
    """All readings by the stored model."""
    o = left.scene.o
    r = measured(o) - predicted(o, left.scene.model)
    total = float(left.r @ left.r)
    return Unseen(_rms_mm(r, o), total / max(left.dof, 1), _chi2_p(total, left.dof))


def _rms_mm(r: Array, o: Observations) -> float:
    readings = o.measurements.case.size
    return float(np.sqrt((r[: 3 * readings] ** 2).sum() / max(readings, 1))) * o.sigma_p * 1e3


def _leave_one_out(left: WithPrior, found: Array, root: Array, free: Sequence[int]) -> Unseen:
    """Every posture predicted from the stored model and the other postures, the changed effects fitted to those alone.

    The p-value is that of the worst posture, times their number.
    """
    o = left.scene.o
    X = np.hstack([stored_columns(left.A, root, free), found])
    y = np.concatenate([measured(o) - predicted(o, left.scene.model), np.zeros(left.prior)])
    G, b = X.T @ X, X.T @ y
    group = posture_groups(o.measurements.cases)[o.cluster]
    error, total, dof, worst = np.zeros(o.rows), 0.0, 0, 1.0
    lost = (o.rows - o.references) / o.rows
    for g in np.unique(group):
        own = np.flatnonzero(group == g)
        part = X[own]
        C = np.linalg.pinv(G - part.T @ part, rcond=1e-12, hermitian=True)
        e = y[own] - part @ (C @ (b - part.T @ y[own]))
        chi2 = float(e @ np.linalg.solve(np.eye(own.size) + part @ C @ part.T, e))
        number = round(own.size * lost)
        error[own] = e
        total, dof = total + chi2, dof + number
        worst = min(worst, _chi2_p(chi2, number))
    return Unseen(_rms_mm(error, o), total / max(dof, 1), min(1.0, worst * np.unique(group).size))
