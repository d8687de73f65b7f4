"""The whole of `diagnose`: locate, name, add, confirm."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from drake_stiffness.campaign import HoldOut, Measurements
from drake_stiffness.diagnosis.bench import Bench, Named
from drake_stiffness.diagnosis.confirmation import HeldOut, held_out, placebo_share, still_explainable
from drake_stiffness.diagnosis.doubts import effects_behind, hint, sticks_out
from drake_stiffness.diagnosis.generic import fit_process
from drake_stiffness.diagnosis.locate import Place, by_part, floor_in_words, in_words
from drake_stiffness.diagnosis.naming import Remaining, remaining
from drake_stiffness.diagnosis.outliers import MOST, Outlier, find_outlier, joined, without
from drake_stiffness.diagnosis.prior import WithPrior
from drake_stiffness.diagnosis.refutation import Stands, borne_out, of_fitting_form
from drake_stiffness.diagnosis.rigidity import NoiseShown, noise_of_remainder, noise_shown
from drake_stiffness.diagnosis.search import Search, search, weighed
from drake_stiffness.diagnosis.signatures import Scene
from drake_stiffness.diagnosis.suspects import Untestable, separate_untestable, suspects
from drake_stiffness.diagnosis.verdict import Verdict, judge, with_doubts
from drake_stiffness.errors import InputError
from drake_stiffness.hold_out import held_out_experiments, posture_groups
from drake_stiffness.identification import Solution, identify
from drake_stiffness.model import Model
from drake_stiffness.observation import Observations, columns, measured, observe, predicted, restrict
from drake_stiffness.rotations import Array
from drake_stiffness.start import starting_model
from drake_stiffness.task import Task

DEFAULT_HOLD_OUT = HoldOut(fraction=0.2, seed=0)
_FEWEST = 6


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
    refuted : frozenset of str
        Those of them that held-out readings alone speak against.
    as_good : dict of name to a form that the catalogue lacks and that does about as well
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
    refuted: frozenset[str]
    as_good: dict[str, str]
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
    outliers: tuple[Outlier, ...] = ()
    limit = _limit(data.fitted)
    known: tuple[Named, ...] = ()
    while True:
        found = None
        o = data.arrange(data.fitted)
        progress("fitting the base model")
        base = identify(start, o, "sdp")
        testable, untestable = separate_untestable(suspects(base.model), base.model, data.fitted, task.displacement)
        noise = noise_shown(Scene(base.model, o), base.residual)
        ratio = noise.ratio if noise.dof > 0 else 1.0
        bench = Bench(base, o, testable, task_seed(task), progress)
        first = bench.round((), set())
        worst = _outlier(bench.left(()), max((t.gain for t in first.passed), default=0.0), ratio)
        if worst is None:
            found = search(bench, known)
            worst = _outlier(found.left, 0.0, ratio) if found.named else None
        if worst is None or len(outliers) == limit:
            found = weighed(found or search(bench, known), known)
            break
        known = () if found is None else found.named
        progress(f"leaving out {worst.name}")
        left = bench.left(()) if found is None else found.left
        outliers = joined(outliers, replace(worst, instead=effects_behind(left, testable, worst)))
        data = replace(data, fitted=without(data.fitted, worst.name))
    return _confirm(data, base, found, outliers, untestable, noise, progress)


def _outlier(left: Remaining, best_gain: float, ratio: float) -> Outlier | None:
    """The worst outlier that is not where something else shows most."""
    worst = find_outlier(left, best_gain, ratio)
    return None if worst is None or sticks_out(left, worst) else worst


def _limit(m: Measurements) -> int:
    """How many outliers there can be at most."""
    return max(1, int(MOST * len(m.experiments)))


def held_outlier(solution: Solution, o: Observations, ratio: float) -> Outlier | None:
    """An outlier among readings that took no part in a fit."""
    model, view = solution.model, solution.identifiability
    # The parameters' uncertainty is part of the residual: as unknowns with a prior, whose rows come last.
    A = columns(o, model)
    X = np.vstack([A @ view.seen, np.diag(view.weight)])
    residual = np.concatenate([measured(o) - predicted(o, model), np.zeros(view.weight.size)])
    Q = np.linalg.qr(X)[0]
    left = WithPrior(Scene(model, o), Q, residual - Q @ (Q.T @ residual), o.rows - o.references, A, view.weight.size)
    return _outlier(left, 0.0, ratio)


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
    left_base = found.bench.left(())
    process_before = fit_process(left_base, base.identifiability.seen)
    stands = of_fitting_form(found)
    held, all_outliers, sticking = _held_outliers(data, stands.search, outliers, ratio)
    o_held, yard = data.arrange(held), _yard(noise, ratio, stands)
    stands = borne_out(stands, held_out(base, o_held, ratio)[0], o_held, yard)
    if stands.anew:
        # What stuck out of a refuted model may not stick out of this one.
        held, all_outliers, sticking = _held_outliers(data, stands.search, outliers, ratio)
        o_held, yard = data.arrange(held), _yard(noise, ratio, stands)
    outliers, found, process_after, withdrawn = all_outliers, stands.search, stands.process, dict(stands.withdrawn)
    before, r_before = held_out(base, o_held, ratio)
    after, r_after = held_out(found.solution, o_held, ratio)
    explainable = (
        still_explainable(process_before, o_held, r_before),
        still_explainable(process_after, o_held, r_after),
    )
    places = by_part(Scene(base.model, o), base.residual, left_base.dof)
    words = (
        in_words(process_before, left_base.per_dof, o.sigma_p * 1e3),
        in_words(process_after, found.left.per_dof, o.sigma_p * 1e3),
    )
    if noise.dof <= 0:
        words = (words[0], words[1] + floor_in_words(process_after, o.sigma_p * 1e3))
        noise = noise_of_remainder(process_after, o.sigma_p)
    placebos = {}
    for n in found.named:
        progress(f"placebos of {n.tested.suspect.name}")
        others = found.bench.left([m.effect for m in found.named if m is not n])
        placebos[n.tested.suspect.name] = placebo_share(others, n.effect, task_seed(data.task))
    beyond = hint(found.left)
    verdict = judge(found, outliers, before, after, ratio, yard)
    if verdict in ("consistent", "explained"):
        lost = max((n.tested.explained for n in stands.lost), default=0.0)
        verdict = with_doubts(verdict, found, lost, beyond.sure, bool(sticking))
    if verdict in ("partly_explained", "unexplained") and beyond.words:
        words = (words[0], f"{words[1]}; {beyond.words}")
    if verdict == "unexplained":
        # Where a gap remains that nothing closes, what stuck out of it is a part of it and no outlier.
        withdrawn |= {f"outliers at {x.name}": "it stuck out of a gap that remains without it" for x in outliers}
        outliers = ()
    withdrawn |= sticking
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
        stands.refuted,
        stands.as_good,
        o,
        o_held,
    )


def _yard(noise: NoiseShown, ratio: float, stands: Stands) -> float:
    """The noise, over the stated one, that a gap can close to: where nothing shows it, what no smooth function gets below."""
    return ratio if noise.dof > 0 else max(1.0, float(np.sqrt(stands.process.floor)))


def _held_outliers(
    data: _Data, found: Search, outliers: tuple[Outlier, ...], ratio: float
) -> tuple[Measurements, tuple[Outlier, ...], dict[str, str]]:
    """Held-out readings without outliers, which prove nothing against a model; all outliers; and what sticks out, but may be an effect."""
    held = data.held
    while len(outliers) < _limit(data.fitted) + 1:
        worst = held_outlier(found.solution, data.arrange(held), ratio)
        if worst is None:
            break
        if behind := effects_behind(_of_all(data, found, outliers), found.bench.found, worst):
            why = (
                f"held out, it sticks out of what the others say; over all experiments {behind[0]} explains as much. Hold out others, or "
                "measure more like it"
            )
            return held, outliers, {f"outliers at {worst.name}": why}
        outliers = joined(outliers, worst)
        held = without(held, worst.name)
    return held, outliers, {}


def _of_all(data: _Data, found: Search, outliers: tuple[Outlier, ...]) -> Remaining:
    """What the model leaves of fitted and held-out readings together."""
    m = data.task.measurements
    for outlier in outliers:
        m = without(m, outlier.name)
    o = data.arrange(m)
    model = found.solution.model
    return remaining(Scene(model, o), measured(o) - predicted(o, model), found.solution.identifiability.seen)


def gap_mm(residual: Array, o: Observations) -> float:
    """Root mean square over readings of the length of the 3-D residual, mm."""
    readings = o.measurements.case.size
    return float(np.sqrt((residual[: 3 * readings] ** 2).sum() / max(readings, 1))) * o.sigma_p * 1e3
