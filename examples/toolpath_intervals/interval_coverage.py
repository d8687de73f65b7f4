"""Do the intervals of `compensate` hold what the true arm does? Campaigns, corrections and cuts on plants of other structure.

Each trial measures a campaign of its own on the plant (links of three tapered beams, `examples/plants`; the model has one spring a
link), identifies, corrects every tenth motion of pocket.src, cuts it on the plant with a force that is off by what process.yaml
states, and asks at every point whether the true residual lies in the interval. In the worlds with curved contacts, joints 2 and 3
give way with the power 2/3 of their torque as well, in those with gear teeth their stiffness varies by 30 % four and five times a
turn: things that no spring of the model can say.

    python examples/toolpath_intervals/interval_coverage.py --trials 10
"""

from __future__ import annotations

import argparse
import shutil
import sys
import tempfile
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

EXAMPLES = Path(__file__).parents[1]
KR270 = EXAMPLES / "kr270"
sys.path[:0] = [str(EXAMPLES), str(KR270)]

import make_campaign  # noqa: E402
from plants.gear_mesh import MeshStiffness  # noqa: E402
from plants.physics import JointPhysics  # noqa: E402
from plants.replay import replay_files  # noqa: E402
from plants.segmented_arm import SegmentedArm  # noqa: E402
from plants.windup import HertzContact  # noqa: E402

from drake_stiffness.jobs import identify_campaign  # noqa: E402
from toolpaths.formats import read_program  # noqa: E402
from toolpaths.job import compensate  # noqa: E402
from toolpaths.process import read_process  # noqa: E402

# Cuts of one correction, each with a force of its own, where the force is uncertain.
CUTS = 10
CONTACTS = (HertzContact(1, 1.5e-4, 3000.0), HertzContact(2, 1.5e-4, 3000.0))
TEETH = (MeshStiffness(1, 2e-7, 0.3, 4.0, 0.5), MeshStiffness(2, 3e-7, 0.3, 5.0, 1.0))


@dataclass(frozen=True)
class World:
    """Attributes
    ----------
    name : str
    physics : tuple of JointPhysics
        What joints of the plant do that the model lacks.
    force_sigma : float
        Relative standard deviation of the true force about the assumed one; it is stated in process.yaml.
    """

    name: str
    physics: tuple[JointPhysics, ...] = ()
    force_sigma: float = 0.0


WORLDS = (
    World("beams of other structure, force exact"),
    World("the same, force uncertain by 10 %", force_sigma=0.1),
    World("curved contacts in joints 2 and 3, force exact", physics=CONTACTS),
    World("curved contacts, force uncertain by 10 %", physics=CONTACTS, force_sigma=0.1),
    World("gear teeth in joints 2 and 3, force exact", physics=TEETH),
    World("gear teeth, force uncertain by 10 %", physics=TEETH, force_sigma=0.1),
)


@dataclass(frozen=True, eq=False)
class Trial:
    """True residuals (C, N) of C cuts, intervals (N,), mm, and what the model says of its form."""

    true_mm: np.ndarray
    low_mm: np.ndarray
    high_mm: np.ndarray
    form: float

    @property
    def inside(self) -> np.ndarray:
        """(C,) share of the points whose true residual lies in the interval."""
        return ((self.true_mm >= self.low_mm) & (self.true_mm <= self.high_mm)).mean(axis=1)


def thinned(lines: list[str], every: int) -> str:
    """A program with every so-many-th linear motion, so that a trial takes a second."""
    motions = [line for line in lines if line.startswith("LIN")]
    return "\n".join(["$BASE = BASE_DATA[1]", *motions[::every]]) + "\n"


def run_trial(world: World, seed: int, folder: Path, every: int = 10) -> Trial:
    """Measure, identify, correct, cut."""
    for name in ("kr270.urdf", "cell.yaml", "campaign.yaml"):
        shutil.copyfile(KR270 / name, folder / name)
    arm = replace(SegmentedArm.from_files(KR270 / "kr270.urdf", KR270 / "true_arm.yaml"), joint_physics=world.physics)
    table = make_campaign.make_table(arm, make_campaign.instruments(), seed)
    (folder / "measurements.csv").write_text(table, encoding="utf-8")
    program = thinned((KR270 / "pocket.src").read_text().splitlines(), every)
    (folder / "pocket.src").write_text(program)
    stated = (KR270 / "process.yaml").read_text()
    if world.force_sigma:
        stated = stated.replace("force:", f"force:\n  relative_sigma: {world.force_sigma}", 1)
    (folder / "process.yaml").write_text(stated)
    model = identify_campaign(folder / "campaign.yaml").model
    result = compensate(read_program(folder / "pocket.src"), model, read_process(folder / "process.yaml"))
    (folder / "corrected.src").write_bytes(result.raw)
    draws = np.random.default_rng([seed, 7]).standard_normal(CUTS if world.force_sigma else 1)
    files = (folder / "pocket.src", folder / "corrected.src", folder / "process.yaml")
    true = [replay_files(arm, *files, force_scale=1 + world.force_sigma * z).distance_mm for z in draws.tolist()]
    interval = result.account.interval
    return Trial(np.stack(true), interval.low_mm, interval.high_mm, float(model.fit["model_form"]["relative"]))


def main() -> None:
    """Print coverage, world by world."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--trials", type=int, default=10)
    parser.add_argument("--every", type=int, default=10, help="thin the program to every so-many-th motion")
    arguments = parser.parse_args()
    print(
        "| world | points in the interval | cuts with all points in it | true residual, mean mm | interval's end, mean mm | form, % |"
    )
    print("|---|---|---|---|---|---|")
    for world in WORLDS:
        trials = []
        for seed in range(1, arguments.trials + 1):
            with tempfile.TemporaryDirectory() as folder:
                trials.append(run_trial(world, seed, Path(folder), arguments.every))
        inside = np.concatenate([trial.inside for trial in trials])
        true = np.mean([trial.true_mm.mean() for trial in trials])
        high = np.mean([trial.high_mm.mean() for trial in trials])
        form = 100 * np.mean([trial.form for trial in trials])
        print(
            f"| {world.name} | {100 * inside.mean():.1f} % | {int((inside == 1).sum())} of {inside.size} | {true:.4f} | {high:.4f} | {form:.2f} |",
            flush=True,
        )


if __name__ == "__main__":
    main()
