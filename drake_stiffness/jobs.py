"""The jobs behind the commands, as functions of files: what `cli` calls and what scripts may call."""

from __future__ import annotations

from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

import drake_stiffness
from drake_stiffness.campaign import CampaignFile, Measurements, naming_the_step, read_campaign_file, read_measurements
from drake_stiffness.cell import read_cell
from drake_stiffness.errors import InputError
from drake_stiffness.files import sha256
from drake_stiffness.model import Model
from drake_stiffness.task import Progress, Task, quiet, read_task
from drake_stiffness.thresholds import LOWER_RATIO, UPPER_RATIO

if TYPE_CHECKING:
    from drake_stiffness.groups import Groups
    from drake_stiffness.inspection import Inspection


@dataclass(frozen=True, eq=False)
class Identified:
    """What `identify` hands back.

    Attributes
    ----------
    model : Model
    warnings : list of str
        What the user must be told.
    campaign : CampaignFile
    measurements : Measurements
        All of them.
    held : (experiments,) bool
        Which took no part.
    residual_mm : (3, M) residuals of the fitted readings, mm (references taken off)
    groups : Groups
        Base parameters, relations, eigen-directions.
    """

    model: Model
    warnings: list[str]
    campaign: CampaignFile
    measurements: Measurements
    held: np.ndarray
    residual_mm: np.ndarray
    groups: Groups


def provenance(files: dict[str, Path], seed: int | None) -> dict[str, Any]:
    """Program version, SHA-256 of the input files, seed; `time` is the only field that differs between runs."""
    return {
        "program": f"drake-stiffness {drake_stiffness.__version__}",
        "inputs": {name: {"file": path.name, "sha256": sha256(path)} for name, path in files.items()},
        "seed": seed,
        "time": datetime.now(UTC).isoformat(timespec="seconds"),
    }


def files_of_campaign(path: Path) -> tuple[Path, ...]:
    """The campaign file and, as far as they can be told, the files it names: none of them may be overwritten."""
    try:
        campaign = read_campaign_file(path)
        cell = path.parent / campaign.cell
        return path, cell, path.parent / campaign.measurements, read_cell(cell).robot_path
    except InputError:
        return (path,)  # what is wrong with it is said when it is used


def identify_campaign(
    path: Path | str,
    method: str = "sdp",
    progress: Progress = quiet,
    *,
    upper: float = UPPER_RATIO,
    lower: float = LOWER_RATIO,
) -> Identified:
    """Identify the model of a campaign (command `identify`).

    Parameters
    ----------
    upper, lower : float
        Thresholds of the ratio (20) between the groups G1+, G1~ and G1-.

    Raises
    ------
    InputError, UntrustworthyError
        See `drake_stiffness.errors`.
    """
    return identify_task(read_task(path, progress), method, progress, upper=upper, lower=lower)


def identify_task(
    task: Task,
    method: str = "sdp",
    progress: Progress = quiet,
    *,
    upper: float = UPPER_RATIO,
    lower: float = LOWER_RATIO,
) -> Identified:
    """The same for a campaign that was read already."""
    from drake_stiffness import statistics as st
    from drake_stiffness import trust
    from drake_stiffness.campaign_limits import limits_of
    from drake_stiffness.groups import find_groups
    from drake_stiffness.identification import identify
    from drake_stiffness.model_form import model_form
    from drake_stiffness.noise_components import seen_noise
    from drake_stiffness.observation import residual_m
    from drake_stiffness.semidefinite import smallest_eigenvalue
    from drake_stiffness.start import hint_of_frame, starting_model

    fitted, held, campaign = task.taking_part(), task.held, task.campaign
    o = task.observations()
    model = starting_model(task.model, fitted)
    hint_of_frame(model, fitted)
    with naming_the_step(fitted):
        solution = identify(model, o, method, progress)  # type: ignore[arg-type]
    fit = st.goodness(solution, o)
    numbers, how = st.statistics(solution, o, fit, upper=upper, lower=lower)
    groups = find_groups(solution, numbers, upper=upper, lower=lower)
    errors = st.held_out_errors(solution.model, task.held_out(), task.displacement) if held.any() else np.zeros((3, 0))
    entry = st.fit_entry(solution, fit, st.rms_mm(errors), method, smallest_eigenvalue(solution.model), how)
    entry["experiments"] = {"fitted": int((~held).sum()), "held_out": int(held.sum())}
    entry["quantity"] = campaign.quantity
    entry["noise_components"] = seen_noise(task.measurements, task.arm, task.cell.reference_points_m, campaign.noise)
    if o.whitening is not None:  # whitened rows mix the readings of a step
        entry["residual_rms_mm"] = st.rms_mm(residual_m(o, solution.model))
    others = task.observations(held) if held.any() else None
    beside = trust.held_out(solution, others) if others is not None else None
    entry["model_form"] = model_form(solution, numbers, others or o, beside)
    doubts = [verdict.line() for verdict in trust.verdicts(solution, groups, fit, beside)]
    lines = [
        *doubts,
        *st.warnings_of(solution, numbers, fit, o, how),
        *groups.warnings(),
        *limits_of(o, solution.model),
    ]
    entry["warnings"] = lines
    seed = campaign.hold_out.seed if campaign.hold_out is not None else None
    final = st.attach(solution, numbers, entry, provenance(task.files, seed))
    readings = fitted.case.size
    residual_mm = solution.residual[: 3 * readings].reshape(readings, 3).T * o.sigma_p * 1e3
    if o.whitening is not None:
        residual_mm = residual_m(o, solution.model) * 1e3
    return Identified(final, lines, campaign, task.measurements, held, residual_mm, groups)


