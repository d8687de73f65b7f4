"""The rigid chain of an arm: constants read once from a Drake plant, then poses and Jacobians of many postures."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
from pydrake.multibody.parsing import Parser
from pydrake.multibody.plant import MultibodyPlant
from pydrake.multibody.tree import BodyIndex, Joint, PrismaticJoint, RevoluteJoint, RigidBody

from . import rotations
from .beams import Array


@dataclass(frozen=True)
class RigidChain:
    """A serial arm of n revolute or prismatic joints, base to flange. World = frame of the base link.

    A link's own frame is the child-side frame of the joint before it (base: the base frame); its end is the parent-side
    frame of the next joint (last link: the flange frame). Bodies welded together are one link.

    Attributes
    ----------
    joint_names, link_names
        n and n + 1 names, base first.
    prismatic, axes
        (n,) flags and (n, 3) unit axes in the joint's frames.
    end_R, end_p
        (n + 1, 3, 3), (n + 1, 3): the link's end in the link's own frame, m.
    masses, centers
        (n + 1,) kg and (n + 1, 3) centres of mass in the link's own frame, m.
    lower, upper
        (n,) joint limits, rad or m.
    """

    joint_names: tuple[str, ...]
    link_names: tuple[str, ...]
    prismatic: tuple[bool, ...]
    axes: Array
    end_R: Array
    end_p: Array
    masses: Array
    centers: Array
    lower: Array
    upper: Array

    @property
    def size(self) -> int:
        """Number of joints."""
        return len(self.joint_names)

    def flange(self, q: Array) -> tuple[Array, Array]:
        """Pose of the flange of the rigid arm without load: q (N, n) -> R (N, 3, 3), p (N, 3) in m."""
        rotation, position, _, _ = self._sweep(q)
        return rotation, position

    def jacobian(self, q: Array, point: Array) -> Array:
        """World velocity (v; w) of a point fixed in the flange (3,) per joint rate, q (N, n) -> (N, 6, n)."""
        rotation, position, axes, origins = self._sweep(q)
        tip = position + rotation @ point
        columns = np.zeros((len(position), 6, self.size))
        for j in range(self.size):
            if self.prismatic[j]:
                columns[:, :3, j] = axes[j]
            else:
                columns[:, :3, j] = np.cross(axes[j], tip - origins[j])
                columns[:, 3:, j] = axes[j]
        return columns

    def _sweep(self, q: Array) -> tuple[Array, Array, list[Array], list[Array]]:
        count = len(q)
        rotation = np.broadcast_to(np.eye(3), (count, 3, 3))
        position = np.zeros((count, 3))
        axes: list[Array] = []
        origins: list[Array] = []
        for link in range(self.size + 1):
            position = position + rotation @ self.end_p[link]
            rotation = rotation @ self.end_R[link]
            if link == self.size:
                break
            axes.append(rotation @ self.axes[link])
            origins.append(position)
            if self.prismatic[link]:
                position = position + axes[-1] * q[:, link, None]
            else:
                rotation = rotation @ rotations.about_axis(self.axes[link], q[:, link])
        return rotation, position, axes, origins


def read_chain(model: str | Path, flange: str = "flange") -> RigidChain:
    """Parse a model file with Drake and read the chain from its base to the frame `flange`.

    Raises
    ------
    ValueError
        If a joint between base and flange is neither fixed, revolute nor prismatic, or a body with mass moves beside
        the chain.
    """
    plant = parse_plant(model)
    joints = _chain_joints(plant, flange)
    context = plant.CreateDefaultContext()
    # All poses read below lie within one link: they do not depend on the joint positions of the context.
    base = joints[0].parent_body()
    begins = [_root(plant, base).body_frame(), *(joint.frame_on_child() for joint in joints)]
    ends = [*(joint.frame_on_parent() for joint in joints), plant.GetFrameByName(flange)]
    relative = [end.CalcPose(context, begin) for begin, end in zip(begins, ends, strict=True)]
    groups = [plant.GetBodiesWeldedTo(begin.body()) for begin in begins]
    masses, centers = np.zeros(len(begins)), np.zeros((len(begins), 3))
    for k, (begin, group) in enumerate(zip(begins, groups, strict=True)):
        bodies = [body for body in group if body.index() != plant.world_body().index()]
        masses[k] = sum(body.default_mass() for body in bodies)
        for body in bodies:
            center = body.default_spatial_inertia().get_com() if body.default_mass() > 0 else np.zeros(3)
            if masses[k] > 0:
                centers[k] += body.default_mass() / masses[k] * (body.body_frame().CalcPose(context, begin) @ center)
    _refuse_side_branches(plant, groups)
    return RigidChain(
        joint_names=tuple(joint.name() for joint in joints),
        link_names=tuple(begin.body().name() for begin in begins),
        prismatic=tuple(isinstance(joint, PrismaticJoint) for joint in joints),
        axes=np.array([_axis(joint) for joint in joints]),
        end_R=np.array([pose.rotation().matrix() for pose in relative]),
        end_p=np.array([pose.translation() for pose in relative]),
        masses=masses,
        centers=centers,
        lower=np.array([joint.position_lower_limits()[0] for joint in joints]),
        upper=np.array([joint.position_upper_limits()[0] for joint in joints]),
    )


def parse_plant(model: str | Path) -> MultibodyPlant:
    """The rigid arm as a finalized Drake plant, its base welded to the world if the file leaves it free."""
    plant = MultibodyPlant(0.0)
    instances = Parser(plant).AddModels(Path(model))
    children = {plant.get_joint(index).child_body().index() for index in plant.GetJointIndices()}
    for index in plant.GetBodyIndices(instances[0]):
        if index not in children:
            plant.WeldFrames(plant.world_frame(), plant.get_body(index).body_frame())
    plant.Finalize()
    return plant


def for_drake(values: npt.ArrayLike) -> Any:
    """An array as Drake takes it; typed Any because Drake's stubs name array types that numpy's do not match."""
    return np.asarray(values, dtype=float)


def _chain_joints(plant: MultibodyPlant, flange: str) -> list[Joint]:
    above = {joint.child_body().index(): joint for joint in map(plant.get_joint, plant.GetJointIndices())}
    chain: list[Joint] = []
    body = plant.GetFrameByName(flange).body()
    while body.index() in above:
        joint = above[body.index()]
        if joint.num_velocities() > 0:
            if not isinstance(joint, RevoluteJoint | PrismaticJoint):
                raise ValueError(f"joint {joint.name()!r} is neither revolute nor prismatic: {joint.type_name()}")
            chain.append(joint)
        body = joint.parent_body()
    if not chain:
        raise ValueError(f"no movable joint between the base and {flange!r}")
    return chain[::-1]


def _root(plant: MultibodyPlant, body: RigidBody) -> RigidBody:
    """The body of the base that hangs on the world itself: its frame is the world of the plants here."""
    above = {joint.child_body().index(): joint for joint in map(plant.get_joint, plant.GetJointIndices())}
    while above[body.index()].parent_body().index() != plant.world_body().index():
        body = above[body.index()].parent_body()
    return body


def _axis(joint: Any) -> Array:
    axis = joint.revolute_axis() if isinstance(joint, RevoluteJoint) else joint.translation_axis()
    return np.asarray(axis, dtype=float)


def _refuse_side_branches(plant: MultibodyPlant, groups: list[list[RigidBody]]) -> None:
    known = {body.index() for group in groups for body in group}
    for body in (plant.get_body(BodyIndex(k)) for k in range(plant.num_bodies())):
        if body.index() not in known and body.default_mass() > 0:
            raise ValueError(f"body {body.name()!r} has mass and moves beside the chain to the flange")
