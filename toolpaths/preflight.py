"""Before anything is computed or written: are frames, reach and force plausible, or is a unit wrong?

What cannot be is refused and asked for by name (exit code 2); what may be, but seldom is, becomes a note.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from drake_stiffness.arm import Arm
from drake_stiffness.errors import InputError, UntrustworthyError
from drake_stiffness.model import Model
from toolpaths.process import Controller, Process
from toolpaths.program import Program

Floats = NDArray[np.float64]
Ints = NDArray[np.int_]

TCP_WITHIN_M = 2.0
# A workpiece that far beyond the arm is no bad cell but a wrong unit.
_FAR = 10.0
# A program that is smaller than this is a dot, or its numbers are metres.
_TINY_MM = 5.0
WARN_FORCE_N, REFUSE_FORCE_N = 5e3, 50e3
# Robots carry a tenth to a third of their own weight.
_PAYLOAD_SHARE = 0.5
# No part is milled with a tool that is pushed aside by more.
REFUSE_DEFLECTION_MM = 20.0


def check_cell(process: Process, program: Program, model: Model) -> list[str]:
    """Tool and base frames against the arm and the program; what is odd is returned as notes.

    Raises
    ------
    InputError
        If a frame or the program can only be in another unit.
    """
    rows = np.flatnonzero(program.corrected)
    R_ET, p_ET = model.tcp
    off = float(np.linalg.norm(p_ET))
    if off > TCP_WITHIN_M:
        raise InputError(
            f"tool.tcp.position_m of the model's cell is {np.array2string(p_ET, precision=4, separator=', ')}: {off:.4g} m from the flange, "
            f"expected at most {TCP_WITHIN_M:g} m. Is tool.tcp.position_m in metres? Mend cell.yaml and identify again."
        )
    if not rows.size:
        return []
    R_WB, p_WB = process.base
    p = program.position_mm[rows] * 1e-3 @ R_WB.T + p_WB
    reach = _reach(model.arm) + off
    far = float(np.median(np.linalg.norm(p, axis=1)))
    if far > _FAR * reach:
        raise _unit_error(process, program, rows, reach, far)
    notes = []
    extent = float(np.ptp(program.position_mm[rows], axis=0).max()) if rows.size > 2 else np.inf
    if extent < _TINY_MM and np.abs(program.position_mm[rows]).max() < _TINY_MM:
        notes.append(
            f"all {rows.size} corrected points lie within {extent:.3g} mm of each other: are the program's lengths really millimetres?"
        )
    notes += _tool_notes(process, program, rows, R_ET, p_ET)
    return notes


def _reach(arm: Arm) -> float:
    """The arm stretched out, m; slides by their travel."""
    slides = sum(
        float(np.abs([low, high])[np.isfinite([low, high])].max(initial=0.0))
        for low, high, prismatic in zip(arm.lower, arm.upper, arm.prismatic, strict=True)
        if prismatic
    )
    return float(np.linalg.norm(arm.p_PF, axis=1).sum()) + slides


def _unit_error(process: Process, program: Program, rows: Ints, reach: float, far: float) -> InputError:
    at, size = process.workpiece.position_m, float(np.linalg.norm(process.workpiece.position_m))
    if size > _FAR * reach:
        return InputError(
            f"{process.path}: workpiece.position_m is {list(at)}: {size:.4g} m from the robot's base, which reaches {reach:.3g} m. Is "
            "workpiece.position_m in metres?"
        )
    row = int(rows[np.linalg.norm(program.position_mm[rows], axis=1).argmax()])
    return InputError(
        f"{program.path}, line {program.line[row]}: the program's points lie {far:.4g} m from the robot's base, which reaches {reach:.3g} m. "
        "Are the program's lengths in millimetres, and is it written in the frame that `workpiece` says?"
    )


def _tool_notes(process: Process, program: Program, rows: Ints, R_ET: Floats, p_ET: Floats) -> list[str]:
    """The spindle should be on the flange's side of the tip, and outside the workpiece."""
    notes = []
    to_spindle = R_ET @ process.spindle_axis
    if np.linalg.norm(p_ET) > 0.05 and float(to_spindle @ p_ET) > 0.5 * np.linalg.norm(p_ET):
        notes.append(
            f"the tool points back at the flange: from the tip, the spindle ({process.tool_axis} of the TCP) lies away from it. Check "
            "tool.tcp.rpy_deg of the cell and tool_axis"
        )
    known = np.isfinite(program.orientation[rows]).all(axis=1)
    if known.any() and program.convention.words:
        R = program.convention.rotation(program.orientation[rows][known])
        axis = R[:, :, 2] if program.convention.axis_only else R @ process.spindle_axis
        below = float((axis[:, 2] < -0.2).mean())
        if below > 0.5:
            notes.append(
                f"the spindle lies on the -z side of the workpiece at {100 * below:.0f} % of the points (it would mill from below): check "
                "workpiece.rpy_deg, tool.tcp.rpy_deg and tool_axis"
            )
    return notes


