"""The report of `design`: how good the plan is and how that is known, what it looks like, every step."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

import drake_stiffness
from drake_stiffness.arm import forward
from drake_stiffness.design.summary import figure_of_merit, gain, predicted_ratios, verdict
from drake_stiffness.report import figures as f
from drake_stiffness.report import page as h
from drake_stiffness.shop.load_words import load_words

if TYPE_CHECKING:
    from drake_stiffness.design.design import Designed
    from drake_stiffness.design.job import PlannedMeasurements


def design_report(result: PlannedMeasurements) -> str:
    """The page of `design --report`."""
    from drake_stiffness.files import sha256

    d = result.designed
    notes = [h.callout("Note.", f"{note}.") for note in result.notes]
    parts = [
        h.verdict(verdict(d)),
        _tiles(d),
        *notes,
        h.section("How good it is, and how that is known", _certificate(d), _information_figure(d)),
        h.section("What it will show", _ratios(d)),
        h.section("Where the arm goes", _places_figure(d)),
        h.section("The plan", _plan(result)),
    ]
    if result.suggestions:
        listed = h.bullets(s.text for s in result.suggestions)
        parts.append(h.section("What more postures would settle", listed))
    rows: list[tuple[object, ...]] = [
        ("cell", result.cell_path.name, h.Markup(f'<span class="mono">{sha256(result.cell_path)}</span>'))
    ]
    rows.append(("settings", str(d.space.settings.path), f"seed {d.space.settings.seed}"))
    return h.page(
        f"Measurement plan for {result.cell_path.name}",
        f"{len(d.chosen)} postures by criterion {d.criterion.name}, chosen from {d.space.candidates.number} candidates.",
        *parts,
        h.section("Provenance", h.table(("input", "file", "SHA-256 or seed"), rows)),
        footer=f"Made by drake-stiffness {drake_stiffness.__version__}.",
    )


def _tiles(d: Designed) -> h.Markup:
    words, unit, value = figure_of_merit(d)
    tiles = [
        (f"{len(d.chosen)}", "postures"),
        (f"{d.efficiency:.3f}", "certified efficiency against the relaxed bound"),
        (f"{h.number(value)} {unit}".strip(), words),
    ]
    if d.random.size:
        tiles.append((f"{gain(d):.2f} times", f"sigma of the median of {d.random.size} random plans of equal size"))
    return h.tiles(tiles)


def _certificate(d: Designed) -> h.Markup:
    return h.paragraph(
        "The criterion is an information: twice as much of it means that half as many readings give the same sigma. A relaxation in "
        "which postures may be measured in part has a maximum that no plan of whole postures exceeds; the equivalence theorem of "
        "optimal design proves an upper bound of it, whatever the solver did: "
        f"{h.number(d.relaxation.bound, 5)}. The plan has {h.number(d.value, 5)}, that is {100 * d.efficiency:.1f} % of the bound."
    )


def _information_figure(d: Designed) -> h.Markup:
    made, ax = f.new(2.6)
    if d.random.size:
        ax.hist(d.random / d.relaxation.bound, bins=24, color=f.GREY, label="random plans of equal size")
    ax.axvline(d.efficiency, color=f.BLUE, linewidth=2.4, label="this plan")
    ax.axvline(1.0, color=f.ORANGE, linewidth=1.6, linestyle="--", label="no plan is better than this")
    ax.set_xlim(0.0, 1.04)
    ax.set_xlabel("information of the plan over the certified bound")
    ax.set_ylabel("random plans")
    f.legend(ax)
    caption = (
        "How much information random plans of equal size carry (grey), this plan (blue), and the bound (dashed) that is proven for all "
        "plans of these candidates."
    )
    return h.figure(f.uri(made), caption, "Histogram of random plans beside this plan and the bound")


def _ratios(d: Designed) -> h.Markup:
    rows = [
        (r["name"], h.number(r["assumed"]), h.number(r["sigma"], 2), r["unit"], h.number(r["ratio"], 3))
        for r in predicted_ratios(d)
    ]
    settings = d.space.settings
    caption = (
        f"Base parameters of interest: assumed values ({settings.compliances}), the standard deviation this plan will give with "
        f"{settings.noise.position_sigma_mm:g} mm noise a coordinate, and their ratio (seed eq. 20; {settings.threshold:g} is wanted)."
    )
    return h.table(("parameter", "assumed", "sigma", "unit", "ratio"), rows, caption=caption, align="lrrlr")


def _places_figure(d: Designed) -> h.Markup:
    space = d.space
    arm, load_point = space.model.arm, space.model.load_point
    every = forward(arm, space.candidates.q[:, :1500]).points(load_point)[0]
    p = forward(arm, d.plan.q).points(load_point)[0]
    side = d.plan.full[:, -1, :3].T
    size = max(float(np.abs(side).max()), 1e-9)
    made, axes = f.new(4.4, 1, 2)
    for ax, (i, j), names in zip(axes, ((0, 1), (0, 2)), (("x", "y"), ("x", "z")), strict=True):
        ax.scatter(every[i], every[j], s=3, color="#d5dbe1", label="candidates", rasterized=True)
        ax.quiver(p[i], p[j], side[i] / size, side[j] / size, color=f.ORANGE, width=0.005, scale=14, label="last load")
        ax.scatter(p[i], p[j], s=22, color=f.BLUE, label="plan")
        ax.set_aspect("equal")
        ax.set_xlabel(f"{names[0]}, m")
        ax.set_ylabel(f"{names[1]}, m")
    f.legend(axes[0])
    caption = (
        "Load points of the plan (blue) among those of the candidates (grey), from above and from the side, world frame; arrows: the last "
        "load direction of each posture. Look at every posture before the robot drives to it: the program knows boxes, floor and "
        "limits, not cables."
    )
    return h.figure(f.uri(made, many=True), caption, "Load points of the plan from above and from the side")


def _plan(result: PlannedMeasurements) -> h.Markup:
    plan, arm = result.designed.plan, result.designed.space.model.arm
    rows = []
    for e, name in enumerate(result.names):
        joints = [f"{q * (1e3 if p else 180 / np.pi):.2f}" for q, p in zip(plan.q[:, e], arm.prismatic, strict=True)]
        loads = "; ".join(load_words(load, arm.gravity) for load in plan.full[e])
        rows.append((name, *joints, loads))
    units = [f"{n}, {'mm' if p else 'deg'}" for n, p in zip(arm.joint_names, arm.prismatic, strict=True)]
    levels = ", ".join(f"{100 * level:.0f} %" for level in result.designed.space.settings.loads.levels)
    caption = f"Every load in turn at {levels} of what stands here, with an unloaded step before, between and after."
    return h.table(("experiment", *units, "full loads"), rows, caption=caption, align="l" + "r" * len(units) + "l")
