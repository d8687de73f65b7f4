"""What `diagnose` prints: verdict, named effects, the gap before and after, what could not be tested."""

from __future__ import annotations

from collections import defaultdict
from typing import Any

from rich.console import Console
from rich.table import Table

from drake_stiffness.diagnosis.job import Diagnosed
from drake_stiffness.diagnosis.locate import short
from drake_stiffness.intervals.interval import read_as

MEANING = {
    "consistent": "the model explains the data to its noise",
    "explained": "the named effects close the gap",
    "partly_explained": "the named effects close a part of the gap; something is left",
    "unexplained": "a gap remains that no known effect closes",
}
# Settings of effects that follow from the arm or are conventions; the others were chosen by the search.
_NEVER_SEARCHED = {
    *("prismatic", "unit", "scale", "floor", "smooth", "start_s", "variant"),
    *("template", "beam_axis", "length_m", "link", "components", "entries", "combined"),
}


def meaning(document: dict[str, Any]) -> str:
    """The verdict in a few words."""
    verdict, named = document["verdict"], {e["kind"] for e in document["effects"]}
    if verdict == "explained" and named == {"outliers"}:
        return "without what was left out as outliers the model explains the data to its noise"
    return MEANING[verdict]


def effect_words(entry: dict[str, Any]) -> str:
    """A named effect in a few words: kind, place, values."""
    return f"{entry['kind'].replace('_', ' ')} at {entry['where']} ({values_in_words(entry)})"


def show_diagnosis(console: Console, result: Diagnosed) -> None:
    """For people; everything is in `--json` and `--report`."""
    document = result.document
    console.print(f"Verdict: {document['verdict']} - {meaning(document)}.")
    console.print(f"Where the gap is: {document['where_in_words']['before']}.")
    if document["effects"]:
        table = Table(title="Named effects, strongest first")
        for name in ("effect", "at", "value", "sigma of evidence", "cannot be told from"):
            table.add_column(name)
        for entry in document["effects"]:
            values = values_in_words(entry)
            evidence = entry["evidence"].get("sigma") or entry["evidence"].get("rms_sigma")
            others = ", ".join(f"{c['kind']} at {c['where']}" for c in entry["confounded_with"])
            table.add_row(entry["kind"], entry["where"], values, f"{evidence:.1f}", others or "-")
        console.print(table)
    gap = document["gap"]
    table = Table(title="The gap, rms of 3-D residuals, mm")
    for name in ("readings", "before", "after", "noise", "chi-square per dof before", "after", "p-value after"):
        table.add_column(name)
    noise = f"{gap['noise_rms_mm']:.4f}"
    table.add_row("fitted", f"{gap['before_rms_mm']:.4f}", f"{gap['after_rms_mm']:.4f}", noise, "", "", "")
    table.add_row(
        "held out", f"{gap['held_out_before_rms_mm']:.4f}", f"{gap['held_out_after_rms_mm']:.4f}", noise,
        f"{gap['held_out_chi2_per_dof_before']:.3g}", f"{gap['held_out_chi2_per_dof_after']:.3g}",
        f"{gap['held_out_p_value_after']:.2g}",
    )  # fmt: skip
    console.print(table)
    if document["verdict"] in ("partly_explained", "unexplained"):
        console.print(f"What remains: {document['where_in_words']['after']}.")
    if gap["noise_implausible"]:
        console.print(
            f"! The stated noise is implausible: {result.diagnosis.noise.in_words}. Tests use the noise that the data show."
        )
    for entry in document["effects"]:
        if entry.get("derived"):
            console.print(
                f"! {entry['kind']} at {entry['where']}: where its ends are was not told, so one of them was placed by convention. The "
                "torque is right whatever their scale; spring, preload and levers by themselves are not measured."
            )
        if entry.get("outside_the_catalogue_as_good"):
            console.print(
                f"! {entry['kind']} at {entry['where']}: a form outside the catalogue explains about as much: "
                f"{entry['outside_the_catalogue_as_good']}."
            )
    for name, why in result.diagnosis.withdrawn.items():
        console.print(f"! Withdrawn: {name}; {why}.")
    for line in limits_in_words(document["not_detectable_above"]):
        console.print(line)
    untestable: dict[tuple[str, str], list[str]] = defaultdict(list)
    for entry in document["untestable"]:
        untestable[entry["kind"], entry["lacks"]].append(entry["where"])
    for (kind, lacks), places in untestable.items():
        console.print(f"Untestable: {kind} ({', '.join(places)}); the campaign lacks {lacks}.")


def values_in_words(entry: dict[str, Any]) -> str:
    """Parameters that stand out of their uncertainty (all of them where none does or there are few), and searched constants."""
    if entry.get("derived"):  # the values themselves are conventions
        return ", ".join(
            f"{name.replace('_', ' ')} {short(p['value'])} {p['unit']}".removesuffix(" 1")
            for name, p in entry["derived"].items()
        )
    parameters = entry["parameters"]
    sure = {n: p for n, p in parameters.items() if p["sigma"] and abs(p["value"]) > 2 * p["sigma"]}
    shown = parameters if len(parameters) <= 3 or not sure else sure
    words = [_value(name, p) for name, p in shown.items()]
    if len(shown) < len(parameters):
        words.append(f"({len(parameters) - len(shown)} more)")
    words += [f"{name} {_number(value)} {unit}".rstrip() for name, value, unit in searched(entry)]
    return ", ".join(words)


def searched(entry: dict[str, Any]) -> list[tuple[str, object, str]]:
    """Constants of a named effect that a search chose: name, value, unit."""
    slides = entry["settings"].get("prismatic", False)
    load = "N" if slides else "N m"
    units = {"threshold": load, "knee": load, "harmonic": "periods a metre" if slides else "periods a turn"}
    units |= {"settling_s": "s", "lever_m": "m", "lever_deg": "deg", "anchor_m": "m"}
    return [
        (name, value, units.get(name, "")) for name, value in entry["settings"].items() if name not in _NEVER_SEARCHED
    ]


def limits_in_words(limits: list[dict[str, Any]]) -> list[str]:
    """How large what was tried and not named could be at most, a line a kind: the place where it shows best and worst."""
    by_kind: dict[str, list[dict[str, Any]]] = defaultdict(list)
    for limit in limits:
        by_kind[limit["kind"]].append(limit)
    lines = []
    for kind, found in by_kind.items():
        found = sorted(found, key=lambda x: x["rms_um"])
        words = [f"{short(x['rms_um'], 2)} um rms at {x['where']}{_as_value(x)}" for x in (found[0], found[-1])]
        lines.append(
            f"Not detectable: {kind} that moves the readings by less than {' .. '.join(dict.fromkeys(words))}."
        )
    return lines


def _as_value(limit: dict[str, Any]) -> str:
    if limit["value"] is None:
        return ""
    factor, unit = read_as(limit["unit"])
    return f" ({limit['parameter']} {short(limit['value'] * factor, 2)} {unit})"


def p_words(p: float) -> str:
    """A p-value for a sentence."""
    return "p < 1e-300" if p < 1e-300 else f"p = {p:.2g}"


def _number(value: object) -> str:
    if isinstance(value, list | tuple):
        return "(" + ", ".join(_number(v) for v in value) + ")"
    return f"{value:.3g}" if isinstance(value, float) else str(value)


def _value(name: str, p: dict[str, Any]) -> str:
    factor, unit = read_as(p["unit"])
    known = p["sigma"] is not None and p["sigma"] == p["sigma"]
    sigma = f" +- {p['sigma'] * factor:.2g}" if known else ""
    return f"{name} = {p['value'] * factor:.3g}{sigma} {unit}"
