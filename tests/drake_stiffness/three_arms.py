"""Three arms as texts: the KR 270 of the examples, an arm on a linear track (URDF), an arm with a free base (SDF)."""

from __future__ import annotations

from pathlib import Path

import numpy as np

KR270 = Path(__file__).parents[2] / "examples" / "kr270"


def _link(name: str, mass: float, com: str) -> str:
    inertia = '<inertia ixx="2" iyy="2.5" izz="3" ixy="0.1" ixz="0.05" iyz="0.02"/>'
    return f'<link name="{name}"><inertial><origin xyz="{com}"/><mass value="{mass}"/>{inertia}</inertial></link>'


def _joint(name: str, kind: str, parent: str, child: str, xyz: str, rpy: str, axis: str = "", limits: str = "") -> str:
    motion = f'<axis xyz="{axis}"/>' if axis else ""
    if limits:
        lower, upper = limits.split()
        motion += f'<limit lower="{lower}" upper="{upper}" effort="9000" velocity="2"/>'
    return (
        f'<joint name="{name}" type="{kind}"><parent link="{parent}"/><child link="{child}"/>'
        f'<origin xyz="{xyz}" rpy="{rpy}"/>{motion}</joint>'
    )


# A carriage that runs along a track askew in the world, then six revolute joints whose axes lie along no frame axis
# here and there. `camera` is welded to the elbow, `finger` slides on a branch, `wrist_lock` is left out of robot.joints.
TRACK_URDF = "\n".join(
    [
        '<robot name="track_arm">',
        _link("rail", 400, "0.1 0 0.1"),
        _joint("track", "prismatic", "rail", "carriage", "0.2 -0.1 0.3", "0.05 -0.1 0.3", "0.9 0.1 -0.05", "-2 3"),
        _link("carriage", 150, "0.02 0.05 0.2"),
        _joint("turn", "revolute", "carriage", "column", "0.05 0.02 0.45", "0.1 0.2 -0.4", "0.1 -0.05 0.9", "-3 3"),
        _link("column", 120, "0.1 -0.04 0.15"),
        _joint("shoulder", "revolute", "column", "upper", "0.25 0.1 0.2", "0 0.3 0", "0 1 0", "-2 2"),
        _link("upper", 80, "0.05 0.03 0.35"),
        _joint("elbow", "revolute", "upper", "elbow_body", "-0.05 0.12 0.8", "0.4 0.1 0.7", "0.3 0.8 0.1", "-2.5 2.5"),
        _link("elbow_body", 45, "0.1 0.0 0.05"),
        _joint("camera_mount", "fixed", "elbow_body", "camera", "0.1 0.2 0.1", "0.3 0 0"),
        _link("camera", 6, "0.01 0.02 0.03"),
        _joint("roll", "revolute", "elbow_body", "forearm", "0.35 0.02 0.12", "0.2 -0.6 0.1", "1 0 0.2", "-3 3"),
        _link("forearm", 25, "0.2 0.01 -0.02"),
        _joint("pitch", "revolute", "forearm", "wrist", "0.5 0.03 -0.06", "0 0 0.2", "0 1 0", "-2 2"),
        _link("wrist", 12, "0.05 0 0"),
        _joint("spin", "revolute", "wrist", "hand", "0.15 0 0.02", "0.1 0.1 0.1", "1 0 0", "-3 3"),
        _link("hand", 8, "0.03 0.01 0.02"),
        _joint("finger", "prismatic", "hand", "finger_body", "0.05 0.1 0", "0 0 0.5", "0 1 0", "0 0.05"),
        _link("finger_body", 1.5, "0 0.02 0"),
        _joint("wrist_lock", "revolute", "hand", "mount", "0.08 0 0.01", "0 0.4 0", "0 0 1", "-1 1"),
        _link("mount", 2.5, "0.02 0 0"),
        "</robot>",
    ]
)
TRACK_JOINTS = ("track", "turn", "shoulder", "elbow", "roll", "pitch", "spin")
TRACK_LINKS = ("rail", "carriage", "column", "upper", "elbow_body", "forearm", "wrist", "hand")
TRACK_CELL = """
robot: {model: track.urdf, flange: mount, joints: [track, turn, shoulder, elbow, roll, pitch, spin]}
gravity_m_per_s2: [0.3, -0.2, -9.7]
tool: {mass_kg: 31.0, center_of_mass_m: [0.08, -0.03, 0.12]}
load_point_m: [0.15, 0.05, 0.2]
reference_points_m: {A: [0.2, 0.05, 0.1], B: [-0.1, 0.2, 0.05], C: [-0.05, -0.2, 0.15]}
springs: {joints: all, links: all, template: symmetric}
"""


