"""What commands print: short tables for people."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from rich.console import Console
from rich.table import Table

from drake_stiffness.groups_text import show_base
from drake_stiffness.intervals.interval import read_as
from drake_stiffness.noise_components import noise_line

if TYPE_CHECKING:
    from drake_stiffness.design.augmentation import Suggestion
    from drake_stiffness.inspection import Inspection
    from drake_stiffness.intervals.interval import Interval
    from drake_stiffness.jobs import Identified
    from toolpaths.result import Compensation

# A model may have hundreds of parameters; the terminal shows the first ones, model.json and the report show all.
_SHOWN = 40
# Suggestions beyond these are counted only.
_SUGGESTED = 4
# Base parameters beside them: the joints of an arm and a few more.
_BASE = 10


def show_inspection(console: Console, result: Inspection) -> None:
    """Chain, springs, counts, ranks."""
    table = Table(title="Chain, base to flange")
    for name in ("joint", "type", "axis (parent-side frame)", "limits", "position at zero, m"):
        table.add_column(name)
    for joint in result.joints:
        axis = " ".join(f"{a:g}" for a in joint["axis"])
        limits = f"{joint['lower']:g} .. {joint['upper']:g} {joint['unit']}"
        table.add_row(
            joint["name"], joint["type"], axis, limits, " ".join(f"{p:.3f}" for p in joint["position_at_zero_m"])
        )
    console.print(table)
    springs = Table(title="Springs of this cell")
    for name in ("spring", "kind", "acts in", "template", "unknowns"):
        springs.add_column(name)
    for spring in result.springs:
        template = spring.get("template") or "-"
        if spring.get("beam_axis"):
            template += f" along {spring['beam_axis']}"
        springs.add_row(spring["name"], spring["kind"], spring["frame"], template, str(spring["unknowns"]))
    console.print(springs)
    c = result.counts
    console.print(
        f"Unknowns of the complete model (all links and joints): {c['complete']}; symmetric (M1): {c['symmetric']}; "
        f"beam template (M2): {c['beam']}; this cell keeps {sum(s['unknowns'] for s in result.springs)}."
    )
    for effect in result.effects:
        unknowns = ", ".join(f"{p['name']} ({p['unit']})" for p in effect["parameters"])
        console.print(
            f"Besides springs: {effect['kind']} at {effect['where']}, {effect['unknowns']} unknowns: {unknowns}."
        )
    if result.effects:
        console.print(f"Unknowns of the complete model with this hardware: {result.parameters_total}.")
    if result.identifiable:
        ranks = Table(
            title="What measurements can show: ranks over random postures, at this cell's load and reference points"
        )
        for name in ("template", "load", "unknowns", "rank", "rank by algebra", "singular-value gap"):
            ranks.add_column(name)
        for entry in result.identifiable:
            gap = "full rank" if entry["singular_gap"] is None else f"{entry['singular_gap']:.1e}"
            algebra = "-" if entry["algebraic_rank"] is None else str(entry["algebraic_rank"])
            ranks.add_row(entry["template"], entry["load"], str(entry["parameters"]), str(entry["rank"]), algebra, gap)
        console.print(ranks)
        for entry in result.identifiable:
            if entry["special_points"]:
                line = f"! {entry['template']}, {entry['load']}: less than other points would show. {entry['special_points']}"
                console.print(line, markup=False)


def show_identification(console: Console, result: Identified) -> None:
    """Parameters with sigmas and groups, the fit, the warnings."""
    model = result.model
    s = model.statistics
    assert s is not None
    table = Table(title=f"{model.x.size} parameters, rank {model.fit['rank']}")
    for name in ("parameter", "value", "sigma", "unit", "group"):
        table.add_column(name, justify="right" if name in ("value", "sigma") else "left")
    for i in range(min(model.x.size, _SHOWN)):
        sigma = f"{s.sigma[i]:.2g}" if np.isfinite(s.sigma[i]) else "-"
        value = f"{model.x[i]:.4g}" if s.group[i].startswith("G1") else f"({model.x[i]:.4g})"
        table.add_row(model.names[i], value, sigma, model.parameters[i].unit, s.group[i])
    console.print(table)
    if any(not group.startswith("G1") for group in s.group):
        console.print(
            "Values in brackets are a convention (least norm): alone they are not determined by these readings."
        )
    if model.x.size > _SHOWN:
        console.print(f"... {model.x.size - _SHOWN} more in the model file and the report.")
    show_base(console, result.groups, _BASE)
    fit = model.fit
    held = fit["held_out_rms_mm"]
    beside = f"; held out: {held:.4f} mm rms" if held == held and held is not None else ""
    console.print(
        f"Fit: residual {fit['residual_rms_mm']:.4f} mm rms{beside}; chi-square per degree of freedom {fit['chi2_per_dof']:.3g} "
        f"({fit['dof']} degrees of freedom)."
    )
    if fit.get("noise_components") is not None:
        line = noise_line(fit["noise_components"], result.campaign.noise, result.campaign.quantity == "displacement")
        console.print(line, markup=False)
    for line in result.warnings:
        console.print(f"! {line}", markup=False)


def show_intervals(console: Console, found: dict[str, tuple[Interval, ...]]) -> None:
    """Intervals part by part, with what they rest on; sigma is that of seed eq. (14)."""
    for part, some in found.items():
        percent = f"{100 * some[0].level:g} %" if some else ""
        what = "base parameters" if part == "base" else part
        table = Table(title=f"{len(some)} {what}, {percent} intervals")
        for name in ("name", "value", "low", "high", "sigma", "unit", "status"):
            table.add_column(name, justify="left" if name in ("name", "unit", "status") else "right")
        for one in some[:_SHOWN]:
            factor, unit = read_as(one.unit)
            numbers = (one.low, one.high, one.sigma)
            value = f"{one.value * factor:.4g}"
            cells = ("-" if v != v else f"{v * factor:.4g}" for v in numbers)
            table.add_row(one.name, value if one.status == "identified" else f"({value})", *cells, unit, one.status)
        console.print(table)
        if len(some) > _SHOWN:
            console.print(f"... {len(some) - _SHOWN} more with --json and in the report.")


def show_suggestions(console: Console, suggestions: list[Suggestion]) -> None:
    """What more postures would settle, the easiest first."""
    if not suggestions:
        return
    order = sorted(suggestions, key=lambda s: (s.postures is None, s.postures or 0, -s.ratio))
    console.print("What more postures would settle (`design --augment` plans them):")
    for suggestion in order[:_SUGGESTED]:
        console.print(f"+ {suggestion.text}", markup=False)
    if len(order) > _SUGGESTED:
        console.print(f"... and {len(order) - _SUGGESTED} more doubtful ones.")


def show_compensation(console: Console, result: Compensation, output: Path | None) -> None:
    """Largest and RMS correction, residuals with their interval, causes, what was refused; no output: nothing was written."""
    d = result.to_dict()
    written = f"{output.name}: " if output is not None else "nothing written (dry run): "
    table = Table(title=f"{written}{d['corrected_points']} points corrected")
    for name in ("mm", "mean", "rms", "p95", "max"):
        table.add_column(name, justify="left" if name == "mm" else "right")
    rows = (
        ("correction", "correction_mm"),
        ("deviation uncompensated, predicted", "uncompensated_mm"),
        ("residual after one shot", "one_shot_residual_mm"),
        ("residual converged, as printed", "residual_mm"),
        ("residual of this model's joint springs alone", "joints_only_mm"),
        ("uncertainty of the model (1 sigma)", "model_sigma_mm"),
    )
    values = [(label, d[key]) for label, key in rows]
    values.insert(4, ("upper end of its 95 % interval", d["residual_interval_mm"]["high"]))
    for label, value in values:
        table.add_row(label, *(f"{value[k]:.4f}" for k in ("mean", "rms", "p95", "max")))
    console.print(table)
    console.print(f"In the interval: {', '.join(d['residual_interval_mm']['carries'])}.")
    console.print(f"Not in it: {', '.join(d['residual_interval_mm']['lacks'])}.")
    causes = [c for c in d["causes"] if np.isfinite(c["share"]) and abs(c["share"]) >= 0.005]
    shares = ", ".join(
        f"{name}{'' if c['told_apart'] else '*'} {100 * c['share']:.0f} %"
        for name, c in zip(names_of(causes), causes, strict=True)
    )
    if shares:
        merged = " (* known in sums only)" if any(not c["told_apart"] for c in d["causes"]) else ""
        console.print(f"What bends the tool aside: {shares}{merged}.", markup=False)
    share = d["percent_compensated"]
    digit = f"half a printed digit is {d['half_printed_digit_mm']:g} mm"
    console.print(
        f"Predicted by this model: {share:.2f} % compensated in {d['iterations']} iterations; {digit}."
        if share == share
        else f"Nothing to compensate that these numbers could hold: {digit}, the predicted deviation less."
    )
    for refusal in result.refusals[:20]:
        console.print(f"! line {refusal.line} left as it was: {refusal.reason}", markup=False)
    for insertion in result.insertions[:20]:
        console.print(f"! line {insertion.line}: inserted {insertion.text.strip()}", markup=False)
    for arc in result.program.replaced[:20]:
        moves = arc.after.count("\n") + 1
        console.print(
            f"! line {arc.line}: an arc became {moves} straight moves, from line {arc.new_line} on", markup=False
        )
    for note in result.notes[:20]:
        console.print(f"! {note}", markup=False)


def names_of(causes: list[dict[str, Any]]) -> list[str]:
    """What bends the tool aside, by place; where a place stands twice (a joint's spring and its friction) with its kind."""
    places = [cause["where"] for cause in causes]
    return [
        f"{where} ({cause['kind'].replace('_', ' ')})" if where and places.count(where) > 1 else where or cause["kind"]
        for where, cause in zip(places, causes, strict=True)
    ]
