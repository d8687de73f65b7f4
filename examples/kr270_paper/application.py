"""Section 5 of the source paper on a virtual KR 270 with a gravity compensator: identification, reduction, compensation.

Run: python examples/kr270_paper/application.py [-o FOLDER] [--quick]

Prints the tables of docs/paper_kr270.md and writes its figure. The truth (world.py) shares no code with what is tried on it.
"""

from __future__ import annotations

import argparse
import shutil
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import world
from figure import draw
from fits import SPRING, Fitted, from_positions, in_turn, same_structure, simpler
from plants.replay import PathError, replay_files
from rich.console import Console
from rich.table import Table

from drake_stiffness.effects.gravity_compensator import GravityCompensator
from drake_stiffness.jobs import inspect
from drake_stiffness.model import Model
from drake_stiffness.task import read_task
from toolpaths.formats import read_program
from toolpaths.job import compensate
from toolpaths.process import read_process

POSTURES = (15, 30, 60)
UNITS = {"k_c": (1e6, "um/N"), "s_0": (1e3, "mm")}
LIMITS = np.radians(np.linspace(-140.0, -5.0, 271))


def numbers_of_the_paper() -> dict[str, tuple[float, float]]:
    """Pull (N), torque (N m) and share of joint 2's stiffness of the printed spring, least and most: all angles, then limits."""
    k_c, s_0 = (world.TABLE_1[name][0] for name in ("k_c", "s_0"))
    printed = GravityCompensator("joint_2", (0.68593, 0.12030), 0.18472, variant="stiffness")
    x, found = np.array([1 / k_c, s_0 / k_c]), {}
    for where, q in (("all angles", np.linspace(-np.pi, np.pi, 20001)), ("within limits", LIMITS)):
        pull = x[0] * printed.length(q)[1] - x[1]
        share = printed.stiffening(q, x) * world.TABLE_1["joint_2"][0]
        turn = printed.moment(q, x)
        for what, values in (("pull", pull), ("share", share), ("torque", turn)):
            found[f"{what}, {where}"] = (float(values.min()), float(values.max()))
    return found


def show_counts(console: Console) -> None:
    """The 260 parameters, and what the seed's pair would be as a real spring."""
    result = inspect(world.HERE / "cell_spring.yaml")
    console.print(
        f"Complete model: {result.counts['complete']} + {sum(e['unknowns'] for e in result.effects)} of the compensator = "
        f"{result.parameters_total} parameters; symmetric {result.counts['symmetric'] + 2}; beams {result.counts['beam'] + 2}."
    )
    n = numbers_of_the_paper()
    for where in ("all angles", "within limits"):
        pull, share = n[f"pull, {where}"], n[f"share, {where}"]
        console.print(
            f"Printed k_c, s_0 as a real spring, {where}: it pulls with {pull[0] / 1e6:.2f} .. {pull[1] / 1e6:.2f} MN; as a stiffness "
            f"it varies joint 2 by {share[0]:+.1%} .. {share[1]:+.1%}."
        )


def show_recovered(console: Console, fit: Fitted, exact: Fitted) -> None:
    """Table 1, which is the truth, beside what the reduced model finds, and which reading of the ± sign the noise supports.

    "stands for": the same parameters fitted to the same campaign without noise, so with what merged into them and what is missing.
    """
    table = Table(title=f"Table 1 beside {fit.kept} parameters from 30 postures (units: urad/(N m), um/N, mm)")
    for column in ("", "printed", "±", "stands for", "found", "sigma", "z", "± / sigma"):
        table.add_column(column, justify="right")
    ratios = []
    for name, (printed, plus_minus) in world.TABLE_1.items():
        factor, _ = UNITS.get(name, (1e6, ""))
        (value, sigma), (meant, _) = fit.value(name), exact.value(name)
        ratios.append(plus_minus / sigma)
        shown = [printed, plus_minus, meant, value, sigma]
        z = (value - meant) / sigma
        table.add_row(name, *(f"{v * factor:.4g}" for v in shown), f"{z:+.1f}", f"{plus_minus / sigma:.1f}")
    console.print(table)
    k_c, plus_minus = world.TABLE_1["k_c"]
    console.print(
        "± read as one, two, three sigma: k_c has the ratio "
        + ", ".join(f"{k_c / plus_minus * m:.2f}" for m in (1, 2, 3))
        + " (M3 deletes below 5), and the paper's sigma would be, median over the table, "
        + ", ".join(f"{np.median(ratios) / m:.1f}" for m in (1, 2, 3))
        + " times this campaign's."
    )
    own, total = world.TABLE_1["joint_2"][0], exact.value("joint_2")[0]
    console.print(
        f"joint_2 stands for {total * 1e6:.4f} urad/(N m), links included; on it k_c must come out ({total / own:.3f})^2 = "
        f"{(total / own) ** 2:.3f} times larger: {k_c * (total / own) ** 2 * 1e6:.4f} um/N. s_0 does not change."
    )


def mill(folder: Path, variant: str, models: list[Fitted]) -> dict[str, PathError]:
    """Errors of the program on the true arm, uncompensated and corrected with each model."""
    program, process = world.KR270 / "pocket.src", world.HERE / "process.yaml"
    arm, errors = world.true_arm(variant), {}
    errors["uncompensated"] = replay_files(arm, program, program, process)
    for fit in models:
        done = compensate(read_program(program), stored(folder, fit.model), read_process(process))
        corrected = folder / f"{variant}_{fit.label.replace(' ', '_').replace(',', '')}.src"
        corrected.write_bytes(done.raw)
        errors[fit.label] = replay_files(arm, program, corrected, process)
    return errors


