"""Arms, models and programs for compensation, made once; the independent arm of `examples/plants` on the import path."""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
import pytest

from drake_stiffness.cell import read_cell
from drake_stiffness.plant import build_arm
from drake_stiffness.truth import read_truth
from toolpaths.formats.krl import Krl
from toolpaths.process import Process

TESTS = Path(__file__).parents[1]
EXAMPLES = TESTS.parent / "examples"
KR270 = EXAMPLES / "kr270"
for folder in (EXAMPLES, TESTS / "drake_stiffness"):
    if str(folder) not in sys.path:
        sys.path.append(str(folder))

# Joint springs of the example's size and three soft links, so that springs of links matter.
TRUTH = """
effects:
  - {kind: joint_compliance, where: joint_1, parameters: {k: 0.33e-6}}
  - {kind: joint_compliance, where: joint_2, parameters: {k: 0.302e-6}}
  - {kind: joint_compliance, where: joint_3, parameters: {k: 0.406e-6}}
  - {kind: joint_compliance, where: joint_4, parameters: {k: 3.002e-6}}
  - {kind: joint_compliance, where: joint_5, parameters: {k: 3.303e-6}}
  - {kind: joint_compliance, where: joint_6, parameters: {k: 2.365e-6}}
  - {kind: link_compliance, where: link_2, parameters: {k22: 2e-8, k26: 2.5e-8, k66: 5e-8, k55: 8e-8, k44: 3e-8, k11: 1e-9}}
  - {kind: link_compliance, where: link_4, parameters: {k55: 1.2e-7, k66: 1.5e-7, k44: 9e-8}}
  - {kind: base_compliance, where: base, parameters: {k44: 2e-8, k55: 2e-8, k66: 1e-8, k33: 1e-9}}
"""
RAIL = """
  <link name="rail">
    <inertial><origin xyz="0 0 0.1"/><mass value="900"/>
      <inertia ixx="90" iyy="90" izz="90" ixy="0" ixz="0" iyz="0"/></inertial>
  </link>
  <joint name="track" type="prismatic">
    <parent link="rail"/><child link="base_link"/><origin xyz="0.1 -0.2 0.3" rpy="0 0 0.2"/><axis xyz="0 1 0"/>
    <limit lower="-2" upper="3" effort="9000" velocity="2"/>
  </joint>
"""


def _arm_folder(folder: Path) -> Path:
    urdf = (KR270 / "kr270.urdf").read_text()
    mark = '  <link name="base_link">'
    assert mark in urdf
    (folder / "kr270.urdf").write_text(urdf)
    (folder / "track.urdf").write_text(urdf.replace(mark, RAIL + mark))
    cell = (KR270 / "cell.yaml").read_text()
    (folder / "cell.yaml").write_text(cell)
    (folder / "track.yaml").write_text(cell.replace("kr270.urdf", "track.urdf"))
    (folder / "truth.yaml").write_text(TRUTH)
    track = TRUTH.replace("kind: base_compliance, where: base,", "kind: link_compliance, where: base_link,")
    (folder / "track_truth.yaml").write_text(
        track + "  - {kind: joint_compliance, where: track, parameters: {k: 4e-9}}\n"
    )
    return folder


@pytest.fixture(scope="session")
def arm_folder(tmp_path_factory):
    return _arm_folder(tmp_path_factory.mktemp("arms"))


@pytest.fixture(scope="session")
def cell(arm_folder):
    return read_cell(arm_folder / "cell.yaml")


@pytest.fixture(scope="session")
def model(arm_folder, cell):
    """KR 270 with joint and link springs, milling tool; no campaign behind it."""
    return read_truth(arm_folder / "truth.yaml", cell, build_arm(cell))


@pytest.fixture(scope="session")
def track_model(arm_folder):
    """The same arm on a rail: seven joints, the first a slide."""
    cell = read_cell(arm_folder / "track.yaml")
    return read_truth(arm_folder / "track_truth.yaml", cell, build_arm(cell))


def process_of(**changes) -> Process:
    """The example's process, changed; `force` as a constant in one frame."""
    content = {
        "workpiece": {"position_m": [1.65, -0.10, 0.75]},
        "posture_deg": [0, -70, 120, 0, -50, 0],
        "force": {"constant": {"fx_N": 240, "fy_N": 180, "fz_N": -400, "frame": "tool"}},
    }
    return Process.model_validate({**content, **changes})


def constant(frame: str, **values) -> dict:
    return {"constant": {"frame": frame, **values}}


def program_of(*lines: str):
    return Krl().parse("\n".join(lines).encode() + b"\n", "test.src")


@pytest.fixture(scope="session")
def pocket():
    """The example's program, every twentieth waypoint and the arcs."""
    lines = (KR270 / "pocket.src").read_text().splitlines()
    motions = [line for line in lines if line.startswith(("LIN", "CIRC"))]
    return program_of("$BASE = BASE_DATA[1]", *motions[:-10:20], *motions[-9:-1])


@pytest.fixture(scope="session")
def tools():
    """What tests build programs and processes with."""

    class Tools:
        process = staticmethod(process_of)
        constant = staticmethod(constant)
        program = staticmethod(program_of)
        posture = np.radians([[0.0, -70.0, 120.0, 20.0, -50.0, 5.0]]).T

    return Tools
