"""The chain that is read from a robot description: links, welds, locks, masses, and what is refused."""

import logging

import numpy as np
import pytest
from three_arms import (
    FREE_CELL,
    FREE_SDF,
    TRACK_CELL,
    TRACK_JOINTS,
    TRACK_LINKS,
    TRACK_URDF,
    random_postures,
    write_arms,
)

from drake_stiffness.arm import forward
from drake_stiffness.cell import read_cell
from drake_stiffness.errors import InputError
from drake_stiffness.plant import build_arm, build_elastic_plant, parse_plant


def arm_of(folder, *, cell=TRACK_CELL, robot=TRACK_URDF, file="track.urdf"):
    (folder / file).write_text(robot)
    (folder / "cell.yaml").write_text(cell)
    return build_arm(read_cell(folder / "cell.yaml"))


def test_the_kr270_is_six_joints_and_seven_links(arms):
    arm = arms["kr270"]
    assert arm.joint_names == tuple(f"joint_{i}" for i in range(1, 7))
    assert arm.link_names == ("base_link", *(f"link_{i}" for i in range(1, 7)))
    assert arm.mass_kg == pytest.approx([226.0, 367.4, 232.1, 191.5, 47.9, 23.7, 12.2])
    assert (arm.tool_mass_kg, arm.prismatic) == (90.0, (False,) * 6)
    assert np.degrees([arm.lower[1], arm.upper[1]]) == pytest.approx([-140, -5])


def test_an_arm_on_a_track_has_seven_joints_and_the_first_slides(arms):
    arm = arms["track"]
    assert arm.joint_names == TRACK_JOINTS
    assert arm.prismatic == (True, *[False] * 6)
    assert np.allclose(np.linalg.norm(arm.axis_F, axis=1), 1.0, atol=1e-15)


def test_welded_branched_and_locked_bodies_are_one_link_named_after_the_first(arms):
    arm = arms["track"]
    assert arm.link_names == TRACK_LINKS
    # camera on the elbow; finger (a branch) and mount (a joint that robot.joints leaves out) on the hand
    assert arm.mass_kg[4] == pytest.approx(45 + 6)
    assert arm.mass_kg[7] == pytest.approx(8 + 1.5 + 2.5)
    com = np.array([0.1, 0, 0.05]) * 45
    c, s = np.cos(0.3), np.sin(0.3)
    com += 6 * (np.array([0.1, 0.2, 0.1]) + np.array([[1, 0, 0], [0, c, -s], [0, s, c]]) @ [0.01, 0.02, 0.03])
    assert arm.p_MCom[4] == pytest.approx(com / 51, abs=1e-12)


def test_a_free_base_is_welded_where_the_file_puts_it(arms):
    arm = arms["free"]
    assert arm.link_names[0] == "pedestal"
    assert arm.mass_kg == pytest.approx([90, 60, 40, 25, 12, 6, 3])
    # the first joint's frame: pose of mast, then the joint's own pose in it
    c, s = np.cos(0.3), np.sin(0.3)
    place = np.array([0.02, 0.03, 0.5]) + np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]]) @ [0.01, 0, -0.05]
    assert arm.p_PF[0] == pytest.approx(place, abs=1e-12)


def test_rigid_poses_are_those_of_the_rigid_drake_plant(arms, cells, arm_name):
    arm, cell = arms[arm_name], cells[arm_name]
    plant = parse_plant(cell)
    plant.Finalize()
    context = plant.CreateDefaultContext()
    q = random_postures(arm, 8, np.random.default_rng(0))
    poses = forward(arm, q)
    flange = plant.GetFrameByName(cell.robot.flange)
    for i in range(8):
        for name, value, prismatic in zip(arm.joint_names, q[:, i], arm.prismatic, strict=True):
            joint = plant.GetJointByName(name)
            (joint.set_translation if prismatic else joint.set_angle)(context, value)
        X = flange.CalcPoseInWorld(context).GetAsMatrix4()
        assert np.abs(poses.p_E[:, i] - X[:3, 3]).max() < 1e-9
        assert np.abs(poses.R_E[:, :, i] - X[:3, :3]).max() < 1e-9


