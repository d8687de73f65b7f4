"""Pictures of the compensation page: what happens along the program, and where the path is bent."""

from __future__ import annotations

import numpy as np
from matplotlib.collections import LineCollection
from matplotlib.ticker import FuncFormatter
from numpy.typing import NDArray

from drake_stiffness.report import figures as f

Floats = f.Floats
Bools = NDArray[np.bool_]

_ARROWS = 45


def path_mm(target_mm: Floats) -> Floats:
    """Length of the path up to every corrected point, (N,) mm."""
    steps = np.linalg.norm(np.diff(target_mm, axis=0), axis=1)
    return np.concatenate([[0.0], np.cumsum(steps)])


def _along(ax: f.Axes) -> None:
    """Path lengths in mm, long ones in m."""
    long = ax.get_xlim()[1] > 20_000
    ax.set_xlabel(f"along the path, {'m' if long else 'mm'}")
    if long:
        ax.xaxis.set_major_formatter(FuncFormatter(lambda value, place: f"{value / 1000:g}"))


def deviation_figure(s_mm: Floats, before: Floats, one_shot: Floats, after: Floats, sigma: Floats) -> str:
    """Predicted distance of the tool from where it is wanted, logarithmic; the model's sigma as dashes."""
    made, ax = f.new(4.2)
    f.line(ax, s_mm, f.log_mm(before), f.SERIES[1], "uncompensated")
    f.line(ax, s_mm, f.log_mm(one_shot), f.SERIES[5], "after one shot")
    f.line(ax, s_mm, f.log_mm(after), f.SERIES[2], "converged, as printed", width=1.0)
    known = np.isfinite(sigma)
    if known.any():
        ax.plot(
            s_mm[known],
            f.log_mm(sigma[known]),
            color=f.INK,
            linestyle=(0, (4, 2)),
            label="uncertainty of the model, 1 sigma",
        )
    ax.set_yscale("log")
    f.log_axis(ax.yaxis)
    low = min(float(np.percentile(f.log_mm(v), 2)) for v in (before, one_shot, after))
    ax.set_ylim(bottom=max(low / 3, 0.5 * f.FLOOR_MM))
    ax.set_ylabel("predicted deviation, mm")
    _along(ax)
    f.legend(ax)
    return f.uri(made, many=s_mm.size > f.MANY)


def interval_figure(s_mm: Floats, after: Floats, low: Floats, high: Floats) -> str:
    """Predicted residual, as printed, in its 95 % interval."""
    made, ax = f.new(3.6)
    x, _, bottom, _ = f.envelope(s_mm, low)
    _, _, _, top = f.envelope(s_mm, high)
    ax.fill_between(x, bottom, top, color=f.SKY, alpha=0.35, linewidth=0, label="95 % interval")
    f.line(ax, s_mm, after, f.BLUE, "residual predicted, as printed", width=1.0)
    ax.set_ylim(bottom=0.0)
    ax.set_ylabel("residual, mm")
    _along(ax)
    f.legend(ax)
    return f.uri(made, many=s_mm.size > f.MANY)


def probe_figure(measured: Floats, after_model: Floats, rest: Floats, order: NDArray[np.int_]) -> str:
    """Lengths of deviations (M, 3) at probed places."""
    made, ax = f.new(3.4)
    place = np.arange(1, order.size + 1)
    for values, colour, label in (
        (measured, f.SERIES[1], "measured"),
        (after_model, f.SERIES[5], "after what the model explains"),
        (rest, f.SERIES[2], "after named causes"),
    ):
        ax.plot(
            place, np.linalg.norm(values[order], axis=1), "o-", color=colour, markersize=3, linewidth=1, label=label
        )
    ax.set_ylim(bottom=0.0)
    ax.set_xlabel("probed place, in the order of the path")
    ax.set_ylabel("deviation, mm")
    f.legend(ax)
    return f.uri(made, many=order.size > f.MANY)


