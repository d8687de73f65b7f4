"""Chosen postures against random ones, measured on an arm that the program does not know: the error that remains.

    python examples/paper/design.py [FOLDER]

Plans of equal size are measured on the true KR 270 of examples/kr270 (tapered beams), identified, and tried on displacements of
the tool that no plan contains: along pocket.src, and at postures all over the space. Three plans are chosen - by criterion d, for
the program, for work all over the space - the others are random, from the same candidates. Writes `design.svg` to FOLDER,
`out/paper` unless given.
"""

from __future__ import annotations

import base64
import sys
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

ROOT = Path(__file__).parents[2]
sys.path[:0] = [str(ROOT), str(ROOT / "examples")]

from plants.segmented_arm import SegmentedArm  # noqa: E402

from drake_stiffness.cell import read_cell  # noqa: E402
from drake_stiffness.commands.design import loaded_path  # noqa: E402
from drake_stiffness.design.assumptions import assumed_model  # noqa: E402
from drake_stiffness.design.candidates import Candidates, draw_candidates  # noqa: E402
from drake_stiffness.design.design import choose  # noqa: E402
from drake_stiffness.design.plan_table import experiment_names, plan_text  # noqa: E402
from drake_stiffness.design.settings import Design, read_design  # noqa: E402
from drake_stiffness.design.space import make_criterion, path_gradients, prepare  # noqa: E402
from drake_stiffness.effects import Cases  # noqa: E402
from drake_stiffness.files import write_whole  # noqa: E402
from drake_stiffness.jobs import identify_campaign  # noqa: E402
from drake_stiffness.model import Model  # noqa: E402
from drake_stiffness.plant import build_arm  # noqa: E402
from drake_stiffness.report import figures as f  # noqa: E402
from drake_stiffness.simulation import simulate_displacement  # noqa: E402

KR270 = ROOT / "examples" / "kr270"
CHOSEN = ("criterion d", "for the program", "for all the space")
SIGMA_MM = 0.05  # a camera system rather than a tracker, so that noise and not the form of the model decides


@dataclass(frozen=True)
class Realised:
    """Of one plan, in um: along the program and elsewhere, the sigma it promises and the rms error over noise draws."""

    name: str
    sigma: tuple[float, float]
    error: tuple[float, float]


def measure(plan: Candidates, model: Model, truth: SegmentedArm, folder: Path, seed: int) -> Path:
    """The campaign of a plan on the true arm; the path of its campaign.yaml."""
    folder.mkdir(parents=True, exist_ok=True)
    cases = plan.cases(model.load_point)
    points = np.array(list(model.points.values()))
    p = truth.points(cases.q.T, cases.wrench.T, model.load_point, points) * 1e3
    p += np.random.default_rng(seed).normal(scale=SIGMA_MM, size=p.shape)
    names = experiment_names(plan.number)
    header, *rows = plan_text(model.arm, plan, names).splitlines()
    lines = [f"{header},point,x_mm,y_mm,z_mm"]
    for row, places in zip(rows, p, strict=True):
        lines += [f"{row},{n},{a:.5f},{b:.5f},{c:.5f}" for n, (a, b, c) in zip(model.points, places, strict=True)]
    (folder / "measurements.csv").write_text("\n".join(lines) + "\n", encoding="utf-8")
    text = f"cell: {KR270 / 'cell.yaml'}\nmeasurements: measurements.csv\nnoise: {{position_sigma_mm: {SIGMA_MM}}}\n"
    (folder / "campaign.yaml").write_text(text, encoding="utf-8")
    return folder / "campaign.yaml"


def error_um(model: Model, truth: SegmentedArm, cases: Cases) -> float:
    """Root mean square length of predicted minus true displacement of the tool centre point."""
    tip = model.tcp[1]
    ends = [truth.points(cases.q.T, w, tip, tip[None])[:, 0] for w in (cases.wrench.T, 0 * cases.wrench.T)]
    at_tip = replace(model, points={"tip": tip})
    moved = simulate_displacement(at_tip, cases, np.arange(cases.number), np.full(cases.number, "tip"))
    return float(np.sqrt(((moved.dp.T - ends[0] + ends[1]) ** 2).sum(axis=1).mean()) * 1e6)


