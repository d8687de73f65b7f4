"""A picture of which way a cut pushes the tool: seen from the spindle, and from the side."""

from __future__ import annotations

from typing import Any

import numpy as np


def arrow(ax: Any, start: tuple[float, float], step: tuple[float, float], colour: str, text: str, **more: Any) -> None:
    """An arrow with a word at its head."""
    end = (start[0] + step[0], start[1] + step[1])
    ax.annotate("", xy=end, xytext=start, arrowprops={"arrowstyle": "-|>", "color": colour, "lw": 2})
    ax.text(end[0], end[1], text, color=colour, **{"ha": "center", "va": "bottom", **more})


def draw(ax: Any) -> None:
    """Left: a slot seen from the spindle. Right: the tool from the side."""
    from matplotlib.patches import Arc, Circle, Rectangle

    ax.add_patch(Rectangle((-2.4, -1.9), 4.9, 3.8, color="0.87"))
    ax.add_patch(Rectangle((-2.4, -1.0), 2.4, 2.0, color="white"))
    ax.add_patch(Circle((0, 0), 1.0, facecolor="white", edgecolor="0.3", lw=1.5))
    ax.add_patch(Arc((0, 0), 1.3, 1.3, theta1=-40, theta2=220, color="0.5"))
    ax.annotate("", xy=(0.47, -0.48), xytext=(0.55, -0.34), arrowprops={"arrowstyle": "-|>", "color": "0.5"})
    ax.text(0, -0.8, "clockwise", ha="center", color="0.4", fontsize=8)
    arrow(ax, (0, 0), (1.6, 0), "tab:blue", " x, feed\n of the tool", va="center", ha="left", fontsize=9)
    arrow(ax, (0, 0), (0, 1.4), "0.2", " y, left", ha="left", va="center", fontsize=9)
    arrow(ax, (0, 0), (-0.62, 1.37), "tab:red", "mean force on the tool", ha="right", va="bottom", fontsize=9)
    ax.text(1.6, 1.05, "up cut:\nmaterial here", ha="center", va="center", fontsize=8)
    ax.text(1.6, -1.05, "down (climb) cut:\nmaterial here", ha="center", va="center", fontsize=8)
    ax.text(0, -2.3, "a slot seen from the spindle", ha="center")
    x = 5.2
    ax.add_patch(Rectangle((x - 2.0, -1.9), 4.0, 1.0, color="0.87"))
    ax.add_patch(Rectangle((x + 0.45, -0.9), 1.55, 1.0, color="0.87"))
    ax.add_patch(Rectangle((x - 0.45, -0.9), 0.9, 2.2, facecolor="white", edgecolor="0.3", lw=1.5))
    for low in np.linspace(-0.8, 0.7, 4):
        ax.plot([x - 0.45, x + 0.45], [low, low + 0.5], color="0.6", lw=1)
    arrow(ax, (x, 1.3), (0, 0.6), "0.2", " z, to the spindle", ha="left", va="center", fontsize=9)
    arrow(ax, (x - 0.9, 0.5), (0, -0.9), "tab:red", "", va="top")
    ax.text(
        x - 1.3,
        0.55,
        "axial force:\na right-hand helix\npulls to the tip",
        color="tab:red",
        ha="center",
        va="bottom",
        fontsize=8,
    )
    ax.text(x, -2.3, "from the side", ha="center")
    ax.set(xlim=(-2.6, 7.4), ylim=(-2.5, 2.3), aspect="equal")
    ax.axis("off")
