"""The main job, end to end, on a KUKA KR 270, and a diagnosis of another arm: `make demo`.

A campaign (simulated on a plant that does not share our code) goes in; a model, a corrected milling program and a report come
out; the corrected program is then milled on the true plant, beside no correction, a joints-only model, and an oracle.
"""

from __future__ import annotations

import argparse
import base64
from pathlib import Path

from rich.console import Console
from rich.table import Table
from trial import PROGRAM, SCENARIOS, Scenario, Trial, run_trial

from drake_stiffness.files import json_text, write_whole
from drake_stiffness.report.demo import DemoRow, RobustnessRow, demo_report
from drake_stiffness.report.demo_plots import along_figure


def rows_of(trial: Trial) -> list[DemoRow]:
    """Errors of the four programs on the true plant."""
    named = {
        "uncompensated": trial.uncompensated,
        "joints-only model": trial.joints_only,
        "full model (joints and links)": trial.full,
        "oracle (true structure, same data)": trial.oracle,
    }
    return [
        DemoRow(name, e.mean_mm, e.p95_mm, e.max_mm, e.percent_compensated(trial.uncompensated))
        for name, e in named.items()
    ]


def robustness_of(scenario: Scenario, trial: Trial) -> RobustnessRow:
    """Mean errors of one scenario."""
    return RobustnessRow(
        scenario.name,
        trial.uncompensated.mean_mm,
        trial.joints_only.mean_mm,
        trial.full.mean_mm,
        trial.oracle.mean_mm,
    )


def show(console: Console, rows: list[DemoRow], robustness: list[RobustnessRow]) -> None:
    """The figures as tables."""
    table = Table(title="Error of the milled path on the true plant, mm")
    for name in ("program", "mean", "p95", "max", "compensated"):
        table.add_column(name, justify="left" if name == "program" else "right")
    for row in rows:
        table.add_row(row.name, f"{row.mean_mm:.4f}", f"{row.p95_mm:.4f}", f"{row.max_mm:.4f}", f"{row.percent:.2f} %")
    console.print(table)
    if not robustness:
        return
    table = Table(title="The same when the world differs: mean error, mm")
    for name in ("scenario", "uncompensated", "joints only", "full", "oracle", "full / oracle"):
        table.add_column(name, justify="left" if name == "scenario" else "right")
    for r in robustness:
        numbers = (r.uncompensated_mm, r.joints_only_mm, r.full_mm, r.oracle_mm)
        table.add_row(r.scenario, *(f"{v:.4f}" for v in numbers), f"{r.full_mm / r.oracle_mm:.2f}")
    console.print(table)
    if any(r.joints_only_mm < r.full_mm for r in robustness):
        console.print(
            "Where joints only comes out ahead, its own error and that of the assumed force happen to cancel."
        )


def main() -> None:
    """Run the job and write the report."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("-o", "--output", type=Path, default=Path("out/kr270"), help="folder for results")
    parser.add_argument("--quick", action="store_true", help="leave out the robustness scenarios")
    arguments = parser.parse_args()
    console, folder = Console(highlight=False), arguments.output
    console.print(f"Identifying 62 compliances from 30 simulated postures and correcting {PROGRAM} ...")
    nominal = run_trial(Scenario("as stated"), folder)
    rows = rows_of(nominal)
    fit = nominal.identified.model.fit
    console.print(
        f"Held-out postures: {fit['held_out_rms_mm']:.4f} mm rms (3-D); chi-square per degree of freedom {fit['chi2_per_dof']:.3f}; "
        f"{fit['rank']} of {fit['unknowns']} compliances are determined, the rest in combination with them."
    )
    show(console, rows, [])
    robustness = [robustness_of(Scenario("as stated"), nominal)]
    for scenario in () if arguments.quick else SCENARIOS:
        console.print(f"... {scenario.name}")
        slug = scenario.name.replace(" ", "_").replace("%", "percent").replace(".", "_")
        robustness.append(robustness_of(scenario, run_trial(scenario, folder / slug)))
    show(console, rows, robustness)
    nominal.identified.model.save(folder / "model.json")
    distances = {
        row.name: error.distance_mm
        for row, error in zip(
            rows, (nominal.uncompensated, nominal.joints_only, nominal.full, nominal.oracle), strict=True
        )
    }
    page = demo_report(
        "Milling with a KUKA KR 270", rows, robustness, nominal.identified, nominal.compensation, distances
    )
    write_whole(folder / "report.html", page)
    # The picture of README.md: a data URI of the report, as a file.
    write_whole(folder / "error_along_path.svg", base64.b64decode(along_figure(distances).split(",", 1)[1]))
    write_whole(
        folder / "figures.json",
        json_text({"rows": [vars(r) for r in rows], "robustness": [vars(r) for r in robustness]}),
    )
    console.print(f"Corrected program: {folder / 'full.src'}\nModel: {folder / 'model.json'}")
    console.print(f"Report: {(folder / 'report.html').resolve()}\n")
    from kr270_hidden.act_two import act_two  # `trial` has put the examples on the path

    act_two(console, folder)


if __name__ == "__main__":
    main()
