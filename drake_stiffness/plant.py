"""The cell as Drake plants, and the Arm read from them. The only file that imports Drake.

Two plants: the rigid one as Drake's parser makes it (its base welded to the world if the model leaves it free), and one
with a virtual joint after every link and in every actuated joint (seed eq. 1). The first is where the Arm's constants come
from; the second is the independent judge of what the Arm computes, and what users continue with in Drake.
"""

from __future__ import annotations

import logging
import re
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from drake_stiffness.arm import Arm
from drake_stiffness.cell import Cell
from drake_stiffness.chain_names import check_names
from drake_stiffness.errors import InputError
from drake_stiffness.files import read_bytes
from drake_stiffness.meshes import warn_of_missing_meshes
from drake_stiffness.model_files import add_models
from drake_stiffness.point_spring import PointSpring
from drake_stiffness.rotations import Array, rotation_of_axis


@dataclass(frozen=True)
class Chain:
    """The serial chain inside a parsed plant: its joints from base to flange and the bodies that move with each link."""

    joints: tuple[Any, ...]
    bodies: tuple[tuple[Any, ...], ...]
    flange: Any


def parse_plant(cell: Cell) -> Any:
    """A MultibodyPlant that holds the robot, its base welded, not yet finalized.

    Raises
    ------
    InputError
        If Drake is not installed here, the model cannot be read, or no such flange or joint exists.
    """
    try:
        from pydrake.multibody.parsing import Parser
        from pydrake.multibody.plant import MultibodyPlant
    except ImportError:
        raise InputError(
            "Drake is not installed here (its wheels serve Linux x86-64 and macOS arm64). `predict` and `compensate` run "
            "without it from a stored model; for this command use one of those systems, or WSL2 on Windows."
        ) from None
    path = cell.robot_path
    read_bytes(path, "a robot description (URDF, SDF, MJCF or Drake model directives)")
    plant = MultibodyPlant(time_step=0.0)
    parser = Parser(plant=plant)
    warn_of_missing_meshes(path)
    # Drake writes warnings (missing actuator limits and the like) to its own log; what concerns the user is raised.
    logging.getLogger("drake").setLevel(logging.ERROR)
    try:
        add_models(parser, path)
    except (RuntimeError, ValueError) as error:
        reason = str(error).strip().splitlines()[0]
        raise InputError(
            f"{path}: Drake's parser cannot read this robot description: {reason}. Expected URDF (.urdf), SDF (.sdf), "
            "MJCF (.xml) or model directives (.dmd.yaml); mend the file, or check package:// paths."
        ) from None
    _weld_base(plant, cell)
    return plant


def _weld_base(plant: Any, cell: Cell) -> None:
    """Weld the root of the flange's tree to the world, unless a joint already ties it there."""
    frame = _find_frame(plant, cell)
    body = frame.body()
    parents = {plant.get_joint(i).child_body().index(): plant.get_joint(i) for i in plant.GetJointIndices()}
    while body.index() in parents:
        body = parents[body.index()].parent_body()
    if body.index() != plant.world_body().index():
        plant.WeldFrames(plant.world_frame(), body.body_frame())


def _find_frame(plant: Any, cell: Cell) -> Any:
    from pydrake.multibody.tree import BodyIndex, FrameIndex

    frames = [plant.get_frame(FrameIndex(i)) for i in range(plant.num_frames())]
    name = cell.robot.flange
    found = [frame for frame in frames if frame.name() == name]
    if not found:
        bodies = {plant.get_body(BodyIndex(i)).name() for i in range(plant.num_bodies())}
        others = {f.name() for f in frames if not re.search(r"_(parent|child)$|^_|^$", f.name())}
        names = sorted((bodies | others) - {"world"})
        raise InputError(
            f"{cell.robot_path}: robot.flange names '{name}', but the model has no such link or frame; it has: "
            f"{', '.join(names)}."
        )
    if len(found) > 1:
        raise InputError(
            f"{cell.robot_path}: robot.flange '{name}' stands for {len(found)} links or frames; rename one in the model."
        )
    return found[0]


