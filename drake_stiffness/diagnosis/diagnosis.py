"""The whole of `diagnose`: locate, name, add, confirm."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from drake_stiffness.campaign import HoldOut, Measurements
from drake_stiffness.diagnosis.confirmation import HeldOut, held_out, placebo_share, still_explainable
from drake_stiffness.diagnosis.generic import Process, fit_process
from drake_stiffness.diagnosis.locate import Place, by_part, floor_in_words, in_words
from drake_stiffness.diagnosis.naming import Remaining, try_all
from drake_stiffness.diagnosis.outliers import MOST, Outlier, find_outlier, without
from drake_stiffness.diagnosis.rigidity import NoiseShown, noise_shown
from drake_stiffness.diagnosis.search import MOST_EFFECTS, Named, Search, leaves, refit, search
from drake_stiffness.diagnosis.signatures import Scene
from drake_stiffness.diagnosis.suspects import Untestable, separate_untestable, suspects
from drake_stiffness.effects import Effect
from drake_stiffness.effects.compliance import Spring
from drake_stiffness.effects.harmonics import JointPeriodicError
from drake_stiffness.errors import InputError
from drake_stiffness.hold_out import held_out_experiments, posture_groups
from drake_stiffness.identification import Solution, identify
from drake_stiffness.model import Model
from drake_stiffness.observation import Observations, measured, observe, predicted, restrict
from drake_stiffness.rotations import Array
from drake_stiffness.start import starting_model
from drake_stiffness.task import Task

Verdict = Literal["consistent", "explained", "partly_explained", "unexplained"]
DEFAULT_HOLD_OUT = HoldOut(fraction=0.25, seed=0)
_FEWEST = 6
_CONSISTENT = 0.01
# The named effects explain the gap when they close this much of it, or what remains is noise; less is a part, little nothing.
_EXPLAINED, _PARTLY = 0.9, 0.1
# What is left is not noise below this probability; forms are then believed only where they close this much of the gap.
_NOT_NOISE, _MOSTLY = 1e-3, 0.75
# A form is wrong when its own place still explains this share of what it explained, and more than five sigma.
_WRONG_FORM, _LEAST_REST = 0.35, 25.0


@dataclass(frozen=True, eq=False)
class Diagnosis:
    """What `diagnose` found.

    Attributes
    ----------
    verdict : str
    search : Search
    outliers : tuple of Outlier
    untestable : list of Untestable
    noise : NoiseShown
        What the readings show of their own noise.
    before, after : HeldOut
        On experiments that took no part.
    fitted_before, fitted_after : Array
        Whitened residuals of the fitted readings.
    placebos : dict of name to (share, number)
    explainable : tuple of two floats
        Squared sigma of held-out readings that a Gaussian process could still explain, before and after.
    where : dict of part to places
    words : tuple of str
        Where the gap is, before and after.
    withdrawn : dict of name to reason
    """

    verdict: Verdict
    search: Search
    outliers: tuple[Outlier, ...]
    untestable: list[Untestable]
    noise: NoiseShown
    before: HeldOut
    after: HeldOut
    placebos: dict[str, tuple[float, int]]
    explainable: tuple[float, float]
    where: dict[str, list[Place]]
    words: tuple[str, str]
    withdrawn: dict[str, str]
    observations: Observations
    held: Observations


@dataclass(frozen=True, eq=False)
class _Data:
    """Readings that are fitted, readings that are held out, and what was left out of both."""

    task: Task
    fitted: Measurements
    held: Measurements

    def arrange(self, m: Measurements) -> Observations:
        return observe(m, self.task.displacement, self.task.campaign.noise, self.task.motion)


def diagnose(task: Task, progress: Callable[[str], None], model: Model | None = None) -> Diagnosis:
    """Locate, name, add, confirm.

    Parameters
    ----------
    model : Model, optional
        Where the springs start.

    Raises
    ------
    InputError
        If there are too few experiments to hold any out.
    """
    data = _split(task)
    start = model or starting_model(task.model, data.fitted)
    outliers: list[Outlier] = []
    limit = _limit(data.fitted)
    while True:
        found = None
        o = data.arrange(data.fitted)
        progress("fitting the base model")
        base = identify(start, o, "sdp")
        testable, untestable = separate_untestable(suspects(base.model), base.model, data.fitted, task.displacement)
        noise = noise_shown(Scene(base.model, o), base.residual)
        ratio = noise.ratio if noise.dof > 0 else 1.0
        first = try_all(leaves(base, o), testable, task_seed(task))
        worst = find_outlier(leaves(base, o), max((t.gain for t in first.passed), default=0.0), ratio)
        if worst is None:
            found = search(base, o, testable, task_seed(task), progress)
            worst = find_outlier(found.left, 0.0, ratio) if found.named else None
        if worst is None or len(outliers) == limit:
            found = found or search(base, o, testable, task_seed(task), progress)
            break
        progress(f"leaving out {worst.name}")
        outliers.append(worst)
        data = replace(data, fitted=without(data.fitted, worst.name))
    return _confirm(data, base, found, tuple(outliers), untestable, noise, progress)


def _limit(m: Measurements) -> int:
    """How many outliers there can be at most."""
    return max(1, int(MOST * len(m.experiments)))


def held_outlier(solution: Solution, o: Observations, ratio: float) -> Outlier | None:
    """An outlier among readings that took no part in a fit."""
    residual = measured(o) - predicted(o, solution.model)
    left = Remaining(Scene(solution.model, o), np.zeros((o.rows, 0)), residual, o.rows - o.references)
    return find_outlier(left, 0.0, ratio)


def task_seed(task: Task) -> int:
    """The seed that the campaign states for its hold-out."""
    return task.campaign.hold_out.seed if task.campaign.hold_out is not None else 0


def _split(task: Task) -> _Data:
    held = task.held
    if task.campaign.hold_out is None:
        held = held_out_experiments(task.measurements, DEFAULT_HOLD_OUT, str(task.path))
    postures = np.unique(posture_groups(task.measurements.cases)).size
    if postures < _FEWEST:
        raise InputError(
            f"{task.path}: {postures} postures are too few to hold any out; `diagnose` needs at least {_FEWEST}. Measure more, or "
            "ask whether a stored model still holds: --fixed --model MODEL.json."
        )
    return _Data(task, restrict(task.measurements, ~held), restrict(task.measurements, held))


def _confirm(
    data: _Data,
    base: Solution,
    found: Search,
    outliers: tuple[Outlier, ...],
    untestable: list[Untestable],
    noise: NoiseShown,
    progress: Callable[[str], None],
) -> Diagnosis:
    progress("confirming on experiments that took no part")
    o, o_held = data.arrange(data.fitted), data.arrange(data.held)
    ratio = noise.ratio if noise.implausible else 1.0
    left_base = leaves(base, o)
    process_before, process_after = fit_process(left_base), fit_process(found.left)
    found, withdrawn = _standing(found, base, o, wrong_forms(_own_rest(found), process_after))
    # Where nothing shows the noise, what no smooth function gets below is the most that a gap can close to.
    yard = ratio if noise.dof > 0 else max(1.0, float(np.sqrt(process_after.floor)))
    # An outlier among the held-out experiments proves nothing against a model; it is named, and the rest confirms.
    while (
        len(outliers) < _limit(data.fitted) + 1 and (worst := held_outlier(found.solution, o_held, ratio)) is not None
    ):
        outliers = (*outliers, worst)
        data = replace(data, held=without(data.held, worst.name))
        o_held = data.arrange(data.held)
    before, r_before = held_out(base, o_held, ratio)
    doubtful = doubtful_names(found, before, held_out(found.solution, o_held, yard)[0], yard)
    found, more = _standing(found, base, o, doubtful)
    withdrawn |= more
    process_after = fit_process(found.left)
    after, r_after = held_out(found.solution, o_held, ratio)
    explainable = (
        still_explainable(process_before, base, o_held, r_before),
        still_explainable(process_after, found.solution, o_held, r_after),
    )
    places = by_part(Scene(base.model, o), base.residual, left_base.dof)
    words = (
        in_words(process_before, left_base.per_dof, o.sigma_p * 1e3),
        in_words(process_after, found.left.per_dof, o.sigma_p * 1e3),
    )
    if noise.dof <= 0:
        words = (words[0], words[1] + floor_in_words(process_after, o.sigma_p * 1e3))
    placebos = {n.tested.suspect.name: _placebo(found, n, base, o, task_seed(data.task)) for n in found.named}
    verdict = judge(found, outliers, before, after, ratio, yard)
    return Diagnosis(
        verdict,
        found,
        outliers,
        untestable,
        noise,
        before,
        after,
        placebos,
        explainable,
        places,
        words,
        withdrawn,
        o,
        o_held,
    )


def _standing(
    found: Search, base: Solution, o: Observations, withdrawn: dict[str, str]
) -> tuple[Search, dict[str, str]]:
    """The search without the names that do not stand, refitted."""
    if not withdrawn:
        return found, {}
    standing = tuple(n for n in found.named if n.tested.suspect.name not in withdrawn)
    solution = refit(base.model, o, [n.effect for n in standing]) if standing else base
    return replace(found, named=standing, solution=solution, left=leaves(solution, o)), withdrawn


def doubtful_names(found: Search, before: HeldOut, after: HeldOut, noise_ratio: float) -> dict[str, str]:
    """Names that stand for something else: where most of the gap remains, only a missing spring is still believed.

    What is no form of the catalogue is soaked up by several forms that each resemble a part of it, and the gap stays open. A
    spring that a model lacks is real beside whatever else is missing.
    """
    closed = _closed(before, after, noise_ratio)
    if min(_p_of_fit(found.left, noise_ratio), after.p_value) > _NOT_NOISE or closed >= _MOSTLY:
        return {}
    return {
        n.tested.suspect.name: f"with it only {100 * max(closed, 0.0):.0f} % of the gap on unseen experiments closes; something else is there"
        for n in found.named
        if not isinstance(n.effect, Spring)
    }


def _placebo(found: Search, n: Named, base: Solution, o: Observations, seed: int) -> tuple[float, int]:
    others = [m.effect for m in found.named if m is not n]
    return placebo_share(leaves(refit(base.model, o, others), o), n.effect, seed)


def _own_rest(found: Search) -> list[Named]:
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
        sorts = _sorts(n.effect)
        if isinstance(n.effect, JointPeriodicError):
            continue  # what other harmonics of the same joint leave does not speak against this one
        places = [p for p in dict.fromkeys(f.where for f in process.families) if p in n.effect.where.split("+")]
        rest = sum(process.at(p, sorts) for p in places)
        if rest > max(_WRONG_FORM * n.tested.explained, _LEAST_REST * max(process.floor, 1.0)):
            out[n.tested.suspect.name] = (
                f"its form does not fit: with it in the model, smooth functions of the {' and '.join(sorted(sorts))} of "
                f"{', '.join(places)} still explain {100 * rest / n.tested.explained:.0f} % of what it explains"
            )
    return out


def _sorts(effect: Effect) -> set[str]:
    """What drives an effect, in the terms of the generic families."""
    if "time" in effect.needs:
        return {"time"}
    if "unloading" in effect.needs:
        return {"branch", "load"}
    return {"angle"} if "positions" in effect.needs else {"load"}


def judge(
    found: Search, outliers: tuple[Outlier, ...], before: HeldOut, after: HeldOut, noise_ratio: float, yard: float
) -> Verdict:
    """The verdict (FORMATS: diagnosis.json); `yard` is the noise, over the stated one, that a gap can close to."""
    fits = min(_p_of_fit(found.left, noise_ratio), after.p_value) > _CONSISTENT / 2
    if fits:
        return "explained" if found.named or outliers else "consistent"
    if not found.named:
        return "unexplained"
    closed = _closed(before, after, yard)
    # Down to a noise that nothing but the fit itself shows is no explanation of all.
    if closed >= _EXPLAINED and yard == noise_ratio:
        return "explained"
    return "partly_explained" if closed >= _PARTLY else "unexplained"


def _p_of_fit(left: Remaining, noise_ratio: float) -> float:
    from scipy.special import chdtrc

    return float(chdtrc(left.dof, float(left.r @ left.r) / noise_ratio**2))


def _closed(before: HeldOut, after: HeldOut, noise_ratio: float) -> float:
    """Share of what is beyond noise on held-out readings that the named effects take away."""
    beyond = before.chi2 - before.dof * noise_ratio**2
    return (before.chi2 - after.chi2) / beyond if beyond > 0 else 0.0


def gap_mm(residual: Array, o: Observations) -> float:
    """Root mean square over readings of the length of the 3-D residual, mm."""
    readings = o.measurements.case.size
    return float(np.sqrt((residual[: 3 * readings] ** 2).sum() / max(readings, 1))) * o.sigma_p * 1e3
