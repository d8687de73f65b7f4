"""How much of a predicted compensation to believe: everything that limits the accuracy, beside each other."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from drake_stiffness.model_form import stated
from drake_stiffness.report import page as h

if TYPE_CHECKING:
    from drake_stiffness.model import Model
    from toolpaths.result import Compensation


def limits(result: Compensation, model: Model) -> list[h.Markup]:
    """A paragraph and a table: what the real arm adds to the model's prediction."""
    fit = model.fit
    sigma = result.sigma_mm[np.isfinite(result.sigma_mm)]
    held = fit.get("held_out_rms_mm")
    form = float(result.account.interval.form_mm.mean()) if np.isfinite(stated(fit)) else float("nan")
    share = float(result.unsupported.max(initial=0.0))
    rows = [
        ("residual predicted, as printed (mean)", h.length(float(result.after_mm.mean())), "computed above"),
        ("half a printed digit, per coordinate", h.length(result.quantum_mm), "decimals of the program"),
        (
            "uncertainty of the model, 1 sigma (mean)",
            h.length(float(sigma.mean()) if sigma.size else None, 2),
            "noise of the campaign, carried to this path and force",
        ),
        (
            "error of the model on held-out readings, 3-D RMS",
            h.length(held),
            "at the campaign's loads, noise of the tracker included",
        ),
        (
            "part of the prediction that the campaign does not support",
            f"{100 * share:.1f} %",
            "at most, along the path; above 20 % the program is refused",
        ),
        ("repeatability of the robot", "see its data sheet", "ISO 9283; often 0.03 to 0.1 mm for large arms"),
        (
            "process force assumed, 1 sigma (mean)",
            h.length(float(result.account.interval.force_mm.mean()))
            if result.account.relative_sigma.any()
            else "not stated",
            "force.relative_sigma of process.yaml; 10 % too much or too little leaves 10 % of the deviation",
        ),
        (
            "error of the model's form, 1 sigma (mean)",
            h.length(form, 2) if np.isfinite(form) else "not known",
            "what held-out readings leave beyond noise, carried to this path",
        ),
    ]
    text = (
        "The deviations above are the model's own predictions: they show that the corrected program does what the model asks, not that "
        "the robot does. On the real arm three things come on top, and usually they are larger: its repeatability, the error of the model "
        "(effects that it does not have, such as backlash, are not in its sigma), and the force, which is an assumption. The uncertainty "
        "stated is one standard deviation from the noise of the identification campaign. A few laser-tracker readings or a test cut "
        "under force decide."
    )
    return [
        h.paragraph(text),
        h.table(("what limits the accuracy", "size", "where it comes from"), rows, align="lrl"),
    ]
