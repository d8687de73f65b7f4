"""What an effect would do to the readings: its columns in units of noise, at a fitted model.

Effects that deflect joints get J_i theta_i at the loaded posture, one evaluation of the effect a parameter; linear springs
their analytic columns (seed eq. 23); all others central differences of the loaded equilibrium. This is for screening many
candidates; what joins the model is refitted around the loaded equilibrium.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from drake_stiffness.arm import Poses, forward, joint_jacobian, torques
from drake_stiffness.effects import Effect
from drake_stiffness.effects.compliance import ROTATION_SCALE, Spring
from drake_stiffness.effects.effect import Carried, Cases, Reading
from drake_stiffness.equilibrium import Equilibrium, solve_equilibrium
from drake_stiffness.model import Model
from drake_stiffness.observation import Observations, whitened
from drake_stiffness.rotations import Array, logarithm, multiply, rotate
from drake_stiffness.sensitivity import SpringColumns, instrument_jacobians, take_poses
from drake_stiffness.simulation import read


@dataclass(frozen=True, eq=False)
class Scene:
    """A fitted model on the readings of a campaign: what every candidate is held against.

    Attributes
    ----------
    model : Model
    o : Observations
    """

    model: Model
    o: Observations

    @property
    def cases(self) -> Cases:
        return self.o.measurements.cases

    @cached_property
    def equilibrium(self) -> Equilibrium:
        return solve_equilibrium(self.model.structure, self.cases)

    @cached_property
    def poses(self) -> Poses:
        """The loaded arm, (..., N)."""
        return forward(
            self.model.structure.arm, self.cases.q, self.equilibrium.theta_joint, self.equilibrium.theta_link
        )

    @cached_property
    def carried(self) -> Carried:
        """What joints and links carry, weight included, and what the joints carry under weight alone."""
        arm, cases, links = self.model.structure.arm, self.cases, self.model.structure.links
        joint, link = torques(arm, self.poses, cases.wrench, cases.p_ELoad, self.equilibrium.theta_link, links)
        weight = torques(arm, forward(arm, cases.q), np.zeros_like(cases.wrench), cases.p_ELoad)[0]
        return Carried(joint, link, weight)

    @cached_property
    def joint_columns(self) -> Array:
        """Change of the readings per unit deflection of each joint, (n, 6, M), as the instruments see it."""
        m = self.o.measurements
        arm, poses = self.model.structure.arm, take_poses(self.poses, m.case)
        p = poses.p_E + rotate(poses.R_E, self.model.point_positions(m.point))
        J = joint_jacobian(arm, poses, p)
        turn = instrument_jacobians(self.model, self.cases, Reading(p, poses.R_E, m.point, m.case))
        if turn is None:
            return J
        return np.concatenate(
            [np.einsum("abm,nbm->nam", turn[0], J[:, :3]), np.einsum("abm,nbm->nam", turn[1], J[:, 3:])], axis=1
        )

    @cached_property
    def spring_columns(self) -> SpringColumns:
        m = self.o.measurements
        return SpringColumns(self.model, m.cases, m.case, m.point)

    def deflected(self, theta: dict[int, Array]) -> Array:
        """Change of the readings `(M, 6)` by further deflections `(N,)` of joints."""
        case = self.o.measurements.case
        out = np.zeros((case.size, 6))
        for number, extra in theta.items():
            out += (self.joint_columns[number] * extra[case]).T
        return out


def signature(scene: Scene, effect: Effect) -> Array:
    """Whitened columns `(rows, p)` of an effect that the model lacks, per unit of its parameters' scales."""
    scales = np.array([parameter.scale for parameter in effect.parameters])
    if isinstance(effect, Spring):
        change = scene.spring_columns.of(effect) * scales
    elif type(effect).deflection is not Effect.deflection or type(effect).torque is not Effect.torque:
        units = np.diag(scales)
        change = np.stack([scene.deflected(_deflection(scene, effect, x)) for x in units], axis=2)
    else:
        change = _differences(scene, effect, scales)
    return whitened(scene.o, change)


def _deflection(scene: Scene, effect: Effect, x: Array) -> dict[int, Array]:
    """By how much an effect deflects joints further, to first order."""
    structure = scene.model.structure
    theta = effect.deflection(structure.arm, scene.carried, scene.cases, x)
    for i, torque in effect.torque(structure.arm, scene.cases.q, scene.equilibrium.theta_joint, x).items():
        # A joint whose spring merged into those of its links has none of its own here; its size is then a matter of the unit.
        k = structure.k_joint[i] or ROTATION_SCALE
        theta[i] = theta.get(i, 0.0) + k * torque
    return theta


def _differences(scene: Scene, effect: Effect, scales: Array) -> Array:
    """Central differences around the effect's own start, `(M, 6, p)`."""
    m, model = scene.o.measurements, scene.model
    start = effect.initial()
    out = np.empty((m.case.size, 6, scales.size))
    fixed = scene.equilibrium if effect.station == "reading" else None
    for place, scale in enumerate(scales):
        ends = []
        for sign in (0.5, -0.5):
            x = start.copy()
            x[place] += sign * scale
            other = extended(model, effect, x)
            equilibrium = fixed or solve_equilibrium(other.structure, m.cases, scene.equilibrium)
            ends.append(read(other, equilibrium, m.cases, m.case, m.point))
        out[:, :3, place] = (ends[0].p - ends[1].p).T
        out[:, 3:, place] = logarithm(multiply(ends[0].R, ends[1].R.transpose(1, 0, 2))).T
    return out


def extended(model: Model, effect: Effect, x: Array | None = None) -> Model:
    """The model with one more effect, by default at its start."""
    values = effect.initial() if x is None else x
    return replace(model, effects=(*model.effects, effect), x=np.concatenate([model.x, values]), statistics=None)
