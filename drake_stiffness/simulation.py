"""From model and load to what is read: predicted readings, linear deflection, Cartesian stiffness."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from drake_stiffness.arm import chain_jacobian
from drake_stiffness.effects.effect import Cases, Reading
from drake_stiffness.equilibrium import Equilibrium, solve_equilibrium
from drake_stiffness.errors import UntrustworthyError
from drake_stiffness.model import Model
from drake_stiffness.rotations import Array, logarithm, multiply, rotate
from drake_stiffness.structure import Structure


def read(
    model: Model, equilibrium: Equilibrium, cases: Cases, case: NDArray[np.int_], point: NDArray[np.str_]
) -> Reading:
    """What the tracker reads in loaded states: M readings of points, instruments' effects included.

    Parameters
    ----------
    case : (M,) which of the equilibrium's cases
    point : (M,) names of reference points
    """
    R, p_E = equilibrium.R_E[:, :, case], equilibrium.p_E[:, case]
    reading = Reading(p_E + rotate(R, model.point_positions(point)), R, point, case)
    for effect, x in zip(model.effects, model.values, strict=True):
        if effect.station == "reading":
            reading = effect.on_reading(reading, cases, x)
    return reading


def simulate_readings(model: Model, cases: Cases, case: NDArray[np.int_], point: NDArray[np.str_]) -> Reading:
    """Loaded equilibrium of the cases, then the readings."""
    return read(model, solve_equilibrium(model.structure, cases), cases, case, point)


@dataclass(frozen=True, eq=False)
class Displacement:
    """By how much loaded points differ from the same points under weight alone.

    Attributes
    ----------
    dp : (3, M)
        Displacement, m.
    phi : (3, M)
        Rotation vector of the flange, rad.
    loaded : Reading
        Where they are.
    """

    dp: Array
    phi: Array
    loaded: Reading


def simulate_displacement(model: Model, cases: Cases, case: NDArray[np.int_], point: NDArray[np.str_]) -> Displacement:
    """Loaded minus unloaded-with-weight at the same commanded joints."""
    loaded = simulate_readings(model, cases, case, point)
    unloaded = simulate_readings(model, cases.unloaded(), case, point)
    turn = multiply(loaded.R, unloaded.R.transpose(1, 0, 2))
    return Displacement(loaded.p - unloaded.p, logarithm(turn), loaded)


def linear_displacement(structure: Structure, q: Array, wrench: Array, p_EP: Array, p_ELoad: Array) -> Array:
    """Displacement J k J_load^T W of a point by the applied wrench alone, on the undeflected arm (seed eq. 8).

    Parameters
    ----------
    q : (N, n), wrench : (N, 6), p_EP, p_ELoad : (3,)

    Returns
    -------
    (N, 6)
        Displacement and rotation vector, m and rad.
    """
    J, _ = chain_jacobian(structure.arm, q, p_EP, structure.links)
    J_load, _ = chain_jacobian(structure.arm, q, p_ELoad, structure.links)
    k = compliance_matrix(structure)
    return np.einsum("nid,de,nje,nj->ni", J, k, J_load, np.asarray(wrench, dtype=float), optimize=True)


def compliance_matrix(structure: Structure) -> Array:
    """Block-diagonal compliance of all springs, joints first (the inverse of K_theta in seed eq. 4)."""
    from scipy.linalg import block_diag

    return block_diag(np.diag(structure.k_joint), *(k for k in structure.k_link if k is not None))


def cartesian_compliance(structure: Structure, q: Array, p_EP: Array) -> Array:
    """J k J^T at a point of the flange for postures `q (N, n)`: the inverse of seed eq. (7), `(N, 6, 6)`, SI."""
    J, _ = chain_jacobian(structure.arm, q, p_EP, structure.links)
    return np.einsum("nid,de,nje->nij", J, compliance_matrix(structure), J, optimize=True)


def cartesian_stiffness(structure: Structure, q: Array, p_EP: Array) -> Array:
    """Cartesian stiffness K_C = (J K^-1 J^T)^-1 (seed eq. 7), `(N, 6, 6)`.

    Raises
    ------
    UntrustworthyError
        If the springs leave a direction rigid: its stiffness is infinite.
    """
    compliance = cartesian_compliance(structure, q, p_EP)
    scale = np.sqrt(np.einsum("nii->ni", compliance))
    if (scale <= 0).any() or (np.linalg.cond(compliance / (scale[:, :, None] * scale[:, None, :])) > 1e13).any():
        raise UntrustworthyError(
            "the Cartesian stiffness is infinite in some direction: the springs of this model leave it rigid there. Use the "
            "Cartesian compliance, or give every link a spring."
        )
    return np.asarray(np.linalg.inv(compliance))


def cartesian_stiffness_saddle(structure: Structure, q: Array, p_EP: Array) -> Array:
    """The same stiffness from the saddle-point system [[0, J], [J^T, -K]] [W; theta] = [dt; 0] (seed eq. 6 as corrected).

    The second unknown is theta (the seed prints 0). Needs K = k^-1, so every spring must be positive definite.
    """
    J, _ = chain_jacobian(structure.arm, q, p_EP, structure.links)
    K = np.linalg.inv(compliance_matrix(structure))
    N, rows, dof = J.shape
    # Springs span decades; a symmetric scaling of theta leaves W untouched and the system solvable.
    scale = 1 / np.sqrt(np.diag(K))
    system = np.zeros((N, rows + dof, rows + dof))
    system[:, :rows, rows:] = J * scale
    system[:, rows:, :rows] = (J * scale).transpose(0, 2, 1)
    system[:, rows:, rows:] = -(scale[:, None] * K * scale)
    right = np.zeros((rows + dof, rows))
    right[:rows] = np.eye(rows)
    return np.linalg.solve(system, np.broadcast_to(right, (N, *right.shape)))[:, :rows]
