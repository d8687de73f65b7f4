"""How a program is machined: `process.yaml`, validated, and checked against model and program."""

from __future__ import annotations

import re
from itertools import pairwise
from pathlib import Path
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray
from pydantic import Field, PrivateAttr, model_validator

from drake_stiffness.cell import Pose, read_cell
from drake_stiffness.errors import InputError
from drake_stiffness.files import Document, read_yaml, sha256
from drake_stiffness.model import Model
from drake_stiffness.rotations import rpy_rotation
from toolpaths.milling.settings import Milling
from toolpaths.program import FrameSetting, Program
from toolpaths.rotary import RotaryAxes

Floats = NDArray[np.float64]
Frame = Literal["tool", "path", "workpiece", "world"]
FRAMES = ("tool", "path", "workpiece", "world")

# Frames set in a program agree with process.yaml when they differ by less than controllers resolve.
_FRAME_MM, _FRAME_DEG = 0.01, 0.001


class ConstantForce(Document):
    """A force and moment on the tool at the TCP, the same at every corrected point."""

    fx_N: float = 0.0
    fy_N: float = 0.0
    fz_N: float = 0.0
    mx_Nm: float = 0.0
    my_Nm: float = 0.0
    mz_Nm: float = 0.0
    frame: Frame

    @property
    def wrench(self) -> Floats:
        """(6,) in the frame's axes."""
        return np.array([self.fx_N, self.fy_N, self.fz_N, self.mx_Nm, self.my_Nm, self.mz_Nm])


class Force(Document):
    """One of a constant, a table or milling; a table's frame is its column `frame`, else this key, else the tool's axes."""

    constant: ConstantForce | None = None
    table: str | None = None
    milling: Milling | None = None
    frame: Frame | None = None
    relative_sigma: float | None = Field(default=None, ge=0.0, le=1.0)

    @model_validator(mode="after")
    def _one_of(self) -> Force:
        if [self.constant, self.table, self.milling].count(None) != 2:
            raise ValueError("give exactly one of constant, table and milling")
        if self.constant is not None and self.frame is not None:
            raise ValueError("frame belongs inside constant")
        if self.milling is not None and self.frame is not None:
            raise ValueError("milling has its own axes (along the feed and the tool); leave frame out")
        return self


class Controller(Document):
    """What the robot's controller knows and does; nothing of it is in the program, and all of it decides. None: not stated."""

    loads_set: bool | None = None
    tool_data_set: bool | None = None
    absolute_accuracy: bool | None = None
    blend_radius_mm: float | None = Field(default=None, ge=0.0)


class Process(Document):
    """The content of `process.yaml` (FORMATS: process.yaml)."""

    cell: str | None = None
    workpiece: Pose = Pose()
    posture_deg: tuple[float, ...] = Field(min_length=1)
    external_axes: dict[str, str] = Field(default_factory=dict)
    tool_axis: Literal["x", "-x", "y", "-y", "z", "-z"] = "-z"
    gcode: RotaryAxes | None = None
    reference: Literal["unloaded", "rigid"] = "unloaded"
    geometry: bool = False
    controller: Controller = Controller()
    force: Force

    _path: Path = PrivateAttr(default=Path())
    _force_rows: tuple[Floats, NDArray[np.str_]] | None = PrivateAttr(default=None)

    @property
    def path(self) -> Path:
        """The file it was read from; paths inside are relative to it."""
        return self._path

    @property
    def force_rows(self) -> tuple[Floats, NDArray[np.str_]] | None:
        """Rows of the force table that belong to a piece of a program; None where the whole table does."""
        return self._force_rows

    def with_force_rows(self, rows: tuple[Floats, NDArray[np.str_]] | None) -> Process:
        """The same process for a piece of a program."""
        process = self.model_copy()
        process._force_rows = rows
        return process

    @property
    def spindle_axis(self) -> Floats:
        """(3,) direction from the tool's tip to the spindle in the TCP frame: what i, j, k of a CAM program say."""
        axis = np.eye(3)["xyz".index(self.tool_axis[-1])]
        return -axis if self.tool_axis.startswith("-") else axis

    @property
    def base(self) -> tuple[Floats, Floats]:
        """Rotation (3, 3) and position (3,) of the program's base frame in the world."""
        return rpy_rotation(np.radians(self.workpiece.rpy_deg)), np.array(self.workpiece.position_m)


