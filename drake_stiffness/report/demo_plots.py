"""Pictures of the demonstration: the four programs on the true arm."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

import numpy as np

from drake_stiffness.report import figures as f
from drake_stiffness.report import page as h

if TYPE_CHECKING:
    from drake_stiffness.report.demo import DemoRow, RobustnessRow

# Uncompensated, joints-only, full, oracle.
_COLOURS = (f.GREY, f.ORANGE, f.BLUE, f.GREEN)


def _colour(place: int) -> str:
    return _COLOURS[place % len(_COLOURS)]


def bars_figure(rows: Sequence[DemoRow]) -> str:
    """Mean, 95th percentile and largest error of every program."""
    made, ax = f.new(0.9 + 0.45 * len(rows), width=8.5)
    values = np.array([[r.mean_mm, r.p95_mm, r.max_mm] for r in rows])
    left = max(float(f.log_mm(values).min()) / 3, f.FLOOR_MM / 3)
    for k, r in enumerate(rows):
        y = len(rows) - 1 - k
        ax.barh(y, max(r.mean_mm, left) - left, left=left, color=_colour(k), height=0.62)
        ax.plot([max(r.p95_mm, left)] * 2, [y - 0.31, y + 0.31], color=f.INK, linewidth=1.6)
        ax.plot(max(r.max_mm, left), y, "o", color=f.INK, markersize=4)
        ax.annotate(
            h.length(r.mean_mm),
            (max(r.max_mm, left), y),
            xytext=(8, 0),
            textcoords="offset points",
            va="center",
            fontsize=10.5,
        )
    ax.set_xscale("log")
    f.log_axis(ax.xaxis)
    ax.set_xlim(left, 4 * float(f.log_mm(values).max()))
    ax.set_yticks(range(len(rows))[::-1], [f.plain(f.shortened(r.name, 38)) for r in rows])
    ax.set_xlabel("error on the true arm, mm (mean written beside)")
    ax.grid(axis="y", visible=False)
    return f.uri(made)


def along_figure(distances_mm: Mapping[str, f.Floats]) -> str:
    """Errors along the program."""
    made, ax = f.new(4.4)
    many = False
    for k, (name, values) in enumerate(distances_mm.items()):
        f.line(ax, np.arange(1, values.size + 1, dtype=float), f.log_mm(values), _colour(k), f.plain(name), width=1.0)
        many |= values.size > f.MANY
    ax.set_yscale("log")
    f.log_axis(ax.yaxis)
    ax.set_xlabel("corrected motion, in the order of the program")
    ax.set_ylabel("error on the true arm, mm")
    f.legend(ax, ncols=2)
    return f.uri(made, many=many)


def cumulative_figure(distances_mm: Mapping[str, f.Floats]) -> str:
    """Cumulative distributions of the errors."""
    made, ax = f.new(3.6, width=8.0)
    for k, (name, values) in enumerate(distances_mm.items()):
        share = np.arange(1, values.size + 1) / values.size
        x, y, _, _ = f.envelope(np.sort(f.log_mm(values)), share)
        ax.plot(x, y, color=_colour(k), label=f.plain(name), linewidth=1.8)
    ax.axhline(0.95, color=f.INK, linewidth=0.8, linestyle=(0, (4, 2)))
    ax.set_xscale("log")
    f.log_axis(ax.xaxis)
    ax.set_ylim(0, 1.02)
    ax.set_xlabel("error on the true arm, mm")
    ax.set_ylabel("share of the path below it")
    f.legend(ax, ncols=2)
    return f.uri(made)


def robustness_figure(robustness: Sequence[RobustnessRow]) -> str:
    """Mean errors of the four programs in every scenario."""
    made, ax = f.new(1.1 + 0.42 * len(robustness), width=8.8)
    labels = ("uncompensated", "joints only", "full", "oracle")
    y = np.arange(len(robustness))[::-1]
    for k, label in enumerate(labels):
        values = f.log_mm(np.array([r.errors_mm[k] for r in robustness]))
        ax.plot(
            values,
            y,
            "o" if k < 3 else "D",
            color=_colour(k),
            markersize=9 if k < 3 else 5,
            label=label,
            linestyle="none",
        )
    ax.set_xscale("log")
    f.log_axis(ax.xaxis)
    ax.set_ylim(-0.7, len(robustness) - 0.3)
    ax.set_yticks(y, [f.plain(f.shortened(r.scenario, 34)) for r in robustness])
    ax.set_xlabel("mean error on the true arm, mm")
    f.legend(ax)
    return f.uri(made)
