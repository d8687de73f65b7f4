"""The honest account of a correction, point by point: intervals, causes, evenness, what is left to limits."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from drake_stiffness.effects.compliance import LinkCompliance
from drake_stiffness.model import Model
from toolpaths.account.blending import Blending
from toolpaths.account.causes import Causes, causes_of
from toolpaths.account.evenness import Evenness, Reserve, evenness, reserve
from toolpaths.account.residual import Interval, residual_interval
from toolpaths.account.turning_points import Turning, turning_points
from toolpaths.history import begins
from toolpaths.loaded_path import LoadedPath
from toolpaths.process import Process
from toolpaths.program import Program, quantum_mm

Floats = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Account:
    """Attributes
    ----------
    interval : Interval
        Predicted residual of every point with its 95 % interval.
    causes : Causes
    evenness : Evenness
    blending : Blending
    reserve : Reserve
    turning : Turning
        Where backlash jumps and friction turns round.
    relative_sigma : (N,)
        Of the process force; zero where not stated.
    merged : set of str
        Joints and links of which the campaign showed sums only: their shares by themselves are a convention.
    """

    interval: Interval
    causes: Causes
    evenness: Evenness
    blending: Blending
    reserve: Reserve
    turning: Turning
    relative_sigma: Floats
    merged: frozenset[str]

    def causes_list(self) -> list[dict[str, object]]:
        """Causes for `--json`, each with whether the campaign tells it from others."""
        return [{**cause, "told_apart": cause["where"] not in self.merged} for cause in self.causes.to_list()]


def merged_places(model: Model) -> frozenset[str]:
    """Joints and links with a parameter that is known in combination only."""
    if model.statistics is None:
        return frozenset()
    groups = model.statistics.group
    found = set()
    for effect, own in zip(model.effects, model.slices, strict=True):
        if any(group in ("G2", "G3") for group in groups[own]):
            found.add(effect.link_name() if isinstance(effect, LinkCompliance) else effect.where)
    return frozenset(found)


def _remainder(process: Process, path: LoadedPath, probed: bool) -> str:
    """What superposition of the springs leaves is made of."""
    parts = ["sag under weight"] if process.reference == "rigid" else []
    parts += ["geometry"] if process.geometry else []
    parts += ["force that follows the depth of cut"] if path.depth_gain is not None else []
    parts += ["what the probe found beyond the model"] if probed else []
    return ", ".join([*parts, "second order"])


def account_of(
    program: Program,
    model: Model,
    process: Process,
    path: LoadedPath,
    deflection: Floats,
    residual: Floats,
    correction_mm: Floats,
    q: Floats,
    measured_sigma: Floats | None = None,
) -> Account:
    """What is known of a corrected path.

    Parameters
    ----------
    deflection, residual : (3, N)
        Predicted where the program is uncorrected, and as printed; m, world axes.
    correction_mm : (N, 3)
    q : (n, N)
        Joints that the corrected program commands.
    measured_sigma : (N,), optional
        Where a probe has seen the deviation: what is left of its uncertainty, m; NaN elsewhere.
    """
    rows, bench, wrench = path.rows, path.bench, path.wrench
    begin = begins(program, rows)
    sigma = np.zeros(rows.size) if path.load is None else path.load.relative_sigma
    remainder = _remainder(process, path, measured_sigma is not None)
    causes = causes_of(bench, path.postures.q, wrench, deflection, remainder)
    turning = turning_points(bench, path.postures.q, wrench, begin, sigma)
    # A force that follows the depth of cut grows by more than its own error: as the whole deflection does.
    elastic = path.depth_gain is not None and process.reference == "unloaded" and not process.geometry
    by_force = deflection if elastic else causes.by_force
    interval = residual_interval(
        model,
        path.postures.q,
        wrench,
        residual,
        deflection,
        by_force,
        sigma,
        turning.jump,
        measured_sigma,
        sag=process.reference == "rigid",
    )
    even = evenness(program.position_mm[rows], correction_mm, begin, quantum_mm(program)[rows])
    stated = process.controller.blend_radius_mm
    blending = Blending(
        program.blend_mm[rows], float("nan") if stated is None else stated, even.spacing_mm, even.change_per_mm
    )
    return Account(
        interval=interval,
        causes=causes,
        evenness=even,
        blending=blending,
        reserve=reserve(model.arm, q, program.line[rows].astype(int)),
        turning=turning,
        relative_sigma=sigma,
        merged=merged_places(model),
    )