def test_the_elastic_plant_has_a_virtual_joint_after_every_link_and_in_every_joint(cells):
    elastic = build_elastic_plant(cells["track"])
    assert len(elastic.joint_springs) == 7
    assert len(elastic.link_springs) == 8
    assert elastic.plant.num_velocities() == 2 * 7 + 6 * 8


def test_the_elastic_plant_weighs_what_the_rigid_one_and_the_tool_weigh(cells, arm_name):
    elastic, plant = build_elastic_plant(cells[arm_name]), parse_plant(cells[arm_name])
    plant.Finalize()
    total = plant.CalcTotalMass(plant.CreateDefaultContext()) + cells[arm_name].tool.mass_kg
    assert elastic.plant.CalcTotalMass(elastic.plant.CreateDefaultContext()) == pytest.approx(total)


def test_the_default_is_every_movable_joint_between_base_and_flange(tmp_path):
    cell = TRACK_CELL.replace(", joints: [track, turn, shoulder, elbow, roll, pitch, spin]", "")
    assert arm_of(tmp_path, cell=cell).joint_names == (*TRACK_JOINTS, "wrist_lock")


def test_a_joint_left_out_in_the_middle_joins_its_links(tmp_path):
    arm = arm_of(tmp_path, cell=TRACK_CELL.replace("elbow, ", ""))
    assert arm.joint_names == ("track", "turn", "shoulder", "roll", "pitch", "spin")
    assert arm.mass_kg[3] == pytest.approx(80 + 45 + 6)


def test_the_robot_may_come_in_mjcf(tmp_path):
    robot = """<mujoco model="m"><worldbody><body name="base"><geom type="sphere" size="0.1" mass="5"/>
    <body name="l1" pos="0 0 0.5"><joint name="j1" type="hinge" axis="0 0 1"/><geom type="sphere" size="0.1" mass="2"/>
    <body name="l2" pos="0.5 0 0"><joint name="j2" type="slide" axis="0 1 0"/><geom type="sphere" size="0.1" mass="3"/>
    </body></body></body></worldbody></mujoco>"""
    arm = arm_of(
        tmp_path,
        cell="robot: {model: m.xml, flange: l2}\nreference_points_m: {A: [0, 0, 0]}\n",
        robot=robot,
        file="m.xml",
    )
    assert arm.joint_names == ("j1", "j2")
    assert arm.prismatic == (False, True)
    assert forward(arm, np.array([[np.pi / 2], [0.2]])).p_E[:, 0] == pytest.approx([-0.2, 0.5, 0.5], abs=1e-12)


def test_the_robot_may_come_as_model_directives(tmp_path):
    (tmp_path / "track.urdf").write_text(TRACK_URDF)
    robot = f"directives:\n- add_model: {{name: x, file: 'file://{tmp_path}/track.urdf'}}\n"
    arm = arm_of(tmp_path, cell=TRACK_CELL.replace("track.urdf", "m.dmd.yaml"), robot=robot, file="m.dmd.yaml")
    assert arm.joint_names == TRACK_JOINTS


MESHES = {
    "urdf": ("track.urdf", TRACK_CELL, TRACK_URDF, '<link name="camera">', '<visual><geometry><mesh filename="{}"/></geometry></visual>'),
    "sdf": ("free.sdf", FREE_CELL, FREE_SDF, '<link name="mast">', '<visual name="v"><geometry><mesh><uri>{}</uri></mesh></geometry></visual>'),
}  # fmt: skip


@pytest.mark.parametrize("kind", list(MESHES))
@pytest.mark.parametrize("uri", ["nowhere/camera.obj", "package://nowhere/camera.stl"])
def test_a_missing_mesh_is_a_warning_that_names_it(tmp_path, caplog, kind, uri):
    file, cell, robot, after, mesh = MESHES[kind]
    with caplog.at_level(logging.WARNING, "drake_stiffness"):
        arm = arm_of(tmp_path, cell=cell, robot=robot.replace(after, after + mesh.format(uri)), file=file)
    assert arm.num_joints in (6, 7)
    assert uri in caplog.text
    assert file in caplog.text


