"""Whether a loaded equilibrium is one: K - H positive definite, that is all eigenvalues of k H below one."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from drake_stiffness.arm import Arm, forward
from drake_stiffness.effects.effect import Cases
from drake_stiffness.errors import NoEquilibriumError
from drake_stiffness.rotations import Array
from drake_stiffness.structure import Structure, at_rest, deflect, stack, torque_slope, unstack

_NEWTON_STEPS = 40
# A deflection of so much (rad or m) is beyond all hope.
HOPELESS = 1e3


def softness(structure: Structure, cases: Cases) -> Array:
    """A generous estimate of |k H|, (N,): the softest rotation times all weight and force at the end of the whole arm.

    An arm that stands exactly upright carries no torque, however unstable it is; its iteration shows nothing.
    """
    arm = structure.arm
    softest = [float(np.where(arm.prismatic, 0.0, np.abs(structure.k_joint)).max(initial=0.0))]
    softest += [float(np.linalg.norm(k[3:, 3:], 2)) for k in structure.k_link if k is not None]
    reach = np.linalg.norm(arm.p_PF, axis=1).sum() + np.linalg.norm(np.atleast_2d(cases.p_ELoad.T), axis=1).max()
    reach = reach + np.abs(cases.q[np.array(arm.prismatic)]).sum(axis=0)
    weight = (arm.mass_kg[1:].sum() + abs(arm.tool_mass_kg)) * np.linalg.norm(arm.gravity)
    force = np.sqrt((cases.wrench[:3] ** 2).sum(axis=0))
    moment = np.sqrt((cases.wrench[3:] ** 2).sum(axis=0))
    estimate = max(softest) * ((weight + force) * reach + moment)
    if structure.torque_effects:
        slope = torque_slope(structure, cases.q, np.zeros_like(cases.q))
        estimate = estimate + np.abs(structure.k_joint[:, None] * slope).max(axis=0)
    return np.asarray(estimate)


def judge_stability(structure: Structure, case: Cases, number: int, stacked: Array | None, failed: bool) -> None:
    """Refuse a case whose K - H is not positive definite at its equilibrium, or that has none that can be found.

    Parameters
    ----------
    stacked : (dof, 1) or None
        The equilibrium; None where none was found.
    """
    load = np.array2string(case.wrench[:, 0], precision=6, separator=", ", suppress_small=True)
    posture = _posture_text(structure.arm, case.q[:, 0])
    found = stacked is not None and bool(np.isfinite(stacked).all())
    # Both where the arm starts from and where it ends: past buckling there may be another equilibrium, which no arm reaches.
    states = [stack(*at_rest(structure, 1)), *([stacked] if stacked is not None and found else [])]
    top = max(float(np.linalg.eigvals(_iteration_matrix(structure, case, at)).real.max(initial=0.0)) for at in states)
    what = f"posture ({posture}), load (N, N m) {load}"
    if top >= 1.0:
        raise NoEquilibriumError(
            number,
            f"{what}: no stable equilibrium: K - H is not positive definite (largest eigenvalue of k H is {top:.3g}, it must "
            "stay below 1). The compliances are too large for this load, or load and weight are in wrong units.",
        )
    if failed or not found:
        raise NoEquilibriumError(
            number,
            f"{what}: the loaded equilibrium does not converge (largest eigenvalue of k H "
            f"{top:.3g}). Deflections this large are outside what springs in series describe; check compliances and units.",
        )


def _posture_text(arm: Arm, q: Array) -> str:
    parts = []
    for name, value, prismatic in zip(arm.joint_names, q, arm.prismatic, strict=True):
        parts.append(f"{name} {value * 1e3:.6g} mm" if prismatic else f"{name} {np.degrees(value):.6g} deg")
    return ", ".join(parts)


def _image(structure: Structure, cases: Cases, stacked: Array) -> Array:
    """k tau at given deflections, stacked."""
    joint, link = unstack(structure, stacked)
    poses = forward(structure.arm, cases.q, joint, link)
    return stack(*deflect(structure, cases, poses, joint, link, np.zeros_like(joint)))


def _iteration_matrix(structure: Structure, case: Cases, at: Array) -> Array:
    """d (k tau) / d theta = k H of one case at deflections `at (dof, 1)`, by central differences."""
    h = 1e-6
    linear = replace(structure, others=())
    size = at.shape[0]
    shift = np.concatenate([np.eye(size), -np.eye(size)], axis=1) * h
    moved = _image(linear, case.take(np.zeros(2 * size, dtype=int)), at + shift)
    return (moved[:, :size] - moved[:, size:]) / (2 * h)


def newton(structure: Structure, case: Cases, stacked: Array) -> Array | None:
    """Newton's iteration on theta = k tau(theta) for a case near buckling; None where it finds nothing."""
    if not np.isfinite(stacked).all():
        stacked = stack(*at_rest(structure, 1))
    for _ in range(_NEWTON_STEPS):
        step = np.linalg.solve(
            np.eye(stacked.shape[0]) - _iteration_matrix(structure, case, stacked),
            _image(structure, case, stacked) - stacked,
        )
        stacked = stacked + step
        if not np.abs(stacked).max() < HOPELESS:
            return None
        if np.abs(step).max() < 1e-12:
            return stacked
    return None
