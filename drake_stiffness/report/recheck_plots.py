"""Figures of the recheck page: values then and now."""

from __future__ import annotations

from collections.abc import Sequence

from matplotlib.axes import Axes

from drake_stiffness.diagnosis.recheck_words import ThenAndNow, strongest
from drake_stiffness.report import figures as f
from drake_stiffness.report.diagnosis_plots import AFTER, BEFORE

# So many values at most, the surest changes.
MOST = 24
_95 = 1.96


def then_and_now_figure(values: Sequence[ThenAndNow]) -> str:
    """Values with their 95 % intervals, orange as stored and blue of now; a panel a unit, several values as changes."""
    shown = strongest(list(values), MOST)
    units = list(dict.fromkeys(v.unit for v in shown))
    panels = [[v for v in shown if v.unit == unit] for unit in units]
    heights = [len(panel) + 1.6 for panel in panels]
    made, axes = f.new(0.27 * sum(heights) + 0.6, len(panels), 1, height_ratios=heights, squeeze=False)
    for ax, panel in zip(axes[:, 0], panels, strict=True):
        _panel(ax, panel)
    f.legend(axes[0, 0])
    return f.uri(made)


def _panel(ax: Axes, values: Sequence[ThenAndNow]) -> None:
    alone = len(values) == 1
    for row, v in enumerate(values):
        origin = 0.0 if alone or v.then is None else v.then
        _dot(ax, (v.then or 0.0) - origin, v.sigma_then, row - 0.14, BEFORE, "s")
        _dot(ax, v.now - origin, v.sigma, row + 0.14, AFTER, "o")
    # One empty dot of each for the legend: the first value need not have both.
    new = all(v.then is None for v in values)
    then = ("white", "not in the stored model") if new else (BEFORE, "then, as stored")
    ax.plot([], [], "s", color=BEFORE, markerfacecolor=then[0], label=then[1])
    ax.plot([], [], "o", color=AFTER, label="now")
    ax.set_yticks(range(len(values)), [f.plain(v.name) for v in values])
    ax.set_ylim(len(values) - 0.4, -0.6)
    ax.grid(axis="y", visible=False)
    ax.ticklabel_format(axis="x", useOffset=False)
    ax.set_xlabel(f"{'value' if alone or new else 'change since then'}, {values[0].unit}")


def _dot(ax: Axes, value: float, sigma: float | None, row: float, colour: str, marker: str) -> None:
    """A value with its interval; hollow where none is known."""
    known = bool(sigma)
    half = [_95 * sigma] if sigma else None
    ax.errorbar(
        [value], [row], xerr=half, fmt=marker, color=colour, markersize=6, capsize=3, linewidth=1.6,
        markerfacecolor=colour if known else "white",
    )  # fmt: skip
