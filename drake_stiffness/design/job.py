"""The whole job of `design`: cell and wishes in, plan and its worth out."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from drake_stiffness.arm import Arm
from drake_stiffness.cell import Cell, read_cell
from drake_stiffness.design.assumptions import assumed_model
from drake_stiffness.design.augmentation import Suggestion, measured_information, settings_like, what_more
from drake_stiffness.design.design import Designed, choose, choose_fewest
from drake_stiffness.design.plan_table import experiment_names, plan_text
from drake_stiffness.design.settings import Design, payload_force, read_design
from drake_stiffness.design.space import (
    Measured,
    Progress,
    Space,
    make_criterion,
    path_gradients,
    prepare,
    unsupported_share,
)
from drake_stiffness.design.summary import summary
from drake_stiffness.design.suspicion import suspected_effect, taken_for_granted
from drake_stiffness.errors import InputError, UntrustworthyError
from drake_stiffness.model import Model
from drake_stiffness.rotations import Array
from drake_stiffness.support import REFUSE_ABOVE, WARN_ABOVE

# What gives postures (n, T) and wrenches (6, T) along a program for a model.
PathOf = Callable[[Model], tuple[Array, Array]]


@dataclass(frozen=True, eq=False)
class PlannedMeasurements:
    """Attributes
    ----------
    designed : Designed
    names : tuple of experiment names
    text : str
        PLAN.csv.
    suggestions : list of Suggestion
        With a campaign: what more postures would settle.
    notes : list of str
        What was taken for granted.
    cell_path : Path
    """

    designed: Designed
    names: tuple[str, ...]
    text: str
    suggestions: list[Suggestion]
    notes: list[str]
    cell_path: Path

    def to_dict(self) -> dict[str, Any]:
        """For `--json`."""
        space = self.designed.space
        suspect = space.model.effects[-1] if space.suspected else None
        return {
            **summary(self.designed),
            "suspect": suspect and {"kind": suspect.kind, "where": suspect.where, "settings": suspect.settings()},
            "experiments": list(self.names),
            "suggestions": [suggestion.to_dict() for suggestion in self.suggestions],
            "notes": self.notes,
        }


def plan_measurements(
    cell_path: Path | str,
    n: int,
    criterion: str = "d",
    settings_path: Path | str | None = None,
    *,
    suspect: str | None = None,
    campaign: Path | str | None = None,
    path: PathOf | None = None,
    progress: Progress = lambda text: None,
) -> PlannedMeasurements:
    """A plan of n postures for a cell (command `design`).

    Raises
    ------
    InputError
        If settings, options and cell do not fit each other, or n postures cannot determine what can be determined.
    UntrustworthyError
        If the displacement along a program rests on what no candidate shows.
    """
    from drake_stiffness.plant import build_arm

    cell_path = Path(cell_path)
    cell, settings = read_cell(cell_path), read_design(settings_path)
    progress("reading the robot")
    arm = build_arm(cell)
    suggestions: list[Suggestion] = []
    measured: Measured | None = None
    if campaign is not None:
        model, measured, settings, suggestions = _continued(Path(campaign), cell, settings, progress)
    else:
        model = assumed_model(cell, arm, settings)
    effect = None if suspect is None else suspected_effect(suspect, model, cell)
    space = prepare(model, n, settings, suspect=effect, measured=measured, progress=progress)
    notes = _notes(space, arm)
    if suspect is not None and effect is not None and (note := taken_for_granted(suspect, effect, model)):
        notes.append(note)
    rows = None
    if path is not None:
        progress("postures along the program")
        rows = path_gradients(space.base_model, *path(space.base_model))
        notes += _path_notes(space, rows)
    if criterion == "ratio":
        designed = choose_fewest(space, n, progress)
    else:
        designed = choose(space, make_criterion(space, criterion, rows), n, progress)
    names = experiment_names(len(designed.chosen), () if measured is None else measured.experiments)
    text = plan_text(arm, designed.plan, names)
    return PlannedMeasurements(designed, names, text, suggestions, notes, cell_path)


def _continued(
    path: Path, cell: Cell, settings: Design, progress: Progress
) -> tuple[Model, Measured, Design, list[Suggestion]]:
    """The identified model of a campaign, its information, settings (its noise and loads unless stated), what more would settle."""
    from drake_stiffness.jobs import identify_task
    from drake_stiffness.task import read_task

    task = read_task(path, progress)
    if task.cell.model_dump() != cell.model_dump():
        raise InputError(
            f"--augment {path}: its cell is {task.cell_path}, which differs from {cell.path}; a campaign can only go on with the robot, tool "
            "and points it began with. Give that cell."
        )
    found = identify_task(task, "sdp", progress)
    m, sigma = found.measurements, task.campaign.noise.position_sigma_mm
    like = settings_like(m, sigma)
    taken = {key: getattr(like, key) for key in ("noise", "loads") if key not in settings.model_fields_set}
    settings = settings.model_copy(update=taken)
    progress("what more postures would settle")
    suggestions = what_more(found.model, found.groups, m, sigma)
    measured = measured_information(found.groups, m.experiments)
    return replace(found.model, statistics=None), measured, settings, suggestions


def _notes(space: Space, arm: Arm) -> list[str]:
    """What the plan takes for granted and a reader must know."""
    settings, loads = space.settings, space.settings.loads
    notes = []
    if loads.down_N is None or loads.horizontal_N is None:
        notes.append(
            f"loads of {payload_force(arm):g} N are a quarter of the weight of the moving links (nothing is known of the payload); state "
            "down_N and horizontal_N under loads in DESIGN.yaml"
        )
    if space.view.rank > space.view.fitted:
        notes.append(
            f"{space.view.rank - space.view.fitted} combinations are hidden by the noise whatever is measured with these loads; the plan "
            "does not aim at them"
        )
    if settings.floor_m is None and not settings.keep_out_boxes:
        notes.append("no keep-out boxes are stated: look at every posture before the robot drives to it")
    return notes


def _path_notes(space: Space, rows: Array) -> list[str]:
    share = unsupported_share(space, rows)
    if share > REFUSE_ABOVE:
        raise UntrustworthyError(
            f"{100 * share:.0f} % of the displacement along the program rests on compliances that no candidate posture shows under these "
            "loads. Load the arm the way the program does: other directions, or moments (loads.vectors in DESIGN.yaml)."
        )
    if share > WARN_ABOVE:
        return [f"up to {100 * share:.0f} % of the displacement along the program is not seen by any candidate"]
    return []
