"""The account of a correction point by point, as CSV (`compensate --points`)."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from toolpaths.result import Compensation

COLUMNS = (
    "line",
    *(f"{axis}_mm" for axis in "xyz"),
    *(f"correction_{axis}_mm" for axis in "xyz"),
    "deviation_before_mm",
    "deviation_after_mm",
    "interval_low_mm",
    "interval_high_mm",
    "sigma_parameters_mm",
    "sigma_force_mm",
    "sigma_model_form_mm",
    "joints_only_mm",
    *(f"f{axis}_N" for axis in "xyz"),
    "unsupported_share",
    "tool_turn_deg",
    "correction_change_per_mm",
)


def points_csv(result: Compensation) -> str:
    """Places and corrections in the program's base frame, forces in world axes; an empty cell where nothing is known."""
    return "".join(_lines(result))


def _lines(result: Compensation) -> Iterator[str]:
    account, interval = result.account, result.account.interval
    yield ",".join(COLUMNS) + "\n"
    columns = [
        *result.target_mm.T,
        *result.correction_mm.T,
        result.before_mm,
        result.after_mm,
        interval.low_mm,
        interval.high_mm,
        interval.parameters_mm,
        interval.force_mm,
        interval.form_mm,
        account.causes.joints_only_mm,
        *result.force_N.T,
        result.unsupported,
        np.zeros(result.rows.size) if result.spin is None else np.degrees(result.spin.angle_rad),
        account.evenness.change_per_mm,
    ]
    form = "%d," + ",".join(["%.6g"] * len(columns)) + "\n"
    # Target places keep the digits that programs print.
    form = form.replace("%.6g", "%.10g", 3)
    for row in zip(result.line.tolist(), *(np.asarray(c, dtype=float).tolist() for c in columns), strict=True):
        yield (form % row).replace("nan", "")
