"""How large the error of a model's form is, as far as readings show it: what they leave beyond noise and parameters.

With whitened residuals r of readings that took no part in the fit, columns A and the covariance C of the parameters,

    E |r|^2 = dof + tr(A C A^T) + |e|^2

where e is what the model cannot say whatever its values. |e|^2 against the power |d|^2 of the whitened displacements is a
relative error, which a prediction of other loads and postures carries along. It says nothing of what those readings do not
excite, and an error that hides below the noise counts as none: `detectable` says how large that could be.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from drake_stiffness.rotations import Array

if TYPE_CHECKING:
    from drake_stiffness.identification import Solution
    from drake_stiffness.model import Model, Statistics
    from drake_stiffness.observation import Observations
    from drake_stiffness.trust import HeldOut


def model_form(
    solution: Solution, statistics: Statistics, o: Observations, held: HeldOut | None = None
) -> dict[str, Any]:
    """The relative error of form, for `fit.model_form` of model.json.

    Parameters
    ----------
    o : Observations
        Of the readings that are asked: those of `held`, or the fitted ones.
    held : HeldOut, optional
        Residuals of readings that took no part; without them the fit's own are asked, which is milder.

    Returns
    -------
    dict
        `relative` (of the displacement), `detectable` (an error that chi-square would show at two of its standard
        deviations), `readings` ("held out" or "fitted"); null where there are no degrees of freedom or no displacement.
    """
    from drake_stiffness.observation import predicted

    model = solution.model
    moved = predicted(o, model) - predicted(o, model.with_x(_rigid(model)))
    power = float(moved @ moved)
    if held is None:
        residual, dof = solution.residual, o.rows - o.references - solution.identifiability.rank
        spread = 0.0
    else:
        residual, dof = held.residual, held.freedom
        C = statistics.covariance / np.outer(model.scales, model.scales)
        spread = float(np.einsum("ri,ij,rj->", held.A, C, held.A, optimize=True))
    if dof <= 0 or power <= 0.0:
        return {"relative": None, "detectable": None, "readings": "held out" if held else "fitted"}
    excess = max(float(residual @ residual) - dof - spread, 0.0)
    return {
        "relative": float(np.sqrt(excess / power)),
        "detectable": float(np.sqrt(2 * np.sqrt(2 * dof) / power)),
        "readings": "held out" if held else "fitted",
    }


def _rigid(model: Model) -> Array:
    """The model's values with nothing that gives way."""
    x = model.x.copy()
    for effect, own in zip(model.effects, model.slices, strict=True):
        if effect.station == "spring":
            x[own] = 0.0
    return x


def stated(fit: dict[str, Any]) -> float:
    """The relative error of form of a stored model; NaN where its file does not say it (earlier versions)."""
    value = (fit.get("model_form") or {}).get("relative")
    return float("nan") if value is None else float(value)
