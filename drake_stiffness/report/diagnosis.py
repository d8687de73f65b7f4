"""The report of `diagnose`: what is missing, the proof that it is, what was ruled out, and what to measure next."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from drake_stiffness.diagnosis.locate import by_part
from drake_stiffness.diagnosis.signatures import Scene
from drake_stiffness.diagnosis.words import effect_words, meaning, p_words, searched
from drake_stiffness.intervals.interval import read_as
from drake_stiffness.report import diagnosis_plots as plots
from drake_stiffness.report import page as h
from drake_stiffness.report.diagnosis_arm import arm_section
from drake_stiffness.report.diagnosis_evidence import fates, next_section, ruled_out_section, suspects_section
from drake_stiffness.report.diagnosis_shape import shapes
from drake_stiffness.report.notes import provenance

if TYPE_CHECKING:
    from drake_stiffness.diagnosis.bench import Named
    from drake_stiffness.diagnosis.job import Diagnosed

SHAPE_CAPTION = (
    "what the readings show of it (grey: the same plus what remains). Middle and right: what is left without and with the named "
    "effects. A level cloud around zero is noise."
)
WHERE_CAPTION = (
    "readings in units of the stated noise (root of chi-square per degree of freedom), parted in every way. One bar far above the others "
    "says where to look; bars that are all alike say that the cause is elsewhere."
)
_REFITTED = "after the model's own parameters had been refitted"


def diagnosis_report(result: Diagnosed) -> str:
    """The page of `diagnose --report`.

    Parameters
    ----------
    result : Diagnosed
        From `drake_stiffness.diagnosis.job.diagnose_campaign`.

    Returns
    -------
    str
        A self-contained HTML page.
    """
    made = result.model.provenance
    name, d = made.get("inputs", {}).get("campaign", {}).get("file", result.task.path.name), result.diagnosis
    return h.page(
        f"Diagnosis of {name}",
        f"{result.task.campaign.measurements}, cell {result.task.campaign.cell}. Where model and measurement disagree, and why.",
        h.verdict(answer(result)),
        *_callouts(result),
        _tiles(result),
        _gap(result),
        *(_effect(result, n) for n in result.diagnosis.search.named),
        _where(result),
        arm_section(d.search.base.model, d.search.solution.model, d.observations),
        suspects_section(
            d.search.first,
            fates(d.search.named, d.withdrawn, d.outliers),
            result.document["rejected"],
            "the base model",
            _REFITTED,
        ),
        ruled_out_section(result.document),
        next_section(result.document["next_experiment"]),
        provenance(made, result.model.fit, level=2),
        footer=f"Made by {made.get('program', 'drake-stiffness')}.",
    )


def answer(result: Diagnosed) -> str:
    """The verdict in plain sentences."""
    document = result.document
    gap, named = document["gap"], [e for e in document["effects"] if e["kind"] != "outliers"]
    parts = [f"{document['verdict'].replace('_', ' ').capitalize()}: {meaning(document)}."]
    if named:
        parts.append(f"Missing in the model: {'; '.join(effect_words(e) for e in named)}.")
    before, after = (h.length(gap[f"held_out_{when}_rms_mm"]) for when in ("before", "after"))
    noise = h.length(gap["noise_rms_mm"])
    if named:
        parts.append(
            f"On experiments that took no part the gap goes from {before} to {after} rms; noise alone leaves {noise}."
        )
    else:
        parts.append(f"On experiments that took no part the gap is {before} rms; noise alone leaves {noise}.")
    if document["verdict"] in ("partly_explained", "unexplained"):
        parts.append(f"What remains: {document['where_in_words']['after']}.")
    return " ".join(parts)


def _callouts(result: Diagnosed) -> list[h.Markup]:
    d = result.diagnosis
    out = []
    if d.noise.implausible:
        out.append(
            h.callout(
                "THE STATED NOISE IS IMPLAUSIBLE.",
                f"{d.noise.in_words[0].upper()}{d.noise.in_words[1:]}.",
                "All tests here use the noise that the data show. Correct noise.position_sigma_mm in campaign.yaml, or look for what "
                "shakes the instrument.",
            )
        )
    for x in d.outliers:
        out.append(
            h.callout(
                f"OUTLIER {x.name}:",
                f"fits nothing ({h.number(x.rms_sigma, 2)} sigma rms, {p_words(x.p_value)}) and was left out.",
                "Look at the log book: a bumped tracker, a wrong load, a wrong posture. Measure it again or set weight 0."
                + (f" Or it alone shows {' or '.join(x.instead)}: measure more like it." if x.instead else ""),
            )
        )
    for name, why in d.withdrawn.items():
        out.append(
            h.callout(
                f"WITHDRAWN: {name}.",
                f"{why[0].upper()}{why[1:]}.",
                "Either chance, or it stood before another effect that fits as well."
                if name in d.refuted
                else "Something lives there that no kind of the catalogue describes.",
            )
        )
    for name, why in d.search.faults.items():
        out.append(h.callout(f"NOT TRIED: {name}.", f"It failed: {why}.", "All other suspects were tried."))
    return out


def _tiles(result: Diagnosed) -> h.Markup:
    gap, d = result.document["gap"], result.diagnosis
    fitted, held = len(d.observations.measurements.experiments), len(d.held.measurements.experiments)
    after = " after" if _changed(result) else ""
    first = ((h.number(gap["held_out_before_rms_mm"]), "held-out gap before, mm rms"),) if after else ()
    return h.tiles(
        (
            *first,
            (h.number(gap["held_out_after_rms_mm"]), f"held-out gap{after}, mm rms"),
            (h.number(gap["noise_rms_mm"]), "stated noise alone, mm rms"),
            (h.number(gap["held_out_chi2_per_dof_after"]), f"held-out chi-square / dof{after}"),
            (h.number(gap["held_out_p_value_after"], 2), "p-value of what remains"),
            (f"{fitted} + {held}", "experiments fitted + held out"),
        )
    )


def _gap(result: Diagnosed) -> h.Markup:
    d = result.diagnosis
    before, after = h.number(d.before.per_dof), h.number(d.after.per_dof)
    second = d.refuted and d.search.named
    text = (
        "Held-out experiments chose no effect and fitted no parameter: they are the proof. "
        f"{'But they refused another name before, so what they say of this one is a little too good. ' if second else ''}"
        "Their chi-square per degree of freedom "
        f"{f'goes from {before} to {after}' if _changed(result) else f'is {after}'} (1 is noise; the uncertainty of the parameters adds a little)."
    )
    return h.section(
        "The gap",
        h.figure(
            plots.gap_figure(result.document["gap"], _changed(result)),
            ("Residuals before (base model) and after (with the named effects). " if _changed(result) else "")
            + "Fitted readings may come out a little below the noise, because unknowns take up some of it.",
            "Bars of the gap before and after",
        ),
        h.paragraph(text),
        h.paragraph(_yardstick(result)),
    )


def _changed(result: Diagnosed) -> bool:
    """Whether the model after differs from the one before."""
    return bool(result.diagnosis.search.named)


def _yardstick(result: Diagnosed) -> str:
    """What any model could still explain, by the Gaussian process of the remainder."""
    d = result.diagnosis
    beyond = d.before.chi2 - d.before.dof
    before, after = (100 * v / max(beyond, 1e-300) for v in d.explainable)
    if beyond < 3 * np.sqrt(2.0 * max(d.before.dof, 1)):
        return (
            "There is hardly more in these readings than noise, so there is nothing that another model could explain."
        )
    words = [
        "The yardstick: smooth functions of every joint's torque, angle and load history and of time, which name nothing, predict "
        f"{max(before, 0):.0f} % of what is beyond noise in the held-out readings before"
    ]
    if d.search.named:
        took = 100 * (d.before.chi2 - d.after.chi2) / beyond
        words.append(
            f"; the named effects take away {took:.0f} %, and the same functions would predict {max(after, 0):.0f} % more"
        )
    return "".join(words) + "."


def _effect(result: Diagnosed, n: Named) -> h.Markup:
    entry = next(
        e
        for e in result.document["effects"]
        if (e["kind"], e["where"]) == (n.tested.suspect.kind, n.tested.suspect.where)
    )
    found = shapes(result.diagnosis, n)
    rows = [_unknown(name, p) for name, p in entry["parameters"].items()]
    how = "searched, at a scale by convention" if entry["derived"] else "searched, not fitted"
    rows += [(name, constant(value), "", how, unit) for name, value, unit in searched(entry)]
    rows += [
        (name.replace("_", " "), h.number(p["value"]), "", "whatever the scale of the levers", p["unit"])
        for name, p in entry["derived"].items()
    ]
    evidence = entry["evidence"]
    lines = [
        f"It explains {h.number(evidence['sigma'])} sigma of the fitted readings when all other unknowns are refitted "
        f"({p_words(evidence['p_value'])}; {evidence['level']:.1g} was needed after the search over all suspects was paid for).",
        f"Readings of experiments that a fit did not see are predicted better by {h.number(evidence['cross_validated_gain'])} in chi-square.",
    ]
    if evidence["placebos"]:
        as_good = round(evidence["placebos_as_good"] * (1 + evidence["placebos"]) - 1)
        lines.append(
            f"{as_good or 'None'} of {evidence['placebos']} placebos (the same kind driven by the angles, torques or times of another "
            "experiment) explains as much."
        )
    return h.section(
        f"Missing: {entry['kind'].replace('_', ' ')} at {entry['where']}",
        class_part(entry),
        h.table(("unknown", "value", "sigma", "95 %", "unit"), rows, align="lrrll"),
        h.bullets(lines),
        h.figure(
            plots.shape_figure(found),
            f"Each dot is a load step. Left: what the effect does in the model (black) and {SHAPE_CAPTION}",
            f"Residual against what explains it, {entry['kind']} at {entry['where']}",
        ),
    )


def _unknown(name: str, p: dict[str, Any]) -> tuple[str, ...]:
    """A row: value, sigma and interval in units that people read."""
    factor, unit = read_as(p["unit"])
    sigma = p["sigma"] * factor if p["sigma"] else None
    return name, h.number(p["value"] * factor), h.number(sigma, 2), interval_words(p["value"] * factor, sigma), unit


def interval_words(value: float, sigma: float | None, digits: int = 3) -> str:
    """The 95 % interval of a value."""
    if not sigma or sigma != sigma:
        return "not determined by itself"
    return " .. ".join(h.number(value + side * 1.96 * sigma, digits) for side in (-1, 1))


def constant(value: object) -> str:
    """A constant of an effect as people read it."""
    if isinstance(value, list | tuple):
        return ", ".join(constant(v) for v in value)
    return h.number(value) if isinstance(value, float) else str(value)


def class_part(entry: dict[str, Any]) -> h.Markup:
    """What this campaign cannot tell a named effect from."""
    others = [f"{c['kind']} at {c['where']}" for c in entry["confounded_with"]]
    if not others:
        return h.paragraph("This campaign tells it from every other suspect.")
    return h.callout(
        "ONE OF A CLASS.",
        f"This campaign cannot tell it from: {', '.join(others)}.",
        "The answer is the whole class; the one shown here is its strongest or simplest member, not the proven one.",
    )


def _where(result: Diagnosed) -> h.Markup:
    d = result.diagnosis
    o, left, words = d.observations, d.search.left, result.document["where_in_words"]
    after = {}
    if _changed(result):
        after = by_part(Scene(d.search.solution.model, o), d.search.solution.residual, left.dof)
    text = f"Before: {words['before']}." + (f" After: {words['after']}." if d.search.named else "")
    return h.section(
        "Where the gap is",
        h.paragraph(text),
        h.figure(
            plots.where_figure(d.where, after),
            f"Fitted {WHERE_CAPTION}",
            "Residuals by joint, direction, level, branch, point, step, time and experiment",
        ),
    )
