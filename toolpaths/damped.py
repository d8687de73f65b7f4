"""Newton steps of joints: the least joint motion that makes a small motion of the tool, for whole arrays of postures."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]

# Of the size of J J^T: it matters at singularities only.
_DAMPING = 1e-12


def damped_step(J: Floats, twist: Floats) -> Floats:
    """J^T (J J^T + d I)^-1 twist, (f, N), with a damping d that matters at singularities only.

    Elimination is done for all postures at once. It needs no pivots, because J J^T + d I is positive definite.

    Parameters
    ----------
    J : (f, 6, N)
        Jacobian, joint first.
    twist : (6, N)
    """
    left, x = np.zeros((6, *twist.shape)), twist.copy()
    for column in J:
        left += column[:, None] * column[None]
    diagonal = left[np.arange(6), np.arange(6)]
    left[np.arange(6), np.arange(6)] = diagonal + _DAMPING * diagonal.sum(axis=0)
    for k in range(5):
        factor = left[k + 1 :, k] / left[k, k]
        left[k + 1 :, k + 1 :] -= factor[:, None] * left[k, k + 1 :]
        x[k + 1 :] -= factor * x[k]
    for k in range(5, -1, -1):
        x[k] = (x[k] - (left[k, k + 1 :] * x[k + 1 :]).sum(axis=0)) / left[k, k]
    return np.asarray((J * x).sum(axis=1))
