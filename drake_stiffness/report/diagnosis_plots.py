"""Figures of the diagnosis report: the gap as bars, where it is, and the residual against what explains it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from textwrap import fill
from typing import Any

import numpy as np
from matplotlib.axes import Axes

from drake_stiffness.diagnosis.locate import Place
from drake_stiffness.report import figures as f
from drake_stiffness.report.diagnosis_shape import Shape

BEFORE, AFTER = f.ORANGE, f.BLUE
# Parts of the readings in the order of the page, with their titles.
PARTS = {
    "by_joint": "joint (what a turn of it would explain)",
    "by_direction": "direction of the load",
    "by_level": "size of the load",
    "by_branch": "branch of the load history",
    "by_point": "reference point",
    "by_step": "load step",
    "by_time": "time",
    "by_experiment": "experiment (the worst)",
}
# So many experiments, the worst; so many of any other part, in their own order.
_WORST, _MOST = 10, 20
# So many letters of an axis label in a row; three panels stand side by side.
_LABEL = 44
_BEHIND = {"facecolor": "white", "edgecolor": "none", "pad": 1.0, "alpha": 0.8}


def gap_figure(gap: dict[str, Any], changed: bool) -> str:
    """Bars before and after (one bar where nothing changed), of fitted and held-out readings, and what noise alone leaves."""
    rows = {
        "fitted readings": (gap["before_rms_mm"] if changed else None, gap["after_rms_mm"]),
        "held-out readings": (gap["held_out_before_rms_mm"] if changed else None, gap["held_out_after_rms_mm"]),
    }
    shown = gap["noise_shown_rms_mm"] if gap["noise_implausible"] else None
    return gap_bars(rows, gap["noise_rms_mm"], shown, "noise the data show")


def gap_bars(
    rows: Mapping[str, tuple[float | None, float | None]], noise: float, other_noise: float | None, other_name: str
) -> str:
    """A bar before and a bar after for every kind of readings, rms in mm, beside the noise; None where there is no such bar."""
    twice = any(before is not None and after is not None for before, after in rows.values())
    made, ax = f.new(1.1 + (0.6 if twice else 0.3) * len(rows))
    top = max(v for pair in rows.values() for v in pair if v is not None)
    one = any(before is not None for before, _ in rows.values())
    labels = {BEFORE: "before", AFTER: "after" if one else "model"}
    for place, (before, after) in enumerate(rows.values()):
        apart = 0.2 if before is not None and after is not None else 0.0
        for shift, value, colour in ((-apart, before, BEFORE), (apart, after, AFTER)):
            if value is not None:
                ax.barh(place + shift, value, height=0.36, color=colour, label=labels.pop(colour, None))
                ax.text(value + 0.008 * top, place + shift, f"{value:.4f}", va="center", fontsize=10, bbox=_BEHIND)
    ax.axvline(noise, color=f.INK, linewidth=1.4, linestyle="--", label="stated noise")
    if other_noise is not None:
        ax.axvline(other_noise, color=f.PURPLE, linewidth=1.4, linestyle=":", label=other_name)
    ax.set_yticks(range(len(rows)), list(rows))
    ax.invert_yaxis()
    ax.grid(axis="y", visible=False)
    ax.set_xlim(0, 1.1 * max(top, noise, other_noise or 0.0))
    ax.set_xlabel("residual, 3-D rms, mm")
    f.legend(ax)
    return f.uri(made)


def where_figure(before: dict[str, list[Place]], after: dict[str, list[Place]]) -> str:
    """Small multiples: root of chi-square per degree of freedom of every part of the readings; `after` is empty where nothing
    changed."""
    shown = [part for part in PARTS if before.get(part)]
    half = (len(shown) + 1) // 2
    chosen = {part: _shown(part, before[part]) for part in shown}
    # Two columns; every row of panels is as high as the longer of its two.
    pairs = [shown[2 * k : 2 * k + 2] for k in range(half)]
    heights = [max(len(chosen[part]) for part in pair) + 2.2 for pair in pairs]
    made = f.Figure(figsize=(10.0, 0.25 * sum(heights) + 0.3), layout="constrained")
    axes = np.atleast_2d(made.subplots(half, 2, height_ratios=heights, squeeze=False))
    for k, pair in enumerate(pairs):
        for c in range(2):
            if c < len(pair):
                f.tidy(axes[k, c])
                _bars(axes[k, c], pair[c], chosen[pair[c]], after.get(pair[c], []))
            else:
                axes[k, c].set_visible(False)
    handles, labels = axes[0, 0].get_legend_handles_labels()
    made.legend(handles, labels, loc="outside upper left", ncols=3, frameon=False, fontsize=10)
    return f.uri(made)


def _shown(part: str, places: Sequence[Place]) -> list[Place]:
    if part == "by_experiment":
        return sorted(places, key=lambda p: -p.chi2_per_dof)[:_WORST]
    if part == "by_time":  # intervals, named by their beginning
        return sorted(places, key=lambda p: float(p.name.split()[0]))
    return list(places)[:_MOST]


def _bars(ax: Axes, part: str, before: Sequence[Place], after: Sequence[Place]) -> None:
    later = {p.name: p.chi2_per_dof for p in after}
    ratio = np.sqrt([[p.chi2_per_dof, later.get(p.name, np.nan)] for p in before])
    rows = np.arange(len(before))
    if later:
        ax.barh(rows - 0.19, ratio[:, 0], height=0.36, color=BEFORE, label="before")
        ax.barh(rows + 0.19, ratio[:, 1], height=0.36, color=AFTER, label="after")
    else:
        ax.barh(rows, ratio[:, 0], height=0.6, color=AFTER, label="model")
    ax.axvline(1.0, color=f.INK, linewidth=1.2, linestyle="--", label="noise")
    ax.set_yticks(rows, [f.plain(f.shortened(p.name, 26)) for p in before], fontsize=9)
    ax.set_ylim(len(before) - 0.4, -0.6)
    ax.grid(axis="y", visible=False)
    ax.set_xlim(0, max(1.25, 1.08 * float(np.nanmax(ratio, initial=0.0))))
    ax.set_title(f"by {PARTS[part]}", loc="left", fontsize=10.5)
    ax.tick_params(axis="x", labelsize=8.5)


def shape_figure(found: Sequence[Shape]) -> str:
    """A row of three panels per shape: the effect with its evidence, the residual before, the residual after."""
    made, axes = f.new(0.5 + 2.7 * len(found), len(found), 3, squeeze=False)
    for row, shape in zip(axes, found, strict=True):
        evidence = shape.itself + shape.after
        _cloud(row[0], shape, evidence, f.GREY)
        order = np.argsort(shape.x, kind="stable")
        row[0].scatter(shape.x[order], shape.itself[order], s=9, color=f.INK, marker="_", label="effect in the model")
        _cloud(row[1], shape, shape.before, BEFORE)
        _cloud(row[2], shape, shape.after, AFTER)
        residuals = np.concatenate([shape.before, shape.after])
        half = 1.08 * float(np.nanmax(np.abs(residuals), initial=1e-9))
        for ax, title in zip(row, ("the effect", "left before", "left after"), strict=True):
            ax.set_title(title, loc="left")
            ax.set_xlabel(fill(f.plain(shape.driver), _LABEL), fontsize=9)
            ax.axhline(0.0, color=f.INK, linewidth=0.7)
        for ax in row[1:]:
            ax.set_ylim(-half, half)
        row[0].set_ylabel(fill(f.plain(shape.quantity), _LABEL), fontsize=9)
    axes[0][0].legend(fontsize=7.5, handletextpad=0.2, borderpad=0.3, framealpha=0.7)
    return f.uri(made, many=sum(s.x.size for s in found) > f.MANY)


def _cloud(ax: Axes, shape: Shape, y: f.Floats, colour: str) -> None:
    """Dots of all steps; loading and unloading with marks of their own where the effect tells them apart."""
    if shape.branch is None:
        ax.scatter(shape.x, y, s=8, color=colour, alpha=0.6, linewidths=0, label="readings")
        return
    for sign, marker, name in ((1, "^", "loading"), (-1, "v", "unloading")):
        mine = shape.branch == sign
        ax.scatter(shape.x[mine], y[mine], s=13, color=colour, alpha=0.65, linewidths=0, marker=marker, label=name)
    rest = shape.branch == 0
    ax.scatter(shape.x[rest], y[rest], s=6, color=colour, alpha=0.35, linewidths=0)


def ranking_figure(names: Sequence[str], sigma: f.Floats, state: Sequence[str]) -> str:
    """How many sigma every suspect explains of the base model's residual, coloured by what became of it."""
    colours = {"named": f.BLUE, "cannot be told from a named one": f.AMBER, "withdrawn": f.PURPLE, "rejected": f.GREY}
    made, ax = f.new(0.9 + 0.25 * len(names))
    rows = np.arange(len(names))
    for what, colour in colours.items():
        mine = np.array([s == what for s in state], dtype=bool)
        if mine.any():
            ax.barh(rows[mine], sigma[mine], color=colour, label=what, height=0.7)
    ax.set_yticks(rows, [f.plain(f.shortened(name, 44)) for name in names], fontsize=9)
    ax.set_ylim(len(names) - 0.4, -0.6)
    ax.grid(axis="y", visible=False)
    ax.set_xlabel("explains of the residual at first, sigma")
    f.legend(ax, bbox_to_anchor=(0.0, 1.0))
    return f.uri(made)
