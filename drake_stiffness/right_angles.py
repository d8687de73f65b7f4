"""Right angles that a robot description prints rounded: 1.5708 rad is 4e-6 short of one.

Taken by the letter, such an arm has axes that are not quite parallel, and combinations of springs that the arm with right angles
does not tell apart seem to be seen, a millionth as well as the others. So columns of the observation matrix, which say what can be seen,
are those of the arm with right angles. Positions and residuals stay those of the description.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from drake_stiffness.arm import Arm

# Direction cosines below this are rounding of the description; four decimals of pi / 2 are off by 4e-6, of pi by 7e-6.
_ROUNDED = 1e-5


def with_right_angles(arm: Arm) -> Arm:
    """The arm with direction cosines between its frames of less than 1e-5 taken for zero; the same arm if there are none."""
    rounded = (np.abs(arm.R_PF) < _ROUNDED) & (arm.R_PF != 0.0)
    which = np.flatnonzero(rounded.any(axis=(1, 2)))
    if not which.size:
        return arm
    R = arm.R_PF.copy()
    U, _, Vt = np.linalg.svd(np.where(rounded, 0.0, R)[which])
    R[which] = U @ Vt  # the nearest rotation
    return replace(arm, R_PF=R)
