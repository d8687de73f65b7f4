"""The report of `make demo`: errors on the true plant beside each other, then identification and compensation."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

import drake_stiffness
from drake_stiffness.report import compensation as comp
from drake_stiffness.report import demo_plots as plots
from drake_stiffness.report import identification as ident
from drake_stiffness.report import page as h
from drake_stiffness.report.evidence import evidence
from drake_stiffness.rotations import Array

if TYPE_CHECKING:
    from drake_stiffness.jobs import Identified
    from toolpaths.result import Compensation


@dataclass(frozen=True)
class DemoRow:
    """Errors of one program on the true plant: mean, 95th percentile and largest (mm), percent of the mean compensated."""

    name: str
    mean_mm: float
    p95_mm: float
    max_mm: float
    percent: float


@dataclass(frozen=True)
class RobustnessRow:
    """Mean errors (mm) on the true plant when it, or the force, differs from what was assumed."""

    scenario: str
    uncompensated_mm: float
    joints_only_mm: float
    full_mm: float
    oracle_mm: float

    @property
    def errors_mm(self) -> tuple[float, float, float, float]:
        """The four of them, as in the table of programs."""
        return self.uncompensated_mm, self.joints_only_mm, self.full_mm, self.oracle_mm


def demo_report(
    title: str,
    rows: Sequence[DemoRow],
    robustness: Sequence[RobustnessRow],
    identified: Identified,
    compensation: Compensation,
    distances_mm: Mapping[str, Array],
) -> str:
    """The page of the demonstration.

    Parameters
    ----------
    title : str
    rows : sequence of DemoRow
        In the order uncompensated, joints-only, full, oracle: errors on the true plant.
    robustness : sequence of RobustnessRow
        Scenarios; may be empty.
    identified : Identified
        The full model's identification.
    compensation : Compensation
        The program that the full model corrected.
    distances_mm : mapping of program name to (N,) errors along the program on the true plant

    Returns
    -------
    str
        A self-contained HTML page.
    """
    e = evidence(identified)
    return h.page(
        title,
        "Everything on this page is simulated: readings, arm and milling. What it shows is how the method does when the truth is known.",
        h.verdict(_answer(rows)),
        h.section("What was done", _story(identified, compensation)),
        h.section("Error of the milled path on the true arm", *_errors(rows, distances_mm)),
        _robustness(robustness),
        h.section(
            "Identification of the full model",
            h.verdict(ident.answer(identified, e)),
            ident.warnings(identified),
            ident.body(identified, e, level=3),
        ),
        h.section(
            "Compensation with the full model",
            h.verdict(comp.answer(compensation)),
            comp.callouts(compensation, identified.model),
            comp.body(compensation, identified.model, level=3),
        ),
        ident.provenance(identified.model.provenance, identified.model.fit, level=2),
        footer=f"Made by drake-stiffness {drake_stiffness.__version__}.",
    )


def _answer(rows: Sequence[DemoRow]) -> str:
    if len(rows) < 2:
        return " ".join(f"{row.name}: {h.length(row.mean_mm)} mean error." for row in rows)
    first, full = rows[0], rows[min(2, len(rows) - 1)]
    text = (
        f"Milled under force, the path is {h.length(first.mean_mm)} off on average ({h.length(first.max_mm)} at most). Corrected with the "
        f"{full.name}, {h.length(full.mean_mm)} remain: {full.percent:.2f} % compensated."
    )
    if len(rows) > 3:
        joints, oracle = rows[1], rows[3]
        ratio = full.mean_mm / oracle.mean_mm if oracle.mean_mm > 0 else float("nan")
        text += (
            f" The {joints.name} leaves {h.length(joints.mean_mm)} ({joints.percent:.1f} %). The {oracle.name}, the best that these data "
            f"allow, leaves {h.length(oracle.mean_mm)}; the full model is at {h.number(ratio)} times that."
        )
    return text


def _story(identified: Identified, compensation: Compensation) -> h.Markup:
    counts, e = identified.model.fit["experiments"], identified.measurements
    points = len(set(e.point.tolist()))
    force = float(np.linalg.norm(compensation.force_N, axis=1).max(initial=0.0))
    load = float(np.linalg.norm(e.cases.wrench[:3], axis=0).max(initial=0.0))
    return h.bullets(
        [
            "A true arm was simulated by a program of its own (examples/plants) that shares no code with the one on trial: links of several "
            "flexible segments each, not the single springs that the model has.",
            f"Its campaign: {counts['fitted'] + counts['held_out']} postures, loads up to {load:.0f} N, {points} reference points, "
            f"{e.case.size} readings with {identified.campaign.noise.position_sigma_mm:g} mm noise per coordinate. "
            f"{counts['held_out']} postures took no part in the fit.",
            "Three models were fitted to the same readings: springs in the joints only, springs in joints and links (full), and an oracle that "
            "knows the true structure and estimates its numbers only.",
            f"Each corrected the same program ({compensation.rows.size} motions under a force of up to {force:.0f} N) and the corrected "
            "programs were milled on the true arm, not on the model that made them.",
        ]
    )


def _errors(rows: Sequence[DemoRow], distances_mm: Mapping[str, Array]) -> list[h.Markup]:
    header = ("program", "mean, mm", "95th percentile, mm", "largest, mm", "compensated")
    cells = [
        (
            r.name,
            h.number(r.mean_mm),
            h.number(r.p95_mm),
            h.number(r.max_mm),
            f"{r.percent:.2f} %" if np.isfinite(r.percent) else h.UNKNOWN,
        )
        for r in rows
    ]
    parts = [
        h.table(header, cells, align="lrrrr"),
        h.figure(
            plots.bars_figure(rows),
            "Mean error (bar), 95th percentile (tick) and largest (dot) on the true arm, on a logarithmic axis.",
            "Errors of the four programs",
            width=85,
        ),
    ]
    if distances_mm:
        parts += [
            h.figure(
                plots.along_figure(distances_mm),
                "Error along the program on the true arm, logarithmic. A line without humps means that no part of the path is worse than others.",
                "Error along the program",
            ),
            h.figure(
                plots.cumulative_figure(distances_mm),
                "Share of the path whose error is below a value. Read it at 0.95 for the 95th percentile.",
                "Cumulative distribution of errors",
                width=80,
            ),
        ]
    return parts


def _robustness(robustness: Sequence[RobustnessRow]) -> h.Markup:
    if not robustness:
        return h.Markup("")
    header = ("scenario", "uncompensated, mm", "joints only, mm", "full, mm", "oracle, mm", "full / oracle")
    cells = [
        (
            r.scenario,
            *(h.number(v) for v in r.errors_mm),
            h.number(r.full_mm / r.oracle_mm if r.oracle_mm > 0 else None),
        )
        for r in robustness
    ]
    caption = (
        "Mean error in every scenario. Blue beside green: the full model does as well as the oracle can. Where blue and green move right "
        "together, the force assumed or the robot's repeatability sets the limit, not the model."
    )
    if any(r.joints_only_mm < r.full_mm for r in robustness):
        caption += (
            " Where the joints-only model comes out ahead, two errors cancel: it underrates the deflection or overrates it, and the force "
            "is wrong the other way."
        )
    return h.section(
        "The same when the world differs",
        h.table(header, cells, align="lrrrrr"),
        h.figure(plots.robustness_figure(robustness), caption, "Mean errors by scenario", width=88),
    )
