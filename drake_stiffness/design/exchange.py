"""From weights to a plan: rounding, then exchange of single postures as long as it helps (Fedorov).

One exchange takes a posture out and tries the most promising others in its place. Promising is decided by first order on the half
removed plan, whose dual gives the gain of all candidates in one product; the short list is then evaluated exactly, as one batch.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from drake_stiffness.design.criteria import Criterion
from drake_stiffness.design.information import Information
from drake_stiffness.rotations import Array

_SHORT_LIST = 60
_PASSES = 30
# An exchange must gain this share: rounding is no progress.
_GAIN = 1e-7


def rounded_plan(x: Array, n: int) -> NDArray[np.int_]:
    """The n candidates of largest weight."""
    return np.sort(np.argsort(-x, kind="stable")[:n])


def exchange(information: Information, criterion: Criterion, chosen: NDArray[np.int_]) -> NDArray[np.int_]:
    """Improve a plan by exchanges of one posture until a whole pass finds none.

    Returns
    -------
    (n,) numbers of candidates, sorted; never the same one twice.
    """
    plan = chosen.copy()
    n = plan.size
    ridge = information.ridge(n)
    M = information.plan(plan) + ridge
    value = float(criterion.value(M))
    for _ in range(_PASSES):
        swapped = False
        F = information.of(plan)
        worth = np.einsum("ij,kij->k", criterion.ascent(M), F)
        for place in np.argsort(worth, kind="stable"):
            out = information.of(int(plan[place]))
            gain = information.inner(criterion.ascent(M - 0.5 * out))
            gain[plan] = -np.inf
            k = min(_SHORT_LIST, information.number - n)
            if k < 1:
                break
            short = np.argpartition(-gain, k - 1)[:k]
            values = criterion.value(M - out + information.of(short))
            best = int(np.argmax(values))
            if values[best] > value * (1 + _GAIN):
                plan[place] = short[best]
                # Summed afresh, so that rounding does not build up.
                M = information.plan(plan) + ridge
                value, swapped = float(criterion.value(M)), True
        if not swapped:
            break
    return np.sort(plan)
