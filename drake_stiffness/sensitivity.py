"""How readings change with the parameters: the observation matrix of seed eqs. (9), (23), reading by reading.

Columns of linear springs are analytic, J omega J^T W at the undeflected posture. That makes them exactly the columns of the
linear theory: redundancies stay exact and ranks have visible gaps, also where a description rounds right angles
(`right_angles`). Where hardware turns a joint (a gravity compensator), what its spring carries includes that torque. All other
effects get central differences of the loaded equilibrium.
"""

from __future__ import annotations

from dataclasses import replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from drake_stiffness.arm import Poses, forward, joint_jacobian, link_jacobian, torques
from drake_stiffness.effects.compliance import Spring
from drake_stiffness.effects.effect import Cases, Reading
from drake_stiffness.equilibrium import solve_equilibrium
from drake_stiffness.model import Model
from drake_stiffness.right_angles import with_right_angles
from drake_stiffness.rotations import Array, logarithm, multiply, rotate
from drake_stiffness.simulation import read
from drake_stiffness.structure import carried_with_hardware

# Central differences step by this share of a parameter's scale: truncation and rounding both stay below 1e-9.
_STEP = 0.05


def sensitivity(
    model: Model, cases: Cases, case: NDArray[np.int_], point: NDArray[np.str_], *, turns: bool = True
) -> Array:
    """Change of M readings per unit of every parameter's scale.

    Parameters
    ----------
    case, point : (M,)
        Which case each reading belongs to, and which reference point is read.
    turns : bool
        Whether rotations are wanted too.

    Returns
    -------
    (M, 6, n) or (M, 3, n), parameter slowest in memory
        Rows: position (m) and rotation of the flange (rad).
    """
    rows = 6 if turns else 3
    out = np.empty((model.x.size, rows, case.size))
    springs = SpringColumns(model, cases, case, point) if any(isinstance(e, Spring) for e in model.effects) else None
    for effect, own in zip(model.effects, model.slices, strict=True):
        if isinstance(effect, Spring) and springs is not None:
            columns = springs.of(effect, rows)
        else:
            columns = _differences(model, cases, case, point, own)[:, :rows]
        np.multiply(columns.transpose(2, 1, 0), model.scales[own, None, None], out=out[own])
    return out.transpose(2, 1, 0)


def has_finite_differences(model: Model) -> bool:
    """Whether any column is a difference quotient (then ranks are judged more coarsely)."""
    return any(not isinstance(effect, Spring) for effect in model.effects)


def _differences(model: Model, cases: Cases, case: NDArray[np.int_], point: NDArray[np.str_], own: slice) -> Array:
    """Central differences of the loaded readings; effects on readings reuse the equilibrium."""
    out = np.empty((case.size, 6, own.stop - own.start))
    fixed = None
    if model.effects[model.slices.index(own)].station == "reading":
        fixed = solve_equilibrium(model.structure, cases)
    for place, number in enumerate(range(own.start, own.stop)):
        h = _STEP * model.scales[number]
        ends = []
        for sign in (1.0, -1.0):
            x = model.x.copy()
            x[number] += sign * h
            other = model.with_x(x)
            equilibrium = fixed or solve_equilibrium(other.structure, cases)
            ends.append(read(other, equilibrium, cases, case, point))
        out[:, :3, place] = (ends[0].p - ends[1].p).T / (2 * h)
        out[:, 3:, place] = logarithm(multiply(ends[0].R, ends[1].R.transpose(1, 0, 2))).T / (2 * h)
    return out


