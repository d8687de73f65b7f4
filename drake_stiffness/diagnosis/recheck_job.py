"""`diagnose --fixed` as a function of files, and its result for programs and for people."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from drake_stiffness.diagnosis.diagnosis import task_seed
from drake_stiffness.diagnosis.document import FORMAT, why_not
from drake_stiffness.diagnosis.evidence import Tested
from drake_stiffness.diagnosis.generic import fit_process
from drake_stiffness.diagnosis.locate import by_part, in_words
from drake_stiffness.diagnosis.prior import WithPrior
from drake_stiffness.diagnosis.recheck import FEWEST_TO_LEAVE_OUT, Change, Recheck, recheck
from drake_stiffness.diagnosis.search import what_may_be
from drake_stiffness.diagnosis.signatures import extended
from drake_stiffness.effects.instruments import TrackerFrame
from drake_stiffness.errors import InputError
from drake_stiffness.jobs import provenance
from drake_stiffness.model import Model, Statistics, load_model
from drake_stiffness.observation import measured, observe, predicted
from drake_stiffness.start import starting_model
from drake_stiffness.task import Task, quiet, read_task

# A standard deviation below this, in units of scale, is rounding: the readings do not move the parameter.
_ROUNDING = 1e-9


@dataclass(frozen=True, eq=False)
class Rechecked:
    """What `diagnose --fixed` hands back.

    Attributes
    ----------
    task : Task
    stored : Model
    recheck : Recheck
    model : Model
        The stored model if it holds, else with the values of now.
    document : dict
        The content of `diagnosis.json`.
    """

    task: Task
    stored: Model
    recheck: Recheck
    model: Model
    document: dict[str, Any]


def recheck_campaign(path: Path | str, model: Path | str, progress: Callable[[str], None] = quiet) -> Rechecked:
    """Ask of a short campaign whether a stored model is still true (command `diagnose --fixed --model`).

    Raises
    ------
    InputError
        If the model is of another arm, or says nothing of how well it is known.
    """
    task = read_task(path, progress)
    stored = load_model(model)
    if stored.arm.joint_names != task.arm.joint_names:
        raise InputError(
            f"{model}: a model of joints {', '.join(stored.arm.joint_names)}; the campaign is of {', '.join(task.arm.joint_names)}."
        )
    if stored.statistics is None:
        raise InputError(
            f"{model}: the model holds no covariance, so nobody can say how far off readings may be; run `identify` to make it."
        )
    # What is held, where the load acts and where the reflectors sit is what the campaign's cell says today.
    today = replace(
        stored, arm=task.arm, points=task.model.points, load_point=task.model.load_point, cell=task.model.cell
    )
    for effect in today.effects:
        effect.check(today.arm, today.points)
    anew, fresh = _set_up_anew(task, today)
    o = observe(task.measurements, task.displacement, task.campaign.noise, task.motion)
    found = recheck(anew, fresh, task.measurements, o, task_seed(task), progress)
    document = recheck_document(found, anew)
    document["recheck"]["model"] = str(model)
    document["recheck"]["set_up_anew"] = [f"{anew.effects[k].kind} at {anew.effects[k].where}" for k in fresh]
    now = _model_of_now(found, anew) if found.changes else stored
    entry = {
        **now.fit,
        "recheck": {"verdict": found.verdict, "changed": [c.named.tested.suspect.name for c in found.changes]},
    }
    now = replace(now, fit=entry, provenance=provenance({**task.files, "model": Path(model)}, task_seed(task)))
    return Rechecked(task, stored, found, now, document)


def _set_up_anew(task: Task, model: Model) -> tuple[Model, list[int]]:
    """The stored model with instruments that the campaign says are unknown, and their numbers."""
    kinds = {"tracker_frame"} if task.campaign.tracker_frame == "unknown" else set()
    if task.campaign.reference_points == "unknown":
        kinds.add("reflector_offset")
    present = {(e.kind, e.where) for e in model.effects}
    statistics = model.statistics
    assert statistics is not None
    for effect in task.effects:
        if effect.kind in kinds and (effect.kind, effect.where) not in present:
            model = extended(model, effect)
            statistics = _padded(statistics, len(effect.parameters))
    fresh = [k for k, e in enumerate(model.effects) if e.kind in kinds]
    if any(isinstance(model.effects[k], TrackerFrame) for k in fresh):
        model = starting_model(model, task.measurements)
    return replace(model, statistics=statistics), fresh


def _padded(s: Statistics, more: int) -> Statistics:
    """The statistics with further parameters that nothing is known of."""
    n = s.sigma.size
    covariance = np.zeros((n + more, n + more))
    covariance[:n, :n] = s.covariance
    return Statistics(
        np.concatenate([s.sigma, np.full(more, np.nan)]),
        (*s.group, *("G1~",) * more),
        (*s.merged_with, *((),) * more),
        covariance,
        np.vstack([s.null_space, np.zeros((more, s.null_space.shape[1]))]),
    )


def _model_of_now(found: Recheck, anew: Model) -> Model:
    """The stored model with the values of now and what is now known of them."""
    model, C = found.settled.model, found.settled.covariance
    assert anew.statistics is not None
    s = _padded(anew.statistics, model.x.size - anew.x.size)
    sigma = np.sqrt(np.maximum(np.diag(C), 0.0)) * model.scales
    changed = np.zeros(model.x.size, dtype=bool)
    for change in found.changes:
        changed[model.slices[change.number]] = True
    known = (np.isfinite(s.sigma) | changed) & (sigma > 0)
    group = tuple("G1~" if c and sd > 0 else g for c, g, sd in zip(changed, s.group, sigma, strict=True))
    statistics = Statistics(
        np.where(known, sigma, np.nan), group, s.merged_with, C * np.outer(model.scales, model.scales), s.null_space
    )
    return replace(model, statistics=statistics)


def recheck_document(found: Recheck, stored: Model) -> dict[str, Any]:
    """The content of `diagnosis.json`; values of now, and beside them `value_then` and `sigma_then` of the stored model."""
    left = found.left
    scene, o = left.scene, left.scene.o
    r = measured(o) - predicted(o, scene.model)
    where = by_part(scene, r, o.rows - o.references)
    after = found.after
    rest = measured(o) - predicted(o, found.settled.model)
    readings = o.measurements.case.size
    rms = float(np.sqrt((rest[: 3 * readings] ** 2).sum() / max(readings, 1))) * o.sigma_p * 1e3
    possible = what_may_be([change.named for change in found.changes])
    # The readings took no part in the stored model: all of them are held out before, every posture in turn after.
    return {
        "format": FORMAT,
        "verdict": found.verdict,
        "effects": [_entry(c, found, stored) for c in found.changes],
        "gap": {
            "noise_rms_mm": float(np.sqrt(3)) * o.sigma_p / found.noise_ratio * 1e3,
            "noise_shown_rms_mm": float(np.sqrt(3)) * o.sigma_p * 1e3,
            "before_rms_mm": found.before.rms_mm,
            "after_rms_mm": rms,
            "held_out_before_rms_mm": found.before.rms_mm,
            "held_out_after_rms_mm": None if after is None else after.rms_mm,
            "held_out_chi2_per_dof_before": found.before.chi2_per_dof,
            "held_out_chi2_per_dof_after": None if after is None else after.chi2_per_dof,
            "held_out_p_value_before": found.before.p_value,
            "held_out_p_value_after": None if after is None else after.p_value,
        },
        "where": {part: [vars(place) for place in places] for part, places in where.items()},
        "where_in_words": {"before": _where_in_words(left), "after": _where_in_words(found.left_after)},
        "rejected": [
            {"kind": t.suspect.kind, "where": t.suspect.where, "why": _why(t, found)}
            for t in [*found.last.passed, *found.last.failed]
            if t.suspect.name not in possible
        ]
        + [
            {"kind": name.partition(" at ")[0], "where": name.partition(" at ")[2], "why": f"could not be tried: {why}"}
            for name, why in found.last.faults.items()
        ],
        "untestable": [vars(u) for u in found.untestable],
        "not_detectable_above": [vars(limit) for limit in found.limits],
        "next_experiment": None,
        "recheck": {
            "postures": found.postures,
            "held_out": "one posture at a time, predicted from the stored model and the others"
            if after is not None
            else f"none after changes: {found.postures} postures are fewer than {FEWEST_TO_LEAVE_OUT}",
            "noise_ratio": found.noise_ratio,
        },
    }


def _why(t: Tested, found: Recheck) -> str:
    if found.changes and found.verdict == "explained" and found.last.level > t.p_value:
        return f"would explain some of the little that is left (p = {t.p_value:.2g}), but the gap is closed without it"
    if found.verdict == "unexplained" and found.last.level > t.p_value:
        return f"would explain a little (p = {t.p_value:.2g}), but nearly all of the gap would be left: no answer"
    return why_not(t, found.last.level, len(found.changes))


def _where_in_words(left: WithPrior) -> str:
    """Where what a model leaves lives, and of what shape it is."""
    process = fit_process(left, np.zeros((left.scene.model.x.size, 0)))
    # Of few postures the families of one joint overlap; together they explain no more than there is.
    beyond = max(float(left.r @ left.r) - left.dof, 0.0)
    share = process.share * min(1.0, beyond / max(float(process.share.sum()), 1e-300))
    return in_words(replace(process, share=share), left.per_dof, left.scene.o.sigma_p * 1e3)


def _entry(change: Change, found: Recheck, stored: Model) -> dict[str, Any]:
    model, named = found.settled.model, change.named
    effect = named.effect
    own = model.slices[change.number]
    sigma = np.sqrt(np.maximum(np.diag(found.settled.covariance)[own], 0.0))
    sigma = np.where(sigma > _ROUNDING, sigma, 0.0) * model.scales[own]
    parameters: dict[str, Any] = {
        p.name: {"value": float(v), "unit": p.unit, "sigma": float(s) if s > 0 else None}
        for p, v, s in zip(effect.parameters, model.x[own], sigma, strict=True)
    }
    if not change.appeared:
        assert stored.statistics is not None
        for p, v, s in zip(effect.parameters, stored.x[own], stored.statistics.sigma[own], strict=True):
            parameters[p.name] |= {"value_then": float(v), "sigma_then": float(s) if np.isfinite(s) else None}
    return {
        "kind": effect.kind,
        "where": effect.where,
        "settings": effect.settings(),
        "change": "appeared" if change.appeared else "changed",
        "parameters": parameters,
        "evidence": {
            "sigma": float(np.sqrt(max(named.tested.explained, 0.0))),
            "explained_chi2": named.tested.explained,
            "p_value": named.tested.p_value,
            "level": named.level,
            "cross_validated_gain": named.tested.gain,
        },
        "confounded_with": [{"kind": t.suspect.kind, "where": t.suspect.where} for t in named.confounded],
    }
