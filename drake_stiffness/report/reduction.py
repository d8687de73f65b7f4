"""The report of `reduce`: which reduction predicts best, and what each of them kept."""

from __future__ import annotations

import numpy as np

import drake_stiffness
from drake_stiffness.reduction.comparison import METHODS, RULE, Comparison
from drake_stiffness.reduction.scoring import Row
from drake_stiffness.report import figures as f
from drake_stiffness.report import page as h
from drake_stiffness.thresholds import LOWER_RATIO, UPPER_RATIO

HEADER = (
    "method", "free", "fitted", "mean, um", "p95, um", "max, um", "% comp.", "noise, um", "variance, um", "bias, um",
)  # fmt: skip
UNUSED_CLASS = (
    "M3 as printed uses one threshold. The class G1~ between v0- and v0+, which the source paper defines, plays no part in it: what "
    "lies there is deleted like G1-. The lower threshold only sorts the list below."
)


def cells(row: Row) -> tuple[str, ...]:
    """The figures of a row as the table shows them, after the method's name."""
    um = [h.number(1e3 * v, 3) for v in (row.mean_mm, row.p95_mm, row.max_mm)]
    parts = [h.number(1e3 * v, 3) for v in (row.noise_mm, row.deviation_mm, row.bias_mm)]
    share = f"{row.percent:.2f}" if np.isfinite(row.percent) else h.UNKNOWN
    return str(row.parameters), str(row.combinations), *um, share, *parts


def answer(result: Comparison) -> str:
    """What to take, in two sentences."""
    if not result.recommended:
        return "No held-out experiment scored a model, so nothing is recommended."
    row = result.row(result.recommended)
    others = [METHODS[m] for m in result.tied if m != result.recommended]
    beside = f" Within noise of the best: {'; '.join(others)}." if others else " No other method is within noise of it."
    return (
        f"Recommended: {row.label} ({row.parameters} parameters, {row.combinations} combinations fitted), mean held-out error "
        f"{h.length(row.mean_mm)}, {row.percent:.2f} % compensated.{beside}"
    )


def reduction_report(result: Comparison) -> str:
    """The page of `reduce --report`: a self-contained HTML page."""
    rows = [
        (row.label, *cells(row)) if row.model is not None else (row.label, *(h.UNKNOWN for _ in HEADER[1:]))
        for row in result.rows
    ]
    failed = [h.callout(row.label, row.note) for row in result.rows if row.note]
    caption = (
        f"{result.fitted} experiments fitted, {result.held} held out. Errors are lengths of the 3-D difference between held-out readings "
        "and predictions, the readings' noise included; noise, variance and bias are root mean squares. Compensated: 1 - mean error / "
        "mean displacement. Free: parameters that are not held at zero. Fitted: how many combinations of them the readings determine."
    )
    return h.page(
        "Reductions compared",
        f"Thresholds: v0+ = {result.upper:g}, v0- = {result.lower:g} (the source paper: {UPPER_RATIO:g} and {LOWER_RATIO:g}).",
        h.verdict(answer(result)),
        *failed,
        h.section("Held-out errors", h.paragraph(caption), h.table(HEADER, rows, align="l" + "r" * (len(HEADER) - 1)), _figure(result)),
        h.section("How the recommendation is made", h.paragraph(RULE)),
        h.section("What each reduction kept", h.paragraph(UNUSED_CLASS), *(_choice(result, row) for row in result.rows)),
        footer=f"Made by drake-stiffness {drake_stiffness.__version__}.",
    )  # fmt: skip


def _figure(result: Comparison) -> h.Markup:
    if not any(row.error_mm.size for row in result.rows):
        return h.Markup("")
    caption = (
        "Left: held-out error, mean (dot), 95 % (bar end) and largest (cross), on a logarithmic scale; the dashed line is what the noise "
        "of the readings alone gives. Right: the held-out mean square by its parts."
    )
    return h.figure(reduction_figure(result), caption, "Held-out error by reduction")


def reduction_figure(result: Comparison) -> str:
    """Error by method with the parameters kept, and its parts, as a data URI."""
    shown = [row for row in result.rows if row.error_mm.size][::-1]
    made, (left, right) = f.new(0.45 * len(shown) + 1.6, 1, 2, width=11.0, width_ratios=[1.6, 1.0], sharey=True)
    y = np.arange(len(shown))
    mean, p95, most = (
        np.array([getattr(row, name) for row in shown]) * 1e3 for name in ("mean_mm", "p95_mm", "max_mm")
    )
    left.hlines(y, mean, p95, color=f.BLUE, linewidth=3)
    left.plot(mean, y, "o", color=f.BLUE, label="mean to 95 %")
    left.plot(most, y, "x", color=f.ORANGE, label="largest")
    # Mean length of three normal coordinates: sqrt(8 / (3 pi)) of its root mean square.
    left.axvline(
        shown[0].noise_mm * 1e3 * np.sqrt(8 / (3 * np.pi)), color=f.GREY, linestyle="--", label="noise alone, mean"
    )
    left.set_xscale("log")
    f.log_axis(left.xaxis)
    left.set_xlabel("held-out error, um")
    left.set_yticks(y, [f"{row.method} ({row.parameters})" for row in shown])
    f.legend(left)
    start = np.zeros(len(shown))
    for name, label, colour in (
        ("noise_mm", "noise", f.GREY),
        ("deviation_mm", "variance", f.SKY),
        ("bias_mm", "bias", f.ORANGE),
    ):
        part = np.array([getattr(row, name) for row in shown]) ** 2
        whole = np.array([row.noise_mm**2 + row.deviation_mm**2 + row.bias_mm**2 for row in shown])
        right.barh(y, 100 * part / whole, left=start, color=colour, label=label)
        start = start + 100 * part / whole
    right.set_xlabel("share of the mean square, %")
    f.legend(right)
    return f.uri(made)


def _choice(result: Comparison, row: Row) -> h.Markup:
    if row.model is None:
        return h.Markup("")
    lines = [h.join("Kept: ", ", ".join(row.kept) or "nothing", ".")]
    if row.added:
        lines.append(h.join("Given back, because the cone needs them: ", ", ".join(row.added), "."))
    if row.dropped:
        fell = ", ".join(f"{d.name} ({d.ratio:.2g}, {result.group(d.ratio)})" for d in row.dropped)
        lines.append(h.join("Dropped, with the ratio at which it fell: ", fell, "."))
    if row.merged:
        lines.append(h.join("Redundant, so the kept ones stand for them as well: ", ", ".join(row.merged), "."))
    return h.section(row.label, h.bullets(lines), level=3)
