"""Figures as data URIs: matplotlib without pyplot, so no backend, window or global state is touched.

Small plots are SVG, clouds of thousands of points PNG. Names from users may hold `$`, which matplotlib takes for
mathematics: `plain` keeps them literal.
"""

from __future__ import annotations

import base64
import io
import re
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.axis import Axis
from matplotlib.figure import Figure
from matplotlib.ticker import FuncFormatter, NullFormatter
from numpy.typing import NDArray

Floats = NDArray[np.float64]

# Okabe and Ito: told apart by colour-blind readers and in grey.
BLUE, ORANGE, GREEN, PURPLE, SKY, AMBER = "#0072b2", "#d55e00", "#009e73", "#aa4499", "#56b4e9", "#e69f00"
GREY, INK = "#8a949e", "#1b1f24"
XYZ = (ORANGE, GREEN, BLUE)
SERIES = (GREY, ORANGE, BLUE, GREEN, PURPLE, AMBER)

# More points than this are drawn as PNG, and lines as an envelope of so many pieces.
MANY = 2000
PIECES = 800
# Below this (a nanometre) a logarithmic axis shows nothing of interest.
FLOOR_MM = 1e-6
# The names that matplotlib draws by lot.
_RANDOM = "[A-Za-z][0-9a-f]{10}|image[0-9a-f]{8,10}"


def new(height: float, rows: int = 1, columns: int = 1, *, width: float = 10.0, **options: Any) -> tuple[Figure, Any]:
    """A figure of `width` x `height` inches and its axes, as `matplotlib.pyplot.subplots` would make them."""
    made = Figure(figsize=(width, height), layout="constrained")
    axes = made.subplots(rows, columns, **options)
    for ax in np.atleast_1d(axes).ravel():
        tidy(ax)
    return made, axes


def tidy(ax: Axes) -> None:
    """Light frame and grid."""
    for side in ("top", "right"):
        ax.spines[side].set_visible(False)
    ax.grid(color="#e3e7eb", linewidth=0.7)
    ax.set_axisbelow(True)
    ax.tick_params(labelsize=10)
    ax.xaxis.label.set_fontsize(11)
    ax.yaxis.label.set_fontsize(11)
    ax.title.set_fontsize(11)


def uri(made: Figure, *, many: bool = False) -> str:
    """The picture as a data URI: SVG, or PNG where it shows many points."""
    stream = io.BytesIO()
    if many:
        made.savefig(stream, format="png", dpi=110)
        return f"data:image/png;base64,{base64.b64encode(stream.getvalue()).decode('ascii')}"
    made.savefig(stream, format="svg", metadata=dict.fromkeys(("Creator", "Date", "Format", "Type")))
    text = stream.getvalue().decode()
    drawing = _numbered(text[text.index("<svg") :])
    return f"data:image/svg+xml;base64,{base64.b64encode(drawing.encode()).decode('ascii')}"


def _numbered(drawing: str) -> str:
    """The same SVG with the random names of clip paths, markers and images numbered, so that equal input gives equal pages."""
    names = list(dict.fromkeys(re.findall(rf'id="({_RANDOM})"', drawing)))
    number = {name: f"i{place}" for place, name in enumerate(names)}
    return re.sub(rf'(?<=["#])({_RANDOM})(?=["_)])', lambda found: number.get(found[1], found[1]), drawing)


def plain(text: object) -> str:
    """A name as matplotlib shall print it, dollar signs and all."""
    return str(text).replace("$", r"\$")


def shortened(text: str, length: int = 18) -> str:
    """A name that fits an axis, its middle left out."""
    if len(text) <= length:
        return text
    half = (length - 1) // 2
    return f"{text[:half]}…{text[len(text) - half :]}"


def envelope(x: Floats, y: Floats) -> tuple[Floats, Floats, Floats, Floats]:
    """Middle of x, mean, smallest and largest y of pieces of a long line; the line itself where it is short.

    Parameters
    ----------
    x, y : (N,)

    Returns
    -------
    x, mean, low, high : (P,)
    """
    if x.size <= 2 * PIECES:
        return x, y, y, y
    starts = np.unique(np.linspace(0, x.size, PIECES + 1).astype(int)[:-1])
    count = np.diff(np.append(starts, x.size))
    mean = np.add.reduceat(y, starts) / count
    middle = np.add.reduceat(x, starts) / count
    return middle, mean, np.minimum.reduceat(y, starts), np.maximum.reduceat(y, starts)


def line(ax: Axes, x: Floats, y: Floats, colour: str, label: str, *, width: float = 1.4) -> None:
    """A line, or for very many points its mean with a band from smallest to largest."""
    middle, mean, low, high = envelope(x, y)
    if middle.size < x.size:
        ax.fill_between(middle, low, high, color=colour, alpha=0.25, linewidth=0)
    marker = "o" if x.size == 1 else None
    ax.plot(middle, mean, color=colour, label=label, linewidth=width, marker=marker)


def log_mm(values: Floats) -> Floats:
    """Sizes for a logarithmic axis: zeros are lifted to a floor that no reading resolves."""
    return np.maximum(values, FLOOR_MM)


def log_axis(axis: Axis) -> None:
    """A logarithmic axis labelled 0.001, 0.01, 0.1 rather than by powers."""
    axis.set_major_formatter(FuncFormatter(lambda value, place: f"{value:g}"))
    axis.set_minor_formatter(NullFormatter())


def legend(ax: Axes, **options: Any) -> None:
    """A legend above the axes, in one row."""
    columns = len(ax.get_legend_handles_labels()[0])
    settings = {"loc": "lower left", "bbox_to_anchor": (0.0, 1.0), "ncols": columns, "frameon": False, "fontsize": 10}
    ax.legend(**(settings | options))
