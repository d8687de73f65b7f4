"""The other half of the diagnosis report: all suspects beside each other, what was ruled out, what could not be tested."""

from __future__ import annotations

import base64
import csv
import io
from collections import defaultdict
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from drake_stiffness.diagnosis.words import p_words
from drake_stiffness.intervals.interval import read_as
from drake_stiffness.report import diagnosis_plots as plots
from drake_stiffness.report import page as h

if TYPE_CHECKING:
    from drake_stiffness.diagnosis.bench import Named
    from drake_stiffness.diagnosis.naming import Round
    from drake_stiffness.diagnosis.outliers import Outlier

_MOST = 15


def suspects_section(
    first: Round,
    fate: Mapping[str, tuple[str, str]],
    rejected: Sequence[Mapping[str, Any]],
    against: str,
    how: str,
) -> h.Markup:
    """The strongest suspects before anything was named, and what became of each.

    Parameters
    ----------
    first : Round
        All of them against the model that lacks what is named.
    fate : dict of name to state and reason
        Of those that were not simply rejected.
    rejected : list of dict
        As in `diagnosis.json`.
    against, how : str
        What they were tried against, and how, in words.
    """
    ranked = sorted([*first.passed, *first.failed], key=lambda t: -t.explained)[:_MOST]
    if not ranked:
        return h.section("Suspects", h.paragraph("There was nothing to try: too few readings are left over."))
    reason = {(e["kind"], e["where"]): e["why"] for e in rejected}
    names = [t.suspect.name for t in ranked]
    sigma = np.sqrt([max(t.explained, 0.0) for t in ranked])
    rows = []
    for t, s in zip(ranked, sigma, strict=True):
        state, why = fate.get(t.suspect.name, ("rejected", reason.get((t.suspect.kind, t.suspect.where), "")))
        gain = h.number(t.gain) if t.p_value < first.level else h.UNKNOWN
        rows.append((t.suspect.name, h.number(s), p_words(t.p_value).removeprefix("p = "), gain, state, why))
    tried = len(first.passed) + len(first.failed)
    text = (
        f"{tried} suspects were tried against {against}, each {how}. An effect that is really "
        "there lends others some of its signature, so many explain something at first; once the named ones are in the model, "
        "the rest is asked again. Last column: why a suspect lost then."
    )
    header = ("suspect", "sigma at first", "p", "gain", "fate", "why")
    state_of = [fate.get(name, ("rejected", ""))[0] for name in names]
    return h.section(
        "Suspects",
        h.paragraph(text),
        h.figure(
            plots.ranking_figure(names, sigma, state_of),
            f"The {len(ranked)} strongest suspects by what they explain of what {against} leaves.",
            "Ranking of suspects",
        ),
        h.table(header, rows, align="lrrrll"),
    )


def fates(
    named: Sequence[Named], withdrawn: Mapping[str, str], outliers: Sequence[Outlier] = ()
) -> dict[str, tuple[str, str]]:
    """What became of suspects that were not simply rejected, by name."""
    out = {name: ("withdrawn", why) for name, why in withdrawn.items()}
    for x in outliers:
        for name in x.instead:
            out.setdefault(name, ("cannot be told from a named one", f"it may be that {x.name} is no outlier"))
    for n in named:
        for t in n.confounded:
            what = f"this campaign cannot tell it from {n.tested.suspect.name}"
            out.setdefault(t.suspect.name, ("cannot be told from a named one", what))
    out |= {n.tested.suspect.name: ("named", "in the model") for n in named}
    return out