class SpringColumns:
    """Columns J omega J^T W of linear springs at the undeflected posture (seed eq. 23), as the instruments see them."""

    def __init__(self, model: Model, cases: Cases, case: NDArray[np.int_], point: NDArray[np.str_]) -> None:
        self.arm, self.case = with_right_angles(model.structure.arm), case
        wrench = cases.wrench
        poses = forward(self.arm, cases.q)
        for effect, x in model.structure.wrench_effects:
            wrench = effect.on_wrench(wrench, cases, poses.R_E, x)
        links = [True] * (self.arm.num_joints + 1)
        tau_joint, self.tau_link = torques(self.arm, poses, wrench, cases.p_ELoad, None, links)
        self.tau_joint = carried_with_hardware(model.structure, cases.q, tau_joint)
        self.poses = take_poses(poses, case)
        R = self.poses.R_E
        self.p = self.poses.p_E + rotate(R, model.point_positions(point))
        self.turn = instrument_jacobians(model, cases, Reading(self.p, R, point, case))

    @cached_property
    def _joints(self) -> Array:
        return joint_jacobian(self.arm, self.poses, self.p)

    def of(self, effect: Spring, rows: int = 6) -> Array:
        """Columns (M, rows, p) of an effect: all rows, or the three of the position."""
        place, number = effect.site(self.arm)
        if place == "joint":
            J = self._joints[number][None]
            tau = self.tau_joint[number][None, self.case]
        else:
            J = link_jacobian(self.poses, number, self.p)
            tau_k = self.tau_link[number]
            assert tau_k is not None
            tau = tau_k[:, self.case]
        # the column of an unknown is the sum over ij of J_i omega_ij tau_j; omega is sparse, so go through its ones
        out = np.zeros((len(effect.basis), rows, self.case.size))
        for unknown, i, j in zip(*np.nonzero(effect.basis), strict=True):
            out[unknown] += J[i, :rows] * (effect.basis[unknown, i, j] * tau[j])
        return self._passed_on(out)

    def moves(self, number: int) -> Array:
        """Change of the readings by each component of a deflection of a link's spring, (M, 6, 6)."""
        return self._passed_on(np.array(link_jacobian(self.poses, number, self.p)))

    def _passed_on(self, out: Array) -> Array:
        """Columns (p, 6, M), or those of the position (p, 3, M), as the instruments pass them on, with the order of axes turned round."""
        if self.turn is not None:
            for rows, D in zip((slice(0, 3), slice(3, 6))[: out.shape[1] // 3], self.turn, strict=False):
                out[:, rows] = np.einsum("abm,lbm->lam", D, out[:, rows])
        return out.transpose(2, 1, 0)


def take_poses(poses: Poses, case: NDArray[np.int_]) -> Poses:
    """Poses reading by reading; constants that broadcast stay as they are."""

    def pick(a: Array) -> Array:
        return a if a.shape[-1] == 1 else a[..., case]

    def picks(entries: list[Array]) -> list[Array]:
        return [pick(a) for a in entries]

    return Poses(
        R_F=picks(poses.R_F),
        p_F=picks(poses.p_F),
        p_S=picks(poses.p_S),
        axis=picks(poses.axis),
        p_J=picks(poses.p_J),
        p_C=picks(poses.p_C),
        R_E=pick(poses.R_E),
        p_E=pick(poses.p_E),
    )


def instrument_jacobians(model: Model, cases: Cases, reading: Reading) -> tuple[Array, Array] | None:
    """How instruments pass on a small displacement (3, 3, M) and a small rotation (3, 3, M); None where they pass it as is."""
    effects = [(e, x) for e, x in zip(model.effects, model.values, strict=True) if e.station == "reading"]
    if not effects:
        return None

    def chain(r: Reading) -> Reading:
        for effect, x in effects:
            r = effect.on_reading(r, cases, x)
        return r

    h = 1e-3
    D = np.empty((3, 3, reading.p.shape[1]))
    for axis in range(3):
        step = np.zeros((3, 1))
        step[axis] = h
        D[:, axis] = (chain(replace(reading, p=reading.p + step)).p - chain(replace(reading, p=reading.p - step)).p) / (
            2 * h
        )
    return D, multiply(chain(reading).R, reading.R.transpose(1, 0, 2))
