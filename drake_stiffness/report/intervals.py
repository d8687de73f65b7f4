"""The report of `intervals`: every value with its interval, coloured by what the interval rests on."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

import drake_stiffness
from drake_stiffness.intervals.interval import Interval, read_as
from drake_stiffness.report import figures as f
from drake_stiffness.report import page as h

COLOURS = {"identified": f.BLUE, "bounded, not identified": f.ORANGE, "unbounded": f.PURPLE}
# More intervals than this do not fit one figure.
_FIT = 90
_TITLES = {"parameters": "Parameters", "base": "Base parameters", "deflections": "Deflections"}


def intervals_report(found: dict[str, tuple[Interval, ...]], level: float, name: str, warnings: Sequence[str]) -> str:
    """The page of `intervals --report`: a self-contained HTML page.

    Parameters
    ----------
    found : part ("parameters", "base", "deflections") to its intervals
    name : str
        Of the campaign file.
    """
    answer = " ".join(_count(part, some) for part, some in found.items())
    return h.page(
        f"Intervals of {name}",
        f"Profile likelihood at {100 * level:g} %: how far a value may lie before chi-square rejects it, all compliances positive semidefinite.",
        h.verdict(answer),
        *(h.callout(*line.split(":", 1)) for line in warnings),
        h.paragraph(_meaning()),
        *(h.section(_TITLES[part], _figure(some), _table(some)) for part, some in found.items()),
        footer=f"Made by drake-stiffness {drake_stiffness.__version__}.",
    )


def _count(part: str, some: tuple[Interval, ...]) -> str:
    number = {status: sum(one.status == status for one in some) for status in COLOURS}
    said = ", ".join(f"{count} {status}" for status, count in number.items() if count)
    return f"{_TITLES[part]}: {said}."


def _meaning() -> str:
    return (
        "Identified: unique without the constraint of positive semidefiniteness; the interval is a measurement. Bounded, not identified: "
        "readings leave the value open, and only what springs can be keeps it finite; the value of the model (in brackets) is a convention, "
        "and any value inside explains the readings as well. Unbounded: nothing limits it. Where a constraint is near, the interval differs "
        "from that of eq. (14), which knows of none."
    )


def _figure(some: tuple[Interval, ...]) -> h.Markup:
    made = interval_figure(some[:_FIT])
    more = f" The first {_FIT} of {len(some)}." if len(some) > _FIT else ""
    caption = (
        "Bars: intervals; dots: values of the model, hollow where they are a convention; thin grey bars below: eq. (14) around least squares; "
        f"arrows: no end. Axes grow as the square root, to both sides of zero.{more}"
    )
    return h.figure(f.uri(made), caption, "Intervals of all values, coloured by status")


def interval_figure(some: Sequence[Interval]) -> Figure:
    """One panel per unit, one row per value."""
    units = list(dict.fromkeys(one.unit for one in some))
    members = [[one for one in some if one.unit == unit] for unit in units]
    rows = [len(m) + 2.5 for m in members]
    made = Figure(figsize=(10.0, 0.9 + 0.2 * sum(rows)), layout="constrained")
    axes = np.atleast_1d(made.subplots(len(units), 1, height_ratios=rows))
    for ax, unit, own in zip(axes, units, members, strict=True):
        f.tidy(ax)
        _panel(ax, unit, own)
    handles = [Line2D([], [], color=colour, linewidth=4, label=status) for status, colour in COLOURS.items()]
    handles.append(Line2D([], [], color=f.GREY, linewidth=1.5, label="eq. (14)"))
    made.legend(handles=handles, loc="outside upper left", ncols=len(handles), frameon=False, fontsize=10)
    return made


def _panel(ax: Axes, unit: str, own: list[Interval]) -> None:
    factor, name = read_as(unit)
    ax.set_xscale("function", functions=(signed_root, signed_square))
    ends = np.array([[one.low, one.high, one.value] for one in own]) * factor
    finite = ends[np.isfinite(ends)]
    low, high = float(finite.min(initial=0.0)), float(finite.max(initial=0.0))
    margin = 0.04 * max(high - low, 1e-300)
    left, right = low - margin, high + margin
    for row, (one, (start, end, value)) in enumerate(zip(own, ends, strict=True)):
        colour = COLOURS[one.status]
        ax.plot([max(start, left), min(end, right)], [row, row], color=colour, linewidth=4, solid_capstyle="butt")
        if start < left:
            ax.plot(left, row, marker="<", color=colour, clip_on=False)
        if end > right:
            ax.plot(right, row, marker=">", color=colour, clip_on=False)
        if one.status == "identified":
            plain = np.array(one.plain) * factor
            ax.plot(np.clip(plain, left, right), [row + 0.34] * 2, color=f.GREY, linewidth=1.5)
        face = f.INK if one.status == "identified" else "white"
        ax.plot(value, row, marker="o", markersize=4, color=f.INK, markerfacecolor=face)
    if left < 0.0 < right:
        ax.axvline(0.0, color=f.INK, linewidth=0.8)
    ax.set_xlim(left, right)
    ax.set_xticks(_ticks(left, right))
    ax.xaxis.set_major_formatter(lambda value, place: f"{value:g}")
    ax.set_yticks(range(len(own)), [f.plain(f.shortened(one.name, 52)) for one in own], fontsize=8)
    ax.set_ylim(len(own) - 0.3, -0.7)
    ax.set_xlabel(name)


def _ticks(left: float, right: float) -> list[float]:
    """Round numbers whose roots are about evenly spread."""
    size = max(abs(left), abs(right))
    unit = 10.0 ** np.floor(np.log10(size / 2.0))
    wanted = [k * unit for k in (0.1, 0.5, 1, 2, 5, 10, 20)]
    both = sorted([0.0, *wanted, *(-w for w in wanted)])
    kept: list[float] = []
    for tick in (t for t in both if left <= t <= right):
        if not kept or signed_root(np.array(tick)) - signed_root(np.array(kept[-1])) > 0.045 * np.sqrt(size):
            kept.append(tick)
    return kept


def signed_root(x: f.Floats) -> f.Floats:
    """sign(x) sqrt |x|."""
    return np.sign(x) * np.sqrt(np.abs(x))


def signed_square(x: f.Floats) -> f.Floats:
    """The inverse of `signed_root`."""
    return np.sign(x) * np.square(x)


def _table(some: tuple[Interval, ...]) -> h.Markup:
    rows = []
    for one in some:
        factor, name = read_as(one.unit)
        value = h.number(one.value * factor)
        low, high, *plain = (
            h.number(end * factor) if np.isfinite(end) else "none" for end in (one.low, one.high, *one.plain)
        )
        beside = " .. ".join(plain) if np.isfinite(one.sigma) else h.UNKNOWN
        rows.append(
            (one.name, value if one.status == "identified" else f"({value})", low, high, beside, name, one.status)
        )
    header = ("value of", "model", "low", "high", "eq. (14)", "unit", "status")
    return h.table(header, rows, align="lrrrrll")
