"""The report of `restore`: which compliances were filled in, between which limits, and what held the limits."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

import drake_stiffness
from drake_stiffness.report import page as h
from drake_stiffness.report.figures import BLUE, GREY, INK, new, plain, uri

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from drake_stiffness.model import Model
    from drake_stiffness.restoration.restoration import Restoration

# Intervals that reach down to zero are drawn to this share of their upper end.
_FLOOR = 1e-4


def restoration_report(result: Restoration, before: Model, errors: tuple[float, float] | None) -> str:
    """The page of `restore --report`.

    Parameters
    ----------
    result : Restoration
    before : Model
        As it was identified.
    errors : held-out errors before and after, mm, or None

    Returns
    -------
    str
        A self-contained HTML page.
    """
    return h.page(
        "Restored model",
        f"{result.number.size} compliances: {result.label}. Nothing on this page was measured beyond what identification found.",
        h.verdict(_answer(result, errors)),
        *(h.callout("Said of the identified model.", line) for line in before.doubts()),
        *(h.callout("Look at this.", line) for line in result.notes),
        _figure(result),
        _table(result, before),
        _matrices(result),
        _how(result),
        footer=f"Made by drake-stiffness {drake_stiffness.__version__}.",
    )


def _answer(result: Restoration, errors: tuple[float, float] | None) -> str:
    moved = (
        f"The identified combinations moved by {h.number(result.departure, 2)} standard deviations of all of them together"
        if result.departure
        else "The identified combinations are untouched"
    )
    text = f"{moved}; every link matrix is positive definite as a whole."
    if errors is not None:
        text += f" Held-out postures are predicted to {h.length(errors[1], 4)} rms (before: {h.length(errors[0], 4)})."
    return text


def _figure(result: Restoration) -> h.Markup:
    units = tuple(dict.fromkeys(entry["unit"] for entry in result.model.restored))
    if not units:
        return h.paragraph("Every compliance of this model is identified; nothing was restored.")
    rows = [[e for e in result.model.restored if e["unit"] == unit] for unit in units]
    made, axes = new(1.2 + 0.24 * max(map(len, rows)), columns=len(units), width=4.2 * len(units) + 1, squeeze=False)
    for ax, unit, entries in zip(axes[0], units, rows, strict=True):
        _intervals(ax, unit, entries)
    caption = (
        "Sizes of restored compliances. Bar: from the smallest to the largest value that measurements, passivity and limits of sections "
        "leave. Grey bars reach down to zero, blue ones do not; an arrow means that nothing bounds it above. Mark: the value in the model."
    )
    return h.section(
        "Intervals", h.figure(uri(made), caption, "Intervals of restored compliances on a logarithmic axis")
    )


def _intervals(ax: Axes, unit: str, entries: list[dict[str, Any]]) -> None:
    for row, entry in enumerate(entries):
        ends = sorted(abs(entry[key]) for key in ("low", "high"))
        value = abs(entry["value"])
        high = ends[1] if np.isfinite(ends[1]) else 30 * value
        open_end = ends[0] < _FLOOR * high
        low = _FLOOR * high if open_end else ends[0]
        ax.plot(
            [low, high], [row, row], color=GREY if open_end else BLUE, linewidth=5, solid_capstyle="butt", alpha=0.6
        )
        if not np.isfinite(ends[1]):
            ax.plot(high, row, marker=">", color=GREY)
        ax.plot(value, row, marker="o", color=INK, markersize=4)
    ax.set_xscale("log")
    ax.set_yticks(range(len(entries)), [plain(entry["name"]) for entry in entries], fontsize=8)
    ax.invert_yaxis()
    ax.set_xlabel(f"size, {unit}")


def _table(result: Restoration, before: Model) -> h.Markup:
    was = dict(zip(before.names, before.x, strict=True))
    rows = [
        (
            entry["name"],
            h.number(was.get(entry["name"]), 3),
            h.number(entry["low"], 3),
            h.number(entry["value"], 3),
            h.number(entry["high"], 3) if np.isfinite(entry["high"]) else "no bound",
            entry["unit"],
            "; ".join(f"{end}: {words.split(' and ')[0]}" for end, words in zip(("low", "high"), held, strict=True)),
        )
        for entry, held in zip(result.model.restored, result.rules, strict=True)
    ]
    header = ("entry", "before", "low", "value", "high", "unit", "held by")
    caption = (
        "Before: what stood in the model, by convention where it was not identified; nothing where a reduction took the entry away. All intervals hold together with the "
        "stated probability if the limits of sections hold. Rules name the entries of a beam along its own x axis."
    )
    return h.section("Restored entries", h.table(header, rows, caption=caption, align="lrrrrll"))


def _matrices(result: Restoration) -> h.Markup:
    rows = [(link, h.number(share, 2)) for link, share in result.smallest.items()]
    caption = "Smallest over largest eigenvalue, components in units of their scales: above zero is positive definite."
    return h.section("Link matrices", h.table(("link", "smallest / largest"), rows, caption=caption, align="lr"))


def _how(result: Restoration) -> h.Markup:
    return h.section(
        "How to read this",
        h.bullets(
            (
                f"The region of the identified combinations: {h.number(result.radius, 3)} standard deviations of all together.",
                "Rules of beams: a link bends along its length by curvatures that are moments of one positive distribution (k26 <= L k66 and so "
                "on), stretches by what the same material does (r² k66 <= k11 <= c² k66), and twists no less than an ellipse.",
                "r: radius of gyration at least; c: half width at most; E/G: ratio of moduli; b: torsion factor at least; shear: what the "
                "shear factor allows. They come from the sections file or, where it is silent, from limits that cover common castings.",
                "A restored value is no evidence: its group in the model stays what identification said.",
            )
        ),
    )
