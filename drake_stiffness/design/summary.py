"""What a plan is worth, in words and numbers: efficiency, certificate, gain over random plans, predicted ratios."""

from __future__ import annotations

from typing import Any

import numpy as np

from drake_stiffness.base_parameters import base_of
from drake_stiffness.design.assumptions import Interest, parameters_of_interest
from drake_stiffness.design.design import Designed
from drake_stiffness.thresholds import LOWER_RATIO, UPPER_RATIO

# So many weak parameters are named in words.
_NAMED = 8

# What 1 / sqrt(phi) is: a standard deviation, in the words and unit of the criterion.
_MEANING = {
    "d": ("geometric mean sigma of all combinations", "units of scale", 1.0),
    "a": ("root mean square sigma of all combinations", "units of scale", 1.0),
    "e": ("sigma of the worst-known combination", "units of scale", 1.0),
    "toolpath": ("sigma of the displacement along the program, rms of its length", "mm", 1e3),
    "ratio": ("sigma over assumed value of the worst parameter of interest", "", 1.0),
    "ds": ("sigma of the suspected effect's parameters, geometric mean", "units of scale", 1.0),
}


def figure_of_merit(d: Designed) -> tuple[str, str, float]:
    """What the criterion is about, its unit, and its value for the plan (smaller is better)."""
    words, unit, factor = _MEANING[d.criterion.name]
    return words, unit, factor / float(np.sqrt(d.value))


def gain(d: Designed) -> float:
    """By which factor the same figure is larger for the median of random plans; NaN without them."""
    return float(np.sqrt(d.value / np.median(d.random))) if d.random.size else float("nan")


def predicted_ratios(d: Designed) -> list[dict[str, Any]]:
    """Every base parameter of interest: assumed value, predicted sigma (SI), ratio (20) with the stated noise."""
    return _ratios(d, d.space.interest())


def weak_parameters(d: Designed) -> list[dict[str, Any]]:
    """Base parameters with an assumed value whose predicted ratio stays below the threshold, the worst first; `far` marks those below
    two fifths of it (2 where 5 is wanted, as between G1~ and G1-)."""
    space = d.space
    every = space.settings.model_copy(update={"parameters": "all"})
    rows = _ratios(d, parameters_of_interest(space.base_model, base_of(space.view, space.base_model), every))
    threshold = space.settings.threshold
    low = sorted((row for row in rows if row["ratio"] < threshold), key=lambda row: row["ratio"])
    return [
        {"name": row["name"], "ratio": row["ratio"], "far": row["ratio"] < LOWER_RATIO / UPPER_RATIO * threshold}
        for row in low
    ]


def _ratios(d: Designed, interest: Interest) -> list[dict[str, Any]]:
    model = d.space.base_model
    basis = d.space.basis[: model.x.size]
    sigma = np.sqrt(np.einsum("ki,ij,kj->k", interest.c @ basis, d.covariance, interest.c @ basis))
    place = {name: i for i, name in enumerate(model.names)}
    rows = []
    for name, value, s in zip(interest.names, interest.value, sigma, strict=True):
        i = place[name]
        rows.append(
            {
                "name": name,
                "assumed": float(value * model.scales[i]),
                "sigma": float(s * model.scales[i]),
                "unit": model.parameters[i].unit,
                "ratio": float(abs(value) / s),
            }
        )
    return rows


def verdict(d: Designed) -> str:
    """The answer in a few sentences."""
    space, n = d.space, len(d.chosen)
    words, unit, figure = figure_of_merit(d)
    before = "" if space.measured is None else f" on top of {len(space.measured.experiments)} measured"
    text = (
        f"{n} postures{before}, chosen from {space.candidates.number} by criterion {d.criterion.name}: {words} {figure:.3g} {unit}".rstrip()
        + f". Certified: no {n} of these candidates have more than {100 * (1 / d.efficiency - 1):.1f} % more information (efficiency "
        f"{d.efficiency:.3f})."
    )
    if d.random.size:
        text += f" The median of {d.random.size} random plans of equal size has {gain(d):.2f} times that sigma."
    text += (
        f" All {space.basis.shape[1]} combinations that the candidates determine are determined by the plan."
        + _weak_words(d)
    )
    if d.fewest is not None and d.reached:
        text += (
            f" It is the smallest plan found whose parameters of interest all exceed ratio {space.settings.threshold:g}; fewer than "
            f"{d.fewest} cannot do it."
        )
    elif d.fewest is not None:
        worst = min(row["ratio"] for row in predicted_ratios(d))
        text += (
            f" NOT REACHED: the worst ratio is {worst:.2g}, below {space.settings.threshold:g}; certified, fewer than {d.fewest} such postures "
            "cannot do it. More postures (-n), stronger loads or a better tracker are needed."
        )
    return text


def _weak_words(d: Designed) -> str:
    """Determined is a matter of rank, known one of size: what is determined and still lost in its sigma."""
    low, threshold = weak_parameters(d), d.space.settings.threshold
    if not low:
        return ""
    far = [f"{row['name']} ({row['ratio']:.2g})" for row in low if row["far"]]
    more = f" and {len(far) - _NAMED} more (--json has all)" if len(far) > _NAMED else ""
    return (
        f" That is a matter of rank: at the assumed values {len(low)} of their base parameters stay below ratio {threshold:g}"
        + (f", {len(far)} of them far below it: {', '.join(far[:_NAMED])}{more}." if far else ", none far below it.")
    )


def summary(d: Designed) -> dict[str, Any]:
    """The numbers for `--json`."""
    space = d.space
    words, unit, figure = figure_of_merit(d)
    return {
        "criterion": d.criterion.name,
        "postures": len(d.chosen),
        "candidates": space.candidates.number,
        "share_of_random_postures_kept": space.candidates.share,
        "combinations": int(space.basis.shape[1]),
        "singular_gap": space.view.gap,
        "information": d.value,
        "bound": d.relaxation.bound,
        "efficiency": d.efficiency,
        "relaxed_efficiency": d.relaxation.value / d.relaxation.bound,
        "figure": {"meaning": words, "unit": unit, "value": figure},
        "random_plans": {
            "number": int(d.random.size),
            "median_efficiency": float(np.median(d.random)) / d.relaxation.bound if d.random.size else None,
            "sigma_gain_over_median": gain(d),
        },
        "fewest_possible": d.fewest,
        "threshold_reached": d.reached if d.fewest is not None else None,
        "parameters": predicted_ratios(d),
        "below_threshold": weak_parameters(d),
        "measured_before": [] if space.measured is None else list(space.measured.experiments),
    }
