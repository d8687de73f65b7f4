"""Pictures of the identification page."""

from __future__ import annotations

import numpy as np

from drake_stiffness.report import figures as f
from drake_stiffness.report.evidence import Evidence, Shares
from drake_stiffness.rotations import Array

# Up to so many experiments are named on the axis.
_NAMED = 45


def experiments_figure(e: Evidence) -> str:
    """RMS of the residuals by experiment and direction, in units of noise, with the band that noise alone would fill."""
    from scipy.stats import chi2

    number = len(e.fitted.experiments)
    count = np.bincount(e.experiment, minlength=number)
    square = np.stack([np.bincount(e.experiment, weights=e.z[c] ** 2, minlength=number) for c in range(3)])
    rms = np.sqrt(square / np.maximum(count, 1))
    made, ax = f.new(3.6)
    x = np.arange(number)
    if np.isfinite(e.left):
        low, high = (e.left * np.sqrt(chi2.ppf(p, np.maximum(count, 1)) / np.maximum(count, 1)) for p in (0.01, 0.99))
        ax.fill_between(
            x, low, high, color="#dfe6ec", step="mid", label="98 % of experiments, if noise is all", linewidth=0
        )
    size = 22 if number <= _NAMED else 5
    for c, (axis, colour) in enumerate(zip("xyz", f.XYZ, strict=True)):
        ax.scatter(x + 0.18 * (c - 1), rms[c], s=size, color=colour, label=axis, linewidths=0, alpha=0.9)
    if number <= _NAMED:
        turn = 0 if number <= 16 and max(map(len, e.fitted.experiments)) < 8 else 90
        ax.set_xticks(x, [f.plain(f.shortened(name, 14)) for name in e.fitted.experiments], rotation=turn, fontsize=9)
    ax.set_xlabel("experiment" if number <= _NAMED else f"experiment (in the order of the table, {number} in all)")
    ax.set_ylabel("residual RMS / stated noise")
    ax.set_ylim(bottom=0)
    ax.set_xlim(-0.8, number - 0.2)
    f.legend(ax, markerscale=1.0 if number <= _NAMED else 3.0)
    return f.uri(made, many=number > 150)


def histogram_figure(e: Evidence) -> str:
    """All residuals against the normal distribution that the stated noise promises."""
    z = (e.z / e.left if np.isfinite(e.left) else e.z).ravel()
    reach = float(np.ceil(max(4.0, np.percentile(np.abs(z), 99.7))))
    edges = np.linspace(-reach, reach, int(min(max(np.sqrt(z.size), 16), 70)) + 1)
    made, ax = f.new(3.3, width=7.0)
    density, _ = np.histogram(np.clip(z, -reach, reach), edges)
    ax.stairs(density / z.size / np.diff(edges), edges, fill=True, color=f.SKY, alpha=0.75, label=f"{z.size} residuals")
    t = np.linspace(-reach, reach, 300)
    ax.plot(t, np.exp(-(t**2) / 2) / np.sqrt(2 * np.pi), color=f.INK, linewidth=1.6, label="stated noise, N(0, 1)")
    ax.set_xlabel("residual / stated noise")
    ax.set_ylabel("density")
    ax.set_xlim(-reach, reach)
    f.legend(ax)
    return f.uri(made)


def load_figure(e: Evidence) -> str:
    """Residuals against the size of the applied force: single ones as dots, RMS as lines."""
    force = np.round(e.force_N)
    levels = np.unique(force)
    if levels.size > 20:
        levels = np.unique(np.quantile(force, np.linspace(0.04, 0.96, 12)))
    nearest = np.abs(force[:, None] - levels).argmin(axis=1)
    step = float(np.diff(levels).min()) if levels.size > 1 else 1.0
    made, ax = f.new(3.4)
    jitter = np.random.default_rng(0).uniform(-0.12, 0.12, force.size) * step
    for c, (axis, colour) in enumerate(zip("xyz", f.XYZ, strict=True)):
        shift = 0.26 * step * (c - 1)
        ax.scatter(force + shift + jitter, e.z[c], s=3, color=colour, alpha=0.35, linewidths=0)
        rms = [
            np.sqrt((e.z[c, nearest == k] ** 2).mean()) if (nearest == k).any() else np.nan for k in range(levels.size)
        ]
        ax.plot(levels + shift, rms, color=colour, marker="o", markersize=5, label=f"RMS, {axis}", linewidth=1.6)
    ax.axhline(0, color=f.INK, linewidth=0.8)
    ax.set_xlabel("size of the applied force, N")
    ax.set_ylabel("residual / stated noise")
    reach = 1.15 * float(np.percentile(np.abs(e.z), 99.8))
    ax.set_ylim(-reach, reach)
    f.legend(ax)
    return f.uri(made, many=True)


