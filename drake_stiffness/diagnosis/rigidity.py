"""The noise that readings show whatever the arm does: points on one flange move as a rigid body.

P points give 3 P numbers a step, of which a rigid motion explains six at most. What is left is noise of the instrument,
free of every model of the arm: no missing effect can be mistaken for it, and it for none. Repeats of a reading add to it.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from drake_stiffness.diagnosis.signatures import Scene
from drake_stiffness.rotations import Array, rotate

_IMPLAUSIBLE = 1e-3


@dataclass(frozen=True)
class NoiseShown:
    """What the readings show of their own noise.

    Attributes
    ----------
    sigma_m : float
        Standard deviation of a coordinate, m; NaN where nothing shows it.
    dof : int
    ratio : float
        Over the stated one.
    p_value : float
        Two-sided, of the stated noise.
    """

    sigma_m: float
    dof: int
    ratio: float
    p_value: float

    @property
    def implausible(self) -> bool:
        """Whether the stated noise cannot be."""
        return self.p_value < _IMPLAUSIBLE


def noise_shown(scene: Scene, residual: Array) -> NoiseShown:
    """Noise from what no rigid motion of the flange explains, and from repeats.

    Parameters
    ----------
    residual : (rows,)
        Whitened residual of any model; only its non-rigid part is looked at.
    """
    from scipy.special import chdtr, chdtrc

    o = scene.o
    total, dof = _not_rigid(scene, residual[: 3 * o.measurements.case.size].reshape(-1, 3))
    if dof <= 0:
        return NoiseShown(float("nan"), 0, float("nan"), 1.0)
    ratio = float(np.sqrt(total / dof))
    p_value = 2 * min(float(chdtr(dof, total)), float(chdtrc(dof, total)))
    return NoiseShown(ratio * o.sigma_p, dof, ratio, min(p_value, 1.0))


def _not_rigid(scene: Scene, r: Array) -> tuple[float, int]:
    """Sum of squares and degrees of freedom of what rigid motions leave of residuals `(M, 3)` that are free of references."""
    m = scene.o.measurements
    p_E = rotate(scene.poses.R_E[:, :, m.case], scene.model.point_positions(m.point))
    total, dof = 0.0, 0
    experiments: set[int] = set()
    order = np.argsort(m.case, kind="stable")
    starts = np.flatnonzero(np.diff(m.case[order], prepend=-1))
    experiment = m.cases.experiment
    for own in np.split(order, starts[1:]):
        P = own.size
        lever = p_E[:, own].T
        A = np.zeros((3 * P, 6))
        for k in range(P):
            x, y, z = lever[k]
            A[3 * k : 3 * k + 3, :3] = np.eye(3)
            A[3 * k : 3 * k + 3, 3:] = [[0, z, -y], [-z, 0, x], [y, -x, 0]]
        U, s, _ = np.linalg.svd(A, full_matrices=True)
        rank = int((s > 1e-9 * s[0]).sum())
        rest = U[:, rank:].T @ r[own].ravel()
        total += float(rest @ rest)
        dof += 3 * P - rank
        experiments.add(int(experiment[m.case[own[0]]]))
    if scene.o.displacement:
        # Every experiment's free references take what one step of it has.
        per_step = dof / max(starts.size, 1)
        dof -= round(per_step * len(experiments))
    return total, dof
