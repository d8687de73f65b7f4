"""The report of `identify`: does the model explain the readings, which springs do they reveal, how sure is that."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from drake_stiffness.effects.compliance import JointCompliance, LinkCompliance, Spring
from drake_stiffness.report import identification_plots as plots
from drake_stiffness.report import page as h
from drake_stiffness.report import springs_tables as springs
from drake_stiffness.report.evidence import Evidence, evidence, shares
from drake_stiffness.report.groups import base_table
from drake_stiffness.report.notes import provenance, warnings
from drake_stiffness.report.residuals import residual_parts

if TYPE_CHECKING:
    from drake_stiffness.jobs import Identified
    from drake_stiffness.model import Model


def identification_report(result: Identified) -> str:
    """The page of `identify --report`.

    Parameters
    ----------
    result : Identified
        From `drake_stiffness.jobs.identify_campaign`.

    Returns
    -------
    str
        A self-contained HTML page.
    """
    e = evidence(result)
    inputs = result.model.provenance.get("inputs", {})
    name = inputs.get("campaign", {}).get("file", "campaign.yaml")
    return h.page(
        f"Identification from {name}",
        f"{result.campaign.measurements}, cell {result.campaign.cell}. How far the arm gives way, and how sure that is.",
        h.verdict(answer(result, e)),
        warnings(result),
        body(result, e, level=2),
        provenance(result.model.provenance, result.model.fit, level=2),
        footer=f"Made by {result.model.provenance.get('program', 'drake-stiffness')}.",
    )


def answer(result: Identified, e: Evidence) -> str:
    """The verdict in plain sentences."""
    fit = result.model.fit
    chi2, dof = fit["chi2_per_dof"], fit["dof"]
    stated = f"{e.sigma_mm:g} mm per coordinate"
    if dof <= 0:
        parts = ["There are as many unknowns as readings, so nothing says whether the model is right."]
    elif fit["noise_rejected"]:
        parts = [
            f"The model does NOT explain the readings to their stated noise ({stated}): what remains is {np.sqrt(chi2):.1f} times larger "
            f"(chi-square/dof {h.number(chi2)}). Something is missing in the model, or the readings are noisier than stated."
        ]
    else:
        parts = [f"The model explains the readings to their noise ({stated}; chi-square/dof {h.number(chi2)})."]
    held = fit["held_out_rms_mm"]
    if held is not None and np.isfinite(held):
        parts.append(
            f"Experiments that took no part in the fit are predicted to {h.number(held)} mm rms in 3-D, where the noise alone would "
            f"leave {h.number(e.held_noise_mm)} mm."
        )
    else:
        parts.append("No experiment was held out, so the prediction of new postures is not checked.")
    s, n = result.model.statistics, result.model.x.size
    merged = s.group.count("G3") if s is not None else 0
    if merged:
        parts.append(f"{merged} of {n} parameters are determined in combination only.")
    hidden = unrevealed_joints(result)
    if hidden:
        parts.append(f"The loads say nothing of the compliance of {_listed(hidden)}.")
    return " ".join(parts)


def unrevealed_joints(result: Identified) -> list[str]:
    """Joints whose spring is asked for and not told from zero, or not seen at all."""
    model, s = result.model, result.model.statistics
    if s is None:
        return []
    pairs = zip(model.effects, model.slices, strict=True)
    return [e.where for e, own in pairs if isinstance(e, JointCompliance) and s.group[own.start] in ("G1-", "G2")]


def _listed(names: list[str]) -> str:
    return names[0] if len(names) == 1 else f"{', '.join(names[:-1])} and {names[-1]}"


def body(result: Identified, e: Evidence, level: int) -> h.Markup:
    """Everything between the verdict and the provenance, with headings from `level` on."""
    s = shares(result.model, result.measurements, result.campaign.quantity == "displacement")
    return h.join(
        _figures(result, e, None if s is None else s.mean_mm),
        h.section("Does the model explain the readings?", *residual_parts(result, e), level=level),
        h.section("What the loads reveal, joint by joint", *_joint_parts(result), level=level),
        _share_section(result, s, level),
        _base_section(result, level),
        h.section("Springs", *_spring_parts(result), level=level),
        _other_section(result, level),
        h.section("How the numbers were got", *_method_parts(result), level=level),
    )


def _figures(result: Identified, e: Evidence, moved_mm: float | None) -> h.Markup:
    fit = result.model.fit
    pairs = [
        (h.number(fit["chi2_per_dof"]), "chi-square per degree of freedom (1 = noise)"),
        (h.length(fit["residual_rms_mm"]), "residual of fitted readings, 3-D RMS"),
        (h.length(fit["held_out_rms_mm"]), "error of held-out readings, 3-D RMS"),
        (f"{fit['rank']} of {result.model.x.size}", "independent combinations determined, of all parameters"),
    ]
    if moved_mm is not None:
        what = "displacement under load" if result.campaign.quantity == "displacement" else "sag of the arm"
        pairs.append((f"{h.number(moved_mm)} mm", f"mean {what}, for comparison"))
    return h.tiles(pairs)


def _joint_parts(result: Identified) -> list[h.Markup]:
    hidden = unrevealed_joints(result)
    parts = []
    if hidden:
        position = (
            "gravity alone (and what else was applied)"
            if result.campaign.quantity == "position"
            else "the applied loads"
        )
        parts.append(
            h.callout(
                "Not revealed.",
                f"In this campaign {position} cannot tell how stiff {_listed(hidden)} {'is' if len(hidden) == 1 else 'are'}.",
                "A joint is revealed only by torques about its axis that change from reading to reading and move the reference points.",
            )
        )
    parts.append(springs.joint_table(result))
    return parts


def _share_section(result: Identified, s: Any, level: int) -> h.Markup:
    if s is None:
        return h.Markup("")
    displacement = result.campaign.quantity == "displacement"
    what = "displacement at the campaign's loads" if displacement else "sag of the arm under weight and loads"
    merged = result.model.statistics is not None and "G3" in result.model.statistics.group
    note = (
        " Between springs that cannot be told apart the split (joints against links too) is the least-norm convention; their sum is not."
        if merged
        else ""
    )
    caption = (
        f"Share of each spring in the mean {what} ({h.number(s.mean_mm)} mm on average, {h.number(s.largest_mm)} mm at most, linear "
        f"theory); in brackets the mean size of what the spring moves by itself, whatever the direction (contributions may cancel). The "
        f"longest bars are where stiffness matters.{note}"
    )
    picture = h.figure(plots.share_figure(s), caption, "Share of every spring in the displacement", width=80)
    return h.section("Which springs make the displacement", picture, level=level)


def _base_section(result: Identified, level: int) -> h.Markup:
    if not result.groups.relations():
        return h.Markup("")
    text = (
        "Where parameters merge, what is known is their sum. Each row is one sum, named after its first member; the command groups "
        "has the whole sums, the gap behind the rank, and the directions."
    )
    return h.section("What is determined", h.paragraph(text), base_table(result.groups, relations=True), level=level)


def _spring_parts(result: Identified) -> list[h.Markup]:
    model, fit = result.model, result.model.fit
    if not any(isinstance(effect, Spring) for effect in model.effects):
        return [h.paragraph("This model has no springs: geometry only.")]
    parts = [
        h.paragraph(f"All {model.x.size} parameters by group, whatever else is fitted along included:"),
        springs.group_table(model),
    ]
    if fit.get("active_constraints"):
        parts.append(
            h.paragraph(
                f"The constraint that a spring must be passive is active for {_listed(_springs_at(model, fit['active_constraints']))}: these stand at "
                "the edge, rigid in at least one direction. It is the usual sign of a part stiffer than the noise resolves. Their sigma "
                "is that of the fit without the constraint."
            )
        )
    caption = (
        "All springs. 1 µrad/(N m) = 1e-6 rad/(N m), 1 nm/N = 1e-9 m/N. Values in grey are conventions, not measurements (G2, G3). The "
        "bar is full at 20 standard deviations; no sigma is stated where the value by itself is not determined."
    )
    parts.append(springs.parameter_table(model, True, caption))
    if any(isinstance(effect, LinkCompliance) for effect in model.effects):
        caption = (
            "Compliance matrices of the links in 1e-9 SI (nm/N, nrad/N, nrad/(N m)): deflection (rows) by the wrench carried (columns), "
            "in the link's spring frame. Darker: larger, on a logarithmic scale of three decades for all links together; orange: "
            "negative; a dot: zero by the template. Where the data leave them open, the smallest springs that fit are shown. Smallest "
            f"eigenvalue of all springs, scaled: {h.number(fit.get('min_eigenvalue'), 2)} (below zero would not be physical)."
        )
        parts += [h.paragraph(h.Markup('<span class="soft">'), caption, h.Markup("</span>")), springs.matrices(model)]
    return parts


def _other_section(result: Identified, level: int) -> h.Markup:
    if all(isinstance(effect, Spring) for effect in result.model.effects):
        return h.Markup("")
    caption = (
        "Fitted along with the springs: geometric errors, the tracker's frame, places of the reference points. Merged ones are told "
        "apart by convention only (least change from nominal), which does not touch predictions."
    )
    return h.section("Geometry and instruments", springs.parameter_table(result.model, False, caption), level=level)


def _method_parts(result: Identified) -> list[h.Markup]:
    fit = result.model.fit
    method = {
        "sdp": "weighted least squares with every compliance matrix kept positive semidefinite (semidefinite program)",
        "least-squares": "weighted least squares without constraints",
    }
    quantity = {
        "displacement": "displacements: the unloaded place of every point in every experiment is an unknown of its own",
        "position": "absolute positions",
    }
    rows = [
        ("fitted quantity", quantity.get(result.campaign.quantity, result.campaign.quantity)),
        ("method", f"{method.get(fit['method'], fit['method'])}, solver {fit['solver']}"),
        ("around the loaded equilibrium", f"{fit['outer_iterations']} iterations until the parameters stood"),
        ("intervals", f"one standard deviation (1 sigma) from {fit['covariance']}"),
        (
            "chi-square",
            f"{h.number(fit['chi2_per_dof'], 4)} per degree of freedom, {fit['dof']} degrees, p = {h.number(fit['p_value'], 2)}",
        ),
        (
            "rank",
            f"{fit['rank']} of {fit['unknowns']}, singular values drop by {h.number(fit['singular_gap'], 2)} behind it",
        ),
        ("smallest eigenvalue of the springs, scaled", h.number(fit["min_eigenvalue"], 2)),
    ]
    return [h.table(("what", "how"), rows), conventions()]


def _springs_at(model: Model, places: list[str]) -> list[str]:
    """The names of springs by where they act (the base link's spring acts at "base")."""
    names = {effect.where: springs.spring_name(effect) for effect in model.effects if isinstance(effect, Spring)}
    return [names.get(place, place) for place in places]


def conventions() -> h.Markup:
    """What the springs' numbers refer to."""
    from drake_stiffness.inspection import CONVENTIONS

    return h.bullets(line[0].upper() + line[1:] + "." for line in CONVENTIONS)
