"""Where a correction would chase what jumps: torques that change sign over a backlash, and friction that turns round.

A joint with backlash of width b rests on the side its torque pushes to. Where the carried torque changes sign from one point to
the next, the predicted tool jumps by J_i b and the correction jumps against it. On the machine the jump comes where the torque
really changes sign, which hangs on the force assumed: a point too early or too late leaves the whole jump as an error. Friction
does not jump, but what it leaves hangs on the way there; the correction follows the order of the program.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from drake_stiffness.arm import forward, joint_jacobian, torques
from drake_stiffness.effects.hysteresis import JointHysteresis, play
from drake_stiffness.effects.transmission import JointBacklash
from drake_stiffness.rotations import rotate
from toolpaths.compensation import Bench
from toolpaths.history import PathOrder

Floats = NDArray[np.float64]
Ints = NDArray[np.int_]

_SHOWN = 12
# Steps of a torque below this share of its size are rounding.
_ROUNDING = 1e-9


@dataclass(frozen=True, eq=False)
class Turning:
    """Attributes
    ----------
    jump : (3, J, N)
        Jump of the tool (m, world) at every backlash, times the root of p (1 - p), p the chance of the other sign.
    kind, where : per place, what turns
    points : per place (M,), the path's points at which it turns, seen from the point before
    size_mm : per place, the largest jump (backlash) or what friction moves (twice its amplitude), mm
    """

    jump: Floats
    kind: tuple[str, ...]
    where: tuple[str, ...]
    points: tuple[Ints, ...]
    size_mm: tuple[float, ...]

    def to_list(self, line: Ints) -> list[dict[str, object]]:
        """For `--json`."""
        return [
            {"kind": kind, "where": where, "lines": sorted(set(line[points].tolist())), "size_mm": size}
            for kind, where, points, size in zip(self.kind, self.where, self.points, self.size_mm, strict=True)
        ]

    def notes(self, line: Ints) -> list[str]:
        """What the user should know, with lines."""
        found = []
        for kind, where, points, size in zip(self.kind, self.where, self.points, self.size_mm, strict=True):
            if not points.size:
                continue
            lines = sorted(set(line[points].tolist()))
            more = f" and {len(lines) - _SHOWN} more" if len(lines) > _SHOWN else ""
            place = f"line {', '.join(map(str, lines[:_SHOWN]))}{more}"
            if kind == JointBacklash.kind:
                found.append(
                    f"the correction chases the backlash of {where}: its torque changes sign at {place}, and the correction jumps by up "
                    f"to {size:.3f} mm there; the machine jumps where the torque really changes sign, which hangs on the force assumed"
                )
            else:
                found.append(
                    f"friction of {where} turns round at {place}: what it leaves (up to {size:.3f} mm) depends on the way there; the "
                    "correction follows the order of the program, so run it from its start"
                )
        return found


def turning_points(
    bench: Bench, q: Floats, wrench: Floats, begin: NDArray[np.bool_], relative_sigma: Floats
) -> Turning:
    """Jumps and turning points along a path.

    Parameters
    ----------
    q, wrench : (n, N), (6, N)
    begin : (N,)
        Where a cut begins: nothing is compared across.
    relative_sigma : (N,)
        Of the process force.
    """
    effects = [(e, x) for e, x in bench.loaded.others if isinstance(e, JointBacklash | JointHysteresis)]
    N = q.shape[1]
    if not effects:
        return Turning(np.zeros((3, 0, N)), (), (), (), ())
    from scipy.special import ndtr

    s = bench.loaded
    poses = forward(s.arm, q)
    J = joint_jacobian(s.arm, poses, poses.p_E + rotate(poses.R_E, bench.p_ET[:, None]))[:, :3]
    whole = torques(s.arm, poses, wrench, bench.p_ET)[0]
    weight = torques(s.arm, poses, np.zeros_like(wrench), bench.p_ET)[0]
    jumps, points, sizes = [], [], []
    for effect, x in effects:
        i = effect.number(s.arm)
        if isinstance(effect, JointBacklash):
            jump = J[i] * x[0]
            spread = relative_sigma * np.abs(whole[i] - weight[i])
            ratio = np.abs(whole[i]) / np.where(spread > 0, spread, 1.0)
            other = np.where(spread > 0, ndtr(-ratio), 0.0)
            jumps.append(jump * np.sqrt(other * (1 - other)))
            signs = [np.sign(whole[i])] + ([np.sign(weight[i])] if bench.reference == "unloaded" else [])
            turns = np.any([_changes(sign) for sign in signs], axis=0) & ~begin
            size = np.sqrt((jump**2).sum(axis=0))
        else:
            order = bench.order or PathOrder(np.arange(N), np.ones(N, dtype=bool))
            tau = np.where(order.loaded, whole[i, order.point], weight[i, order.point])
            followed = play(tau, weight[i, order.point], effect.threshold, order.cases(q, wrench, bench.p_ET))
            turns = _reversals(followed[order.loaded], begin)
            size = 2 * x[0] * np.sqrt((J[i] ** 2).sum(axis=0))
        here = np.flatnonzero(turns)
        points.append(here)
        sizes.append(float(size[here].max(initial=0.0)) * 1e3)
    return Turning(
        np.stack(jumps, axis=1) if jumps else np.zeros((3, 0, N)),
        tuple(e.kind for e, _ in effects),
        tuple(e.where for e, _ in effects),
        tuple(points),
        tuple(sizes),
    )


def _changes(sign: Floats) -> NDArray[np.bool_]:
    """(N,) where a sign differs from the one before."""
    return np.concatenate([[False], sign[1:] * sign[:-1] < 0])


def _reversals(followed: Floats, begin: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """(N,) where the torque that a joint follows starts to go the other way than it last went, within a cut."""
    step = np.diff(followed, prepend=followed[:1])
    step = np.sign(np.where(np.abs(step) > _ROUNDING * np.abs(followed).max(initial=0.0), step, 0.0))
    step[begin] = 0.0
    moving = np.flatnonzero(step)
    out = np.zeros(followed.size, dtype=bool)
    if moving.size > 1:
        cut = np.cumsum(begin)
        turned = (step[moving][1:] != step[moving][:-1]) & (cut[moving][1:] == cut[moving][:-1])
        out[moving[1:][turned]] = True
    return out
