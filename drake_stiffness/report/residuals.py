"""Does the model explain the readings? Residuals by experiment, direction, load and joint, beside what noise alone leaves."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from drake_stiffness.report import identification_plots as plots
from drake_stiffness.report import page as h
from drake_stiffness.report.evidence import Evidence, rms, rms_3d

if TYPE_CHECKING:
    from drake_stiffness.jobs import Identified


def residual_parts(result: Identified, e: Evidence) -> list[h.Markup]:
    """Tables and pictures of the residuals."""
    counts = result.model.fit["experiments"]
    rows = [("fitted", counts["fitted"], e.fitted.case.size, *_directions(e.residual_mm), h.number(e.fit_noise_mm))]
    if e.held_mm.size:
        rows.append(
            ("held out", counts["held_out"], e.held_mm.shape[1], *_directions(e.held_mm), h.number(e.held_noise_mm))
        )
    header = ("readings", "experiments", "number", "x, mm", "y, mm", "z, mm", "3-D, mm", "noise alone, 3-D, mm")
    table = h.table(header, rows, caption=_about_rms(result, e), align="lrrrrrrr")
    band = "Grey band: where 98 % of the experiments lie if noise is all there is. " if np.isfinite(e.left) else ""
    scale = " (each divided by what the fit leaves of the noise)" if np.isfinite(e.left) else ""
    far = float((np.abs(e.z / (e.left if np.isfinite(e.left) else 1.0)) > 3).mean())
    parts = [
        table,
        h.figure(
            plots.experiments_figure(e),
            f"Residuals by experiment and direction, in units of the stated noise. {band}An experiment far above the others deserves a "
            "look at its readings; one direction above the others points at the tracker or at a missing spring.",
            "Residual RMS by experiment and direction",
        ),
        _worst(e),
        h.figure(
            plots.histogram_figure(e),
            f"All residuals{scale} against the normal distribution that the stated noise promises; outliers are counted in the outermost "
            f"bars. {100 * far:.1f} % lie beyond 3 standard deviations (noise alone: 0.3 %).",
            "Histogram of residuals against the normal distribution",
            width=70,
        ),
    ]
    if e.force_N.max() > 0:
        parts.append(
            h.figure(
                plots.load_figure(e),
                "Residuals against the size of the applied force (0: the unloaded steps). Lines that rise with the force mean that "
                "something elastic is missing; level lines mean noise.",
                "Residuals against applied force",
            )
        )
    if result.campaign.quantity == "position":
        arm = result.model.arm
        parts.append(
            h.figure(
                plots.joint_figure(e, arm.joint_names, arm.prismatic),
                "Mean residual by position of each joint. Where a line leaves the grey band of chance, something that depends on this "
                "joint is missing in the model (a periodic gear error, a spring that is not linear, an axis that wobbles).",
                "Mean residual by joint position",
            )
        )
    return parts


def _directions(error_mm: np.ndarray) -> tuple[str, ...]:
    return (*(h.number(rms(error_mm[c])) for c in range(3)), h.number(rms_3d(error_mm)))


def _about_rms(result: Identified, e: Evidence) -> str:
    text = "Root mean square of measured minus modelled. 3-D: length of the error vector, so noise alone gives sqrt(3) times the noise of one coordinate"
    if result.campaign.quantity == "displacement":
        text += "; less in fitted readings (unknowns take up some of it), more in held-out ones (their unloaded reference is noisy too)"
    return text + "."


def _worst(e: Evidence) -> h.Markup:
    """The experiments that fit worst, by name, for the engineer who goes back to the log book."""
    number = len(e.fitted.experiments)
    count = np.bincount(e.experiment, minlength=number)
    square = np.stack([np.bincount(e.experiment, weights=e.z[c] ** 2, minlength=number) for c in range(3)])
    total = np.sqrt(square.sum(axis=0) / np.maximum(3 * count, 1))
    rows = [
        (
            e.fitted.experiments[i],
            count[i],
            h.number(total[i] * e.sigma_mm * np.sqrt(3)),
            h.number(total[i], 2),
            "xyz"[int(square[:, i].argmax())],
        )
        for i in np.argsort(-total)[:5]
    ]
    header = ("experiment", "readings", "residual 3-D RMS, mm", "in units of noise", "mostly in")
    return h.table(header, rows, caption="The experiments that fit worst.", align="lrrrc")
