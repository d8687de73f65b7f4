"""The loaded equilibrium of an arm with springs, for whole arrays of postures.

The loaded equilibrium is the fixed point theta = k tau(theta), tau = J(theta)^T W + sum of J_n(theta)^T G_n: dead loads and
weight on the deflected arm. The iteration contracts when the spectral radius of k H is below one, H = d tau / d theta; with
k positive semidefinite and H symmetric this says that K - H is positive definite, so the equilibrium is stable. Where
contraction is in doubt the eigenvalues of k H are computed; beyond one the load is refused.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from drake_stiffness.arm import Arm, Poses, forward, torques
from drake_stiffness.effects.effect import Carried, Cases, Effect
from drake_stiffness.errors import UntrustworthyError
from drake_stiffness.rotations import Array

# Postures are evaluated in chunks that stay in the processor's cache.
CHUNK = 2048
# Arms contract by a hundredth; what is still under way then is near buckling, and is finished by Newton's method.
_MAX_ITERATIONS = 60
_NEWTON_STEPS = 40
# A deflection that moves by so much (rad or m) between iterations is beyond all hope.
_HOPELESS = 1e3
# Deflections stand when nothing moves by more than this (rad or m): 1e-13 of a 3 m arm is well below a nanometre.
_TOLERANCE = 1e-13
_DOUBTFUL_RATE = 0.5


@dataclass(frozen=True, eq=False)
class Structure:
    """An arm with the springs and further effects that bend it: what the equilibrium needs of a model.

    Attributes
    ----------
    arm : Arm
        As it really is (geometric effects applied).
    k_joint : (n,)
        Joint compliances, rad/(N m) or m/N.
    k_link : n + 1 entries of (6, 6) or None
        Link compliances; None is rigid.
    others : tuple of (effect, values)
        Effects with a `deflection` of their own.
    wrench_effects : tuple of (effect, values)
        Effects that change the applied wrench.
    """

    arm: Arm
    k_joint: Array
    k_link: tuple[Array | None, ...]
    others: tuple[tuple[Effect, Array], ...] = ()
    wrench_effects: tuple[tuple[Effect, Array], ...] = ()

    @property
    def links(self) -> list[bool]:
        return [k is not None for k in self.k_link]

    @property
    def is_rigid(self) -> bool:
        return not (self.k_joint.any() or any(k is not None and k.any() for k in self.k_link) or self.others)


def build_structure(arm: Arm, effects: Sequence[Effect], values: Sequence[Array]) -> Structure:
    """Collect what the effects do to arm and springs.

    Parameters
    ----------
    values : one array per effect, SI
    """
    for effect, x in zip(effects, values, strict=True):
        if effect.station == "arm":
            arm = effect.on_arm(arm, x)
    joint, link = np.zeros(arm.num_joints), dict[int, Array]()
    others = []
    for effect, x in zip(effects, values, strict=True):
        if effect.station != "spring":
            continue
        effect.compliance(arm, x, joint, link)
        if type(effect).deflection is not Effect.deflection:
            others.append((effect, x))
    wrench = tuple((e, x) for e, x in zip(effects, values, strict=True) if e.station == "wrench")
    k_link = tuple(link.get(k) for k in range(arm.num_joints + 1))
    return Structure(arm, joint, k_link, tuple(others), wrench)


@dataclass(frozen=True, eq=False)
class Equilibrium:
    """Loaded states of N cases.

    Attributes
    ----------
    R_E, p_E : (3, 3, N), (3, N)
        The loaded flange in the world.
    theta_joint : (n, N)
    theta_link : n + 1 entries of (6, N) or None
    rate : (N,)
        Observed contraction of the iteration; 0 where it ended at once.
    iterations : int
        The most any chunk took.
    """

    R_E: Array
    p_E: Array
    theta_joint: Array
    theta_link: tuple[Array | None, ...]
    rate: Array
    iterations: int


def solve_equilibrium(structure: Structure, cases: Cases, start: Equilibrium | None = None) -> Equilibrium:
    """The loaded equilibrium of every case.

    Parameters
    ----------
    start : Equilibrium, optional
        Of the same cases at nearly the same joints: the iteration starts from its deflections.

    Raises
    ------
    UntrustworthyError
        If a case has no stable equilibrium or the iteration does not converge; the message names posture and load.
    """
    history = bool(structure.others)
    size = cases.number if history else CHUNK  # load history runs over the cases: they stay together
    parts = [
        _solve_chunk(structure, cases.take(slice(a, a + size)), a, start)
        for a in range(0, max(cases.number, 1), max(size, 1))
    ]
    if len(parts) == 1:
        return parts[0]
    return Equilibrium(
        np.concatenate([p.R_E for p in parts], axis=2),
        np.concatenate([p.p_E for p in parts], axis=1),
        np.concatenate([p.theta_joint for p in parts], axis=1),
        tuple(
            None if k is None else np.concatenate([p.theta_link[i] for p in parts], axis=1)
            for i, k in enumerate(structure.k_link)
        ),
        np.concatenate([p.rate for p in parts]),
        max(p.iterations for p in parts),
    )


def _solve_chunk(structure: Structure, cases: Cases, first: int, start: Equilibrium | None) -> Equilibrium:
    arm, N = structure.arm, cases.number
    wrench = cases.wrench
    for effect, x in structure.wrench_effects:
        wrench = effect.on_wrench(wrench, cases, forward(arm, cases.q).R_E, x)
    cases = Cases(cases.q, wrench, cases.p_ELoad, cases.experiment, cases.step, cases.time_s)
    theta_joint = np.zeros((arm.num_joints, N))
    theta_link: list[Array | None] = [None if k is None else np.zeros((6, N)) for k in structure.k_link]
    if start is not None:
        here = slice(first, first + N)
        theta_joint = start.theta_joint[:, here]
        theta_link = [None if t is None else t[:, here] for t in start.theta_link]
    poses = forward(arm, cases.q) if start is None else forward(arm, cases.q, theta_joint, theta_link)
    rate, before = np.zeros(N), np.full(N, np.inf)
    if structure.is_rigid:
        return Equilibrium(poses.R_E, poses.p_E, theta_joint, tuple(theta_link), rate, 0)
    weight = theta_joint
    if structure.others:
        weight = torques(arm, forward(arm, cases.q), np.zeros_like(wrench), cases.p_ELoad)[0]
    iteration = 0
    while iteration < _MAX_ITERATIONS:
        iteration += 1
        new_joint, new_link = _deflect(structure, cases, poses, theta_link, weight)
        change = np.abs(new_joint - theta_joint).max(axis=0, initial=0.0)
        for new, old in zip(new_link, theta_link, strict=True):
            if new is not None and old is not None:
                change = np.maximum(change, np.abs(new - old).max(axis=0))
        seen = (before < np.inf) & (before > 100 * _TOLERANCE)
        rate = np.where(seen, np.maximum(rate, change / np.where(seen, before, 1.0)), rate)
        theta_joint, theta_link, before = new_joint, new_link, change
        for case in np.flatnonzero(~(change < _HOPELESS)):
            _judge_stability(structure, cases.take(np.array([case])), first + int(case), None, True)
        poses = forward(arm, cases.q, theta_joint, theta_link)
        if change.max() < _TOLERANCE:
            break
    failed = ~(before < max(_TOLERANCE, 1e-11))
    doubtful = np.flatnonzero((rate > _DOUBTFUL_RATE) | failed | (_softness(structure, cases) > _DOUBTFUL_RATE))
    for case in doubtful:
        one = cases.take(np.array([case]))
        here = _stack(theta_joint, theta_link)[:, [case]]
        stacked = _newton(structure, one, here) if failed[case] and not structure.others else here
        _judge_stability(structure, one, first + int(case), stacked, bool(failed[case] and structure.others))
        assert stacked is not None  # or it would have been refused
        theta_joint[:, [case]], links = _unstack(structure, stacked)
        for own, new in zip(theta_link, links, strict=True):
            if own is not None and new is not None:
                own[:, [case]] = new
    if doubtful.size:
        poses = forward(arm, cases.q, theta_joint, theta_link)
    return Equilibrium(poses.R_E, poses.p_E, theta_joint, tuple(theta_link), rate, iteration)


def _softness(structure: Structure, cases: Cases) -> Array:
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
    return np.asarray(max(softest) * ((weight + force) * reach + moment))


def _deflect(
    structure: Structure, cases: Cases, poses: Poses, theta_link: Sequence[Array | None], weight: Array
) -> tuple[Array, list[Array | None]]:
    """k tau at the present poses."""
    tau_joint, tau_link = torques(structure.arm, poses, cases.wrench, cases.p_ELoad, theta_link, structure.links)
    joint = structure.k_joint[:, None] * tau_joint
    if structure.others:
        carried = Carried(tau_joint, tau_link, weight)
        for effect, x in structure.others:
            for number, extra in effect.deflection(structure.arm, carried, cases, x).items():
                joint[number] += extra
    link = [
        None if k is None or tau is None else np.einsum("ij,jn->in", k, tau)
        for k, tau in zip(structure.k_link, tau_link, strict=True)
    ]
    return joint, link


def _judge_stability(structure: Structure, case: Cases, number: int, stacked: Array | None, failed: bool) -> None:
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
    states = [_stack(*_rest(structure, 1)), *([stacked] if stacked is not None and found else [])]
    top = max(float(np.linalg.eigvals(_iteration_matrix(structure, case, at)).real.max(initial=0.0)) for at in states)
    what = f"case {number + 1}, posture ({posture}), load (N, N m) {load}"
    if top >= 1.0:
        raise UntrustworthyError(
            f"{what}: no stable equilibrium: K - H is not positive definite (largest eigenvalue of k H is {top:.3g}, it must "
            "stay below 1). The compliances are too large for this load, or load and weight are in wrong units."
        )
    if failed or not found:
        raise UntrustworthyError(
            f"{what}: the loaded equilibrium does not converge in {_MAX_ITERATIONS} iterations (largest eigenvalue of k H "
            f"{top:.3g}). Deflections this large are outside what springs in series describe; check compliances and units."
        )


def _posture_text(arm: Arm, q: Array) -> str:
    parts = []
    for name, value, prismatic in zip(arm.joint_names, q, arm.prismatic, strict=True):
        parts.append(f"{name} {value * 1e3:.6g} mm" if prismatic else f"{name} {np.degrees(value):.6g} deg")
    return ", ".join(parts)


def _rest(structure: Structure, N: int) -> tuple[Array, list[Array | None]]:
    """No deflection."""
    return np.zeros((structure.arm.num_joints, N)), [None if k is None else np.zeros((6, N)) for k in structure.k_link]


def _stack(joint: Array, link: Sequence[Array | None]) -> Array:
    """Deflections of all springs as (dof, N)."""
    return np.concatenate([joint, *(part for part in link if part is not None)])


def _unstack(structure: Structure, stacked: Array) -> tuple[Array, list[Array | None]]:
    """The inverse of `_stack`."""
    n = structure.arm.num_joints
    starts = iter(range(n, stacked.shape[0], 6))
    links = [None if k is None else stacked[(a := next(starts)) : a + 6] for k in structure.k_link]
    return stacked[:n], links


def _image(structure: Structure, cases: Cases, stacked: Array) -> Array:
    """k tau at given deflections, stacked."""
    joint, link = _unstack(structure, stacked)
    poses = forward(structure.arm, cases.q, joint, link)
    return _stack(*_deflect(structure, cases, poses, link, np.zeros_like(joint)))


def _iteration_matrix(structure: Structure, case: Cases, at: Array) -> Array:
    """d (k tau) / d theta = k H of one case at deflections `at (dof, 1)`, by central differences."""
    h = 1e-6
    linear = Structure(structure.arm, structure.k_joint, structure.k_link)
    size = at.shape[0]
    shift = np.concatenate([np.eye(size), -np.eye(size)], axis=1) * h
    moved = _image(linear, case.take(np.zeros(2 * size, dtype=int)), at + shift)
    return (moved[:, :size] - moved[:, size:]) / (2 * h)


def _newton(structure: Structure, case: Cases, stacked: Array) -> Array | None:
    """Newton's iteration on theta = k tau(theta) for a case near buckling; None where it finds nothing."""
    if not np.isfinite(stacked).all():
        stacked = _stack(*_rest(structure, 1))
    for _ in range(_NEWTON_STEPS):
        step = np.linalg.solve(
            np.eye(stacked.shape[0]) - _iteration_matrix(structure, case, stacked),
            _image(structure, case, stacked) - stacked,
        )
        stacked = stacked + step
        if not np.abs(stacked).max() < _HOPELESS:
            return None
        if np.abs(step).max() < 1e-12:
            return stacked
    return None
