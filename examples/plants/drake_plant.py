"""The segmented arm as a Drake plant of single-dof joints, and its statics by Drake's own quantities."""

from __future__ import annotations

from typing import Any

import numpy as np
from pydrake.math import RigidTransform, RotationMatrix
from pydrake.multibody.plant import MultibodyPlant
from pydrake.multibody.tree import (
    FixedOffsetFrame,
    Frame,
    JacobianWrtVariable,
    PrismaticJoint,
    RevoluteJoint,
    SpatialInertia,
    UnitInertia,
)

from .beams import Array
from .chain import for_drake
from .deformation import Deformation
from .segmented_arm import SegmentedArm


def build(arm: SegmentedArm) -> MultibodyPlant:
    """A finalized plant: per element three prismatic and three revolute joints (x, y, z each), and the arm's own.

    Coordinates in the order base to flange: per link all elements (dx, dy, dz, rx, ry, rz), then the joint that
    follows. For a 6-axis arm of three segments that is 7 * 3 * 6 + 6 = 132. The flange is the frame "flange_end".
    """
    plant = MultibodyPlant(0.0)
    plant.mutable_gravity_field().set_gravity_vector(for_drake(arm.gravity))
    seg, chain = arm.segments, arm.chain
    frame: Frame = plant.world_frame()
    links, pieces = seg.masses.shape
    for k in range(links):
        frame = _offset(
            plant, f"beam_{k}", frame, RigidTransform(RotationMatrix(for_drake(seg.beam_R[k])), for_drake(np.zeros(3)))
        )
        for s in range(pieces):
            # The element itself is rigid; it is welded to what the spring before it carries.
            body = plant.AddRigidBody(f"element_{k}_{s}", _point_mass(seg.masses[k, s], seg.centers[k, s]))
            plant.WeldFrames(frame, body.body_frame())
            frame = _offset(
                plant, f"node_{k}_{s}", body.body_frame(), RigidTransform(for_drake([seg.step[k], 0.0, 0.0]))
            )
            for kind in (PrismaticJoint, RevoluteJoint):
                for axis in range(3):
                    frame = _joint(plant, f"spring_{k}_{s}_{kind.__name__}_{axis}", kind, frame, np.eye(3)[axis])
        frame = _offset(
            plant, f"end_{k}", frame, RigidTransform(RotationMatrix(for_drake(seg.end_R[k])), for_drake(np.zeros(3)))
        )
        if k < chain.size:
            kind = PrismaticJoint if chain.prismatic[k] else RevoluteJoint
            frame = _joint(plant, chain.joint_names[k], kind, frame, chain.axes[k])
    tool = plant.AddRigidBody("tool", _point_mass(arm.tool.mass, arm.tool.center_of_mass))
    plant.WeldFrames(frame, tool.body_frame())
    _offset(plant, "flange_end", tool.body_frame(), RigidTransform())
    plant.Finalize()
    return plant


def coordinates(q: Array, theta: Deformation, index: int) -> Array:
    """The plant's position vector for posture `index` of a batch: q (N, n) with deflections."""
    pieces: list[Array] = []
    for k in range(len(theta.elements)):
        pieces.append(theta.elements[k, :, index].reshape(-1))
        if k < q.shape[1]:
            pieces.append(q[index, k : k + 1] + theta.joints[k, index])
    return np.concatenate(pieces)


def generalized_forces(plant: MultibodyPlant, positions: Array, wrench: Array, load_point: Array) -> Array:
    """tau_g + J^T W by Drake at the plant's positions, the wrench (6,) acting at `load_point` of the flange; N, N m."""
    context = plant.CreateDefaultContext()
    plant.SetPositions(context, for_drake(positions))
    flange, world = plant.GetFrameByName("flange_end"), plant.world_frame()
    spatial = plant.CalcJacobianSpatialVelocity(
        context, JacobianWrtVariable.kQDot, flange, for_drake(load_point), world, world
    )
    # Drake's spatial vectors carry the rotation first.
    forces: Array = plant.CalcGravityGeneralizedForces(context) + spatial.T @ np.concatenate([wrench[3:], wrench[:3]])
    return forces


def flange_pose(plant: MultibodyPlant, positions: Array) -> tuple[Array, Array]:
    """Flange pose by Drake at the plant's positions: R (3, 3), p (3,) in m."""
    context = plant.CreateDefaultContext()
    plant.SetPositions(context, for_drake(positions))
    pose = plant.GetFrameByName("flange_end").CalcPoseInWorld(context)
    return np.asarray(pose.rotation().matrix(), dtype=float), np.asarray(pose.translation(), dtype=float)


def _offset(plant: MultibodyPlant, name: str, parent: Frame, pose: RigidTransform) -> Frame:
    return plant.AddFrame(FixedOffsetFrame(name, parent, pose))


def _joint(plant: MultibodyPlant, name: str, kind: Any, parent: Frame, axis: Array) -> Frame:
    body = plant.AddRigidBody(f"after_{name}", _point_mass(0.0, np.zeros(3)))
    plant.AddJoint(kind(name, parent, body.body_frame(), axis))
    return body.body_frame()


def _point_mass(mass: float, center: Array) -> SpatialInertia:
    return SpatialInertia(mass, for_drake(center), UnitInertia.PointMass(for_drake(center)))
