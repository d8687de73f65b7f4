"""What was done and read: `campaign.yaml` and `measurements.csv`, validated; the split into fitted and held-out parts."""

from __future__ import annotations

import logging
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import numpy as np
from numpy.typing import NDArray
from pydantic import Field, model_validator

from drake_stiffness.arm import Arm
from drake_stiffness.effects.effect import Cases
from drake_stiffness.errors import InputError, NoEquilibriumError, UntrustworthyError
from drake_stiffness.files import Document, read_yaml
from drake_stiffness.rotations import Array
from drake_stiffness.tables import Table, read_table

log = logging.getLogger("drake_stiffness")

_LENGTHS, _ANGLES = ("_mm", "_m", "_um"), ("_mrad", "_rad")
_OPTIONAL = ("time_s", "repeat", "temperature_degC", "weight", "note")


class Noise(Document):
    """One standard deviation of one coordinate of one reading; and how exactly the arm comes back to a posture.

    `posture_sigma_mm` is one standard deviation of a coordinate of the motion that all points share because the arm does not
    come back exactly, drawn anew `per_experiment` (the arm stands still between load steps) or `per_step`.
    """

    position_sigma_mm: float = Field(gt=0.0)
    orientation_sigma_mrad: float | None = Field(default=None, gt=0.0)
    posture_sigma_mm: float | None = Field(default=None, gt=0.0)
    posture_noise: Literal["per_experiment", "per_step"] = "per_experiment"


class HoldOut(Document):
    """Which experiments take no part in the fit."""

    fraction: float | None = Field(default=None, gt=0.0, lt=1.0)
    seed: int = Field(default=0, ge=0)
    experiments: tuple[str, ...] | None = None

    @model_validator(mode="after")
    def _one_way(self) -> HoldOut:
        if (self.fraction is None) == (self.experiments is None):
            raise ValueError("give either fraction (between 0 and 1, with seed) or experiments (a list of names)")
        return self


class CampaignFile(Document):
    """The content of `campaign.yaml` (FORMATS: campaign.yaml)."""

    cell: str
    measurements: str
    noise: Noise
    hold_out: HoldOut | None = None
    quantity: Literal["displacement", "position"] = "displacement"
    tracker_frame: Literal["world", "unknown"] = "world"
    reference_points: Literal["known", "unknown"] = "known"
    estimate: tuple[Literal["joint_zero_offsets", "link_geometry"], ...] = ()


def read_campaign_file(path: Path | str) -> CampaignFile:
    """Read and validate a `campaign.yaml`; InputError names file, key, value and remedy."""
    return read_yaml(Path(path), CampaignFile, "a campaign description (campaign.yaml)")


@dataclass(frozen=True, eq=False)
class Measurements:
    """A measurements table (or a plan: then without readings) in SI.

    Attributes
    ----------
    table : Table
        The file it came from, for writing rows back and for line numbers.
    cases : Cases
        Every step of every experiment once, ordered by experiment (as they appear) and step.
    experiments : tuple of names
        `cases.experiment` numbers them.
    case, row : (M,)
        Which case reading m belongs to, and which row of the table it is; rows of weight 0 are left out.
    point : (M,) names of reference points
    position : (M, 3) or None
        Position, or displacement if `relative`; None in a plan.
    relative : bool
    orientation : (M, 3)
        Rotation vector of the flange's displacement; NaN where not read.
    """

    table: Table
    cases: Cases
    experiments: tuple[str, ...]
    case: NDArray[np.int_]
    row: NDArray[np.int_]
    point: NDArray[np.str_]
    position: Array | None
    relative: bool
    orientation: Array

    @property
    def unloaded(self) -> NDArray[np.bool_]:
        """(N,) which cases carry weight alone."""
        return np.abs(self.cases.wrench).max(axis=0) == 0.0

    def line(self, reading: int) -> int:
        """Line of a reading in its file."""
        return self.table.lines[self.row[reading]]


