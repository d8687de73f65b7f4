"""A campaign before anything is hidden in it: arm, experiment, base model, and what every joint carries."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
from plants.default_experiment import Experiment, default_experiment
from plants.deformation import Deformation
from plants.measured_world import MeasuredWorld
from plants.segmented_arm import SegmentedArm

from blind_trials.stands import RIGID, Array, Stand, stand

Quantity = Literal["displacement", "position"]


@dataclass(frozen=True)
class Setting:
    """Everything but the hidden effect.

    Attributes
    ----------
    label
        Settings of one label are the same.
    links
        Whether the base model has springs in the links; without, the true links are rigid.
    rigid_joint
        A joint that the base model holds rigid, and that is rigid unless an effect is hidden there.
    world
        The world where nothing is wrong.
    torque, swing
        (n, N) what the joints carry, and (n,) the largest change of it in an experiment, N m or N.
    start
        The equilibrium of `world`.
    """

    label: str
    stand: Stand
    quantity: Quantity
    links: bool
    rigid_joint: str | None
    experiment: Experiment
    world: MeasuredWorld
    torque: Array
    swing: Array
    start: Deformation

    @property
    def joint_names(self) -> tuple[str, ...]:
        return self.stand.chain.joint_names

    def read(self, world: MeasuredWorld, *, exact: bool = False) -> Array:
        """Noise-free readings (N, P, 3); `exact` to the last digit, else fit for differences of a per mille."""
        e, s = self.experiment, self.stand
        if exact:
            return world.read(e.q, e.wrench, e.course, s.room.load_point, s.targets)
        return world.read(e.q, e.wrench, e.course, s.room.load_point, s.targets, start=self.start, tolerance=1e-8)


def make_setting(
    name: str, quantity: Quantity, links: bool, postures: int, design: int, rigid_joint: str | None = None
) -> Setting:
    """Draw the experiment (`design` is its seed) and solve the world without anything hidden."""
    s, rng = stand(name), np.random.default_rng([design, postures])
    label = f"{name}-{quantity}-{'links' if links else 'joints'}-{postures}-{design}-{rigid_joint or 'all'}"
    experiment = default_experiment(s.chain, s.room, postures, rng)
    arm = SegmentedArm.from_truth(s.chain, s.truth)
    if not links:
        arm = replace(arm, link_factors=np.full_like(arm.link_factors, RIGID))
    if rigid_joint is not None:
        compliance = arm.joint_compliance.copy()
        compliance[s.chain.joint_names.index(rigid_joint)] = 0.0
        arm = replace(arm, joint_compliance=compliance)
    shape, start = arm.equilibrium(experiment.q, experiment.wrench, s.room.load_point)
    torque = arm.generalized_forces(shape, experiment.wrench, s.room.load_point, arm.gravity).joints
    rows = torque.reshape(s.chain.size, postures, -1)
    swing = np.abs(rows - rows[:, :, :1]).max(axis=(1, 2))
    return Setting(
        label, s, quantity, links, rigid_joint, experiment, MeasuredWorld.of(arm, len(s.points)), torque, swing, start
    )