def correction_figure(s_mm: Floats, correction_mm: Floats, force_N: Floats) -> str:
    """Components of the correction, and the force it answers."""
    made, (top, bottom) = f.new(5.4, 2, 1, sharex=True)
    for c, (axis, colour) in enumerate(zip("xyz", f.XYZ, strict=True)):
        f.line(top, s_mm, correction_mm[:, c], colour, axis)
        f.line(bottom, s_mm, force_N[:, c], colour, axis)
    f.line(bottom, s_mm, np.linalg.norm(force_N, axis=1), f.INK, "size", width=1.0)
    for ax in (top, bottom):
        ax.axhline(0, color=f.GREY, linewidth=0.8)
        f.legend(ax)
    top.set_ylabel("correction, mm\n(program's base frame)")
    bottom.set_ylabel("force on the tool, N\n(world axes)")
    _along(bottom)
    return f.uri(made, many=s_mm.size > f.MANY)


def spin_figure(s_mm: Floats, kept_mm: Floats, chosen_mm: Floats, angle_rad: Floats) -> str:
    """Deflection with the tool as programmed and as turned about its axis, and the turn."""
    made, (top, bottom) = f.new(4.6, 2, 1, sharex=True)
    f.line(top, s_mm, kept_mm, f.SERIES[1], "as programmed")
    f.line(top, s_mm, chosen_mm, f.SERIES[2], "as turned")
    f.line(bottom, s_mm, np.degrees(angle_rad), f.INK, "turn")
    top.set_ylim(bottom=0.0)
    top.set_ylabel("deflection, mm")
    bottom.set_ylabel("turn of the tool, deg")
    f.legend(top)
    _along(bottom)
    return f.uri(made, many=s_mm.size > f.MANY)


def top_view_figure(target_mm: Floats, correction_mm: Floats, begin: Bools) -> tuple[str, str]:
    """The path in the plane it mostly lies in, coloured by the correction, with arrows.

    Parameters
    ----------
    begin : (N,)
        Where a cut begins: nothing is drawn on the way to it.

    Returns
    -------
    picture : data URI
    view : what is seen, for the caption
    """
    extent = np.ptp(target_mm, axis=0)
    across, up = sorted(np.argsort(-extent, kind="stable")[:2])
    size = np.linalg.norm(correction_mm, axis=1)
    p = target_mm[:, [across, up]]
    made, ax = f.new(6.2, width=8.6)
    along = ~begin[1:]
    if along.any():
        steps = np.stack([p[:-1], p[1:]], axis=1)[along]
        colours = LineCollection(list(steps), cmap="viridis", linewidths=2.0)
        colours.set_array(((size[:-1] + size[1:]) / 2)[along])
        bar = made.colorbar(ax.add_collection(colours), ax=ax, shrink=0.85)
        bar.set_label("size of the correction, mm", fontsize=11)
    else:
        ax.plot(*p.T, "o", color=f.BLUE)
    factor = _arrows(ax, p, correction_mm[:, [across, up]], size)
    ax.set_aspect("equal", adjustable="datalim")
    ax.margins(0.12)
    ax.autoscale_view()
    ax.set_xlabel(f"{'xyz'[across]}, mm")
    ax.set_ylabel(f"{'xyz'[up]}, mm")
    view = f"seen along {'xyz'[3 - across - up]}; arrows: the correction's part in this plane, drawn {factor:g} times as long as it is"
    return f.uri(made, many=target_mm.shape[0] > f.MANY), view


def _arrows(ax: f.Axes, p: Floats, correction: Floats, size: Floats) -> float:
    """Arrows at some points; the factor by which they are longer than the correction, a round number."""
    span = max(float(np.ptp(p, axis=0).max()), 1.0)
    largest = float(size.max(initial=0.0))
    if largest <= 0.0:
        return 1.0
    wanted = 0.11 * span / largest
    power = 10.0 ** np.floor(np.log10(wanted))
    factor = float(power * max(k for k in (1.0, 2.0, 5.0) if k * power <= wanted * (1 + 1e-9)))
    some = np.unique(np.linspace(0, p.shape[0] - 1, min(_ARROWS, p.shape[0])).astype(int))
    tip = correction[some] * factor
    ax.quiver(
        *p[some].T, *tip.T, angles="xy", scale_units="xy", scale=1.0, width=0.0026, color=f.ORANGE, zorder=3, headwidth=4.5
    )  # fmt: skip
    ax.update_datalim(p[some] + tip)
    return factor
