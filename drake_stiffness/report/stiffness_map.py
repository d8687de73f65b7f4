"""The report of `map`: a picture from above for every height, the best place, the table of states."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

import drake_stiffness
from drake_stiffness.report import figures as f
from drake_stiffness.report import page as h

if TYPE_CHECKING:
    from drake_stiffness.model import Model
    from toolpaths.process import Process
    from toolpaths.stiffness_map import StiffnessMap


# A marker is drawn on pictures of about its height.
_SAME_HEIGHT_M = 0.1


def map_report(found: StiffnessMap, model: Model, process: Process) -> str:
    """The page of `map --report`."""
    best, unit = found.best, "mm of mean deflection along the program" if found.by_program else "um per 100 N"
    what = (
        "Mean predicted deflection along the program"
        if found.by_program
        else "Deflection under 100 N in the direction that bends most"
    )
    x, y, z = found.place_m[best]
    here = found.measure[found.here]
    sentence = f"Best place: x {x:.3f}, y {y:.3f}, z {z:.3f} m with {found.measure[best]:.4g} {unit}"
    sentence += f"; as it is now {here:.4g}." if np.isfinite(here) else "; as it is now the arm cannot machine there."
    heights = np.unique(found.place_m[:-1, 2].round(9))
    figures = [_picture(found, height, f"{what} at z = {height:.3f} m, seen from above.") for height in heights]
    states, counts = np.unique(found.state[:-1], return_counts=True)
    return h.page(
        "Stiffness map of the cell",
        f"{len(found.place_m) - 1} places, process {process.path.name}.",
        h.verdict(sentence),
        h.section("The map", *figures),
        h.section("Places", h.table(("state", "places"), list(zip(states.tolist(), counts.tolist(), strict=True)))),
        h.section(
            "How it was computed",
            h.paragraph(
                "Linear deflection J k J^T W of the identified springs at every place, on the arm branch of posture_deg, without weight. "
                f"Springs: {len(model.effects)} effects of the model. A map compares places; what a program is corrected by is the loaded "
                "equilibrium."
            ),
        ),
        footer=f"Made by drake-stiffness {drake_stiffness.__version__}.",
    )


def _picture(found: StiffnessMap, height: float, caption: str) -> h.Markup:
    level = np.abs(found.place_m[:, 2] - height) < 1e-9
    level[found.here] = False
    place, value = found.place_m[level], found.measure[level]
    known = np.isfinite(value)
    made, ax = f.new(6.0, width=8.0)
    shown = np.isfinite(found.measure)
    low, high = (found.measure[shown].min(), found.measure[shown].max()) if shown.any() else (0.0, 1.0)
    side = max(3.0, 300.0 / np.sqrt(len(place)))
    ax.plot(*place[~known, :2].T, "x", color=f.GREY, markersize=5, label="cannot be machined")
    dots = ax.scatter(
        *place[known, :2].T, c=value[known], s=side**2, marker="s", cmap="viridis", vmin=low, vmax=high, linewidths=0
    )
    for index, style, label in ((found.here, "o", "as it is now"), (found.best, "*", "best place")):
        if abs(found.place_m[index, 2] - height) < _SAME_HEIGHT_M:
            ax.plot(
                *found.place_m[index, :2], style, color=f.ORANGE, markeredgecolor="white", markersize=15, label=label
            )
    ax.plot(0.0, 0.0, "s", color=f.INK, markersize=9, label="robot base")
    ax.set_aspect("equal")
    ax.set_xlabel("x, m (world)")
    ax.set_ylabel("y, m (world)")
    made.colorbar(dots, ax=ax, label="mm" if found.by_program else "um per 100 N")
    f.legend(ax)
    return h.figure(f.uri(made, many=True), caption, caption)
