"""What an effect would do to the readings: its columns in units of noise, at a fitted model.

Effects that deflect joints get their deflection times what a turn of the joint does to the loaded arm; linear springs
their analytic columns (seed eq. 23); all others central differences of the loaded equilibrium. This is for screening many
candidates; what joins the model is refitted around the loaded equilibrium.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from drake_stiffness.arm import Arm, Poses, forward, torques
from drake_stiffness.effects import Effect
from drake_stiffness.effects.compliance import ROTATION_SCALE, Spring
from drake_stiffness.effects.effect import Carried, Cases, Parameter
from drake_stiffness.equilibrium import Equilibrium, solve_equilibrium
from drake_stiffness.model import Model
from drake_stiffness.observation import Observations, whitened
from drake_stiffness.rotations import Array, logarithm, multiply
from drake_stiffness.sensitivity import SpringColumns
from drake_stiffness.simulation import read

# A further deflection (rad or m) whose effect is linear, and far above rounding.
_TURNED = 1e-4
# A column that a million units of its scale would leave below one sigma is not seen.
_UNSEEN = 1e-6


class _Turned(Effect):
    """A joint that stands off by a constant, load or no load; never a suspect."""

    kind, station = "turned", "spring"

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        return (Parameter("turn", "rad", _TURNED),)

    def deflection(self, arm: Arm, carried: Carried, cases: Cases, x: Array) -> dict[int, Array]:
        return {arm.joint_names.index(self.where): np.full(cases.number, x[0])}


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
        """Change of the readings per unit of further deflection of each joint, (n, 6, M), in the loaded equilibrium.

        The turned joint moves what the others carry, so all springs give anew: for an arm of 5 mm sag and a compensator that
        turns a joint by 5 mrad this is as large as the compensator's own trace in displacements.
        """
        m = self.o.measurements
        scales = np.array([_TURNED])
        turns = [_Turned(name) for name in self.model.structure.arm.joint_names]
        columns = [_differences(self, turn, scales)[:, :, 0].T / _TURNED for turn in turns]
        return np.stack(columns) if columns else np.zeros((0, 6, m.case.size))

    def shows(self, effect: Effect) -> bool:
        """Whether these readings reach what makes an effect different from all others."""
        return not effect.idle(self.model.structure.arm, self.carried)

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
    """Whitened columns `(rows, p)` of an effect that the model lacks, per unit of its parameters' scales; zeros where it is not seen."""
    scales = np.array([parameter.scale for parameter in effect.parameters])
    if isinstance(effect, Spring):
        change = scene.spring_columns.of(effect) * scales
    elif type(effect).deflection is not Effect.deflection or type(effect).torque is not Effect.torque:
        units = np.diag(scales)
        change = np.stack([scene.deflected(_deflection(scene, effect, x)) for x in units], axis=2)
    else:
        change = _differences(scene, effect, scales)
    columns = whitened(scene.o, change)
    # References cancel what is the same in a whole experiment - a preload - but for rounding, which is no regressor.
    columns[:, np.linalg.norm(columns, axis=0) < _UNSEEN] = 0.0
    return columns


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