def read_measurements(
    path: Path | str, arm: Arm, points: tuple[str, ...], load_point: Array, *, readings: bool
) -> Measurements:
    """Read a measurements table or a plan.

    Parameters
    ----------
    points : names of the cell's reference points
    readings : bool
        Whether the table must hold readings. A plan without a `point` column reads every point.

    Raises
    ------
    InputError
        On a missing, unknown or doubled column, a cell that is no number, an unknown point, a doubled row, a step whose
        rows disagree about posture or load.
    """
    table = read_table(path, "a table of readings (measurements.csv)" if readings else "a table of postures and loads")
    joint_units = [("_mm", "_m") if prismatic else ("_deg", "_rad") for prismatic in arm.prismatic]
    _refuse_unknown_columns(table, arm, joint_units)
    for name in ("experiment", "step", *(("point",) if readings else ())):
        if name not in table.header:
            raise InputError(f"{table.path}: missing column '{name}'. Columns found: {', '.join(table.header)}.")
    q = np.stack([_joint_column(table, n, u) for n, u in zip(arm.joint_names, joint_units, strict=True)])
    wrench = np.zeros((6, len(table.rows)))
    for c, axis in enumerate("xyz"):
        for place, stem, units in ((c, f"f{axis}", ("_N", "_kN")), (c + 3, f"m{axis}", ("_Nm", "_kNm"))):
            column = table.quantity(stem, units, required=False, empty=0.0)
            if column is not None:
                wrench[place] = column
    position, relative = _read_positions(table) if readings else (None, False)
    orientation = _read_orientations(table)
    experiment, step = table.text("experiment"), table.whole_numbers("step")
    for place, name in enumerate(experiment):
        if not name:
            raise InputError(
                f"{table.where(place, 'experiment')}: found an empty cell; expected the experiment's name."
            )
    weight = table.numbers("weight", empty=1.0)
    for bad in np.flatnonzero((weight != 0) & (weight != 1)).tolist():
        raise InputError(f"{table.where(bad, 'weight')}: found {weight[bad]:g}; expected 1, or 0 to exclude the row.")
    _check_points_and_duplicates(table, experiment, step, points)
    kept = np.flatnonzero(weight == 1)
    if not kept.size:
        raise InputError(f"{table.path}: every row has weight 0; nothing is left.")
    names = list(dict.fromkeys(experiment[r] for r in kept))
    number = {name: i for i, name in enumerate(names)}
    keys = np.array([(number[experiment[r]], step[r]) for r in kept])
    unique, first, case = np.unique(keys, axis=0, return_index=True, return_inverse=True)
    case = case.reshape(-1)
    _check_cases_agree(table, arm, kept, kept[first][case], q, wrench, experiment)
    time_s = table.numbers("time_s", empty=np.nan)
    lead = kept[first]
    cases = Cases(q[:, lead], wrench[:, lead], load_point, unique[:, 0], unique[:, 1], time_s[lead])
    _check_one_posture(table, arm, cases, names)
    _warn_of_limits(table, arm, cases, lead)
    row = kept
    if "point" in table.header:
        point = np.array(table.text("point"))[kept]
    else:
        point, row, case = np.tile(points, kept.size), np.repeat(kept, len(points)), np.repeat(case, len(points))
    return Measurements(
        table=table,
        cases=cases,
        experiments=tuple(names),
        case=case,
        row=row,
        point=point,
        position=None if position is None else position[row],
        relative=relative,
        orientation=orientation[row],
    )


def _refuse_unknown_columns(table: Table, arm: Arm, joint_units: list[tuple[str, str]]) -> None:
    known = {"experiment", "step", "point", *_OPTIONAL}
    for name, units in zip(arm.joint_names, joint_units, strict=True):
        known |= {name + unit for unit in units}
    known |= {f"f{a}{u}" for a in "xyz" for u in ("_N", "_kN")} | {f"m{a}{u}" for a in "xyz" for u in ("_Nm", "_kNm")}
    known |= {f"{d}{a}{u}" for d in ("", "d") for a in "xyz" for u in _LENGTHS}
    known |= {f"r{a}{u}" for a in "xyz" for u in _ANGLES}
    table.refuse_unknown(known, allowed_prefix="predicted_")


def _joint_column(table: Table, joint: str, units: tuple[str, str]) -> Array:
    column = table.quantity(joint, units, required=True)
    assert column is not None
    return column


def _read_positions(table: Table) -> tuple[Array, bool]:
    absolute = [table.quantity(a, _LENGTHS, required=False) for a in "xyz"]
    relative = [table.quantity(f"d{a}", _LENGTHS, required=False) for a in "xyz"]
    some = [any(c is not None for c in columns) for columns in (absolute, relative)]
    if all(some):
        raise InputError(
            f"{table.path}: both positions (x, y, z) and displacements (dx, dy, dz) are given; keep one kind."
        )
    if not any(some):
        raise InputError(
            f"{table.path}: missing column 'x_mm' (with y_mm, z_mm) or 'dx_mm' (with dy_mm, dz_mm): no readings. Columns found: "
            f"{', '.join(table.header)}."
        )
    stem, columns = ("", absolute) if some[0] else ("d", relative)
    for axis, column in zip("xyz", columns, strict=True):
        if column is None:
            raise InputError(f"{table.path}: missing column '{stem}{axis}_mm'; x, y and z are read together.")
    return np.stack([c for c in columns if c is not None], axis=1), some[1]


