"""The arm in 3-D with its residuals as arrows, before and after."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from matplotlib.ticker import MaxNLocator
from mpl_toolkits.mplot3d import Axes3D
from numpy.typing import NDArray

from drake_stiffness.arm import forward
from drake_stiffness.model import Model
from drake_stiffness.observation import Observations, residual_m
from drake_stiffness.report import figures as f
from drake_stiffness.report import page as h
from drake_stiffness.report.arm_picture import draw_arm
from drake_stiffness.rotations import Array
from drake_stiffness.simulation import simulate_readings

# The longest arrow, as a share of the picture.
_LONGEST = 0.25


@dataclass(frozen=True, eq=False)
class Arrows:
    """Residuals at the points that were read.

    Attributes
    ----------
    p : (3, M)
        Where the model sees the points, m.
    before, after : (3, M)
        Residuals times `magnified`, m.
    magnified : float
    experiment : str
        The one that fits the base model worst.
    q : (n, 1)
        Its posture.
    of_worst, worst_steps : (M,) bool
        Its readings; the readings of every experiment's worst step.
    """

    p: Array
    before: Array
    after: Array
    magnified: float
    experiment: str
    q: Array
    of_worst: NDArray[np.bool_]
    worst_steps: NDArray[np.bool_]


def arm_section(before: Model, after: Model, o: Observations, about: str = "") -> h.Markup:
    """The part of a page that shows the residuals of two models on the arm; `about` is what the two are."""
    found = residual_arrows(before, after, o)
    return h.section(
        "The arm",
        h.figure(
            arrows_figure(found, after),
            f"Residuals as arrows, {found.magnified:g} times magnified: orange before, blue after{about}. Left: the arm in experiment "
            f"{found.experiment}, which fits worst before. Right: every experiment's worst step.",
            "The arm in 3-D with residual arrows",
        ),
    )


def residual_arrows(before: Model, after: Model, o: Observations) -> Arrows:
    """Residuals of two models as arrows that can be seen."""
    m = o.measurements
    r = [residual_m(o, model) for model in (before, after)]
    p = simulate_readings(after, m.cases, m.case, m.point).p
    experiment = m.cases.experiment[m.case]
    square = (r[0] ** 2).sum(axis=0)
    worst = int(np.bincount(experiment, square).argmax())
    longest = max(float(np.sqrt(square.max())), 1e-12)
    magnified = _round(_LONGEST * max(float(np.ptp(p)), 1e-3) / longest)
    case = int(m.case[np.flatnonzero(experiment == worst)[0]])
    steps = _worst_steps(square, m.case, experiment)
    return Arrows(
        p,
        r[0] * magnified,
        r[1] * magnified,
        magnified,
        m.experiments[worst],
        m.cases.q[:, [case]],
        experiment == worst,
        steps,
    )


def arrows_figure(found: Arrows, model: Model) -> str:
    """Residuals of the worst experiment on the arm, and of the worst step of every experiment in space."""
    made = f.Figure(figsize=(11.0, 5.6))
    left, right = (
        made.add_axes((0.48 * k, -0.02, 0.52, 0.98), projection="3d", facecolor="none", computed_zorder=False)
        for k in (0, 1)
    )
    assert isinstance(left, Axes3D)
    assert isinstance(right, Axes3D)
    arm, mine, step = model.arm, found.of_worst, found.worst_steps
    draw_arm(left, arm, forward(arm, found.q), [False] * (arm.num_joints + 1), model.tcp[0])
    for arrows, colour, label in ((found.before, f.ORANGE, "before"), (found.after, f.BLUE, "after")):
        _arrows(left, found.p[:, mine], arrows[:, mine], colour, label)
        _arrows(right, found.p[:, step], arrows[:, step], colour, label)
    _frame(right, found.p)
    left.legend(loc="upper right", frameon=False, fontsize=10)
    made.text(0.04, 0.95, f.plain(f"experiment {found.experiment}, all steps"), fontsize=12, fontweight="bold")
    made.text(0.54, 0.95, "all experiments, the worst step of each", fontsize=12, fontweight="bold")
    return f.uri(made, many=found.p.shape[1] > f.MANY)


def _worst_steps(square: Array, case: NDArray[np.int_], experiment: NDArray[np.int_]) -> NDArray[np.bool_]:
    """Readings (bool) that belong to the step of their experiment with the largest residual."""
    total = np.bincount(case, square)
    out = np.zeros(case.size, dtype=bool)
    for e in np.unique(experiment):
        own = np.unique(case[experiment == e])
        out |= case == own[total[own].argmax()]
    return out


def _arrows(ax: Axes3D, p: Array, v: Array, colour: str, label: str) -> None:
    ax.quiver(*p, *v, color=colour, linewidth=1.0, arrow_length_ratio=0.25, label=label, zorder=10)


def _frame(ax: Axes3D, p: Array) -> None:
    """Equal scales around the points."""
    middle, half = (p.max(axis=1) + p.min(axis=1)) / 2, np.maximum(np.ptp(p, axis=1) / 2, 0.1) * 1.15
    for set_limits, c, reach in zip((ax.set_xlim, ax.set_ylim, ax.set_zlim), middle, half, strict=True):
        set_limits(c - reach, c + reach)
    ax.set_box_aspect(tuple(half), zoom=0.86)
    ax.view_init(elev=22, azim=-58)
    for axis, name in zip((ax.xaxis, ax.yaxis, ax.zaxis), "xyz", strict=True):
        axis.set_label_text(f"{name}, m")
        axis.set_tick_params(labelsize=8)
        axis.set_major_locator(MaxNLocator(5, steps=[1, 2, 5, 10]))
        axis.set_pane_color((0.96, 0.97, 0.98, 1.0))


def _round(value: float) -> float:
    """Down to 1, 2 or 5 times a power of ten."""
    power = 10.0 ** np.floor(np.log10(value))
    return float(power * max(k for k in (1, 2, 5) if k * power <= value))
