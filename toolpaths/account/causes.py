"""What bends the tool off its path: shares of joints, links and further effects, and what a joints-only model would leave.

By linear superposition on the undeflected arm. Under the process force alone a spring moves the tool by

    d_s = J_s k_s tau_s                                                                     (seed eq. 8, spring by spring)

and an effect that is no linear spring by J_i times what it adds to joint i, under force and weight less under weight alone.
Each is projected on the direction of the whole predicted deflection D; its share is sum_t u_t . d_s,t / sum_t |D_t|. What is
left to one is of second order (for `reference: rigid` sag under weight, for `geometry: true` geometry as well) and has a line
of its own, so that shares add up to one.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from drake_stiffness.arm import Poses, forward, joint_jacobian, link_jacobian, torques
from drake_stiffness.effects.effect import Carried
from drake_stiffness.rotations import rotate
from drake_stiffness.structure import add_torques
from toolpaths.compensation import CHUNK, Bench
from toolpaths.history import PathOrder

Floats = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class BestJoints:
    """Least squares over joint compliances: normal matrix (n, n) and right side (n,), squared deflections, number of points."""

    normal: Floats
    right: Floats
    power: float
    number: int

    def __add__(self, other: BestJoints) -> BestJoints:
        return BestJoints(
            self.normal + other.normal, self.right + other.right, self.power + other.power, self.number + other.number
        )

    @property
    def left_mm(self) -> float:
        """RMS, mm, of what it leaves."""
        return _left_by_best(self.normal, self.right, self.power, self.number)


@dataclass(frozen=True, eq=False)
class Causes:
    """Attributes
    ----------
    kind, where : C names
        Kind of effect, and the joint or link; the last is `remainder`.
    share : (C,)
        Of the predicted deflection along its own direction; they add up to one (NaN where nothing deflects).
    mean_mm : (C,)
        Mean length of what each contributes, whatever its direction; NaN for the remainder.
    by_force : (3, N)
        Deflection by the process force, superposed, m, world axes.
    joints_only_mm : (N,)
        What a correction by this model's joint springs alone would leave.
    best_joints_only_mm : float
        RMS of what the best joint springs for this very program would leave: no joints-only model can do better here.
    best : BestJoints
        Where that comes from.
    """

    kind: tuple[str, ...]
    where: tuple[str, ...]
    share: Floats
    mean_mm: Floats
    by_force: Floats
    joints_only_mm: Floats
    best_joints_only_mm: float
    best: BestJoints

    def to_list(self) -> list[dict[str, object]]:
        """For `--json`, largest first, the remainder last."""
        order = sorted(range(len(self.kind) - 1), key=lambda c: -abs(float(np.nan_to_num(self.share[c]))))
        return [
            {
                "kind": self.kind[c],
                "where": self.where[c],
                "share": float(self.share[c]),
                "mean_mm": float(self.mean_mm[c]),
            }
            for c in [*order, len(self.kind) - 1]
        ]


def causes_of(bench: Bench, q: Floats, wrench: Floats, deflection: Floats, remainder: str) -> Causes:
    """Shares of a path's deflection.

    Parameters
    ----------
    q, wrench : (n, N), (6, N)
        Joints of the program as it is, and what the tool carries.
    deflection : (3, N)
        The whole predicted deflection, m, world axes.
    remainder : name of what superposition leaves
    """
    N = q.shape[1]
    size = max(N, 1) if bench.order else CHUNK
    labels: list[tuple[str, str]] = []
    along, lengths, whole = np.zeros(0), np.zeros(0), 0.0
    by_force, by_joints = np.zeros((3, N)), np.zeros((3, N))
    normal, right = np.zeros((q.shape[0],) * 2), np.zeros(q.shape[0])
    for start in range(0, N, size):
        own = slice(start, min(start + size, N))
        D = deflection[:, own]
        length = np.sqrt((D**2).sum(axis=0))
        u = D / np.where(length > 0, length, 1.0)
        parts, J, tau = _parts(bench, q[:, own], wrench[:, own])
        labels = [label for label, _ in parts]
        if not along.size:
            along, lengths = np.zeros(len(parts)), np.zeros(len(parts))
        for c, ((kind, _), d) in enumerate(parts):
            along[c] += float((u * d).sum())
            lengths[c] += float(np.sqrt((d**2).sum(axis=0)).sum())
            by_force[:, own] += d
            if kind == "joint_compliance":
                by_joints[:, own] += d
        whole += float(length.sum())
        columns = (J[:, :3] * tau[:, None]).reshape(J.shape[0], -1)
        normal += columns @ columns.T
        right += columns @ by_force[:, own].reshape(-1)
    share = along / whole if whole > 0 else np.full(along.size, np.nan)
    best = BestJoints(normal, right, float((by_force**2).sum()), N)
    left = np.sqrt(((by_force - by_joints) ** 2).sum(axis=0)) * 1e3
    return Causes(
        kind=(*(kind for kind, _ in labels), remainder),
        where=(*(where for _, where in labels), ""),
        share=np.append(share, 1 - share.sum()),
        mean_mm=np.append(lengths / max(N, 1) * 1e3, np.nan),
        by_force=by_force,
        joints_only_mm=left,
        best_joints_only_mm=best.left_mm,
        best=best,
    )


def _left_by_best(normal: Floats, right: Floats, power: float, N: int) -> float:
    """RMS, mm, of what least squares over joint compliances leaves of deflections of a given power."""
    scale = np.sqrt(np.diag(normal))
    seen = scale > 1e-12 * scale.max(initial=0.0)
    if not N or not seen.any():
        return float(np.sqrt(power / max(N, 1)) * 1e3)
    A, b = normal[np.ix_(seen, seen)] / np.outer(scale[seen], scale[seen]), right[seen] / scale[seen]
    explained = float(b @ np.linalg.lstsq(A, b, rcond=1e-12)[0])
    return float(np.sqrt(max(power - explained, 0.0) / N) * 1e3)


def _parts(bench: Bench, q: Floats, wrench: Floats) -> tuple[list[tuple[tuple[str, str], Floats]], Floats, Floats]:
    """Label and contribution (3, N) of every cause; the Jacobian (n, 6, N) of the joints and what they carry (n, N)."""
    s = bench.loaded
    poses = forward(s.arm, q)
    tip = poses.p_E + rotate(poses.R_E, bench.p_ET[:, None])
    J = joint_jacobian(s.arm, poses, tip)
    light = replace(s.arm, gravity=np.zeros(3))
    tau, tau_link = torques(light, poses, wrench, bench.p_ET, None, s.links)
    parts: list[tuple[tuple[str, str], Floats]] = [
        (("joint_compliance", name), J[i, :3] * (s.k_joint[i] * tau[i]))
        for i, name in enumerate(s.arm.joint_names)
        if s.k_joint[i]
    ]
    for k, name in enumerate(s.arm.link_names):
        compliance, carried = s.k_link[k], tau_link[k]
        if compliance is not None and carried is not None:
            theta = np.einsum("ij,jn->in", compliance, carried)
            kind = "link_compliance" if k else "base_compliance"
            parts.append(((kind, name), np.einsum("cpn,cn->pn", link_jacobian(poses, k, tip)[:, :3], theta)))
    parts += [
        (label, (J[:, :3] * theta[:, None]).sum(axis=0))
        for label, theta in _beyond_springs(bench, q, wrench, poses, tau)
    ]
    return parts, J, tau


def _beyond_springs(
    bench: Bench, q: Floats, wrench: Floats, poses: Poses, tau: Floats
) -> Iterator[tuple[tuple[str, str], Floats]]:
    """Joint deflections (n, N) that effects other than linear springs add under the process force."""
    s = bench.loaded
    if not (s.others or s.torque_effects):
        return
    N = q.shape[1]
    order = bench.order or PathOrder(np.arange(N), np.ones(N, dtype=bool))
    weight = torques(s.arm, poses, np.zeros_like(wrench), bench.p_ET)[0]
    cases = order.cases(q, wrench, bench.p_ET)
    if s.torque_effects:
        k = s.k_joint[:, None]
        ends = []
        for carried in (weight + tau, weight):
            ends.append(np.zeros_like(tau))
            add_torques(s, q, k * carried, ends[-1])
        where = "+".join(effect.where for effect, _ in s.torque_effects)
        yield (s.torque_effects[0][0].kind, where), k * (ends[0] - ends[1])
    W = weight[:, order.point]
    loaded = W + tau[:, order.point] * order.loaded
    no_links: list[Floats | None] = [None] * len(s.k_link)
    for effect, x in s.others:
        theta = np.zeros((q.shape[0], N))
        for sign, carried in ((1.0, loaded), (-1.0, W)):
            extra = effect.deflection(s.arm, Carried(carried, no_links, W), cases, x)
            for joint, value in extra.items():
                theta[joint] += sign * value[order.loaded]
        yield (effect.kind, effect.where), theta