def check_force(program: Program, rows: Ints, wrench: Floats, arm: Arm) -> list[str]:
    """The process force against what milling and arms bear.

    Raises
    ------
    InputError
        If it is beyond any cut; the first line is named.
    """
    size = np.sqrt((wrench[:3] ** 2).sum(axis=0))
    largest, line = float(size.max(initial=0.0)), int(program.line[rows[size.argmax()]])
    if largest > REFUSE_FORCE_N:
        raise InputError(
            f"{program.path}, line {line}: the force on the tool is {largest:.4g} N, expected at most {REFUSE_FORCE_N:g} N. Are the forces of "
            "process.yaml (or its table) in newtons?"
        )
    weight = float(arm.mass_kg[1:].sum() * np.linalg.norm(arm.gravity))
    limit = min(WARN_FORCE_N, _PAYLOAD_SHARE * weight) if weight > 0 else WARN_FORCE_N
    if largest > limit:
        return [
            f"the force on the tool is up to {largest:.4g} N (line {line}), more than milling or this arm usually bear ({limit:.3g} N): check "
            "unit and frame"
        ]
    return [] if largest > 0 else ["no force acts on any point"]


def check_deflection(program: Program, rows: Ints, deflection: Floats) -> None:
    """Refuse what no cut can be: a predicted deflection (3, N), m, of centimetres.

    Raises
    ------
    UntrustworthyError
        Naming the lines.
    """
    size = np.sqrt((deflection**2).sum(axis=0)) * 1e3
    if (size > REFUSE_DEFLECTION_MM).any():
        lines = sorted(set(program.line[rows[size > REFUSE_DEFLECTION_MM]].tolist()))
        shown = ", ".join(map(str, lines[:12])) + (f" and {len(lines) - 12} more" if len(lines) > 12 else "")
        raise UntrustworthyError(
            f"{program.path}: the predicted deflection is up to {size.max():.3g} mm at line {shown}; more than {REFUSE_DEFLECTION_MM:g} mm is "
            "no milling. Check force, its unit and frame, and the units of the campaign that the model comes from."
        )


_QUESTIONS = {
    "loads_set": "are the load data of tool and spindle set",
    "tool_data_set": "is the tool's TCP that of the model",
    "absolute_accuracy": "is the absolute-accuracy option on",
    "blend_radius_mm": "which blend radius is in force",
}


def controller_notes(process: Process, elastic_geometry: bool, blend_said: str = "") -> list[str]:
    """What the controller does decides whether a correction lands; what is not stated is asked for.

    Parameters
    ----------
    elastic_geometry : bool
        Whether the model holds identified geometric errors.
    blend_said : str
        What the program itself says of blend radii, if it says one for every point.
    """
    c: Controller = process.controller
    notes = []
    questions = dict(_QUESTIONS)
    if blend_said:
        questions["blend_radius_mm"] = f"does it blend as the program says, {blend_said}"
    open_keys = [key for key in questions if getattr(c, key) is None]
    if open_keys:
        asked = "; ".join(f"{questions[key]} ({key})" for key in open_keys)
        notes.append(f"not stated under `controller` in process.yaml, and it decides: {asked}?")
    if c.loads_set is False:
        notes.append(
            "the controller does not know the load it carries (loads_set: false): its own sag model is that of another robot; set the load data"
        )
    if c.loads_set and process.reference == "rigid":
        notes.append(
            "the controller knows its load and may correct sag itself; with reference: rigid it would be corrected twice"
        )
    if c.tool_data_set is False:
        notes.append(
            "the controller's TCP is not the model's (tool_data_set: false): every orientation then moves the tool elsewhere"
        )
    if c.absolute_accuracy and process.geometry and elastic_geometry:
        notes.append(
            "absolute accuracy is on, and geometry: true corrects identified geometric errors too: they would be corrected twice"
        )
    if c.absolute_accuracy is False and not process.geometry:
        notes.append(
            "absolute accuracy is off: geometric errors of the arm (often tenths of a millimetre) remain; they are not in the interval"
        )
    return notes