def find_chain(plant: Any, cell: Cell) -> Chain:
    """The joints between base and flange and the lumps of bodies between them.

    Raises
    ------
    InputError
        If a named joint does not exist or is not between base and flange, if a joint has more than one degree of freedom,
        or if the arm has none.
    """
    flange = _find_frame(plant, cell)
    joints = [plant.get_joint(i) for i in plant.GetJointIndices()]
    by_child = {joint.child_body().index(): joint for joint in joints}
    path: list[Any] = []
    body = flange.body()
    while body.index() in by_child:
        joint = by_child[body.index()]
        path.insert(0, joint)
        body = joint.parent_body()
    movable = [joint for joint in path if joint.num_velocities() > 0]
    wanted = [joint.name() for joint in movable] if cell.robot.joints is None else list(cell.robot.joints)
    where = cell.robot_path
    check_names(wanted, movable, joints, where)
    chosen = [joint for joint in movable if joint.name() in wanted]
    if not chosen:
        raise InputError(f"{where}: no movable joint lies between the base and the flange '{cell.robot.flange}'.")
    for joint in chosen:
        if joint.type_name() not in ("revolute", "prismatic"):
            raise InputError(
                f"{where}: joint '{joint.name()}' is of type {joint.type_name()}; the arm's joints must be revolute or "
                "prismatic. Fix it in the model, or leave it out of robot.joints (it is then locked)."
            )
    return Chain(tuple(chosen), _lumps(plant, joints, chosen), flange)


def _lumps(plant: Any, joints: list[Any], chosen: list[Any]) -> tuple[tuple[Any, ...], ...]:
    """Bodies that move together once every joint outside the chain is locked; lump k hangs on chosen joint k (0: base)."""
    from pydrake.multibody.tree import BodyIndex

    chosen_children = {joint.child_body().index(): k + 1 for k, joint in enumerate(chosen)}
    parent = {joint.child_body().index(): joint.parent_body().index() for joint in joints}
    lumps: list[list[Any]] = [[plant.world_body()], *([] for _ in chosen)]
    for number in range(1, plant.num_bodies()):
        here = BodyIndex(number)
        while here not in chosen_children and here in parent:
            here = parent[here]
        if here in chosen_children or here == plant.world_body().index():
            lumps[chosen_children.get(here, 0)].append(plant.get_body(BodyIndex(number)))
    return tuple(tuple(lump) for lump in lumps)


def _link_name(lump: tuple[Any, ...], joint: Any | None) -> str:
    """Links welded together are one link, named after the first: the one that its own joint moves."""
    if joint is not None:
        return str(joint.child_body().name())
    named = [body.name() for body in lump if body.name() != "world"]
    return str(named[0] if named else "world")


def build_arm(cell: Cell) -> Arm:
    """The Arm of a cell: every constant read once from the finalized rigid plant at its default posture.

    Raises
    ------
    InputError
        If the robot description cannot be read or does not hold the arm that the cell names.
    """
    plant = parse_plant(cell)
    chain = find_chain(plant, cell)
    plant.Finalize()
    _warn_of_loose_bodies(plant, cell)
    context = plant.CreateDefaultContext()
    links = tuple(_link_name(lump, chain.joints[k - 1] if k else None) for k, lump in enumerate(chain.bodies))
    if len(set(links)) != len(links):
        raise InputError(f"{cell.robot_path}: two links of the arm have one name: {', '.join(links)}. Rename one.")
    n = len(chain.joints)
    R_PF, p_PF = np.zeros((n + 1, 3, 3)), np.zeros((n + 1, 3))
    mass, p_MCom = np.zeros(n + 1), np.zeros((n + 1, 3))
    own = [plant.world_frame(), *(joint.frame_on_child() for joint in chain.joints)]
    springs = [*(joint.frame_on_parent() for joint in chain.joints), chain.flange]
    for k in range(n + 1):
        X = springs[k].CalcPose(context, own[k])
        R_PF[k], p_PF[k] = X.rotation().matrix(), X.translation()
        mass[k], p_MCom[k] = _mass_and_centre(plant, context, chain.bodies[k], own[k])
    axes = np.array([_axis(joint) for joint in chain.joints])
    return Arm(
        joint_names=tuple(joint.name() for joint in chain.joints),
        link_names=links,
        prismatic=tuple(joint.type_name() == "prismatic" for joint in chain.joints),
        R_PF=R_PF,
        p_PF=p_PF,
        axis_F=axes,
        lower=np.array([joint.position_lower_limits()[0] for joint in chain.joints]),
        upper=np.array([joint.position_upper_limits()[0] for joint in chain.joints]),
        mass_kg=mass,
        p_MCom=p_MCom,
        tool_mass_kg=cell.tool.mass_kg,
        p_ETool=np.array(cell.tool.center_of_mass_m),
        gravity=np.array(cell.gravity_m_per_s2),
    )


