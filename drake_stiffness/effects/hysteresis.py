"""Friction that keeps a joint back: the play operator over the order of load steps."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import TYPE_CHECKING

import numpy as np

from drake_stiffness.effects.effect import Carried, Cases, Effect, Parameter
from drake_stiffness.effects.transmission import JointEffect
from drake_stiffness.rotations import Array

if TYPE_CHECKING:
    from drake_stiffness.arm import Arm

# Half-widths of the play that a search tries, N m (or N): geometric, from where every step slips to where few do.
THRESHOLDS = (5.0, 15.0, 40.0, 100.0, 250.0, 600.0, 1500.0, 4000.0)


class JointHysteresis(JointEffect):
    """Friction: the joint follows a torque p that lags behind the carried torque tau by at most r, the play operator

        p_t = min(max(p_(t-1), tau_t - r), tau_t + r)        theta = a (p - tau) / r

    so loading and unloading differ by up to 2 a. History starts with every experiment at p = the torque of weight alone.
    Needs unloading at more than one level. The half-width r is a constant of the effect (searched, not fitted); a is fitted.
    """

    kind = "joint_hysteresis"
    needs = ("load", "unloading")

    def __init__(self, where: str, prismatic: bool = False, threshold: float = 100.0) -> None:
        super().__init__(where, prismatic)
        self.threshold = threshold

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        return (Parameter("amplitude", self.deflection_unit, 1e-4, lower=0.0),)

    def settings(self) -> dict[str, object]:
        return {**super().settings(), "threshold": self.threshold}

    @classmethod
    def candidates(cls, arm: Arm, points: Mapping[str, object]) -> Iterator[Effect]:
        for name, prismatic in zip(arm.joint_names, arm.prismatic, strict=True):
            for threshold in THRESHOLDS:
                yield cls(name, bool(prismatic), threshold)

    def neighbours(self, step: float) -> Iterator[Effect]:
        for factor in (1 + step, 1 / (1 + step)):
            yield JointHysteresis(self.where, self.prismatic, self.threshold * factor)

    def idle(self, arm: Arm, carried: Carried) -> bool:
        """A joint that never slips is a spring of the load alone."""
        i = self.number(arm)
        return float(np.abs(carried.tau_joint[i] - carried.weight_joint[i]).max(initial=0.0)) <= self.threshold

    def deflection(self, arm: Arm, carried: Carried, cases: Cases, x: Array) -> dict[int, Array]:
        i = self.number(arm)
        tau = carried.tau_joint[i]
        followed = play(tau, carried.weight_joint[i], self.threshold, cases)
        return {i: x[0] * (followed - tau) / self.threshold}


def play(tau: Array, start: Array, r: float, cases: Cases) -> Array:
    """The play operator of half-width r over the steps of every experiment, `(N,)`.

    Parameters
    ----------
    tau, start : (N,)
        Torque, and the state in which every experiment begins (that of its first step is taken).
    """
    if not cases.experiment.size:  # no history is known: every case comes straight from weight alone
        return np.minimum(np.maximum(start, tau - r), tau + r)
    order = np.lexsort((cases.step, cases.experiment))
    experiment = cases.experiment[order]
    first = np.flatnonzero(np.diff(experiment, prepend=-1))
    length = np.diff(np.append(first, experiment.size))
    out = np.empty_like(tau)
    p = start[order[first]]
    for place in range(int(length.max(initial=0))):
        going = np.flatnonzero(length > place)
        here = order[first[going] + place]
        p[going] = np.minimum(np.maximum(p[going], tau[here] - r), tau[here] + r)
        out[here] = p[going]
    return out
