"""A kind of effect that the catalogue lacks: a joint that goes on giving while its load stays on, and comes back slowly."""

from itertools import pairwise

import numpy as np

from drake_stiffness.effects import Effect, Parameter, register
from drake_stiffness.errors import InputError


@register
class JointCreep(Effect):
    """theta = k s, where s runs after the joint's torque tau: T ds/dt = tau - s (a Kelvin element). T is searched, k fitted."""

    kind = "joint_creep"
    station = "spring"  # it acts on what the springs carry, inside the loaded equilibrium
    needs = ("load", "time")  # without loaded steps and column time_s it is untestable

    def __init__(self, where, relaxation_s=100.0):
        super().__init__(where)
        self.relaxation_s = relaxation_s

    @property
    def parameters(self):
        return (Parameter("k", "rad/(N m)", 1e-7, lower=0.0),)  # name, unit, typical size, bound

    def settings(self):  # what makes this effect again from model.json
        return {"relaxation_s": self.relaxation_s}

    @classmethod
    def candidates(cls, arm, points):  # everywhere it can be, and every constant worth trying: what `diagnose` tries
        for joint, slides in zip(arm.joint_names, arm.prismatic, strict=True):
            if not slides:
                yield from (cls(joint, T) for T in (10.0, 30.0, 100.0, 300.0, 1000.0))

    def neighbours(self, step):  # the constant a little changed: what `diagnose` refines
        yield from (JointCreep(self.where, self.relaxation_s * f) for f in (1 + step, 1 / (1 + step)))

    def check(self, arm, points):
        if self.where not in arm.joint_names:
            raise InputError(f"joint_creep at '{self.where}': there is no such joint.")

    def deflection(self, arm, carried, cases, x):  # one entry a load step; x holds the parameters
        joint = arm.joint_names.index(self.where)
        tau = carried.tau_joint[joint]
        s = tau.copy()  # at its first step, and where no time is known, the joint has settled
        for e in np.unique(cases.experiment):
            steps = np.flatnonzero((cases.experiment == e) & np.isfinite(cases.time_s))
            steps = steps[np.argsort(cases.step[steps])]
            for before, now in pairwise(steps):
                decay = np.exp((cases.time_s[before] - cases.time_s[now]) / self.relaxation_s)
                s[now] = tau[now] + (s[before] - tau[now]) * decay
        return {joint: x[0] * s}