def _sdf_link(name: str, frame: str, pose: str, mass: float, com: str) -> str:
    relative = f' relative_to="{frame}"' if frame else ""
    inertia = "<ixx>1</ixx><iyy>1.2</iyy><izz>1.1</izz><ixy>0</ixy><ixz>0.02</ixz><iyz>0</iyz>"
    return (
        f'<link name="{name}"><pose{relative}>{pose}</pose><inertial><pose>{com} 0.1 0.2 0.3</pose>'
        f"<mass>{mass}</mass><inertia>{inertia}</inertia></inertial></link>"
    )


def _sdf_joint(name: str, parent: str, child: str, axis: str, pose: str = "") -> str:
    place = f"<pose>{pose}</pose>" if pose else ""
    return (
        f'<joint name="{name}" type="revolute">{place}<parent>{parent}</parent><child>{child}</child>'
        f"<axis><xyz>{axis}</xyz><limit><lower>-2.9</lower><upper>2.9</upper></limit></axis></joint>"
    )


# Nothing ties `pedestal` to the world: it is a free body until the program welds it where the file puts it. The joint
# of `mast` has a frame of its own, away from the link's.
FREE_SDF = "\n".join(
    [
        '<?xml version="1.0"?><sdf version="1.9"><model name="free_arm">',
        _sdf_link("pedestal", "", "0 0 0 0 0 0", 90, "0 0 0.1"),
        _sdf_link("mast", "pedestal", "0.02 0.03 0.5 0 0 0.3", 60, "0.05 0 0.1"),
        _sdf_joint("s1", "pedestal", "mast", "0.05 0 1", "0.01 0 -0.05 0.1 0 0"),
        _sdf_link("boom", "mast", "0.2 0.05 0.15 0.2 0.1 0", 40, "0 0.02 0.3"),
        _sdf_joint("s2", "mast", "boom", "0 1 0"),
        _sdf_link("jib", "boom", "0.02 -0.04 0.7 0 0.5 0.3", 25, "0.1 0 0.02"),
        _sdf_joint("s3", "boom", "jib", "0 1 0.3"),
        _sdf_link("arm4", "jib", "0.3 0.02 0.05 0 0 0", 12, "0.15 0 0"),
        _sdf_joint("s4", "jib", "arm4", "1 0 0"),
        _sdf_link("arm5", "arm4", "0.4 0.03 -0.02 0 0 0.4", 6, "0.03 0 0"),
        _sdf_joint("s5", "arm4", "arm5", "0 1 0"),
        _sdf_link("arm6", "arm5", "0.12 0 0.01 0.3 0 0", 3, "0.02 0.01 0"),
        _sdf_joint("s6", "arm5", "arm6", "1 0.1 0"),
        '<frame name="tool_plate" attached_to="arm6"><pose>0.07 0.01 0.02 0.2 0.3 -0.1</pose></frame>',
        "</model></sdf>",
    ]
)
FREE_CELL = """
robot: {model: free.sdf, flange: tool_plate}
tool: {mass_kg: 14.0, center_of_mass_m: [0.05, 0.02, 0.1]}
load_point_m: [0.1, -0.05, 0.15]
reference_points_m: {A: [0.1, 0.05, 0.1], B: [-0.1, 0.1, 0.05], C: [0, -0.1, 0.2]}
springs: {joints: all, links: all, template: symmetric}
"""


def write_arms(folder: Path) -> dict[str, Path]:
    """The cells of the three arms; those of two are written into `folder`."""
    (folder / "track.urdf").write_text(TRACK_URDF)
    (folder / "track.yaml").write_text(TRACK_CELL)
    (folder / "free.sdf").write_text(FREE_SDF)
    (folder / "free.yaml").write_text(FREE_CELL)
    return {"kr270": KR270 / "cell.yaml", "track": folder / "track.yaml", "free": folder / "free.yaml"}


def random_postures(arm, number: int, rng: np.random.Generator) -> np.ndarray:
    """(n, N) inside the middle of the limits."""
    lower, upper = np.maximum(arm.lower, -2.0), np.minimum(arm.upper, 2.0)
    middle, half = (lower + upper) / 2, (upper - lower) / 2
    return middle[:, None] + 0.8 * half[:, None] * rng.uniform(-1, 1, (arm.num_joints, number))


def random_wrench(number: int, rng: np.random.Generator, force: float = 2000.0, moment: float = 300.0) -> np.ndarray:
    return np.concatenate([rng.normal(0, force, (3, number)), rng.normal(0, moment, (3, number))])


def random_springs(arm, rng: np.random.Generator) -> tuple[np.ndarray, tuple[np.ndarray, ...]]:
    """Joint compliances (n,) and full positive-definite link compliances of industrial size."""
    scale = np.where(arm.prismatic, 3e-8, 5e-7)
    joint = scale * rng.uniform(0.3, 2.0, arm.num_joints)
    size = np.array([1e-4] * 3 + [2.5e-4] * 3)
    links = []
    for _ in arm.link_names:
        half = rng.normal(size=(6, 6)) * size[:, None]
        links.append(half @ half.T)
    return joint, tuple(links)
