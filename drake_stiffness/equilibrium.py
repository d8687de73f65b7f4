"""The loaded equilibrium of an arm with springs, for whole arrays of postures.

The loaded equilibrium is the fixed point theta = k tau(theta), tau = J(theta)^T W + sum of J_n(theta)^T G_n: dead loads and
weight on the deflected arm. The iteration contracts when the spectral radius of k H is below one, H = d tau / d theta; with
k positive semidefinite and H symmetric this says that K - H is positive definite, so the equilibrium is stable. Where
contraction is in doubt the eigenvalues of k H are computed; beyond one the load is refused.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from drake_stiffness.arm import forward, torques
from drake_stiffness.effects.effect import Cases
from drake_stiffness.rotations import Array
from drake_stiffness.stability import HOPELESS, judge_stability, newton, softness
from drake_stiffness.structure import Structure, deflect, stack, unstack

# Postures at a time, few enough for the processor's cache. No power of two: rows so far apart meet in the same places of it.
CHUNK = 5000
# Arms contract by a hundredth; what is still under way then is near buckling, and is finished by Newton's method.
_MAX_ITERATIONS = 60
# Deflections stand when no more than this is left (rad or m): 1e-13 of a 3 m arm is well below a nanometre.
_TOLERANCE = 1e-13
# What is left after a step is the step times the contraction, which may be so much slower than what was seen of it.
_RATE_MARGIN = 4.0
_DOUBTFUL_RATE = 0.5


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
        Observed contraction of the iteration (and of the one it started from); 0 where it ended at once.
    iterations : int
        The most any chunk took.
    """

    R_E: Array
    p_E: Array
    theta_joint: Array
    theta_link: tuple[Array | None, ...]
    rate: Array
    iterations: int


def solve_equilibrium(
    structure: Structure, cases: Cases, start: Equilibrium | None = None, tolerance: float = _TOLERANCE
) -> Equilibrium:
    """The loaded equilibrium of every case.

    Parameters
    ----------
    start : Equilibrium, optional
        Of the same cases at nearly the same joints: the iteration starts from its deflections.
    tolerance : float
        Deflections stand when no more than this is left of them to find, rad or m.

    Raises
    ------
    UntrustworthyError
        If a case has no stable equilibrium or the iteration does not converge; the message names posture and load.
    """
    history = bool(structure.others)
    size = cases.number if history else CHUNK  # load history runs over the cases: they stay together
    parts = [
        _solve_chunk(structure, cases.take(slice(a, a + size)), a, start, tolerance)
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


def _solve_chunk(
    structure: Structure, cases: Cases, first: int, start: Equilibrium | None, tolerance: float
) -> Equilibrium:
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
    rate, before = np.zeros(N) if start is None else start.rate[here], np.full(N, np.inf)
    if structure.is_rigid:
        return Equilibrium(poses.R_E, poses.p_E, theta_joint, tuple(theta_link), rate, 0)
    weight = theta_joint
    if structure.others:
        weight = torques(arm, forward(arm, cases.q), np.zeros_like(wrench), cases.p_ELoad)[0]
    iteration = 0
    while iteration < _MAX_ITERATIONS:
        iteration += 1
        new_joint, new_link = deflect(structure, cases, poses, theta_joint, theta_link, weight)
        change = np.abs(new_joint - theta_joint).max(axis=0, initial=0.0)
        for new, old in zip(new_link, theta_link, strict=True):
            if new is not None and old is not None:
                change = np.maximum(change, np.abs(new - old).max(axis=0))
        seen = (before < np.inf) & (before > 100 * _TOLERANCE)
        rate = np.where(seen, np.maximum(rate, change / np.where(seen, before, 1.0)), rate)
        theta_joint, theta_link, before = new_joint, new_link, change
        left = change if structure.others else change * np.minimum(np.where(rate > 0, _RATE_MARGIN * rate, 1.0), 1.0)
        for case in np.flatnonzero(~(change < HOPELESS)):
            judge_stability(structure, cases.take(np.array([case])), first + int(case), None, True)
        poses = forward(arm, cases.q, theta_joint, theta_link)
        if left.max() < tolerance:
            break
    failed = ~(left < max(tolerance, 1e-11))
    doubtful = np.flatnonzero((rate > _DOUBTFUL_RATE) | failed | (softness(structure, cases) > _DOUBTFUL_RATE))
    for case in doubtful:
        one = cases.take(np.array([case]))
        now = stack(theta_joint, theta_link)[:, [case]]
        stacked = newton(structure, one, now) if failed[case] and not structure.others else now
        judge_stability(structure, one, first + int(case), stacked, bool(failed[case] and structure.others))
        assert stacked is not None  # or it would have been refused
        theta_joint[:, [case]], links = unstack(structure, stacked)
        for own, new in zip(theta_link, links, strict=True):
            if own is not None and new is not None:
                own[:, [case]] = new
    if doubtful.size:
        poses = forward(arm, cases.q, theta_joint, theta_link)
    return Equilibrium(poses.R_E, poses.p_E, theta_joint, tuple(theta_link), rate, iteration)
