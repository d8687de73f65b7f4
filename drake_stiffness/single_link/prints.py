"""What the source paper prints of its single-link example, and matrix (15) rebuilt from it.

The link's true compliance matrix (15) is lost in the text. It follows from three prints:

1. an entry of the estimate (25) over its ratio in (17) is the standard deviation of that entry (M1 and M2 hardly move the
   entries used here), which gives one standard deviation for rows 1 to 3 and one for rows 4 to 6;
2. an exact ratio of (18) times that standard deviation is the size of an entry of (15); an entry and its twin across the
   diagonal are printed with different numbers of digits, and the finer print is taken;
3. the signs off the diagonal come from (25), because (18) prints absolute values.

So agreement with (18) shows that the prints fit together; it is no proof of (15), which was made from (18).
"""

from __future__ import annotations

from dataclasses import dataclass
from decimal import Decimal

import numpy as np
from numpy.typing import NDArray

from drake_stiffness.rotations import Array
from drake_stiffness.springs import spring_template


@dataclass(frozen=True, eq=False)
class Print:
    """A 6x6 table as printed.

    Attributes
    ----------
    value : (6, 6)
    half_digit : (6, 6)
        Half a unit of the last printed digit; 0 where a bare 0 is printed.
    """

    value: Array
    half_digit: Array


def _print(text: str) -> Print:
    words = [Decimal(word) for word in text.split()]
    last = [0.0 if not word else 0.5 * 10.0 ** int(word.as_tuple().exponent) for word in words]
    return Print(np.array([float(word) for word in words]).reshape(6, 6), np.array(last).reshape(6, 6))


# Ratios of the estimate; the bars of the absolute value are lost in print, and one minus sign with them is not.
PRINTED_17 = _print(
    """
    0.12 0.35  0.74 0.64 0.31 0.46
    1.81 322   0.83 0.79 0.46 1593
    0.91 1.50  146  0.89 684  0.45
    0.06 0.73  0.28 1504 0.44 1.64
    1.31 0.49 -67.3 1.60 436  2.02
    1.04 159   0.42 0.11 0.02 1060
    """
)
# The same of the exact values.
PRINTED_18 = _print(
    """
    0.18 0   0    0    0   0
    0    320 0    0    0   1592
    0    0   146  0    684 0
    0    0   0    1504 0   0
    0    0   68.4 0    436 0
    0    159 0    0    0   1060
    """
)
# The estimate after M1 and M2, SI; "-3.0510^-8" in the text is -3.05e-8.
PRINTED_25 = _print(
    """
    -3.05e-8 0        0        0       0        0
    0        8.05e-5  0        0       0        3.98e-4
    0        0        3.64e-5  0      -1.71e-4  0
    0        0        0        3.76e-3 0        0
    0        0       -1.71e-4  0       1.09e-3  0
    0        3.98e-4  0        0       0        2.65e-3
    """
)

# Where (24) has a star: the ten places of the eight entries of a beam along x.
NONZERO: NDArray[np.bool_] = spring_template("beam", "x").basis.sum(axis=0) > 0
ROTATION_ROW: NDArray[np.bool_] = np.arange(6) >= 3


def names_of(places: NDArray[np.bool_]) -> tuple[str, ...]:
    """`k11`, `k26`, ... of the marked places, row by row."""
    return tuple(f"k{i + 1}{j + 1}" for i, j in np.argwhere(places).tolist())


@dataclass(frozen=True, eq=False)
class Reconstruction:
    """Matrix (15) rebuilt from (17), (18) and (25).

    Attributes
    ----------
    sigma_low, sigma_high : (2,)
        Standard deviations of an entry in rows 1-3 and in rows 4-6 that every print allows (prints are rounded), SI.
    sigma : (2,)
        The value of two digits inside both: what is used.
    compliance : (6, 6)
        Matrix (15), SI; symmetric.
    low, high : (6, 6)
        Smallest and largest size of every entry that the rounding of (18) leaves at that sigma; 0 where (24) has no star.
    source : tuple of str
        For every nonzero entry, row by row, the print that it comes from.
    """

    sigma_low: Array
    sigma_high: Array
    sigma: Array
    compliance: Array
    low: Array
    high: Array
    source: tuple[str, ...]


def reconstruct() -> Reconstruction:
    """Matrix (15) from the printed tables (see the module's text).

    Raises
    ------
    ValueError
        If no standard deviation fits all prints, or no two-digit one.
    """
    ratio, estimate = np.abs(PRINTED_17.value), np.abs(PRINTED_25.value)
    # k53 and k62: M1 replaces these entries by (nearly) their twins, so (25) is not theirs to divide.
    kept = NONZERO & np.triu(np.ones((6, 6), dtype=bool))
    kept_low = np.where(kept, (estimate - PRINTED_25.half_digit) / np.where(kept, ratio + PRINTED_17.half_digit, 1), 0)
    kept_high = np.where(
        kept, (estimate + PRINTED_25.half_digit) / np.where(kept, ratio - PRINTED_17.half_digit, 1), np.inf
    )
    groups = (~ROTATION_ROW, ROTATION_ROW)
    low = np.array([kept_low[rows].max() for rows in groups])
    high = np.array([kept_high[rows].min() for rows in groups])
    sigma = np.array([float(f"{value:.1e}") for value in (low + high) / 2])
    if (sigma < low).any() or (sigma > high).any():
        raise ValueError(f"no two-digit standard deviation lies between {low} and {high}")
    by_row = sigma[ROTATION_ROW.astype(int)][:, None]
    finer = PRINTED_18.half_digit / np.where(NONZERO, PRINTED_18.value, 1)
    # Where both twins are printed equally finely the one above the diagonal is taken.
    upper = finer <= finer.T * (1 + 1e-9)
    own = np.where(np.triu(np.ones((6, 6), dtype=bool)), upper, ~upper.T)
    size = by_row * PRINTED_18.value
    size = np.where(own, size, size.T)
    source = tuple(
        f"(18) at ({i + 1},{j + 1})" if own[i, j] else f"(18) at ({j + 1},{i + 1}), by symmetry"
        for i, j in np.argwhere(NONZERO).tolist()
    )
    return Reconstruction(
        sigma_low=low,
        sigma_high=high,
        sigma=sigma,
        # (25) has k11 negative too, which the paper itself calls contrary to physics.
        compliance=np.where((PRINTED_25.value < 0) & ~np.eye(6, dtype=bool), -size, size),
        low=by_row * (PRINTED_18.value - PRINTED_18.half_digit),
        high=by_row * (PRINTED_18.value + PRINTED_18.half_digit),
        source=source,
    )
