"""Chosen postures against random ones, measured on an arm that the program does not know: the error that remains.

    python examples/paper/design.py [FOLDER] [RANDOM_PLANS]

Plans of eight postures are measured on the true KR 270 of examples/kr270 (tapered beams), identified, and tried on displacements of
the tool that no plan contains: along pocket.src, and at postures all over the space. Three plans are chosen - by criterion d, for
the program, for work all over the space - with ten draws of the noise each; 100 are random, from the same candidates, one draw each.
Some five minutes. Writes `design.svg` to FOLDER, `out/paper` unless given.
"""

import base64
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np

ROOT = Path(__file__).parents[2]
sys.path[:0] = [str(ROOT), str(ROOT / "examples")]

from plants.segmented_arm import SegmentedArm  # noqa: E402

from drake_stiffness import campaign, cell, identification, observation, plant, simulation  # noqa: E402
from drake_stiffness.commands.design import loaded_path  # noqa: E402
from drake_stiffness.design import assumptions, candidates, design, settings, space  # noqa: E402
from drake_stiffness.effects import Cases  # noqa: E402
from drake_stiffness.files import write_whole  # noqa: E402
from drake_stiffness.report import figures as f  # noqa: E402
from drake_stiffness.tables import Table  # noqa: E402

KR270 = ROOT / "examples" / "kr270"
CHOSEN = {"criterion d": f.BLUE, "for the program": f.ORANGE, "for all the space": f.GREEN}
SIGMA_MM = 0.05  # a camera system rather than a tracker, so that noise and not the form of the model decides


def measure(plan, model, truth, seed):
    """The readings of a plan on the true arm."""
    cases, names = plan.cases(model.load_point), tuple(model.points)
    p = truth.points(cases.q.T, cases.wrench.T, model.load_point, np.array(list(model.points.values()))).reshape(-1, 3)
    p = p + np.random.default_rng(seed).normal(scale=SIGMA_MM * 1e-3, size=p.shape)
    case, point = np.repeat(np.arange(cases.number), len(names)), np.tile(names, cases.number)
    no_table, unread = Table(Path("simulated"), (), [], []), np.full(p.shape, np.nan)
    experiments, row = tuple(f"E{i}" for i in range(plan.number)), np.arange(case.size)
    m = campaign.Measurements(no_table, cases, experiments, case, row, point, p, False, unread)
    return observation.observe(m, True, campaign.Noise(position_sigma_mm=SIGMA_MM))


def error_um(model, truth, cases):
    """Root mean square length of predicted minus true displacement of the tool centre point."""
    tip = model.tcp[1]
    ends = [truth.points(cases.q.T, w, tip, tip[None])[:, 0] for w in (cases.wrench.T, 0 * cases.wrench.T)]
    every, names = np.arange(cases.number), np.full(cases.number, "tip")
    moved = simulation.simulate_displacement(replace(model, points={"tip": tip}), cases, every, names)
    return float(np.sqrt(((moved.dp.T - ends[0] + ends[1]) ** 2).sum(axis=1).mean()) * 1e6)


def work_all_over(model, wishes, number, seed):
    """Random postures under the forces of milling: 500 N at the tool, any direction."""
    some = candidates.draw_candidates(model, wishes.model_copy(update={"candidates": number, "seed": seed}))
    force = np.random.default_rng(seed).normal(size=(3, number))
    force *= 500 / np.linalg.norm(force, axis=0)
    return Cases(some.q, np.concatenate([force, np.zeros((3, number))]), model.tcp[1])


def trial(n, randoms, number, draws):
    """By plan, along the program and elsewhere, um: the two sigmas that it promises and the two rms errors."""
    robot = cell.read_cell(KR270 / "cell.yaml")
    wishes = settings.read_design(Path(__file__).parent / "design.yaml").model_copy(update={"candidates": number})
    model = assumptions.assumed_model(robot, plant.build_arm(robot), wishes)
    truth = SegmentedArm.from_files(KR270 / "kr270.urdf", KR270 / "true_arm.yaml")
    choices = space.prepare(model, n, wishes)
    q, wrench = loaded_path(KR270 / "pocket.src", KR270 / "process.yaml", model)
    other = work_all_over(model, wishes, 300, seed=7)
    gradients = [space.path_gradients(model, *work) for work in ((q, wrench), (other.q, other.wrench))]
    aims = [space.make_criterion(choices, "toolpath", rows) for rows in gradients]
    tried = [Cases(q[:, ::20], wrench[:, ::20], model.tcp[1]), work_all_over(model, wishes, 100, seed=99)]
    criteria = zip(CHOSEN, [space.make_criterion(choices, "d"), *aims], strict=True)
    plans = [(name, design.choose(choices, criterion, n).chosen, range(draws)) for name, criterion in criteria]
    rng, found = np.random.default_rng(5), {}
    plans += [(f"random {k + 1}", rng.choice(number, n, replace=False), [k]) for k in range(randoms)]
    for name, plan, seeds in plans:
        promised = [1e6 / np.sqrt(aim.value(choices.information.plan(plan))) for aim in aims]
        readings = (measure(choices.candidates.take(plan), model, truth, seed) for seed in seeds)
        fits = [identification.identify(model, o).model for o in readings]
        off = np.sqrt(np.mean([[error_um(fit, truth, cases) ** 2 for cases in tried] for fit in fits], axis=0))
        found[name] = np.array([*promised, *off])
        print(f"{name:17} promised, um: {found[name][:2].round(1)}, off by: {found[name][2:].round(1)}", flush=True)
    return found


def figure(found):
    """Errors of the plans, sorted, as a data URI."""
    made, axes = f.new(3.6, 1, 2)
    for ax, k, title in zip(axes, (2, 3), ("along pocket.src", "all over the space"), strict=True):
        order = sorted(found, key=lambda name: found[name][k])
        ax.bar(range(len(order)), [found[n][k] for n in order], color=[CHOSEN.get(n, f.GREY) for n in order])
        ax.set_xticks([])
        ax.set_xlabel(title)
    axes[0].set_ylabel("error, µm rms")
    for name, colour in {**CHOSEN, "random plans": f.GREY}.items():
        axes[0].bar(0, 0, color=colour, label=name)
    made.legend(loc="outside upper left", ncols=4, frameon=False, fontsize=10)
    return f.uri(made)


def main(folder, randoms):
    """The trial, its figure, and by how much the median random plan is off more than each chosen one."""
    found = trial(n=8, randoms=randoms, number=3000, draws=10)
    folder.mkdir(parents=True, exist_ok=True)
    write_whole(folder / "design.svg", base64.b64decode(figure(found).split(",", 1)[1]))
    at_random = np.array([numbers for name, numbers in found.items() if name not in CHOSEN])
    median = np.median(at_random, axis=0)
    print("random plans: median", median.round(1), "best in each", at_random.min(axis=0).round(1))
    for name in CHOSEN:
        better = (at_random < found[name]).sum(axis=0)[2:]
        print(f"{name}: gain {(median / found[name])[2:].round(2)}, of the random plans {better} are better")


if __name__ == "__main__":
    arguments = sys.argv[1:]
    main(Path(arguments[0]) if arguments else Path("out/paper"), int(arguments[1]) if len(arguments) > 1 else 100)
