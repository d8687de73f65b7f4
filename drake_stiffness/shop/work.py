"""From a plan to what the shop works with: robot program, load sheet, the plan in the order it is driven."""

from __future__ import annotations

import csv
import io
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from drake_stiffness.arm import Arm
from drake_stiffness.campaign import Measurements, read_measurements
from drake_stiffness.cell import read_cell
from drake_stiffness.errors import InputError
from drake_stiffness.hold_out import posture_groups
from drake_stiffness.rotations import Array
from drake_stiffness.shop.axis_words import read_words
from drake_stiffness.shop.load_sheet import load_sheet
from drake_stiffness.shop.plan_program import ProgramOptions, plan_program
from drake_stiffness.shop.visiting_order import Order, total_travel, visiting_order


@dataclass(frozen=True, eq=False)
class ShopPapers:
    """What the shop gets.

    Attributes
    ----------
    program : bytes
        KRL.
    sheet : str
        HTML.
    plan_in_order : str
        The plan's rows, cells untouched, in the order the program drives them.
    experiments : tuple of names in that order
    steps : int
    travel_rad : float
        Of the axis that moves most, over all motions between experiments.
    words : dict of program word to joint name
    warnings : list of str
    """

    program: bytes
    sheet: str
    plan_in_order: str
    experiments: tuple[str, ...]
    steps: int
    travel_rad: float
    words: dict[str, str]
    warnings: list[str]

    def to_dict(self) -> dict[str, Any]:
        """The result for programs."""
        return {
            "experiments": list(self.experiments),
            "steps": self.steps,
            "travel_deg": float(np.degrees(self.travel_rad)),
            "words": self.words,
            "warnings": self.warnings,
        }


def prepare(
    plan: Path | str,
    cell_path: Path | str,
    *,
    name: str,
    order: Order = "plan",
    seed: int = 0,
    axes: Sequence[str] = (),
    speed_percent: int = 10,
    tool_number: int | None = None,
    via: Sequence[float] | None = None,
) -> ShopPapers:
    """Program and sheet of a plan (command `shop`).

    Parameters
    ----------
    via : numbers per joint, deg (mm if prismatic)
        Posture to pass between experiments.
    """
    from drake_stiffness.plant import build_arm

    cell = read_cell(cell_path)
    arm = build_arm(cell)
    m = read_measurements(plan, arm, tuple(cell.reference_points_m), np.array(cell.load_point_m), readings=False)
    words = read_words(axes, arm)
    chosen = visiting_order(m, arm.prismatic, order, seed)
    options = ProgramOptions(speed_percent, tool_number, None if via is None else _posture(via, arm))
    return ShopPapers(
        program=plan_program(m, arm, name, chosen, words, options),
        sheet=load_sheet(m, arm, f"Load sheet: {Path(plan).stem}", chosen, words),
        plan_in_order=in_order(m, chosen),
        experiments=tuple(m.experiments[e] for e in chosen),
        steps=m.cases.number,
        travel_rad=total_travel(m, arm.prismatic, chosen),
        words={w.word: arm.joint_names[w.joint] for w in words},
        warnings=_warnings(m, chosen, via is not None),
    )


def in_order(m: Measurements, order: NDArray[np.int_]) -> str:
    """The rows of a plan, cells untouched, experiment by experiment in the order given and step by step."""
    place = {m.experiments[e]: rank for rank, e in enumerate(order.tolist())}
    names, steps = m.table.text("experiment"), m.table.whole_numbers("step")
    kept = sorted(set(m.row.tolist()), key=lambda r: (place[names[r]], steps[r], r))
    # Planned times of another order would put the experiments back into it.
    _, first = np.unique(m.cases.experiment, return_index=True)
    timed = bool((np.diff(m.cases.time_s[first][order]) >= 0).all())
    columns = [i for i, name in enumerate(m.table.header) if name != "time_s" or timed]
    out = io.StringIO(newline="")
    writer = csv.writer(out, lineterminator="\n")
    writer.writerow([m.table.header[i] for i in columns])
    writer.writerows([m.table.rows[r][i] for i in columns] for r in kept)
    return out.getvalue()


def _posture(via: Sequence[float], arm: Arm) -> Array:
    if len(via) != arm.num_joints:
        raise InputError(
            f"--via-deg: found {len(via)} numbers; expected one per joint: {', '.join(arm.joint_names)} (deg, mm if "
            "prismatic)."
        )
    q = np.array(via) * np.where(arm.prismatic, 1e-3, np.pi / 180)
    for joint in np.flatnonzero((q < arm.lower - 1e-9) | (q > arm.upper + 1e-9)).tolist():
        raise InputError(f"--via-deg: {via[joint]:g} is outside the limits of joint '{arm.joint_names[joint]}'.")
    return q


def _warnings(m: Measurements, order: NDArray[np.int_], via: bool) -> list[str]:
    """What the plan lacks or the order cannot mend."""
    lines = []
    group = posture_groups(m.cases)
    twice = np.flatnonzero(np.diff(group[order]) == 0)
    if twice.size and not via:
        first, second = (m.experiments[e] for e in order[twice[0] : twice[0] + 2])
        lines.append(
            f"experiments '{first}' and '{second}' have the same posture and follow each other: the arm does not "
            "move between them, so they tell nothing of its repeatability. Use another order, or --via-deg."
        )
    unloaded = np.bincount(m.cases.experiment[m.unloaded], minlength=len(m.experiments)) > 0
    if not unloaded.all():
        lacking = [name for name, has in zip(m.experiments, unloaded, strict=True) if not has]
        more = f" ({len(lacking) - 1} more like it)" if len(lacking) > 1 else ""
        lines.append(
            f"experiment '{lacking[0]}'{more} has no unloaded step: its displacements would have no reference."
        )
    return lines
