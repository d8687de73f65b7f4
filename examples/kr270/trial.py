"""One trial of the main job against a true plant: identify from its campaign, correct the program, mill it on the plant.

The plant (examples/plants) and the oracle fitted to the same data know nothing of drake_stiffness; only this file sees both.
"""

from __future__ import annotations

import shutil
import sys
from dataclasses import dataclass
from pathlib import Path

import numpy as np

HERE = Path(__file__).parent
sys.path.insert(0, str(HERE.parent))
sys.path.insert(0, str(HERE))

import make_campaign  # noqa: E402
from plants import mirror, oracle, readings  # noqa: E402
from plants.krl_reader import read_program as read_poses  # noqa: E402
from plants.process import Process as TrueProcess  # noqa: E402
from plants.repeatability import joint_errors  # noqa: E402
from plants.replay import PathError, replay_files  # noqa: E402
from plants.segmented_arm import SegmentedArm  # noqa: E402

from drake_stiffness.jobs import Identified, identify_campaign  # noqa: E402
from toolpaths.formats import read_program  # noqa: E402
from toolpaths.job import compensate  # noqa: E402
from toolpaths.process import read_process  # noqa: E402
from toolpaths.result import Compensation  # noqa: E402

PROGRAM = "pocket.src"
FILES = ("kr270.urdf", "cell.yaml", "cell_joints_only.yaml", "campaign.yaml", "campaign_joints_only.yaml",
         "process.yaml", "process_joints_only.yaml", "true_arm.yaml", PROGRAM)  # fmt: skip


@dataclass(frozen=True)
class Scenario:
    """How the world differs from the embedded example.

    Attributes
    ----------
    name : str
    link_stiffness : float
        Factor on the stiffness of all links of the true arm.
    force : float
        The force that really acts over the one that was assumed.
    repeatability_mm : float
        Random posture errors of the robot, in the campaign and when milling.
    """

    name: str
    link_stiffness: float = 1.0
    force: float = 1.0
    repeatability_mm: float = 0.0


SCENARIOS = (
    Scenario("links 0.3 times as stiff", link_stiffness=0.3),
    Scenario("links 3 times as stiff", link_stiffness=3.0),
    Scenario("force 20 % higher than assumed", force=1.2),
    Scenario("force 20 % lower than assumed", force=0.8),
    Scenario("repeatability 0.06 mm", repeatability_mm=0.06),
)


@dataclass(frozen=True, eq=False)
class Trial:
    """Errors on the true plant of the program uncompensated and corrected with three models, and how they were got."""

    uncompensated: PathError
    joints_only: PathError
    full: PathError
    oracle: PathError
    identified: Identified
    compensation: Compensation


def true_arm(scenario: Scenario) -> SegmentedArm:
    """The plant of true_arm.yaml as the scenario has it."""
    return SegmentedArm.from_files(
        HERE / "kr270.urdf", HERE / "true_arm.yaml", link_stiffness_factor=scenario.link_stiffness
    )


def run_trial(scenario: Scenario, folder: Path, *, seed: int = make_campaign.SEED) -> Trial:
    """Do the whole job in `folder` and mill the results on the true plant.

    The nominal scenario with the default seed uses the committed campaign; all others make theirs.
    """
    folder.mkdir(parents=True, exist_ok=True)
    for name in FILES:
        shutil.copyfile(HERE / name, folder / name)
    arm = true_arm(scenario)
    if scenario.link_stiffness == 1.0 and scenario.repeatability_mm == 0.0 and seed == make_campaign.SEED:
        shutil.copyfile(HERE / "measurements.csv", folder / "measurements.csv")
    else:
        tools = make_campaign.instruments(repeatability_m=scenario.repeatability_mm * 1e-3)
        table = make_campaign.make_table(arm, tools, seed)
        (folder / "measurements.csv").write_text(table, encoding="utf-8", newline="")

    full, compensation = _correct(folder, "campaign.yaml", "process.yaml", "full.src")
    _correct(folder, "campaign_joints_only.yaml", "process_joints_only.yaml", "joints_only.src")
    _correct_by_oracle(folder, arm, full)

    return Trial(
        uncompensated=_mill(scenario, arm, folder, PROGRAM),
        joints_only=_mill(scenario, arm, folder, "joints_only.src"),
        full=_mill(scenario, arm, folder, "full.src"),
        oracle=_mill(scenario, arm, folder, "oracle.src"),
        identified=full,
        compensation=compensation,
    )


def _correct(folder: Path, campaign: str, process: str, output: str) -> tuple[Identified, Compensation]:
    identified = identify_campaign(folder / campaign)
    result = compensate(read_program(folder / PROGRAM), identified.model, read_process(folder / process))
    (folder / output).write_bytes(result.raw)
    return identified, result


def _correct_by_oracle(folder: Path, arm: SegmentedArm, identified: Identified) -> None:
    """The true structure fitted to the same experiments, then the same program corrected with it."""
    tools = make_campaign.instruments()
    names = [e for e, held in zip(identified.measurements.experiments, identified.held, strict=True) if not held]
    data = readings.read_measurements(
        folder / "measurements.csv", arm.chain.joint_names, tools.points, experiments=names
    )
    fitted = oracle.fit(oracle.wrong_start(arm), data, tools.load_point, tools.sigma_m)
    text = mirror.compensate(fitted.arm, read_poses(folder / PROGRAM), TrueProcess.from_file(folder / "process.yaml"))
    (folder / "oracle.src").write_bytes(text.encode("latin-1"))


def _mill(scenario: Scenario, arm: SegmentedArm, folder: Path, corrected: str) -> PathError:
    errors = None
    if scenario.repeatability_mm:
        process = TrueProcess.from_file(folder / "process.yaml")
        q = process.joints(arm.chain, read_poses(folder / PROGRAM))
        errors = joint_errors(arm.chain, q, scenario.repeatability_mm * 1e-3, np.random.default_rng(6))
    return replay_files(
        arm,
        folder / PROGRAM,
        folder / corrected,
        folder / "process.yaml",
        force_scale=scenario.force,
        joint_error=errors,
    )