def inspect(path: Path | str, identifiability: bool = False) -> Inspection:
    """Describe a cell (command `inspect`)."""
    from drake_stiffness.inspection import inspect_cell
    from drake_stiffness.plant import build_arm

    cell = read_cell(path)
    return inspect_cell(cell, build_arm(cell), identifiability=identifiability)


@dataclass(frozen=True, eq=False)
class Simulated:
    """A virtual campaign: the files of the folder by name, and the displacement it shows.

    Attributes
    ----------
    files : dict of file name to text
    displacement_rms_mm, displacement_max_mm : float
        Of loaded readings against unloaded ones at the same joints.
    """

    files: dict[str, str]
    displacement_rms_mm: float
    displacement_max_mm: float


def simulate(
    cell_path: Path | str, truth: Path | str, plan: Path | str, folder: Path, sigma_mm: float, seed: int
) -> Simulated:
    """A virtual campaign from the loaded equilibrium (command `simulate`).

    Parameters
    ----------
    folder : Path
        Where the files will stand (paths in campaign.yaml are relative to it).
    sigma_mm : float
        Noise added to every coordinate; 0 for none.
    """
    from drake_stiffness.plant import build_arm
    from drake_stiffness.simulation import simulate_displacement
    from drake_stiffness.truth import read_truth
    from drake_stiffness.virtual import campaign_files

    cell = read_cell(cell_path)
    arm = build_arm(cell)
    model = read_truth(truth, cell, arm)
    m = read_measurements(plan, arm, tuple(cell.reference_points_m), model.load_point, readings=False)
    with naming_the_step(m):
        change = simulate_displacement(model, m.cases, m.case, m.point)
    loaded = ~m.unloaded[m.case]
    size = np.linalg.norm(change.dp, axis=0)[loaded] * 1e3
    files = campaign_files(m, change.loaded.p, Path(cell_path), folder, sigma_mm, seed)
    rms = float(np.sqrt((size**2).mean())) if size.size else 0.0
    return Simulated(files, rms, float(size.max(initial=0.0)))


@dataclass(frozen=True, eq=False)
class Predicted:
    """Predictions for the rows of a table.

    Attributes
    ----------
    text : str
        The table with predicted columns added.
    rows : int
    unsupported : (M,)
        Share of every prediction that rests on what the campaign did not see.
    rms_mm : float
        Root mean square of predicted displacements.
    error_rms_mm : float
        Root mean square of measured minus predicted where the table holds readings; NaN otherwise.
    """

    text: str
    rows: int
    unsupported: np.ndarray
    rms_mm: float
    error_rms_mm: float


def predict(model: Model, path: Path | str) -> Predicted:
    """Predict the readings of a table (command `predict`); needs neither Drake nor cvxpy."""
    from drake_stiffness.simulation import simulate_displacement
    from drake_stiffness.statistics import held_out_errors, rms_mm
    from drake_stiffness.support import displacement_support, position_support
    from drake_stiffness.virtual import with_columns

    points = tuple(model.points)
    m = read_measurements(path, model.arm, points, model.load_point, readings=False)
    with naming_the_step(m):
        change = simulate_displacement(model, m.cases, m.case, m.point)
    absolute = model.fit.get("quantity") == "position"
    support = (position_support if absolute else displacement_support)(model, m.cases, m.case, m.point)
    added = {}
    for c, axis in enumerate("xyz"):
        added[f"predicted_d{axis}_mm"] = change.dp[c] * 1e3
        added[f"predicted_{axis}_mm"] = change.loaded.p[c] * 1e3
        added[f"predicted_sigma_{axis}_mm"] = support.sigma[:, c] * 1e3
        known = change.loaded.p[c] if absolute else change.dp[c]
        added[f"predicted_low_{axis}_mm"] = (known + support.low[:, c]) * 1e3
        added[f"predicted_high_{axis}_mm"] = (known + support.high[:, c]) * 1e3
    added["predicted_unsupported_share"] = support.unsupported
    error = float("nan")
    if any(name.removeprefix("d").rsplit("_", 1)[0] in ("x", "y", "z") for name in m.table.header):
        read = read_measurements(path, model.arm, points, model.load_point, readings=True)
        if not (absolute and read.relative):  # displacements say nothing of positions
            error = rms_mm(held_out_errors(model, read, not absolute))
    return Predicted(with_columns(m, added), m.case.size, support.unsupported, rms_mm(change.dp), error)
