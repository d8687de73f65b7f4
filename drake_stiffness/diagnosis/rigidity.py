"""The noise that readings show whatever the arm does: points on one flange move as a rigid body.

P points give 3 P numbers a step, of which a rigid motion explains six at most. What is left is noise of the instrument,
free of every model of the arm: no missing effect can be mistaken for it, and it for none. Repeats of a reading add to it.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np

from drake_stiffness.diagnosis.generic import Process
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
        Two-sided, of the stated noise; one-sided where the remainder shows it, because that is noise at most.
    how : str
        What shows it: "rigidity", or "remainder" where nothing but the fit itself does.
    """

    sigma_m: float
    dof: int
    ratio: float
    p_value: float
    how: Literal["rigidity", "remainder"] = "rigidity"

    @property
    def in_words(self) -> str:
        """What shows how much, for a sentence about a stated noise that cannot be."""
        if self.how == "remainder":
            return f"no smooth function of angles, torques and time gets below {self.ratio:.2g} times the stated one"
        return f"points of one flange, which move as a rigid body, show {self.ratio:.2g} times as much"

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


def noise_of_remainder(process: Process, sigma_m: float) -> NoiseShown:
    """Where one point a step and no repeats show nothing of the noise: what no smooth function of the remainder takes away.

    That is the most the noise can be: an arm that does not come back to a posture exactly, or an effect of fine structure, is in it.
    """
    from scipy.special import chdtrc

    dof = round(process.dof)
    if dof <= 1:
        return NoiseShown(float("nan"), 0, float("nan"), 1.0)
    ratio = float(np.sqrt(process.floor))
    return NoiseShown(ratio * sigma_m, dof, ratio, float(chdtrc(dof, process.floor * dof)), "remainder")


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
