"""The arm as sticks in 3-D: links, joint axes, spring frames."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from matplotlib.ticker import MaxNLocator
from mpl_toolkits.mplot3d import Axes3D

from drake_stiffness.arm import Arm, Poses, forward
from drake_stiffness.report import figures as f

Floats = f.Floats


def bent_posture(arm: Arm) -> Floats:
    """A posture inside the limits in which neighbouring axes show: a third to a half of the way off the middle.

    Returns
    -------
    (n,)
        rad or m.
    """
    span = np.where(arm.prismatic, 0.5, np.pi / 2)
    lower = np.where(np.isfinite(arm.lower), np.maximum(arm.lower, -2 * span), -span)
    upper = np.where(np.isfinite(arm.upper), np.minimum(arm.upper, 2 * span), span)
    middle, half = (lower + upper) / 2, np.minimum((upper - lower) / 2, span)
    turn = np.resize([0.35, 0.15, 0.2, 0.45, 0.5, 0.3], arm.num_joints)
    return np.asarray(middle + turn * half)


def arm_figure(arm: Arm, sprung: Sequence[bool], tcp: Floats) -> tuple[str, list[Floats]]:
    """Stick pictures at zero and at a bent posture.

    Parameters
    ----------
    sprung : n + 1 bools
        Which links carry a spring; their frames are drawn.
    tcp : (3,)
        Tool centre point in the flange frame, m.

    Returns
    -------
    picture : data URI
    postures : the two postures shown, rad or m
    """
    postures = [np.zeros(arm.num_joints), bent_posture(arm)]
    made = f.Figure(figsize=(11.0, 5.4))
    for place, (q, title) in enumerate(zip(postures, ("all joints at zero", "bent"), strict=True)):
        ax = made.add_axes((0.48 * place, -0.04, 0.52, 1.04), projection="3d", facecolor="none")
        assert isinstance(ax, Axes3D)
        draw_arm(ax, arm, forward(arm, q[:, None]), sprung, tcp)
        made.text(0.04 + 0.5 * place, 0.95, title, fontsize=12, fontweight="bold")
    return f.uri(made), postures


def draw_arm(ax: Axes3D, arm: Arm, poses: Poses, sprung: Sequence[bool], tcp: Floats) -> None:
    """One posture as sticks, with the frames of links that carry a spring and short names."""
    frames = [p[:, 0] for p in poses.p_F]
    tool = poses.points(tcp)[0][:, 0]
    chain = np.stack([np.zeros(3), *frames])
    size = float(max(np.ptp(np.vstack([chain, tool[None]]), axis=0).max(), 1e-3))
    joints = [p[:, 0] for p in poses.p_J]
    ax.plot(*chain.T, color="#56616c", linewidth=5, alpha=0.55, solid_capstyle="round")
    ax.plot(*np.stack([frames[-1], tool]).T, color=f.AMBER, linewidth=3)
    ax.scatter(*tool[:, None], color=f.AMBER, s=26, depthshade=False)
    for point, axis in zip(joints, poses.axis, strict=True):
        along = np.broadcast_to(axis, (3, 1))[:, 0] * 0.11 * size
        ax.plot(*np.stack([point - along, point + along]).T, color=f.INK, linewidth=1.1, linestyle=(0, (4, 2)))
        ax.scatter(*point[:, None], color=f.INK, s=16, depthshade=False)
    for k, origin in enumerate(frames):
        if not sprung[k]:
            continue
        R = poses.R_F[k][:, :, 0]
        for c, colour in enumerate(f.XYZ):
            ax.plot(*np.stack([origin, origin + 0.075 * size * R[:, c]]).T, color=colour, linewidth=2.4)
    _name(ax, chain, joints, tool, size)
    _fit(ax, np.vstack([chain, tool[None]]), size)


def _name(ax: Axes3D, chain: Floats, joints: list[Floats], tool: Floats, size: float) -> None:
    """Short names, those at one place in one label: J for joints, L for the middles of links that have a length."""
    places: list[tuple[Floats, list[str]]] = []
    for i, point in enumerate(joints):
        near = next((names for where, names in places if np.linalg.norm(where - point) < 0.06 * size), None)
        if near is None:
            places.append((point, [f"J{i + 1}"]))
        else:
            near.append(f"J{i + 1}")
    aside = np.array([0.03, 0.03, 0.045]) * size
    for where, names in places:
        ax.text(*(where + aside), ",".join(names), fontsize=10.5, fontweight="bold", color=f.INK)
    for k in range(len(chain) - 1):
        if np.linalg.norm(chain[k + 1] - chain[k]) > 0.12 * size:
            ax.text(*((chain[k] + chain[k + 1]) / 2 - aside), f"L{k}", fontsize=10.5, color=f.GREY, fontstyle="italic")
    ax.text(*(tool + aside), "TCP", fontsize=9.5, color="#9a6a00")


def _fit(ax: Axes3D, points: Floats, size: float) -> None:
    """Equal scales on all axes, in a box not much larger than the arm."""
    middle = (points.max(axis=0) + points.min(axis=0)) / 2
    half = np.maximum(np.ptp(points, axis=0) / 2 + 0.12 * size, 0.22 * size)
    for set_limits, centre, reach in zip((ax.set_xlim, ax.set_ylim, ax.set_zlim), middle, half, strict=True):
        set_limits(centre - reach, centre + reach)
    ax.set_box_aspect(tuple(half), zoom=0.86)
    ax.view_init(elev=22, azim=-58)
    for axis, name, reach in zip((ax.xaxis, ax.yaxis, ax.zaxis), "xyz", half, strict=True):
        axis.set_label_text(f"{name}, m")
        axis.label.set_fontsize(10)
        axis.set_tick_params(labelsize=8)
        axis.set_major_locator(MaxNLocator(max(2, round(5 * reach / half.max())), steps=[1, 2, 5, 10]))
        axis.set_pane_color((0.96, 0.97, 0.98, 1.0))