def _warn_of_loose_bodies(plant: Any, cell: Cell) -> None:
    """Say what hangs in the air: a `floating` joint inside the chain cuts it, and the part before it is no part of the arm."""
    loose = sorted(plant.get_body(index).name() for index in plant.GetFloatingBaseBodies())
    if loose:
        logging.getLogger("drake_stiffness").warning(
            "%s: %s: not connected to the flange '%s' by joints; no part of the arm. If it should be, mend the joint that ties it.",
            cell.robot_path, ", ".join(loose), cell.robot.flange,
        )  # fmt: skip


def _axis(joint: Any) -> Array:
    axis = joint.revolute_axis() if joint.type_name() == "revolute" else joint.translation_axis()
    return np.asarray(axis, dtype=float) / np.linalg.norm(axis)


def _mass_and_centre(plant: Any, context: Any, bodies: tuple[Any, ...], frame: Any) -> tuple[float, Array]:
    masses = np.array([0.0 if body.name() == "world" else body.get_mass(context) for body in bodies])
    total = float(masses.sum())
    if not np.isfinite(total) or total <= 0.0:
        return 0.0, np.zeros(3)
    centre = np.zeros(3)
    for mass, body in zip(masses, bodies, strict=True):
        if mass > 0.0:
            p_BCom = body.CalcCenterOfMassInBodyFrame(context)
            X = body.body_frame().CalcPose(context, frame)
            centre += mass * (X @ p_BCom)
    return total, centre / total


@dataclass(frozen=True)
class ElasticPlant:
    """A finalized Drake plant with virtual joints, and where they are.

    Attributes
    ----------
    plant : MultibodyPlant
    joints : tuple of the n actuated joints
    joint_springs : tuple of n one-dof joints in series with them
    link_springs : tuple of n + 1 RpyFloatingJoint, the virtual joints after every link
    end : Frame
        The flange beyond the last spring; the tool hangs there.
    """

    plant: Any
    joints: tuple[Any, ...]
    joint_springs: tuple[Any, ...]
    link_springs: tuple[Any, ...]
    end: Any


