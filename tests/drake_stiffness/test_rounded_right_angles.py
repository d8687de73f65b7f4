"""A robot description that prints right angles rounded is the robot that has right angles, to every command alike."""

from dataclasses import replace

import numpy as np
import pytest
from synthetic import hand_made_arm

from drake_stiffness.design.job import plan_measurements
from drake_stiffness.identification import identify
from drake_stiffness.intervals.profile import base_combinations, is_identified, problem_of
from drake_stiffness.jobs import identify_campaign, inspect, simulate
from drake_stiffness.right_angles import with_right_angles
from drake_stiffness.rotations import rpy_rotation
from drake_stiffness.task import read_task

# Position and roll, pitch, yaw of every joint in the frame before it, in right angles; all axes are z.
JOINTS = (
    ("0 0 0.3", (0, 0, 0)), ("0.15 0 0.2", (1, 0, 0)), ("0.9 0 0", (0, 0, 1)),
    ("0.15 0 0.1", (1, 0, 0)), ("0 0 0.8", (-1, 0, 0)), ("0 0 0.12", (1, 0, 1)),
)  # fmt: skip
CELL = """
robot: {model: robot.urdf, flange: flange}
load_point_m: [0.1, 0, 0.2]
reference_points_m: {A: [0.2, 0.05, 0.1], B: [-0.1, 0.2, 0.05], C: [-0.05, -0.2, 0.15]}
springs: {joints: all, links: all, template: beam}
"""


def urdf(right_angle):
    """Six revolute joints, frames as by Denavit and Hartenberg."""
    inertia = '<inertia ixx="2" iyy="2.5" izz="3" ixy="0" ixz="0" iyz="0"/>'
    parts = [
        f'<link name="link_{i}"><inertial><origin xyz="0.02 0.03 0.1"/><mass value="{60 - 8 * i}"/>{inertia}</inertial></link>'
        for i in range(7)
    ]
    for i, (xyz, turns) in enumerate(JOINTS, start=1):
        rpy = " ".join({0: "0", 1: right_angle, -1: f"-{right_angle}"}[turn] for turn in turns)
        parts.append(
            f'<joint name="joint_{i}" type="revolute"><parent link="link_{i - 1}"/><child link="link_{i}"/><origin xyz="{xyz}" rpy="{rpy}"/>'
            '<axis xyz="0 0 1"/><limit lower="-3" upper="3" effort="9000" velocity="2"/></joint>'
        )
    tip = f'<origin xyz="0 0 0.1" rpy="0 -{right_angle} 0"/>'
    parts.append(f'<joint name="tip" type="fixed"><parent link="link_6"/><child link="flange"/>{tip}</joint>')
    return f'<robot name="six"><link name="flange"/>{"".join(parts)}</robot>'


@pytest.fixture
def folder(tmp_path):
    """A cell of that robot, and a virtual campaign of fifteen postures with three forces."""
    (tmp_path / "robot.urdf").write_text(urdf("1.5708"))
    (tmp_path / "cell.yaml").write_text(CELL)
    bends = [f"{{kind: joint_compliance, where: joint_{i}, parameters: {{k: 1.0e-6}}}}" for i in range(1, 7)]
    bends += [f"{{kind: link_compliance, where: link_{i}, parameters: {{k55: 1e-7, k66: 1e-7}}}}" for i in range(1, 7)]
    (tmp_path / "TRUTH.yaml").write_text("effects:\n" + "".join(f"- {line}\n" for line in bends))
    lines = ["experiment,step," + ",".join(f"joint_{i}_rad" for i in range(1, 7)) + ",fx_N,fy_N,fz_N"]
    for e, q in enumerate(np.random.default_rng(3).uniform(-2.5, 2.5, (15, 6))):
        posture = ",".join(f"{angle:.4f}" for angle in q)
        lines += [f"E{e},{s},{posture},{f}" for s, f in enumerate(("0,0,0", "0,0,-1500", "1500,0,0", "0,1500,0"))]
    (tmp_path / "PLAN.csv").write_text("\n".join(lines) + "\n")
    files = [tmp_path / name for name in ("cell.yaml", "TRUTH.yaml", "PLAN.csv")]
    for name, text in simulate(*files, tmp_path, 0.01, 0).files.items():
        (tmp_path / name).write_text(text)
    return tmp_path


def test_all_commands_speak_of_the_rank_of_a_robot_with_right_angles(folder):
    """Taken by the letter the file's robot has 44 combinations, ten of them a millionth of the others in size."""
    by_template = {
        (row["template"], row["load"]): row["rank"] for row in inspect(folder / "cell.yaml", True).identifiable
    }
    assert by_template["beam", "force"] == 34
    found = identify_campaign(folder / "campaign.yaml", "least-squares")
    groups = found.groups.to_dict()
    assert found.model.fit["rank"] == groups["rank"] == len(groups["base"]) == 34
    task = read_task(folder / "campaign.yaml")
    o = task.observations()
    solution = identify(task.model, o, "least-squares")
    combinations, problem = base_combinations(solution), problem_of(solution, o)
    assert len(combinations) == 34
    assert all(is_identified(problem, c.weights * solution.model.scales) for c in combinations)
    (folder / "DESIGN.yaml").write_text("{candidates: 150, random_plans: 0}")
    planned = plan_measurements(folder / "cell.yaml", 8, "d", folder / "DESIGN.yaml")
    assert planned.to_dict()["combinations"] == 34


def test_right_angles_are_restored_and_nothing_else_is_touched():
    exact = arm_of_turns(lambda turn: turn * np.pi / 2)
    rounded = arm_of_turns(lambda turn: turn * 1.5708 if turn in (-1, 1) else turn * np.pi / 2)
    assert np.abs(rounded.R_PF - exact.R_PF).max() > 1e-6
    np.testing.assert_allclose(with_right_angles(rounded).R_PF, exact.R_PF, atol=1e-10)
    tilted = arm_of_turns(lambda turn: turn * 1.571)  # two tenths of a milliradian are meant
    assert with_right_angles(tilted) is tilted


def arm_of_turns(angle):
    """Two joints in an arm whose frames are turned by roll, pitch, yaw; `angle` makes radians of right angles."""
    turns = np.array([(1, 0, 0.3), (0, 1, 0.4), (0.2, -1, 0)])
    R = np.stack([rpy_rotation(tuple(angle(turn) for turn in rpy)) for rpy in turns.tolist()])
    return replace(hand_made_arm([(1, 0, 0)] * 3, [(0, 0, 1)] * 2), R_PF=R)