BAD_ROBOTS = {
    "case": ({"robot": ('"turn"', '"Shoulder"'), "cell": ("turn, ", "Shoulder, ")}, ["track.urdf", "'Shoulder'", "'shoulder'", "upper and lower case"]),
    "unknown joint": ({"cell": ("turn, ", "twist, ")}, ["robot.joints", "'twist'", "does not exist", "shoulder"]),
    "joint in other case": ({"cell": ("turn, ", "Turn, ")}, ["'Turn'", "Did you mean 'turn'"]),
    "joint of a branch": ({"cell": ("turn, ", "finger, ")}, ["'finger'", "not a movable joint between base and flange"]),
    "order": ({"cell": ("track, turn", "turn, track")}, ["from base to flange", "[track, turn"]),
    "twice": ({"cell": ("track, turn", "track, track")}, ["twice"]),
    "unknown flange": ({"cell": ("flange: mount", "flange: plate")}, ["robot.flange", "'plate'", "mount"]),
    "no joint": ({"cell": ("flange: mount, joints: [track, turn, shoulder, elbow, roll, pitch, spin]", "flange: rail")}, ["no movable joint", "'rail'"]),
    "ball joint": ({"robot": ('name="turn" type="revolute"', 'name="turn" type="planar"')}, ["'turn'", "revolute or prismatic"]),
    "not xml": ({"robot": ("</robot>", "")}, ["track.urdf", "Drake's parser cannot read"]),
}  # fmt: skip


@pytest.mark.parametrize("name", list(BAD_ROBOTS))
def test_a_robot_that_does_not_hold_the_arm_is_refused_with_reason(tmp_path, name):
    changes, words = BAD_ROBOTS[name]
    robot, cell = TRACK_URDF, TRACK_CELL
    if "robot" in changes:
        assert changes["robot"][0] in robot
        robot = robot.replace(*changes["robot"])
    if "cell" in changes:
        assert changes["cell"][0] in cell
        cell = cell.replace(*changes["cell"])
    with pytest.raises(InputError) as error:
        arm_of(tmp_path, cell=cell, robot=robot)
    for word in words:
        assert word in str(error.value)


def test_an_unknown_package_in_model_directives_is_named(tmp_path):
    robot = "directives:\n- add_model: {name: x, file: package://nowhere/x.urdf}\n"
    with pytest.raises(InputError, match="nowhere"):
        arm_of(tmp_path, cell=TRACK_CELL.replace("track.urdf", "m.dmd.yaml"), robot=robot, file="m.dmd.yaml")


@pytest.mark.parametrize("content", [None, b"", b"\n \n"])
def test_a_robot_description_that_is_not_there_or_empty_is_refused(tmp_path, content):
    write_arms(tmp_path)
    (tmp_path / "track.urdf").unlink()
    if content is not None:
        (tmp_path / "track.urdf").write_bytes(content)
    with pytest.raises(InputError, match=r"track\.urdf: (no such file|the file is empty)"):
        build_arm(read_cell(tmp_path / "track.yaml"))


@pytest.mark.parametrize("file", ["pkg/track.urdf", "package://arm_description/track.urdf"])
def test_directives_may_name_a_relative_file_or_a_package_beside_them(tmp_path, file):
    (tmp_path / "pkg").mkdir()
    (tmp_path / "pkg" / "track.urdf").write_text(TRACK_URDF)
    (tmp_path / "pkg" / "package.xml").write_text("<package format='2'><name>arm_description</name></package>")
    robot = f"directives:\n- add_model: {{name: x, file: {file}}}\n"
    arm = arm_of(tmp_path, cell=TRACK_CELL.replace("track.urdf", "m.dmd.yaml"), robot=robot, file="m.dmd.yaml")
    assert arm.joint_names == TRACK_JOINTS
