"""The arm as numbers: constants read once from a finalized Drake plant, evaluated for whole arrays of postures.

The chain is, from the world to the flange (seed eq. 1, with the base as a seventh link),

    X_WE = X_WF1 S_0  Joint_1(q_1 + theta_1)  X_M1F2 S_1  ...  Joint_n(q_n + theta_n)  X_MnE S_n

where F_i is the parent-side frame of joint i, M_i its child-side frame, E the flange, and S_k the 6-dof spring of link k:
a translation (dx, dy, dz) followed by a rotation exp(rx, ry, rz), both in the axes of the frame it stands in.

Frame notation is Drake's: `X_AB`, `R_AB`, `p_AB`; arrays inside end in the number of postures N (see `rotations`).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from drake_stiffness.rotations import (
    Array,
    conjugate_moment,
    cross,
    exponential,
    multiply,
    rotate,
    rotate_back,
    rotate_fixed,
    turned,
)


@dataclass(frozen=True, eq=False)
class Arm:
    """Kinematic and mass constants of a serial arm with n joints and n + 1 links (the base link counts).

    Attributes
    ----------
    joint_names, link_names : tuples of n and n + 1 names
    prismatic : tuple of n bools
    R_PF, p_PF : (n + 1, 3, 3), (n + 1, 3)
        Pose of link k's spring frame (F_{k+1}, the flange for the last) in its own joint's child-side frame (the world
        for the base); metres.
    axis_F : (n, 3)
        Unit axis of joint i in F_i.
    lower, upper : (n,)
        Joint limits, rad or m; infinite where the model has none.
    mass_kg, p_MCom : (n + 1,), (n + 1, 3)
        Mass and centre of mass of every link in its own joint's child-side frame.
    tool_mass_kg, p_ETool : float, (3,)
        Mass and centre of mass of what the flange carries, beyond the last link's spring.
    gravity : (3,)
        m/s^2 in the world.
    """

    joint_names: tuple[str, ...]
    link_names: tuple[str, ...]
    prismatic: tuple[bool, ...]
    R_PF: Array
    p_PF: Array
    axis_F: Array
    lower: Array
    upper: Array
    mass_kg: Array
    p_MCom: Array
    tool_mass_kg: float
    p_ETool: Array
    gravity: Array

    @property
    def num_joints(self) -> int:
        return len(self.joint_names)

    @property
    def length_m(self) -> float:
        """Mean length of a link, which makes translations and rotations comparable when springs are scaled."""
        return float(max(np.linalg.norm(self.p_PF, axis=1).mean(), 1e-3))

    def to_dict(self) -> dict[str, Any]:
        """Plain lists and numbers, as they stand in `model.json`; infinite limits become null there."""
        return {key: value.tolist() if isinstance(value, np.ndarray) else value for key, value in asdict(self).items()}

    @staticmethod
    def from_dict(content: dict[str, Any]) -> Arm:
        """The inverse of `to_dict`."""
        known: dict[str, Any] = {k: tuple(content[k]) for k in ("joint_names", "link_names", "prismatic")}
        for key in ("R_PF", "p_PF", "axis_F", "mass_kg", "p_MCom", "p_ETool", "gravity"):
            known[key] = np.array(content[key], dtype=float)
        for key, unlimited in (("lower", -np.inf), ("upper", np.inf)):
            known[key] = np.array([unlimited if v is None else v for v in content[key]], dtype=float)
        n = len(known["joint_names"])
        shapes = {
            "R_PF": (n + 1, 3, 3), "p_PF": (n + 1, 3), "axis_F": (n, 3), "lower": (n,), "upper": (n,),
            "mass_kg": (n + 1,), "p_MCom": (n + 1, 3), "p_ETool": (3,), "gravity": (3,),
        }  # fmt: skip
        for key, shape in shapes.items():
            if known[key].shape != shape:
                raise ValueError(f"arm.{key} has shape {known[key].shape}, expected {shape}")
            if key not in ("lower", "upper") and not np.isfinite(known[key]).all():
                raise ValueError(f"arm.{key} holds a number that is not finite")
        if len(known["link_names"]) != n + 1 or len(known["prismatic"]) != n:
            raise ValueError(f"arm.link_names and arm.prismatic do not fit {n} joints")
        return Arm(**known, tool_mass_kg=float(content["tool_mass_kg"]))


@dataclass(frozen=True, eq=False)
class Poses:
    """Where everything is for N postures, in the world; lists run along the chain.

    Attributes
    ----------
    R_F, p_F : lists of n + 1 arrays (3, 3, N), (3, N)
        Spring frames before the spring's own deflection.
    p_S : list of n + 1 arrays (3, N)
        Origins about which the springs turn (after their translation).
    axis, p_J : lists of n arrays (3, N)
        Joint axes and a point on each.
    p_C : list of n + 1 arrays (3, N)
        Centres of mass: entry k of link k (the base link's is not used), the last + 1 of the tool.
    R_E, p_E : (3, 3, N), (3, N)
        The flange, beyond the last spring.
    """

    R_F: list[Array]
    p_F: list[Array]
    p_S: list[Array]
    axis: list[Array]
    p_J: list[Array]
    p_C: list[Array]
    R_E: Array
    p_E: Array

    def points(self, p_EP: Array) -> Array:
        """World positions `(P, 3, N)` of points `p_EP (P, 3)` fixed on the flange."""
        return np.stack([self.p_E + rotate(self.R_E, p[:, None]) for p in np.atleast_2d(p_EP)])


def forward(
    arm: Arm, q: Array, theta_joint: Array | None = None, theta_link: Sequence[Array | None] | None = None
) -> Poses:
    """Poses of N postures, deflected or not.

    Parameters
    ----------
    q : (n, N)
        Commanded joint positions, rad or m.
    theta_joint : (n, N), optional
        Deflection of the joint springs.
    theta_link : n + 1 entries of (6, N) or None, optional
        Deflection of the link springs; None where a link is rigid.
    """
    n = arm.num_joints
    angles = q if theta_joint is None else q + theta_joint
    N = angles.shape[1]
    R, p = np.broadcast_to(np.eye(3)[:, :, None], (3, 3, 1)), np.zeros((3, 1))
    out = Poses([], [], [], [], [], [], R, p)
    bends = {} if theta_link is None else _bends(theta_link)
    turns_not = (np.eye(3) == arm.R_PF).all(axis=(1, 2))
    for k in range(n + 1):
        if k:
            out.p_C.append(p + rotate_fixed(R, arm.p_MCom[k]))
        else:
            out.p_C.append(p)
        p = p + rotate_fixed(R, arm.p_PF[k])
        if not turns_not[k]:
            R = multiply(R, arm.R_PF[k][:, :, None])
        out.R_F.append(R)
        out.p_F.append(p)
        theta = None if theta_link is None else theta_link[k]
        if theta is not None:
            p = p + rotate(R, theta[:3])
            R = multiply(R, bends[k])
        out.p_S.append(p)
        if k == n:
            break
        axis = rotate_fixed(R, arm.axis_F[k])
        out.axis.append(axis)
        out.p_J.append(p)
        if arm.prismatic[k]:
            p = p + axis * angles[k]
        else:
            R = turned(R, arm.axis_F[k], angles[k])
    full = (3, 3, N)
    R_E, p_E = np.broadcast_to(R, full), np.broadcast_to(p, full[1:])
    out.p_C.append(p_E + rotate_fixed(R_E, arm.p_ETool))
    return Poses(out.R_F, out.p_F, out.p_S, out.axis, out.p_J, out.p_C, R_E, p_E)


def _bends(theta_link: Sequence[Array | None]) -> dict[int, Array]:
    """Rotation (3, 3, N) of every link spring that there is; all at once, because calls cost more than numbers."""
    known = {k: theta[3:] for k, theta in enumerate(theta_link) if theta is not None}
    if not known:
        return {}
    all_of_them = exponential(np.concatenate(list(known.values()), axis=1))
    return dict(zip(known, np.split(all_of_them, len(known), axis=2), strict=True))


def torques(
    arm: Arm,
    poses: Poses,
    wrench: Array,
    p_ELoad: Array,
    theta_link: Sequence[Array | None] | None = None,
    links: Sequence[bool] | None = None,
) -> tuple[Array, list[Array | None]]:
    """What every spring carries: the weight of all that hangs beyond it and the applied wrench (seed eq. 3 with weight).

    Parameters
    ----------
    wrench : (6, N)
        Force and moment on the tool at the load point, world axes, N and N m.
    p_ELoad : (3,) or (3, N)
        The load point in the flange frame.
    theta_link : deflections, needed where a spring turns by a finite angle
    links : n + 1 bools, optional
        For which links the wrench is wanted; default none.

    Returns
    -------
    tau_joint : (n, N)
        Torque about (force along) every joint axis.
    tau_link : n + 1 entries of (6, N) or None
        Generalised force of every wanted link spring in its own coordinates (fx, fy, fz, mx, my, mz).
    """
    n = arm.num_joints
    g = arm.gravity[:, None]
    N = wrench.shape[1]
    load = p_ELoad[:, None] if p_ELoad.ndim == 1 else p_ELoad
    p_L = poses.p_E + rotate(poses.R_E, load)
    weight = arm.tool_mass_kg * g
    force = wrench[:3] + weight
    # Moments are about the world's origin, so that passing inward along the chain is a plain sum.
    moment = wrench[3:] + cross(p_L, wrench[:3]) + cross(poses.p_C[n + 1], np.broadcast_to(weight, (3, N)))
    tau_joint = np.empty((n, N))
    tau_link: list[Array | None] = [None] * (n + 1)
    for k in range(n, -1, -1):
        if links is not None and links[k]:
            about = moment - cross(poses.p_S[k], force)
            f = rotate_back(poses.R_F[k], force)
            m = rotate_back(poses.R_F[k], about)
            theta = None if theta_link is None else theta_link[k]
            tau_link[k] = np.concatenate([f, m if theta is None else conjugate_moment(theta[3:], m)])
        if k:
            weight = arm.mass_kg[k] * g
            force = force + weight
            moment = moment + cross(poses.p_C[k], np.broadcast_to(weight, poses.p_C[k].shape))
            axis, point = poses.axis[k - 1], poses.p_J[k - 1]
            carried = force if arm.prismatic[k - 1] else moment - cross(point, force)
            tau_joint[k - 1] = (axis * carried).sum(axis=0)
    return tau_joint, tau_link


def joint_jacobian(arm: Arm, poses: Poses, p: Array) -> Array:
    """Jacobian of a point and of the flange's orientation in the joints: `(n, 6, N)`, rows (p, phi) as the seed orders.

    Parameters
    ----------
    p : (3, N)
        World position of the point.
    """
    N = p.shape[1]
    J = np.zeros((arm.num_joints, 6, N))
    for i, prismatic in enumerate(arm.prismatic):
        if prismatic:
            J[i, :3] = poses.axis[i]
        else:
            J[i, :3] = cross(np.broadcast_to(poses.axis[i], (3, N)), p - poses.p_J[i])
            J[i, 3:] = poses.axis[i]
    return J


def link_jacobian(poses: Poses, k: int, p: Array) -> Array:
    """Jacobian of a point in the six coordinates of link k's spring at zero deflection: `(6, 6, N)`, coordinate first."""
    N = p.shape[1]
    J = np.zeros((6, 6, N))
    R = np.broadcast_to(poses.R_F[k], (3, 3, N))
    arm = p - poses.p_F[k]
    for c in range(3):
        J[c, :3] = R[:, c]
        J[3 + c, :3] = cross(R[:, c], arm)
        J[3 + c, 3:] = R[:, c]
    return J


def chain_jacobian(arm: Arm, q: Array, p_EP: Array, links: Sequence[bool] | None = None) -> tuple[Array, list[str]]:
    """Jacobian J_theta of seed eq. (4) at undeflected postures, for every joint and every wanted link spring.

    Parameters
    ----------
    q : (N, n)
        Postures, rad or m.
    p_EP : (3,)
        The point on the flange.
    links : n + 1 bools, optional
        Default: all.

    Returns
    -------
    J : (N, 6, dof)
        Rows (p, phi).
    names : list of dof names
        Joints first, then `link.dx` ... `link.rz`.
    """
    poses = forward(arm, np.asarray(q, dtype=float).T)
    p = poses.points(p_EP)[0]
    wanted = [True] * (arm.num_joints + 1) if links is None else list(links)
    parts = [joint_jacobian(arm, poses, p)]
    names = list(arm.joint_names)
    for k, name in enumerate(arm.link_names):
        if wanted[k]:
            parts.append(link_jacobian(poses, k, p))
            names += [f"{name}.{c}" for c in ("dx", "dy", "dz", "rx", "ry", "rz")]
    return np.concatenate(parts).transpose(2, 1, 0), names
