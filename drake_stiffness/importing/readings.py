"""Readings that a tracker exported become a measurements.csv (command `import`)."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from drake_stiffness.arm import Arm, forward
from drake_stiffness.campaign import Measurements, read_measurements
from drake_stiffness.cell import Cell, read_cell
from drake_stiffness.errors import InputError
from drake_stiffness.importing.foreign_tables import Start, read_foreign, read_start, read_times
from drake_stiffness.importing.logs import Readout, joints_of_steps, loads_of_steps, rows_of_steps
from drake_stiffness.importing.map_file import ImportMap, TextFile, read_import_map
from drake_stiffness.importing.matching import Steps, lines_of, steps_of_columns, steps_of_plan
from drake_stiffness.importing.samples import Averaged, average, join_samples, read_samples
from drake_stiffness.importing.table import missing_readings, repeat_sigma, table_text
from drake_stiffness.rotations import Array
from drake_stiffness.tables import Table

# Measured against what the joints say: beyond these the unit or the frame is wrong.
_UNIT_BAND, _FRAME_OFF_M = 1.5, 0.05
# A joint this far from the plan is another posture, rad or m.
_OFF_PLAN = 0.02
# Displacements of a loaded arm, m: outside, the unit is wrong.
_DISPLACEMENTS_M = (1e-6, 0.1)


@dataclass(frozen=True, eq=False)
class Imported:
    """A measurements.csv and what has to be said of it.

    Attributes
    ----------
    text : str
    rows, experiments, steps : int
    points : tuple of names
    sample_sigma_mm : float
        Standard deviation of one coordinate of one sample about the mean of its step; NaN without several samples.
    repeat_sigma_mm : float
        The same of readings that repeat a load inside an experiment; NaN where none does.
    dropped, unmatched, missing : lists of str
        Rows left out by `drop`, rows that belong nowhere, steps of the plan without a reading.
    warnings : list of str
    """

    text: str
    rows: int
    experiments: int
    steps: int
    points: tuple[str, ...]
    sample_sigma_mm: float
    repeat_sigma_mm: float
    dropped: list[str]
    unmatched: list[str]
    missing: list[str]
    warnings: list[str]

    def to_dict(self) -> dict[str, Any]:
        """The summary for programs."""
        return {name: getattr(self, name) for name in self.__dataclass_fields__ if name != "text"}


def files_of_map(path: Path | str) -> tuple[Path, ...]:
    """The map and the files it names: none of them may be overwritten."""
    path = Path(path)
    try:
        content = read_import_map(path)
    except InputError:
        return (path,)  # what is wrong with it is said when it is used
    names = [content.cell, content.plan, *(entry.file for entry in content.readings)]
    names += [log.file for log in (content.forces, content.joints) if log is not None]
    return path, *(content.folder / name for name in names if name is not None)


def import_readings(path: Path | str) -> Imported:
    """Read a MAP.yaml and the files it names.

    Raises
    ------
    InputError
        On anything missing, ambiguous or not understood; see `import_map`.
    """
    from drake_stiffness.plant import build_arm

    content = read_import_map(path)
    cell = read_cell(content.folder / content.cell)
    arm = build_arm(cell)
    points = tuple(cell.reference_points_m)
    plan = None
    if content.plan is not None:
        load_point = np.array(cell.load_point_m)
        plan = read_measurements(content.folder / content.plan, arm, points, load_point, readings=False)
    files = _Files(content)
    tables = [files.read(spec) for spec in content.readings]
    pairs = [(table, spec.match) for (table, _), spec in zip(tables, content.readings, strict=True)]
    steps = steps_of_columns(pairs) if plan is None else steps_of_plan(plan)
    parts, lost = [], []
    for (table, times), spec in zip(tables, content.readings, strict=True):
        samples, strays = read_samples(table, spec, steps, times, points)
        parts.append(samples)
        lost += strays
    if lost and content.unmatched == "refuse":
        raise InputError(
            "rows that belong nowhere:\n"
            + "\n".join(f"  {entry}" for entry in lost)
            + "\nMend the map or the files, or write "
            "unmatched: list in the map; then they are left out and listed."
        )
    samples = join_samples(parts)
    if not samples.case.size:
        raise InputError(f"{content.path}: no reading is left; check match and point names.")
    readings = average(samples, content.samples, steps, points)
    readout = Readout(samples.case, samples.time_s, content.readings[0].file)
    warnings: list[str] = []
    q = _joints(content, files, steps, readout, arm, plan, warnings)
    wrench = _loads(content, files, steps, readout, q, arm, cell, plan, warnings)
    relative = content.readings[0].quantity == "displacement"
    warnings += _implausible(readings, q, arm, cell, relative)
    text = table_text(readings, steps, q, wrench, arm, plan, content, relative)
    used = np.unique(readings.case)
    return Imported(
        text=text,
        rows=readings.case.size,
        experiments=len({steps.experiment[c] for c in used}),
        steps=used.size,
        points=tuple(name for name in points if (readings.point == name).any()),
        sample_sigma_mm=readings.sigma_m * 1e3,
        repeat_sigma_mm=repeat_sigma(readings, steps, wrench) * 1e3,
        dropped=files.dropped,
        unmatched=[str(entry) for entry in lost],
        missing=missing_readings(readings, steps, points),
        warnings=warnings + ([f"the sample farthest from its mean: {readings.worst}"] if readings.worst else []),
    )


class _Files:
    """Reads the files of a map; keeps what they were told to drop, and the time that counts as zero."""

    def __init__(self, content: ImportMap) -> None:
        self.folder = content.folder
        self.dropped: list[str] = []
        self.start: Start | None = None if content.start is None else read_start(content.start, str(content.path))

    def read(self, spec: TextFile) -> tuple[Table, Array]:
        """A table and the time of its rows (NaN without a time column)."""
        table, out = read_foreign(self.folder, spec)
        if out:
            self.dropped.append(f"{spec.file}, line{'s' if len(out) > 1 else ''} {lines_of(out)}")
        if spec.time is None:
            return table, np.full(len(table.rows), np.nan)
        times, self.start = read_times(table, spec.time, self.start)
        return table, times


def _joints(
    content: ImportMap,
    files: _Files,
    steps: Steps,
    readout: Readout,
    arm: Arm,
    plan: Measurements | None,
    warnings: list[str],
) -> Array:
    if content.joints is None:
        assert plan is not None
        return plan.cases.q
    table, times = files.read(content.joints)
    rows = rows_of_steps(table, content.joints.match, steps, times, readout, "robot position")
    q = joints_of_steps(table, content.joints, rows, steps, arm)
    if plan is not None:
        apart = np.abs(q - plan.cases.q)[:, readout.used]
        joint, place = np.unravel_index(apart.argmax(), apart.shape)
        if apart[joint, place] > _OFF_PLAN:
            warnings.append(
                f"the robot log is up to {apart[joint, place]:.3g} rad (or m) off the plan, at "
                f"'{arm.joint_names[joint]}' of {steps.name(int(readout.used[place]))}; the log counts. Are its "
                "signs and zeros the model's?"
            )
    return q


def _loads(
    content: ImportMap,
    files: _Files,
    steps: Steps,
    readout: Readout,
    q: Array,
    arm: Arm,
    cell: Cell,
    plan: Measurements | None,
    warnings: list[str],
) -> Array:
    if content.forces is None:
        assert plan is not None
        return plan.cases.wrench
    table, times = files.read(content.forces)
    rows = rows_of_steps(table, content.forces.match, steps, times, readout, "force")
    loads = loads_of_steps(
        table, content.forces, rows, steps, q, arm, cell, None if plan is None else plan.cases.wrench
    )
    warnings += loads.notes
    return loads.wrench


def _implausible(readings: Averaged, q: Array, arm: Arm, cell: Cell, relative: bool) -> list[str]:
    """What the readings' size says of their unit: they are set against where the commanded joints put the points."""
    if relative:
        size = float(np.sqrt((readings.p**2).sum(axis=1).mean()))
        low, high = _DISPLACEMENTS_M
        if size and not low < size < high:
            return [f"the displacements are {size * 1e3:.3g} mm rms; is readings.unit right?"]
        return []
    poses = forward(arm, q[:, readings.case])
    places = np.array([cell.reference_points_m[str(name)] for name in readings.point])
    expected = poses.p_E.T + np.einsum("ijm,mj->mi", poses.R_E, places)
    spread = [float(np.sqrt(((p - p.mean(axis=0)) ** 2).sum(axis=1).mean())) for p in (readings.p, expected)]
    if spread[1] < 1e-3:  # one point at one posture has no extent to compare
        return []
    ratio = spread[0] / spread[1]
    if not 1 / _UNIT_BAND < ratio < _UNIT_BAND:
        return [
            f"the readings spread over {spread[0]:.4g} m, the commanded joints put the points over {spread[1]:.4g} "
            f"m: {ratio:.4g} times; is readings.unit right, and do the rows belong to the steps they were matched to?"
        ]
    off = np.linalg.norm(readings.p - expected, axis=1)
    if np.median(off) > _FRAME_OFF_M:
        return [
            f"the readings lie {np.median(off) * 1e3:.0f} mm (median) from where the commanded joints put the "
            "points: the tracker's frame is not the robot's base; write tracker_frame: unknown in campaign.yaml, or "
            "the point names are mixed up."
        ]
    return []