def joint_figure(e: Evidence, names: tuple[str, ...], prismatic: tuple[bool, ...]) -> str:
    """Mean residual by joint position: what depends on a joint shows as a line that leaves zero."""
    q = e.fitted.cases.q[:, e.fitted.case]
    columns = 3
    rows = -(-len(names) // columns)
    made, axes = f.new(2.5 * rows, rows, columns, sharey=True, squeeze=False)
    for i, ax in enumerate(axes.ravel()):
        if i >= len(names):
            ax.set_axis_off()
            continue
        shown = q[i] * (1e3 if prismatic[i] else 180 / np.pi)
        edges = np.unique(np.quantile(shown, np.linspace(0, 1, 13)))
        if edges.size < 3:
            ax.text(0.5, 0.5, "did not move", transform=ax.transAxes, ha="center", color=f.GREY)
        else:
            place = np.clip(np.searchsorted(edges, shown, side="right") - 1, 0, edges.size - 2)
            _binned(ax, shown, e.z, place, edges.size - 1)
        ax.axhline(0, color=f.INK, linewidth=0.8)
        ax.set_xlabel(f"{f.plain(f.shortened(names[i], 22))}, {'mm' if prismatic[i] else 'deg'}")
    for row in axes:
        row[0].set_ylabel("mean residual\n/ stated noise")
    handles, labels = axes[0, 0].get_legend_handles_labels()
    made.legend(handles, labels, loc="outside upper left", ncols=4, frameon=False, fontsize=10)
    return f.uri(made)


def _binned(ax: f.Axes, x: Array, z: Array, place: np.ndarray, bins: int) -> None:
    count = np.bincount(place, minlength=bins)
    kept = count > 2
    centre = np.bincount(place, weights=x, minlength=bins)[kept] / count[kept]
    for c, (axis, colour) in enumerate(zip("xyz", f.XYZ, strict=True)):
        mean = np.bincount(place, weights=z[c], minlength=bins)[kept] / count[kept]
        ax.plot(centre, mean, color=colour, marker="o", markersize=3.5, linewidth=1.4, label=axis)
        if c == 2:
            noise = z.std() / np.sqrt(count[kept])
            ax.fill_between(centre, -2 * noise, 2 * noise, color="#dfe6ec", linewidth=0, label="chance")


def share_figure(s: Shares) -> str:
    """Bars: how much of the displacement every spring makes."""
    made, ax = f.new(0.9 + 0.28 * len(s.name), width=8.5)
    y = np.arange(len(s.name))[::-1]
    percent = 100 * np.array(s.share)
    for joint, colour, label in ((True, f.BLUE, "joints"), (False, f.ORANGE, "links")):
        mine = np.array(s.joint) == joint
        if mine.any():
            ax.barh(
                y[mine],
                percent[mine],
                color=colour,
                label=f"{label}, together {percent[mine].sum():.0f} %",
                height=0.68,
            )
    for place, value, alone in zip(y, percent, s.alone_mm, strict=True):
        text = f"{round(value, 1) + 0.0:.1f} %  ({alone:.3g} mm)" if alone > 1e-6 else "none"
        ax.annotate(text, (max(value, 0), place), xytext=(4, 0), textcoords="offset points", va="center", fontsize=10)
    ax.set_yticks(y, [f.plain(f.shortened(name, 24)) for name in s.name])
    ax.set_xlabel("share of the displacement, %")
    ax.set_xlim(right=1.25 * max(percent.max(), 1.0))
    ax.grid(axis="y", visible=False)
    f.legend(ax)
    return f.uri(made)
