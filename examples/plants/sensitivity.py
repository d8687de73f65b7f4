"""How the positions of points on a loaded segmented arm change with its compliances."""

from __future__ import annotations

import numpy as np

from .beams import Array
from .deformation import Deformation, Shape
from .segmented_arm import SegmentedArm


def compliance_columns(arm: SegmentedArm, shape: Shape, loads: Deformation, points: Array) -> Array:
    r"""Displacement of one point per posture when a compliance grows by its own size, d p / d ln(compliance).

    A joint of compliance k that carries tau turns by k tau more; part c of a link's elements adds sum_s J_s c_s w_s.
    What the springs carry is held fixed, which leaves out terms of the size load stiffness over spring stiffness (about
    1 %): enough for the steps of a Gauss-Newton iteration whose residual is exact.

    Parameters
    ----------
    shape, loads
        The equilibrium at N postures and what its springs carry.
    points
        (N, 3) points in the world, m.

    Returns
    -------
    (N, 3, n + 4 L), m: joints, then links by `beams.PARTS`.
    """
    slides = np.array(arm.chain.prismatic)[:, None, None]
    joints = np.where(slides, shape.joint_a, np.cross(shape.joint_a, points - shape.joint_p))
    joints = joints * (arm.joint_compliance[:, None] * loads.joints)[..., None]
    parts = arm.segments.parts / arm.link_factors[:, None, :, None, None]
    given = np.einsum("lscij,lsnj->lscni", parts, loads.elements)
    moved = np.einsum("lsnij,lscnj->lscni", shape.node_R, given[..., :3])
    turned = np.einsum("lsnij,lscnj->lscni", shape.node_A, given[..., 3:])
    moved = (moved + np.cross(turned, (points - shape.node_p)[:, :, None])).sum(axis=1)
    links = moved.reshape(-1, *points.shape)
    return np.moveaxis(np.concatenate([joints, links]), 0, -1)