def work_all_over(model: Model, settings: Design, number: int, seed: int) -> Cases:
    """Random postures under the forces of milling: 500 N at the tool, any direction."""
    some = draw_candidates(model, settings.model_copy(update={"candidates": number, "seed": seed}))
    force = np.random.default_rng(seed).normal(size=(3, number))
    force *= 500 / np.linalg.norm(force, axis=0)
    return Cases(some.q, np.concatenate([force, np.zeros((3, number))]), model.tcp[1])


def trial(n: int, randoms: int, candidates: int, draws: int, folder: Path) -> list[Realised]:
    """Three chosen plans and some random ones, measured with several draws of the noise, and tried."""
    cell = read_cell(KR270 / "cell.yaml")
    settings = read_design(Path(__file__).parent / "design.yaml").model_copy(update={"candidates": candidates})
    model = assumed_model(cell, build_arm(cell), settings)
    truth = SegmentedArm.from_files(KR270 / "kr270.urdf", KR270 / "true_arm.yaml")
    space = prepare(model, n, settings)
    q, wrench = loaded_path(KR270 / "pocket.src", KR270 / "process.yaml", model)
    other = work_all_over(model, settings, 300, seed=7)
    aims = [
        make_criterion(space, "toolpath", path_gradients(model, *w)) for w in ((q, wrench), (other.q, other.wrench))
    ]
    tried = [Cases(q[:, ::20], wrench[:, ::20], model.tcp[1]), work_all_over(model, settings, 100, seed=99)]
    chosen = zip(CHOSEN, (make_criterion(space, "d"), *aims), strict=True)
    plans = {name: choose(space, criterion, n).chosen for name, criterion in chosen}
    rng = np.random.default_rng(5)
    plans |= {f"random {k + 1}": rng.choice(candidates, n, replace=False) for k in range(randoms)}
    found = []
    for name, plan in plans.items():
        M = space.information.plan(plan)
        sigma = tuple(1e6 / float(np.sqrt(aim.value(M))) for aim in aims)
        squares = np.zeros(2)
        for seed in range(draws):
            campaign = measure(space.candidates.take(plan), model, truth, folder, seed)
            fitted = identify_campaign(campaign).model
            squares += [error_um(fitted, truth, cases) ** 2 / draws for cases in tried]
        found.append(Realised(name, sigma, tuple(np.sqrt(squares).tolist())))
        print(
            "{:12} promised {:5.1f} {:5.1f} um, off by {:5.1f} {:5.1f} um".format(name, *sigma, *found[-1].error),
            flush=True,
        )
    return found


def gains(found: list[Realised]) -> dict[str, tuple[float, float]]:
    """By how much the median random plan is off more than each chosen plan, along the program and elsewhere."""
    median = np.median([r.error for r in found[len(CHOSEN) :]], axis=0)
    return {r.name: (float(median[0] / r.error[0]), float(median[1] / r.error[1])) for r in found[: len(CHOSEN)]}


def figure(found: list[Realised]) -> str:
    """Errors of the plans, sorted, as a data URI."""
    made, axes = f.new(3.6, 1, 2)
    colours = dict(zip(CHOSEN, (f.BLUE, f.ORANGE, f.GREEN), strict=True))
    for ax, k, title in zip(axes, (0, 1), ("along pocket.src", "all over the space"), strict=True):
        order = sorted(found, key=lambda r: r.error[k])
        ax.bar(range(len(order)), [r.error[k] for r in order], color=[colours.get(r.name, f.GREY) for r in order])
        ax.set_xticks([])
        ax.set_xlabel(title)
    axes[0].set_ylabel("error, µm rms")
    for name, colour in {**colours, "random plans": f.GREY}.items():
        axes[0].bar(0, 0, color=colour, label=name)
    made.legend(loc="outside upper left", ncols=4, frameon=False, fontsize=10)
    return f.uri(made)


def main(folder: Path) -> None:
    """The trial and its figure."""
    found = trial(n=8, randoms=15, candidates=3000, draws=3, folder=folder / "design")
    for name, gain in gains(found).items():
        print(
            "{}: the median random plan is off {:.2f} times as much along the program, {:.2f} times elsewhere".format(
                name, *gain
            )
        )
    write_whole(folder / "design.svg", base64.b64decode(figure(found).split(",", 1)[1]))


if __name__ == "__main__":
    main(Path(sys.argv[1]) if len(sys.argv) > 1 else Path("out/paper"))
