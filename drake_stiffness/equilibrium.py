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
_MAX_ITERATIONS = 60
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
        if not np.isfinite(change).all() or change.max() > 1e3:
            break
        poses = forward(arm, cases.q, theta_joint, theta_link)
        if change.max() < _TOLERANCE:
            break
    failed = ~(before < max(_TOLERANCE, 1e-11))
    doubtful = np.flatnonzero((rate > _DOUBTFUL_RATE) | failed)
    for case in doubtful:
        _judge_stability(structure, cases.take(np.array([case])), first + int(case), bool(failed[case]))
    return Equilibrium(poses.R_E, poses.p_E, theta_joint, tuple(theta_link), rate, iteration)


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


def _judge_stability(structure: Structure, case: Cases, number: int, failed: bool) -> None:
    """Refuse a case whose K - H is not positive definite, or that did not converge."""
    load = np.array2string(case.wrench[:, 0], precision=6, separator=", ", suppress_small=True)
    posture = _posture_text(structure.arm, case.q[:, 0])
    top = _largest_eigenvalue(structure, case)
    what = f"case {number + 1}, posture ({posture}), load (N, N m) {load}"
    if top >= 1.0:
        raise UntrustworthyError(
            f"{what}: no stable equilibrium: K - H is not positive definite (largest eigenvalue of k H is {top:.3g}, it must "
            "stay below 1). The compliances are too large for this load, or load and weight are in wrong units."
        )
    if failed:
        raise UntrustworthyError(
            f"{what}: the loaded equilibrium does not converge in {_MAX_ITERATIONS} iterations (largest eigenvalue of k H "
            f"{top:.3g}). Deflections this large are outside what springs in series describe; check compliances and units."
        )


def _posture_text(arm: Arm, q: Array) -> str:
    parts = []
    for name, value, prismatic in zip(arm.joint_names, q, arm.prismatic, strict=True):
        parts.append(f"{name} {value * 1e3:.6g} mm" if prismatic else f"{name} {np.degrees(value):.6g} deg")
    return ", ".join(parts)


def _largest_eigenvalue(structure: Structure, case: Cases) -> float:
    """Largest real part among the eigenvalues of k H at the undeflected posture, by central differences of k tau."""
    h = 1e-6
    n = structure.arm.num_joints
    active = [i for i, k in enumerate(structure.k_link) if k is not None]
    size = n + 6 * len(active)
    shift = np.concatenate([np.eye(size), -np.eye(size)], axis=1) * h
    many = case.take(np.zeros(2 * size, dtype=int))
    theta_link: list[Array | None] = [None] * (n + 1)
    for place, i in enumerate(active):
        theta_link[i] = shift[n + 6 * place : n + 6 * place + 6]
    poses = forward(structure.arm, many.q, shift[:n], theta_link)
    linear = Structure(structure.arm, structure.k_joint, structure.k_link)
    joint, link = _deflect(linear, many, poses, theta_link, shift[:n])
    stacked = np.concatenate([joint, *(link[i] for i in active)])
    G = (stacked[:, :size] - stacked[:, size:]) / (2 * h)
    return float(np.linalg.eigvals(G).real.max(initial=0.0))
