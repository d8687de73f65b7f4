"""Where the ratio of value to standard deviation (seed eq. 20) divides G1+, G1~ and G1-; light, for the command line imports it."""

from __future__ import annotations

from math import isfinite

from drake_stiffness.errors import InputError

UPPER_RATIO, LOWER_RATIO = 5.0, 2.0


def check_thresholds(upper: float, lower: float) -> None:
    """Raise InputError unless 0 <= lower <= upper."""
    if not (isfinite(upper) and isfinite(lower) and 0 <= lower <= upper):
        raise InputError(
            f"--upper {upper:g} --lower {lower:g}: expected two ratios of value to standard deviation, 0 <= lower <= upper, such as "
            "5 and 2."
        )