def stored(folder: Path, model: Model) -> Model:
    """The model as a shop would get it: through its file."""
    from drake_stiffness.model import load_model

    model.save(folder / "model.json")
    return load_model(folder / "model.json")


def show_milling(console: Console, variant: str, models: list[Fitted], errors: dict[str, PathError]) -> None:
    """Errors of the milled path."""
    table = Table(title=f"Milled on the true arm, compensator as {variant}; mm")
    for column in ("model", "parameters", "chi2/dof", "mean", "p95", "max", "compensated"):
        table.add_column(column, justify="left" if column == "model" else "right")
    about = {fit.label: (str(fit.kept), f"{fit.chi2_per_dof:.3g}") for fit in models}
    for name, error in errors.items():
        figures = (f"{v:.4f}" for v in (error.mean_mm, error.p95_mm, error.max_mm))
        percent = error.percent_compensated(errors["uncompensated"])
        table.add_row(name, *about.get(name, ("", "")), *figures, f"{percent:.2f} %")
    console.print(table)


def show_kept(console: Console, variant: str, fits: dict[int, Fitted]) -> None:
    """How many parameters dropping in turn keeps."""
    kept = ", ".join(f"{fit.kept} at {n}" for n, fit in fits.items())
    has = ", ".join("yes" if SPRING in fit.model.names else "no" for fit in fits.values())
    console.print(
        f"Reduced in turn, compensator as {variant}: {kept} postures keep so many; the compensator among them: {has}."
    )


def show_real_spring(console: Console, folder: Path, full: Fitted, postures: int = 30) -> None:
    """What readings show of a spring that carries the arm; `full` is the complete model of its displacements."""
    moved, lifted = world.spring_in_readings(postures)
    console.print(
        f"The real spring changes displacements under load by {np.median(moved) * 1e6:.1f} um (median; most {moved.max() * 1e6:.1f}), "
        f"and lifts the unloaded points by {np.median(lifted) * 1e3:.2f} mm (most {lifted.max() * 1e3:.2f})."
    )
    positions = read_task(world.write_campaign(folder, "spring", postures, extra="quantity: position\n"))
    table = Table(title=f"The real spring: K_c {world.BALANCING:.3g} N/m, s_0 458 mm, from {postures} postures")
    for column in ("from", "K_c, N/m", "sigma", "s_0, mm", "sigma", "chi2/dof"):
        table.add_column(column, justify="left" if column == "from" else "right")
    rows = [("displacements", full.value(SPRING), full.value("s_0"), full.chi2_per_dof)]
    for label, known in (("positions, frame and zeros known", True), ("positions, frame and zeros fitted", False)):
        found = from_positions(positions, full.model, calibrated=known)
        rows.append((label, found.spring, found.free_length, found.chi2_per_dof))
    for label, spring, length, chi2 in rows:
        numbers = (f"{spring[0]:.4g}", f"{spring[1]:.2g}", f"{length[0] * 1e3:.1f}", f"{length[1] * 1e3:.2g}")
        table.add_row(label, *numbers, f"{chi2:.3g}")
    console.print(table)
    console.print(
        f"joint_2 of that model is {full.value('joint_2')[0] * 1e6:.4f} urad/(N m); its own compliance is 0.302."
    )


@dataclass(frozen=True, eq=False)
class Application:
    """What a run of one variant found: models reduced in turn by number of postures, the noise-free fit of the middle one, rivals,
    and the errors of the milled program."""

    reduced: dict[int, Fitted]
    exact: Fitted
    models: list[Fitted]
    errors: dict[str, PathError]


def apply(folder: Path, variant: str, postures: tuple[int, ...] = POSTURES, main: int = 30) -> Application:
    """The application with one variant of the compensator."""
    tasks = {n: read_task(world.write_campaign(folder, variant, n)) for n in postures}
    both = {n: in_turn(task) for n, task in tasks.items()}
    reduced = {n: pair[0] for n, pair in both.items()}
    exact = same_structure(world.write_campaign(folder, variant, main, noise_m=0.0), reduced[main])
    models = [*simpler(tasks[main]), *both[main]]
    return Application(reduced, exact, models, mill(folder, variant, models))


def main() -> None:
    """Both variants, the tables and the figure."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("-o", "--output", type=Path, default=Path("out/kr270_paper"), help="folder for results")
    parser.add_argument("--quick", action="store_true", help="15 and 30 postures only, and no figure")
    arguments = parser.parse_args()
    console, folder = Console(highlight=False, width=150), arguments.output
    postures = POSTURES[:2] if arguments.quick else POSTURES
    show_counts(console)
    found = {}
    for variant in ("stiffness", "spring"):
        console.print(f"\nCompensator as {variant}")
        found[variant] = apply(folder, variant, postures)
        show_kept(console, variant, found[variant].reduced)
        if variant == "stiffness":
            show_recovered(console, found[variant].reduced[30], found[variant].exact)
        show_milling(console, variant, found[variant].models, found[variant].errors)
    show_real_spring(console, folder, found["spring"].models[-1])
    if not arguments.quick:
        draw(found["stiffness"].reduced[30], found["stiffness"].errors, folder / "paper_kr270.svg")
        console.print(f"Figure: {folder / 'paper_kr270.svg'}")
        shutil.copyfile(folder / "stiffness_complete_cone.src", folder / "corrected.src")


if __name__ == "__main__":
    main()