def ruled_out_section(document: Mapping[str, Any], about: str = "") -> h.Markup:
    """What is not there, as far as this campaign shows, and what it could not have shown, by the content of `diagnosis.json`."""
    classes = {(c["kind"], c["where"]) for entry in document["effects"] for c in entry["confounded_with"]}
    places: dict[str, list[str]] = defaultdict(list)
    for entry in document["rejected"]:
        if (entry["kind"], entry["where"]) not in classes and not entry["why"].startswith("could not be tried"):
            places[entry["kind"]].append(entry["where"])
    limits: dict[str, list[Mapping[str, Any]]] = defaultdict(list)
    for limit in document["not_detectable_above"]:
        limits[limit["kind"]].append(limit)
    rows = [(kind, *_limits(limits[kind]), _places(own)) for kind, own in sorted(places.items())]
    header = ("kind", "found above, µm rms", "that is", "tried at")
    parts: list[object] = [
        h.paragraph(
            "Tried with the named effects in the model, and not needed: nothing that noise would not do as well. Absent means below what "
            "this campaign can see: an effect of the stated size (the displacement it makes, at the best and at the worst place) would "
            f"have been found nine times in ten.{about}"
        ),
        h.table(header, rows, align="lrll") if rows else h.paragraph("Nothing was tried."),
        h.section("Untestable", _untestable(document["untestable"]), level=3),
    ]
    return h.section("Ruled out", *parts)


def _limits(own: Sequence[Mapping[str, Any]]) -> tuple[str, str]:
    """Least sizes that would have been found, over the places of a kind: as displacement, and as value of its one parameter."""
    if not own:
        return h.UNKNOWN, ""
    size = _range([limit["rms_um"] for limit in own])
    units = {limit["unit"] for limit in own}
    if len(units) > 1 or own[0]["value"] is None:
        return size, ""
    factor, unit = read_as(own[0]["unit"])
    return size, f"{own[0]['parameter']} {_range([abs(limit['value']) * factor for limit in own])} {unit}"


def _range(values: Sequence[float]) -> str:
    ends = dict.fromkeys(h.number(v, 2) for v in (min(values), max(values)))
    return " .. ".join(ends)


def _untestable(entries: Sequence[Mapping[str, Any]]) -> h.Markup:
    if not entries:
        return h.paragraph("Nothing: this campaign could have shown every kind of the catalogue.")
    places: dict[tuple[str, str], list[str]] = defaultdict(list)
    for entry in entries:
        places[entry["kind"], entry["lacks"]].append(entry["where"])
    rows = [(kind, _places(own), lacks) for (kind, lacks), own in places.items()]
    text = "This campaign could not have shown these, so it says nothing about them; last column: what it would take."
    return h.join(h.paragraph(text), h.table(("kind", "at", "the campaign lacks"), rows))


def _places(names: Sequence[str]) -> str:
    return ", ".join(sorted(set(names)))


def next_section(plan: Mapping[str, Any] | None) -> h.Markup:
    """What to measure next: what for, how far apart it takes what is confounded, its postures, and the plan as a file."""
    if not plan:
        return h.Markup("")
    parts: list[object] = [
        h.paragraph(f"{plan['postures']} more postures, to:"),
        h.bullets(plan["purpose"]),
    ]
    if plan["expected_separation"]:
        rows = [
            (_name(s["effect"]), _name(s["rival"]), h.number(s["sigma_now"]), h.number(s["sigma_expected"]))
            for s in plan["expected_separation"]
        ]
        header = ("effect", "rival", "sigma between them now", "expected with the plan")
        parts.append(h.table(header, rows, align="llrr"))
    joints, postures = _postures(plan["plan_csv"])
    parts.append(h.table(joints, postures, caption="Postures of the plan; loads and order stand in the file."))
    content = base64.b64encode(plan["plan_csv"].encode()).decode("ascii")
    link = f'<p><a download="PLAN.csv" href="data:text/csv;base64,{content}">PLAN.csv</a> (measurements.csv without readings)</p>'
    parts.append(h.Markup(link))
    return h.section("What to measure next", *parts)


def _name(suspect: Mapping[str, str]) -> str:
    return f"{suspect['kind']} at {suspect['where']}"


def _postures(text: str) -> tuple[list[str], list[list[str]]]:
    """Experiment and joints of every posture of a plan, once."""
    table = list(csv.DictReader(io.StringIO(text)))
    joints = [name for name in table[0] if name.endswith(("_deg", "_mm", "_rad", "_m"))]
    header = ["experiment", *joints]
    seen = {row["experiment"]: [row[name] for name in header] for row in reversed(table)}
    return header, list(reversed(seen.values()))