def read_process(path: Path | str) -> Process:
    """Read and validate a `process.yaml`; InputError names file, key, value and remedy."""
    path = Path(path)
    process = read_yaml(path, Process, "a process description (process.yaml)")
    process._path = path
    return process


def check_model(process: Process, model: Model) -> None:
    """Raise InputError if process.yaml names a cell that the model is not of (its springs may differ)."""
    if process.cell is None:
        return
    path = process.path.parent / process.cell
    cell = read_cell(path)
    robot, stated = cell.robot_path, model.provenance.get("inputs", {}).get("robot", {}).get("sha256")
    if stated is not None and robot.exists() and sha256(robot) != stated:
        raise InputError(
            f"{process.path}: the model is of another cell than {path}: its robot description {robot} is not the file that the model was "
            "made from (SHA-256 differs). Identify again, or name the cell the model was made from."
        )
    named = _identity(cell.model_dump(mode="json"))
    own = _identity(model.cell)
    for key, value in named.items():
        if value != own.get(key):
            raise InputError(
                f"{process.path}: the model is of another cell than {path}: {key} is {own.get(key)} in the model, {value} in "
                "the cell. Identify a model of this cell, or name the cell the model was made from."
            )


def _identity(cell: dict[str, Any]) -> dict[str, Any]:
    """What makes a cell this cell, flat; springs are how it is modelled, not what it is."""
    flat: dict[str, Any] = {
        "robot.model": Path(cell["robot"]["model"]).name,
        "robot.flange": cell["robot"]["flange"],
        "robot.joints": cell["robot"].get("joints"),
        "gravity_m_per_s2": list(cell["gravity_m_per_s2"]),
        "tool.mass_kg": cell["tool"]["mass_kg"],
        "tool.center_of_mass_m": list(cell["tool"]["center_of_mass_m"]),
    }
    tcp = cell["tool"]["tcp"]
    flat |= {"tool.tcp.position_m": list(tcp["position_m"]), "tool.tcp.rpy_deg": list(tcp["rpy_deg"])}
    return flat


def check_frames(process: Process, program: Program, model: Model) -> None:
    """Raise InputError if a frame that the program itself sets disagrees with process.yaml or the cell."""
    R_WB, p_WB = process.base
    R_ET, p_ET = model.tcp
    in_force = governing(program)
    for setting in in_force:
        if setting.origin == "controller":
            continue  # its numbers live in the controller; process.yaml and the cell state them
        name = _frame_name(setting)
        where = f"{program.path}, line {setting.line}: {setting.text.strip()}"
        if setting.origin == "expression" or setting.pose is None or np.isnan(setting.pose).any():
            raise InputError(
                f"{where}: {name} is computed or only partly written, so where the points lie is not known. Write it as a literal "
                "{X .., Y .., Z .., A .., B .., C ..} or take it from the controller by number."
            )
        R, p = (R_WB, p_WB) if setting.what == "base" else (R_ET, p_ET)
        pose = np.array(setting.pose)
        turn = R.T @ setting.convention.rotation(pose[None, 3:])[0]
        angle = np.degrees(np.arccos(np.clip((np.trace(turn) - 1) / 2, -1, 1)))
        distance = float(np.linalg.norm(pose[:3] - p * 1e3))
        if distance > _FRAME_MM or angle > max(_FRAME_DEG, 2e-6):
            key = "workpiece of process.yaml" if setting.what == "base" else "tool.tcp of the model's cell"
            raise InputError(
                f"{where}: differs from {key} by {distance:.3f} mm and {angle:.4f} deg; the program would be corrected in the wrong "
                "place. Make the two agree."
            )
    refuse_changes(program, in_force)


def governing(program: Program) -> list[FrameSetting]:
    """The settings in force at corrected motions."""
    lines = np.sort(program.line[program.corrected])
    found: list[FrameSetting] = []
    for what in ("base", "tool"):
        settings = sorted((s for s in program.frames if s.what == what), key=lambda s: s.line)
        ends = [*(s.line for s in settings[1:]), np.inf]
        # A motion may name its own frame: then the setting stands on its line.
        mine = [s for s, end in zip(settings, ends, strict=False) if ((lines >= s.line) & (lines < end)).any()]
        found += mine
    return found