def build_elastic_plant(cell: Cell, springs: Sequence[PointSpring] = ()) -> ElasticPlant:
    """The plant of seed eq. (1): every chain joint is replaced by virtual joint, actuated joint and joint spring in series.

    The plant is for statics (its intermediate bodies are massless): set the positions of the virtual joints and read poses,
    Jacobians and generalised forces.

    Parameters
    ----------
    springs : sequence of PointSpring
        Each becomes a LinearSpringDamper (`GravityCompensator.point_spring` makes one).
    """
    from pydrake.math import RigidTransform
    from pydrake.multibody import tree

    plant = parse_plant(cell)
    chain = find_chain(plant, cell)
    for actuator in [plant.get_joint_actuator(i) for i in plant.GetJointActuatorIndices()]:
        plant.RemoveJointActuator(actuator)
    _lock_others(plant, chain)
    massless = tree.SpatialInertia(mass=0.0, p_PScm_E=np.zeros(3), G_SP_E=tree.UnitInertia(0.0, 0.0, 0.0))
    instance = chain.joints[0].model_instance()
    actuated, joint_springs, link_springs, sides = [], [], [], {}
    kinds = {"revolute": tree.RevoluteJoint, "prismatic": tree.PrismaticJoint}
    for joint in chain.joints:
        name, F, M, axis = joint.name(), joint.frame_on_parent(), joint.frame_on_child(), _axis(joint)
        make = kinds[joint.type_name()]
        plant.RemoveJoint(joint)
        bent = plant.AddRigidBody(f"{name}_bent_link", instance, massless)
        link_springs.append(plant.AddJoint(tree.RpyFloatingJoint(f"{name}_link_spring", F, bent.body_frame())))
        moved = plant.AddRigidBody(f"{name}_moved", instance, massless)
        actuated.append(plant.AddJoint(make(name, bent.body_frame(), moved.body_frame(), axis)))
        joint_springs.append(plant.AddJoint(make(f"{name}_spring", moved.body_frame(), M, axis)))
        sides[name] = (bent, M)
    for spring in springs:
        bent, M = sides[spring.joint]
        # M may be offset from its body, the link after the joint.
        p_BodyB = M.GetFixedPoseInBodyFrame() @ spring.p_MB
        plant.AddForceElement(
            tree.LinearSpringDamper(bent, spring.p_FA, M.body(), p_BodyB, spring.free_length, spring.stiffness, 0.0)
        )
    x, y, z = cell.tool.center_of_mass_m
    about = tree.UnitInertia(y * y + z * z, x * x + z * z, x * x + y * y, -x * y, -x * z, -y * z)
    tool = tree.SpatialInertia(mass=cell.tool.mass_kg, p_PScm_E=np.array([x, y, z]), G_SP_E=about)
    end = plant.AddRigidBody("elastic_flange", instance, tool)
    link_springs.append(plant.AddJoint(tree.RpyFloatingJoint("flange_link_spring", chain.flange, end.body_frame())))
    frame = plant.AddFrame(tree.FixedOffsetFrame("elastic_end", end.body_frame(), RigidTransform()))
    plant.mutable_gravity_field().set_gravity_vector(np.array(cell.gravity_m_per_s2))
    plant.Finalize()
    return ElasticPlant(plant, tuple(actuated), tuple(joint_springs), tuple(link_springs), frame)


def _lock_others(plant: Any, chain: Chain) -> None:
    """Replace every movable joint outside the chain by a weld at its default position."""
    from pydrake.math import RigidTransform, RotationMatrix
    from pydrake.multibody.tree import WeldJoint

    kept = {joint.index() for joint in chain.joints}
    for joint in [plant.get_joint(i) for i in plant.GetJointIndices()]:
        if joint.index() in kept or joint.num_velocities() == 0:
            continue
        if joint.type_name() not in ("revolute", "prismatic"):
            raise InputError(
                f"joint '{joint.name()}' ({joint.type_name()}) is movable but not part of the arm; weld it in the model."
            )
        value = float(joint.default_positions()[0])
        if joint.type_name() == "revolute":
            X_FM = RigidTransform(
                RotationMatrix(rotation_of_axis(_axis(joint), np.array([value]))[:, :, 0]), np.zeros(3)
            )
        else:
            X_FM = RigidTransform(_axis(joint) * value)
        name, F, M = joint.name(), joint.frame_on_parent(), joint.frame_on_child()
        plant.RemoveJoint(joint)
        plant.AddJoint(WeldJoint(f"{name}_locked", F, M, X_FM))


def start_viewer() -> Any:
    """Drake's Meshcat, open to this machine only; everything put into it becomes one page by its `StaticHtml()`."""
    from pydrake.geometry import Meshcat, MeshcatParams

    logging.getLogger("drake").setLevel(logging.ERROR)
    return Meshcat(MeshcatParams(host="localhost"))
