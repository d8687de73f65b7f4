"""What a campaign asks, read once: its files, the arm, the measurements, who takes part, and the model to start from."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from drake_stiffness.arm import Arm
from drake_stiffness.assembly import campaign_effects, make_model, spring_effects
from drake_stiffness.campaign import CampaignFile, Measurements, read_campaign_file, read_measurements
from drake_stiffness.cell import Cell, read_cell
from drake_stiffness.effects import Effect
from drake_stiffness.errors import InputError
from drake_stiffness.hold_out import held_out_experiments
from drake_stiffness.model import Model
from drake_stiffness.observation import Observations, observe, restrict
from drake_stiffness.posture_noise import PostureNoise, posture_noise

Progress = Callable[[str], None]


def quiet(_: str) -> None:
    """Progress that nobody watches."""


@dataclass(frozen=True, eq=False)
class Task:
    """A campaign, validated.

    Attributes
    ----------
    path, cell_path, table_path : Path
    campaign : CampaignFile
    cell : Cell
    arm : Arm
    measurements : Measurements
        All of them.
    held : (experiments,) bool
        Which take no part in a fit.
    effects : tuple of Effect
        What is to be identified: the cell's springs, then what the campaign adds.
    """

    path: Path
    campaign: CampaignFile
    cell: Cell
    arm: Arm
    measurements: Measurements
    held: NDArray[np.bool_]
    effects: tuple[Effect, ...]

    @property
    def cell_path(self) -> Path:
        return self.path.parent / self.campaign.cell

    @property
    def table_path(self) -> Path:
        return self.path.parent / self.campaign.measurements

    @property
    def files(self) -> dict[str, Path]:
        """Every file that decides the result, by its part."""
        return {
            "campaign": self.path,
            "cell": self.cell_path,
            "robot": self.cell.robot_path,
            "measurements": self.table_path,
        }

    @property
    def displacement(self) -> bool:
        return self.campaign.quantity == "displacement"

    @property
    def model(self) -> Model:
        """The model with every effect at its own start."""
        return make_model(self.cell, self.arm, self.effects)

    @property
    def motion(self) -> PostureNoise | None:
        """How exactly the arm comes back, if the campaign states it."""
        noise = self.campaign.noise
        if noise.posture_sigma_mm is None:
            return None
        points = self.cell.reference_points_m
        return posture_noise(noise.posture_sigma_mm * 1e-3, noise.posture_noise, self.arm, points, self.measurements)

    def taking_part(self) -> Measurements:
        """The measurements that a fit may use."""
        return restrict(self.measurements, ~self.held)

    def held_out(self) -> Measurements:
        """The measurements that a fit must not see."""
        return restrict(self.measurements, self.held)

    def observations(self, experiments: NDArray[np.bool_] | None = None) -> Observations:
        """The readings of some experiments, arranged for a fit; by default of those that take part."""
        chosen = ~self.held if experiments is None else experiments
        return observe(restrict(self.measurements, chosen), self.displacement, self.campaign.noise, self.motion)


def read_task(path: Path | str, progress: Progress = quiet) -> Task:
    """Read a campaign with all that it names.

    Raises
    ------
    InputError
        If a file is wrong, experiments lack what a fit needs, or there is nothing to identify.
    """
    from drake_stiffness.plant import build_arm

    path = Path(path)
    campaign = read_campaign_file(path)
    cell = read_cell(path.parent / campaign.cell)
    progress("reading the robot")
    arm = build_arm(cell)
    points = tuple(cell.reference_points_m)
    progress("reading the measurements")
    table = path.parent / campaign.measurements
    m = read_measurements(table, arm, points, np.array(cell.load_point_m), readings=True)
    held = held_out_experiments(m, campaign.hold_out, str(path))
    # What is wrong with held-out experiments is said now, not after the fit.
    observe(m, campaign.quantity == "displacement", campaign.noise)
    effects = tuple(spring_effects(cell, arm) + campaign_effects(campaign, cell, arm))
    if not effects:
        raise InputError(
            f"{path}: nothing to identify: the cell has no springs and the campaign estimates nothing. Set springs in "
            f"{cell.path}, or tracker_frame, reference_points or estimate."
        )
    return Task(path, campaign, cell, arm, m, held, effects)
