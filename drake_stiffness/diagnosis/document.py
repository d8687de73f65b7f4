"""`diagnosis.json`: the result for programs (FORMATS: diagnosis.json)."""

from __future__ import annotations

from typing import Any

import numpy as np

from drake_stiffness.diagnosis.bench import Named
from drake_stiffness.diagnosis.detection import Limit, detection_limits
from drake_stiffness.diagnosis.diagnosis import Diagnosis, gap_mm
from drake_stiffness.diagnosis.evidence import Tested
from drake_stiffness.diagnosis.growth import Further
from drake_stiffness.diagnosis.outliers import Outlier
from drake_stiffness.diagnosis.search import MOST_EFFECTS, what_may_be
from drake_stiffness.diagnosis.suspects import suspects, timed

FORMAT = "drake-stiffness-diagnosis/1"


def diagnosis_document(d: Diagnosis, sigma: dict[str, float], plan: dict[str, Any] | None) -> dict[str, Any]:
    """The content of `diagnosis.json`.

    Parameters
    ----------
    sigma : dict
        Standard deviation of every parameter of the final model, by name.
    plan : dict, optional
        The next experiment.
    """
    o = d.observations
    return {
        "format": FORMAT,
        "verdict": d.verdict,
        "level": d.search.first.level,
        "effects": [_entry(d, n, sigma) for n in d.search.named] + [_outlier(x) for x in d.outliers],
        "gap": {
            "noise_rms_mm": float(np.sqrt(3)) * o.sigma_p * 1e3,
            "noise_shown_rms_mm": float(np.sqrt(3)) * d.noise.sigma_m * 1e3,
            "noise_shown_by": d.noise.how,
            "noise_implausible": d.noise.implausible,
            "before_rms_mm": gap_mm(d.search.base.residual, o),
            "after_rms_mm": gap_mm(d.search.solution.residual, o),
            "held_out_before_rms_mm": d.before.rms_mm,
            "held_out_after_rms_mm": d.after.rms_mm,
            "held_out_chi2_per_dof_before": d.before.per_dof,
            "held_out_chi2_per_dof_after": d.after.per_dof,
            "held_out_p_value_before": d.before.p_value,
            "held_out_p_value_after": d.after.p_value,
            "held_out_explainable_before": d.explainable[0],
            "held_out_explainable_after": d.explainable[1],
        },
        "where": {part: [vars(place) for place in places] for part, places in d.where.items()},
        "where_in_words": {"before": d.words[0], "after": d.words[1]},
        "rejected": _rejected(d),
        "untestable": [vars(u) for u in d.untestable],
        "not_detectable_above": [vars(limit) for limit in _limits(d)],
        "next_experiment": plan,
    }


def _entry(d: Diagnosis, n: Named, sigma: dict[str, float]) -> dict[str, Any]:
    model = d.search.solution.model
    place = next(i for i, e in enumerate(model.effects) if e is n.effect)
    values = model.values[place]
    name, loose = n.tested.suspect.name, n.effect.conventional
    share, placebos = d.placebos.get(name, (float("nan"), 0))
    return {
        "kind": n.effect.kind,
        "where": n.effect.where,
        "settings": n.effect.settings(),
        "parameters": {
            p.name: {"value": float(v), "unit": p.unit, "sigma": None if p.name in loose else sigma.get(full)}
            for p, v, full in zip(n.effect.parameters, values, n.effect.names, strict=True)
        },
        "derived": {key: {"value": v, "unit": unit} for key, (v, unit) in n.effect.derived(values).items()},
        "evidence": {
            "sigma": float(np.sqrt(max(n.tested.explained, 0.0))),
            "explained_chi2": n.tested.explained,
            "p_value": n.tested.p_value,
            "level": n.level,
            "cross_validated_gain": n.tested.gain,
            "placebos_as_good": share,
            "placebos": placebos,
        },
        "confounded_with": [{"kind": t.suspect.kind, "where": t.suspect.where} for t in n.confounded],
        "outside_the_catalogue_as_good": d.as_good.get(name),
    }


def _limits(d: Diagnosis) -> list[Limit]:
    """How large what was tried and not named could be."""
    model = d.search.solution.model
    out = {(u.kind, u.where) for u in d.untestable} | {tuple(name.split(" at ", 1)) for name in d.withdrawn}
    present = {(e.kind, e.where) for e in model.effects}
    tried = [
        timed(s, d.observations.measurements)
        for s in suspects(model)
        if (s.kind, s.where) not in out and s.name not in d.search.faults and s.makes_sense_beside(present)
    ]
    return detection_limits(d.search.left, d.search.last, tried)


def _outlier(x: Outlier) -> dict[str, Any]:
    return {
        "kind": "outliers",
        "where": x.name,
        "settings": {},
        "parameters": {},
        "derived": {},
        "evidence": {"p_value": x.p_value, "excess": x.excess, "rms_sigma": x.rms_sigma},
        "confounded_with": [dict(zip(("kind", "where"), name.split(" at ", 1), strict=True)) for name in x.instead],
    }


def _rejected(d: Diagnosis) -> list[dict[str, Any]]:
    out = [
        {"kind": name.partition(" at ")[0], "where": name.partition(" at ")[2], "why": why}
        for name, why in d.withdrawn.items()
    ]
    possible = what_may_be(d.search.named) | {name for x in d.outliers for name in x.instead}
    said = possible | set(d.withdrawn) | set(d.search.faults)
    tested = [t for t in (*d.search.last.passed, *d.search.last.failed) if t.suspect.name not in said]
    out += [
        {"kind": t.suspect.kind, "where": t.suspect.where, "why": why_not(t, d.search.last.level, len(d.search.named))}
        for t in tested
        if not isinstance(t.suspect, Further)
    ]
    said |= {t.suspect.name for t in tested}
    out += [
        {
            "kind": s.kind,
            "where": s.where,
            "why": "nothing of it is left beside the model, or its value would be out of bounds",
        }
        for s in d.search.tried
        if s.name not in said
    ]
    for name, reason in d.search.faults.items():
        if name in possible:
            continue
        kind, _, where = name.partition(" at ")
        out.append({"kind": kind, "where": where, "why": f"could not be tried: {reason}"})
    return out


def why_not(t: Tested, level: float, named: int) -> str:
    """Why a suspect lost beside so many named effects."""
    if t.p_value >= level:
        return f"explains no more than noise does (p = {t.p_value:.2g}, needed {level:.1g})"
    if t.gain <= 0:
        return f"does not predict unseen experiments better (cross-validated gain {t.gain:.3g})"
    if named >= MOST_EFFECTS:
        return f"would gain {t.gain:.3g}, but more effects than are named were never told apart"
    return (
        f"would gain {t.gain:.3g}, but beside what is named it is not beyond doubt (p = {t.p_value:.2g}), or it is what the form of a "
        "named effect at its place misses"
    )