def _read_orientations(table: Table) -> Array:
    columns = [table.quantity(f"r{a}", _ANGLES, required=False, empty=np.nan) for a in "xyz"]
    given = [c for c in columns if c is not None]
    if not given:
        return np.full((len(table.rows), 3), np.nan)
    if len(given) < 3:
        raise InputError(f"{table.path}: orientation needs all of rx_mrad, ry_mrad and rz_mrad.")
    stacked = np.stack(given, axis=1)
    for row in np.flatnonzero(np.isnan(stacked).any(axis=1) & ~np.isnan(stacked).all(axis=1)):
        raise InputError(
            f"{table.path}, line {table.lines[row]}: orientation needs all of rx, ry and rz, or none of them."
        )
    return stacked


def _check_points_and_duplicates(
    table: Table, experiment: list[str], step: NDArray[np.int_], points: tuple[str, ...]
) -> None:
    names, repeat = table.text("point"), table.text("repeat")
    if "point" in table.header:
        for row, name in enumerate(names):
            if name not in points:
                raise InputError(
                    f"{table.where(row, 'point')}: found '{name}'; the cell's reference_points_m has {', '.join(points)}."
                )
    seen: dict[tuple[str, int, str, str], int] = {}
    for row, key in enumerate(zip(experiment, step.tolist(), names, repeat, strict=True)):
        other = seen.setdefault(key, row)
        if other != row:
            raise InputError(
                f"{table.path}, line {table.lines[row]}: a second row for experiment '{key[0]}', step {key[1]}, point "
                f"'{key[2]}' (the first is line {table.lines[other]}). Number true repeats in a column 'repeat', or delete one."
            )


def _check_cases_agree(
    table: Table,
    arm: Arm,
    rows: NDArray[np.int_],
    leads: NDArray[np.int_],
    q: Array,
    wrench: Array,
    experiment: list[str],
) -> None:
    differs = (np.abs(q[:, rows] - q[:, leads]) > 1e-9).any(axis=0)
    differs |= (np.abs(wrench[:, rows] - wrench[:, leads]) > 1e-9).any(axis=0)
    for place in np.flatnonzero(differs):
        row, lead = int(rows[place]), int(leads[place])
        raise InputError(
            f"{table.path}, line {table.lines[row]}: other joints or loads than line {table.lines[lead]}, though both are the same "
            f"step of experiment '{experiment[row]}'. Give it a step of its own, or mend the row."
        )


def _check_one_posture(table: Table, arm: Arm, cases: Cases, names: list[str]) -> None:
    _, first = np.unique(cases.experiment, return_index=True)
    off = np.abs(cases.q - cases.q[:, first][:, cases.experiment]) > 1e-6
    for joint, case in zip(*np.nonzero(off), strict=True):
        raise InputError(
            f"{table.path}: experiment '{names[cases.experiment[case]]}': joint '{arm.joint_names[joint]}' differs between step "
            f"{cases.step[first[cases.experiment[case]]]} and step {cases.step[case]}; an experiment is one arm configuration. "
            "Name the second posture as an experiment of its own."
        )


def _warn_of_limits(table: Table, arm: Arm, cases: Cases, lead: NDArray[np.int_]) -> None:
    outside = (cases.q < arm.lower[:, None] - 1e-9) | (cases.q > arm.upper[:, None] + 1e-9)
    for joint in np.flatnonzero(outside.any(axis=1)):
        scale, unit = (1e3, "mm") if arm.prismatic[joint] else (180 / np.pi, "deg")
        cases_out = np.flatnonzero(outside[joint])
        case = cases_out[0]
        log.warning(
            "%s, line %d: joint '%s' stands at %.6g %s, outside its limits %.6g .. %.6g%s.",
            table.path, table.lines[lead[case]], arm.joint_names[joint],
            cases.q[joint, case] * scale, unit, arm.lower[joint] * scale, arm.upper[joint] * scale,
            f"; so it does in {cases_out.size - 1} further steps" if cases_out.size > 1 else "",
        )  # fmt: skip


@contextmanager
def naming_the_step(m: Measurements) -> Iterator[None]:
    """Say experiment and step where an equilibrium is missing, instead of the number of a case."""
    try:
        yield
    except NoEquilibriumError as error:
        if error.case >= m.cases.number:
            raise
        name, step = m.experiments[m.cases.experiment[error.case]], m.cases.step[error.case]
        raise UntrustworthyError(f"{m.table.path}: experiment '{name}', step {step}: {error.what}") from None