def refuse_changes(program: Program, settings: list[FrameSetting]) -> None:
    """Raise InputError if base or tool change between corrected motions: process.yaml holds one workpiece, the cell one tool."""
    for one, two in pairwise(settings):
        if one.what == two.what and _frame_key(one) != _frame_key(two):
            name = _frame_name(one)
            raise InputError(
                f"{program.path}, line {two.line}: {two.text.strip()}: {name} changes between corrected motions (line {one.line}: "
                f"{one.text.strip()}); process.yaml and the cell hold one. Split the program, one part per frame."
            )


def _frame_name(setting: FrameSetting) -> str:
    """What a programmer calls it; KRL's settings have no key of their own."""
    if setting.key is not None:
        return "the base frame" if setting.what == "base" else "the tool frame"
    return "$BASE" if setting.what == "base" else "$TOOL"


def _frame_key(setting: FrameSetting) -> object:
    """What tells one frame from another: the literal's numbers, or the name or number in the controller's table."""
    if setting.key is not None:
        return setting.key
    if setting.origin == "literal":
        return setting.pose
    numbers = re.findall(r"\d+", setting.text.split(";")[0])
    return numbers[-1] if numbers else setting.text.strip().upper()


def posture(process: Process, model: Model) -> Floats:
    """(n,) the posture that picks the branch, rad and m.

    `posture_deg` lists the revolute joints from base to flange, or all joints with prismatic ones in mm.
    """
    arm = model.arm
    revolute = [not p for p in arm.prismatic]
    given = np.array(process.posture_deg)
    q = np.zeros(arm.num_joints)
    if given.size == arm.num_joints:
        q = given * np.where(arm.prismatic, 1e-3, np.pi / 180)
    elif given.size == sum(revolute):
        q[revolute] = np.radians(given)
    else:
        raise InputError(
            f"{process.path}: posture_deg has {given.size} numbers; the arm has {sum(revolute)} revolute joints of {arm.num_joints} "
            f"({', '.join(arm.joint_names)}). Give the revolute ones in degrees, or all with prismatic ones in mm."
        )
    return q


def _refuse_unmapped(process: Process, program: Program, model: Model, rows: NDArray[np.int_]) -> None:
    """Raise InputError if the program drives an axis that nothing maps while the arm has joints to spare."""
    mapped = {word.upper() for word in process.external_axes}
    spare = model.arm.num_joints - 6 - len(mapped)
    for place in range(6):
        word = f"E{place + 1}"
        values = program.external[rows, place]
        if word in mapped or spare <= 0 or not (np.nan_to_num(values) != 0).any():
            continue
        row = int(rows[np.flatnonzero(np.nan_to_num(values) != 0)[0]])
        raise InputError(
            f"{program.path}, line {program.line[row]}: {word} is driven, but external_axes of {process.path} does not say which joint "
            f"it is; the arm has {model.arm.num_joints} joints ({', '.join(model.arm.joint_names)}). Add external_axes: {{{word}: joint}}."
        )


def external_positions(process: Process, program: Program, model: Model, rows: NDArray[np.int_]) -> dict[int, Floats]:
    """Joint number to position (rows,), rad or m, of joints that words of the program drive.

    Raises
    ------
    InputError
        If a word or joint does not exist, or a row does not say the word.
    """
    arm, found = model.arm, {}
    _refuse_unmapped(process, program, model, rows)
    for word, joint in process.external_axes.items():
        if joint not in arm.joint_names:
            raise InputError(
                f"{process.path}: external_axes: '{word}' drives '{joint}', which the arm does not have; it has "
                f"{', '.join(arm.joint_names)}."
            )
        name = word.upper()
        if not (len(name) == 2 and name[0] == "E" and name[1] in "123456"):
            raise InputError(f"{process.path}: external_axes: '{word}' is no external word; expected E1 .. E6.")
        number = arm.joint_names.index(joint)
        written = program.external[rows, int(name[1]) - 1]
        for row in np.flatnonzero(np.isnan(written))[:1].tolist():
            raise InputError(
                f"{program.path}, line {program.line[rows[row]]}: {name} is not known here, but it drives '{joint}'; write it."
            )
        found[number] = written * (1e-3 if arm.prismatic[number] else np.pi / 180)
    return found
