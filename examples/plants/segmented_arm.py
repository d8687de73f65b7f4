"""A robot arm whose links are chains of beams: the truth that identification and compensation are tried on.

Geometry and masses come from the model file through Drake (`chain.py`). Every link is cut into hollow-box beam elements
with a 6-dof spring at the end of each, every joint has a spring, and the exact static equilibrium under weight and a
dead wrench is found with finite rotations. `drake_plant.py` builds the same structure in Drake; a test holds the two
against each other.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from . import rotations
from .beams import PARTS, Array
from .chain import RigidChain, read_chain
from .compensator import PinSpring
from .course import Course
from .deformation import Deformation, Shape, sum_beyond, turn_xyz
from .physics import JointPhysics, LinkPhysics, Pull
from .segments import Segments, cut
from .truth import Tool, Truth, load_truth


class EquilibriumError(ArithmeticError):
    """No static equilibrium was found: the load buckles the arm or the springs are far too soft."""


@dataclass(frozen=True)
class SegmentedArm:
    """An arm of beams and joint springs.

    Attributes
    ----------
    chain, segments
        Rigid geometry and the beams cut from it.
    joint_compliance
        (n,) rad/(N m) or m/N.
    link_factors
        (L, 4) stiffness factors per link on bending_y, bending_z, torsion, axial (`beams.PARTS`).
    tool, gravity
        What the flange carries, and g in world axes, m/s^2.
    compensator
        A spring that pulls on the links on both sides of a joint.
    stiffening
        A spring that does not pull but makes its joint stiffer by the second derivative of its energy (Table 1 read so).
    joint_physics, link_physics
        What joints and beams do beyond their linear springs, on what they carry.
    pulls
        Further forces on the links.
    """

    chain: RigidChain
    segments: Segments
    joint_compliance: Array
    link_factors: Array
    tool: Tool
    gravity: Array
    compensator: PinSpring | None = None
    stiffening: PinSpring | None = None
    joint_physics: tuple[JointPhysics, ...] = ()
    link_physics: tuple[LinkPhysics, ...] = ()
    pulls: tuple[Pull, ...] = ()

    @classmethod
    def from_files(
        cls, model: str | Path, truth: str | Path, *, link_stiffness_factor: float = 1.0, tool: Tool | None = None
    ) -> SegmentedArm:
        """Read a model file (URDF and whatever Drake parses) and a truth file; `tool` replaces the truth's tool."""
        stated = load_truth(truth)
        arm = cls.from_truth(read_chain(model, stated.flange), stated if tool is None else replace(stated, tool=tool))
        return arm.with_link_stiffness(link_stiffness_factor)

    @classmethod
    def from_truth(cls, chain: RigidChain, truth: Truth) -> SegmentedArm:
        """Build the arm from a chain and its truth."""
        compliance = _in_order(truth.joint_compliance, chain.joint_names)
        factors = np.ones((len(chain.link_names), len(PARTS)))
        return cls(chain, cut(chain, truth), compliance, factors, truth.tool, truth.gravity)

    def with_link_stiffness(self, factor: float) -> SegmentedArm:
        """The same arm with EI, GJ, EA (and GA) of all links multiplied by `factor`."""
        return replace(self, link_factors=self.link_factors * factor)

    def with_values(self, *, joint_compliance: Array | None = None, link_factors: Array | None = None) -> SegmentedArm:
        """The same arm with other joint compliances (n,) or other stiffness factors (L, 4)."""
        return replace(
            self,
            joint_compliance=self.joint_compliance if joint_compliance is None else np.array(joint_compliance),
            link_factors=self.link_factors if link_factors is None else np.array(link_factors),
        )

    def element_compliance(self) -> Array:
        """Compliance of the elements, sum over parts of part / factor: (L, S, 6, 6), SI."""
        weighted: Array = np.einsum("lp,lspij->lsij", 1.0 / self.link_factors, self.segments.parts)
        return weighted

    def joint_compliance_at(self, q: Array) -> Array:
        """Compliance of the joints at commanded q (N, n): (n, N), rad/(N m) or m/N."""
        out = np.repeat(self.joint_compliance[:, None], len(q), axis=1)
        if self.stiffening is not None:
            i = self.stiffening.joint
            out[i] = 1.0 / (1.0 / out[i] + self.stiffening.stiffness_about_joint(self.chain, q[:, i]))
        return out

    def flange_pose(
        self, q: Array, wrench: Array | None = None, load_point_m: Array | None = None
    ) -> tuple[Array, Array]:
        """Pose of the flange at one loaded posture.

        Parameters
        ----------
        q
            (n,) commanded joint positions, rad or m.
        wrench
            (6,) force and moment in world axes at the load point, N and N m; None: weight only.
        load_point_m
            (3,) in the flange frame; None: the flange origin.

        Returns
        -------
        R (3, 3), p (3,): flange in the world, p in m.
        """
        rotation, position = self.poses(
            np.asarray(q, dtype=float)[None],
            None if wrench is None else np.asarray(wrench, dtype=float)[None],
            load_point_m,
        )
        return rotation[0], position[0]

    def points(
        self, q: Array, wrench_N_Nm: Array | None, load_point: Array | None, points: Array, *, weight: bool = True
    ) -> Array:
        """World positions of points (P, 3) fixed in the flange at N loaded postures -> (N, P, 3), m. See `poses`."""
        rotation, position = self.poses(q, wrench_N_Nm, load_point, weight=weight)
        return position[:, None] + np.einsum("nij,pj->npi", rotation, np.atleast_2d(points))

    def poses(
        self, q: Array, wrench_N_Nm: Array | None = None, load_point: Array | None = None, *, weight: bool = True
    ) -> tuple[Array, Array]:
        """Flange poses at the static equilibrium of N postures.

        Parameters
        ----------
        q
            (N, n) commanded joint positions, rad or m.
        wrench_N_Nm
            (N, 6) dead wrench (fx, fy, fz, mx, my, mz), world axes, acting at `load_point` which moves with the flange.
        load_point
            (3,) or (N, 3) in the flange frame, m.
        weight
            False switches off the weight of arm and tool.

        Returns
        -------
        R (N, 3, 3), p (N, 3) in m.
        """
        shape, _ = self.equilibrium(q, wrench_N_Nm, load_point, weight=weight)
        return shape.R, shape.p

    def equilibrium(
        self,
        q: Array,
        wrench_N_Nm: Array | None = None,
        load_point: Array | None = None,
        *,
        weight: bool = True,
        course: Course | None = None,
        start: Deformation | None = None,
        tolerance: float = 1e-13,
        max_iterations: int = 200,
    ) -> tuple[Shape, Deformation]:
        r"""Static equilibrium with finite rotations, by fixed point on theta = C tau(q, theta).

        tau are the generalized forces of the dead wrench and of the weights at the deformed shape. The map contracts
        with the ratio of load stiffness to spring stiffness, about 1e-2 for an industrial arm, so six or seven passes
        reach `tolerance` (largest change of a deflection in a pass, m or rad). Physics with a memory needs the `course` of
        the N postures; without it each is the first step of an experiment of its own. `start` is a
        deformation nearby that saves passes.

        Raises
        ------
        EquilibriumError
            If it does not contract within `max_iterations`, naming the first posture that did not.
        """
        q = np.asarray(q, dtype=float)
        wrench = np.zeros((len(q), 6)) if wrench_N_Nm is None else np.asarray(wrench_N_Nm, dtype=float)
        lever = np.zeros(3) if load_point is None else np.asarray(load_point, dtype=float)
        gravity = self.gravity if weight else np.zeros(3)
        compliance, joint_compliance = self.element_compliance(), self.joint_compliance_at(q)
        links, segments = compliance.shape[:2]
        when = Course.unknown(len(q)) if course is None else course
        theta = start or Deformation(np.zeros((links, segments, len(q), 6)), np.zeros((self.chain.size, len(q))))
        for _ in range(max_iterations):
            shape = self.shape(q, theta)
            loads = self.generalized_forces(shape, wrench, lever, gravity)
            new = Deformation(
                np.einsum("lsij,lsnj->lsni", compliance, loads.elements)
                + sum(p.bend(loads.elements, q, when) for p in self.link_physics),
                joint_compliance * loads.joints + sum(p.turn(loads.joints, q, when) for p in self.joint_physics),
            )
            change = np.maximum(
                np.abs(new.elements - theta.elements).max(axis=(0, 1, 3)), np.abs(new.joints - theta.joints).max(axis=0)
            )
            theta = new
            if not np.all(change < 1.0):
                break
            if change.max(initial=0.0) < tolerance:
                return self.shape(q, theta), theta
        worst = int(np.argmax(~(change < tolerance)))
        raise EquilibriumError(f"no equilibrium at posture {worst}: q = {q[worst]}, wrench = {wrench[worst]} N, N m")

    def shape(self, q: Array, theta: Deformation) -> Shape:
        """Forward kinematics of the deformed arm at q (N, n)."""
        seg, count = self.segments, len(q)
        links, pieces = seg.masses.shape
        node_p, mass_p = np.empty((links, pieces, count, 3)), np.empty((links, pieces, count, 3))
        node_R, node_A = np.empty((links, pieces, count, 3, 3)), np.empty((links, pieces, count, 3, 3))
        joint_p, joint_a = np.empty((self.chain.size, count, 3)), np.empty((self.chain.size, count, 3))
        rotation, position = np.broadcast_to(np.eye(3), (count, 3, 3)), np.zeros((count, 3))
        for k in range(links):
            rotation = rotation @ seg.beam_R[k]
            for s in range(pieces):
                mass_p[k, s] = position + rotation @ seg.centers[k, s]
                node_R[k, s] = rotation
                # Displace along the axes before the turn, then turn about x, y, z in this order.
                u = theta.elements[k, s]
                along = u[:, :3] + np.array([seg.step[k], 0.0, 0.0])
                position = position + np.einsum("nij,nj->ni", rotation, along)
                turn, axes = turn_xyz(u[:, 3:])
                node_A[k, s] = rotation @ axes
                node_p[k, s] = position
                rotation = rotation @ turn
            rotation = rotation @ seg.end_R[k]
            if k < self.chain.size:
                axis = self.chain.axes[k]
                joint_p[k], joint_a[k] = position, rotation @ axis
                moved = q[:, k] + theta.joints[k]
                if self.chain.prismatic[k]:
                    position = position + joint_a[k] * moved[:, None]
                else:
                    rotation = rotation @ rotations.about_axis(axis, moved)
        return Shape(rotation, position, node_p, node_R, node_A, mass_p, joint_p, joint_a)

    def generalized_forces(self, shape: Shape, wrench: Array, load_point: Array, gravity: Array) -> Deformation:
        """What every spring carries: its axes dotted with the force and moment of all that hangs beyond it (N, N m)."""
        links, pieces, count, _ = shape.mass_p.shape
        tool_p = shape.p + shape.R @ self.tool.center_of_mass
        load_p = shape.p + np.einsum("nij,nj->ni", shape.R, np.broadcast_to(load_point, (count, 3)))
        tool_f = self.tool.mass * gravity
        force_end = wrench[:, :3] + tool_f
        moment_end = wrench[:, 3:] + np.cross(load_p, wrench[:, :3]) + np.cross(tool_p, tool_f)
        # An element's own weight hangs before the spring at its end: only the elements beyond count.
        weight = self.segments.masses.reshape(-1)[:, None] * gravity
        moment = np.cross(shape.mass_p.reshape(-1, count, 3), weight[:, None])
        force = np.repeat(weight[:, None], count, axis=1)
        compensator = () if self.compensator is None else (self.compensator,)
        for source in (*compensator, *self.pulls):
            for element, pin, pull in source.pull(shape, self.segments, self.chain):
                force[element] += pull
                moment[element] += np.cross(pin, pull)
        force_beyond = sum_beyond(force).reshape(links, pieces, count, 3) + force_end
        moment_beyond = sum_beyond(moment).reshape(links, pieces, count, 3) + moment_end
        about_node = moment_beyond - np.cross(shape.node_p, force_beyond)
        elements = np.concatenate(
            [
                np.einsum("lsnij,lsni->lsnj", shape.node_R, force_beyond),
                np.einsum("lsnij,lsni->lsnj", shape.node_A, about_node),
            ],
            axis=-1,
        )
        about_joint = moment_beyond[:-1, -1] - np.cross(shape.joint_p, force_beyond[:-1, -1])
        slides = np.array(self.chain.prismatic)[:, None, None]
        carried = np.where(slides, force_beyond[:-1, -1], about_joint)
        return Deformation(elements, np.einsum("kni,kni->kn", shape.joint_a, carried))


def _in_order(values: Mapping[str, float], names: tuple[str, ...]) -> Array:
    missing = [name for name in names if name not in values]
    if missing:
        raise KeyError(f"the truth states no joint_compliance for {missing}")
    return np.array([values[name] for name in names])
