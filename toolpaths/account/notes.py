"""What the user must know of a corrected program, in sentences."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from drake_stiffness.model import Model
from drake_stiffness.support import WARN_ABOVE
from toolpaths.account.account import Account
from toolpaths.loaded_path import LoadedPath
from toolpaths.preflight import controller_notes
from toolpaths.process import Process
from toolpaths.program import Program, quantum_mm

Floats = NDArray[np.float64]
_GEOMETRY = ("joint_zero_offset", "link_geometry")


def notes_of(
    program: Program, model: Model, process: Process, path: LoadedPath, account: Account, before_mm: Floats
) -> list[str]:
    """Notes on model, program, force, controller and correction, gravest first."""
    line = program.line[path.rows].astype(int)
    return [
        *(f"said of the model when it was identified: {doubt}" for doubt in model.doubts()),
        *account.turning.notes(line),
        *account.evenness.notes(line),
        *account.blending.notes(),
        *_program_notes(program, process, path, before_mm),
        *_uncertainty_notes(process, account),
        *controller_notes(process, any(effect.kind in _GEOMETRY for effect in model.effects), _blends(account)),
    ]


def _blends(account: Account) -> str:
    """The blend radii of the program, where it says one for every point."""
    if not account.blending.all_said:
        return ""
    low, high = account.blending.limits_mm
    return f"{low:g} mm" if low == high else f"{low:g} to {high:g} mm"


def _program_notes(program: Program, process: Process, path: LoadedPath, before_mm: Floats) -> list[str]:
    rows, only = path.rows, path.only
    notes = [f"line {n.line}: {n.reason}" for n in program.notes[:20]]
    notes += list(program.warnings)
    driven = [f"E{i + 1}" for i in range(6) if (np.nan_to_num(program.external[rows, i]) != 0).any()]
    loose = sorted(set(driven) - {word.upper() for word in process.external_axes})
    if loose:
        notes.append(
            f"{', '.join(loose)} is driven by the program but moves nothing here; a positioner would move the workpiece"
        )
    if only.any():
        notes.append(
            f"{int(only.sum())} of {rows.size} points write no orientation, or a later point keeps theirs: only their positions were corrected"
        )
    if process.force.table is not None and process.force.frame is None:
        notes.append("the force table was read in tool axes unless its column 'frame' says otherwise")
    if path.load is not None:
        notes += path.load.notes
    if path.depth_gain is not None:
        notes.append(
            f"the force follows the true depth of cut: the loop of depth and force has a gain of up to {path.depth_gain.max(initial=0.0):.2g} (it "
            "settles below 1); once corrected the depth is the stated one"
        )
    if process.reference == "rigid":
        notes.append(
            "sag under weight is corrected too (reference: rigid): the robot must not have its own sag compensation on"
        )
    coarse = float(np.nanmax(quantum_mm(program)[rows]))
    largest = float(before_mm.max())
    if coarse > 0.2 * largest > 0:
        notes.append(
            f"the program prints to {2 * coarse:g} mm, while the largest deviation to be corrected is {largest:.3f} mm; print more decimals"
        )
    return notes


def _uncertainty_notes(process: Process, account: Account) -> list[str]:
    interval, notes = account.interval, []
    share = float(interval.unsupported.max(initial=0.0))
    if share > WARN_ABOVE:
        notes.append(f"up to {100 * share:.0f} % of the prediction is not supported by the model's campaign")
    if np.isnan(interval.parameters_mm).all():
        notes.append("the model carries no statistics: its own uncertainty is not known")
    if not account.relative_sigma.any():
        notes.append(
            "the uncertainty of the process force is not stated (force.relative_sigma of process.yaml), so intervals leave it out: 10 % too "
            "much or too little force leaves 10 % of the deflection"
        )
    if any("model's form" in lacking for lacking in interval.lacks):
        notes.append(
            "the model's file does not say how large the error of its form is; intervals leave it out (identify again)"
        )
    return notes
