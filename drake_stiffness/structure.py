"""What the equilibrium needs of a model: the arm as it really is, its springs, and what else bends it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from drake_stiffness.arm import Arm, Poses, torques
from drake_stiffness.effects.effect import Carried, Cases, Effect
from drake_stiffness.rotations import Array

# Torques of hardware change by less than their own size over a radian: this step keeps ten digits of their slope.
_STEP = 1e-5
# A joint gives way by milliradians; the torque on it hardly changes over that.
_NEWTON_STEPS = 4


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
    torque_effects : tuple of (effect, values)
        Effects with a `torque` of their own.
    """

    arm: Arm
    k_joint: Array
    k_link: tuple[Array | None, ...]
    others: tuple[tuple[Effect, Array], ...] = ()
    wrench_effects: tuple[tuple[Effect, Array], ...] = ()
    torque_effects: tuple[tuple[Effect, Array], ...] = ()

    @property
    def links(self) -> list[bool]:
        return [k is not None for k in self.k_link]

    @property
    def is_rigid(self) -> bool:
        return not (self.k_joint.any() or any(k is not None and k.any() for k in self.k_link) or self.others)


def acts_on_joints(effect: Effect) -> bool:
    """Whether an effect puts torques of its own on joints."""
    return type(effect).torque is not Effect.torque


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
    others, torque = [], []
    for effect, x in zip(effects, values, strict=True):
        if effect.station != "spring":
            continue
        effect.compliance(arm, x, joint, link)
        if type(effect).deflection is not Effect.deflection:
            others.append((effect, x))
        if acts_on_joints(effect):
            torque.append((effect, x))
    wrench = tuple((e, x) for e, x in zip(effects, values, strict=True) if e.station == "wrench")
    k_link = tuple(link.get(k) for k in range(arm.num_joints + 1))
    return Structure(arm, joint, k_link, tuple(others), wrench, tuple(torque))


def add_torques(structure: Structure, q: Array, theta: Array, tau_joint: Array) -> None:
    """Add the torques that hardware puts on the joints to `tau_joint (n, N)` (own array of the caller)."""
    for effect, x in structure.torque_effects:
        for number, extra in effect.torque(structure.arm, q, theta, x).items():
            tau_joint[number] += extra


def torque_slope(structure: Structure, q: Array, theta: Array) -> Array:
    """d T / d theta (n, N) of the torques T that hardware puts on the joints, by central differences."""
    ends = []
    for step in (_STEP, -_STEP):
        ends.append(np.zeros_like(theta))
        add_torques(structure, q, theta + step, ends[-1])
    return np.asarray((ends[0] - ends[1]) / (2 * _STEP))


def carried_with_hardware(structure: Structure, q: Array, tau_joint: Array) -> Array:
    """What a joint's deflection is per unit of its compliance, (n, N): d theta / d k where theta = k (tau + T(q, theta)).

    Without hardware on the joint this is `tau_joint` itself, the torque it carries on the undeflected arm.
    """
    if not structure.torque_effects:
        return tau_joint
    k, theta = structure.k_joint[:, None], structure.k_joint[:, None] * tau_joint
    for _ in range(_NEWTON_STEPS):
        total = tau_joint.copy()
        add_torques(structure, q, theta, total)
        softening = 1 - k * torque_slope(structure, q, theta)
        theta = theta - (theta - k * total) / softening
    return np.asarray(total / softening)


def deflect(
    structure: Structure,
    cases: Cases,
    poses: Poses,
    theta_joint: Array,
    theta_link: Sequence[Array | None],
    weight: Array,
) -> tuple[Array, list[Array | None]]:
    """k tau at the present poses and deflections."""
    tau_joint, tau_link = torques(structure.arm, poses, cases.wrench, cases.p_ELoad, theta_link, structure.links)
    add_torques(structure, cases.q, theta_joint, tau_joint)
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


def at_rest(structure: Structure, N: int) -> tuple[Array, list[Array | None]]:
    """No deflection."""
    return np.zeros((structure.arm.num_joints, N)), [None if k is None else np.zeros((6, N)) for k in structure.k_link]


def stack(joint: Array, link: Sequence[Array | None]) -> Array:
    """Deflections of all springs as (dof, N)."""
    return np.concatenate([joint, *(part for part in link if part is not None)])


def unstack(structure: Structure, stacked: Array) -> tuple[Array, list[Array | None]]:
    """The inverse of `stack`."""
    n = structure.arm.num_joints
    starts = iter(range(n, stacked.shape[0], 6))
    links = [None if k is None else stacked[(a := next(starts)) : a + 6] for k in structure.k_link]
    return stacked[:n], links
