"""`drake-stiffness design`: which postures and loads to measure."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from drake_stiffness.commands.console import (
    BesideOption,
    DialectOption,
    JsonOption,
    ReportOption,
    check_outputs,
    console,
    json_of,
    no_program_of,
    say,
    working,
    write,
)
from drake_stiffness.errors import InputError

if TYPE_CHECKING:
    from drake_stiffness.design.augmentation import Suggestion
    from drake_stiffness.design.design import Designed
    from drake_stiffness.model import Model
    from drake_stiffness.rotations import Array
    from drake_stiffness.shop.work import ShopPapers

CRITERIA = ("a", "d", "e", "toolpath", "ratio", "ds")


def design(
    cell: Annotated[Path, typer.Argument(help="cell.yaml")],
    postures: Annotated[
        int, typer.Option("-n", "--postures", min=1, help="postures; with criterion ratio at most so many")
    ],
    output: Annotated[Path, typer.Option("-o", "--output", help="PLAN.csv to write")],
    criterion: Annotated[str, typer.Option(help="a, d, e, toolpath, ratio or ds")] = "d",
    program: Annotated[Path | None, typer.Option(help="of criterion toolpath: the program to be machined")] = None,
    beside: BesideOption = None,
    dialect: DialectOption = None,
    process: Annotated[Path | None, typer.Option(help="of criterion toolpath: process.yaml")] = None,
    suspect: Annotated[str | None, typer.Option(help="of criterion ds: KIND:WHERE[:key=value,..] of an effect")] = None,
    settings: Annotated[Path | None, typer.Option(help="DESIGN.yaml")] = None,
    augment: Annotated[Path | None, typer.Option(help="campaign.yaml whose readings the plan adds to")] = None,
    krl: Annotated[Path | None, typer.Option(help="KRL program of the plan to write")] = None,
    sheet: Annotated[Path | None, typer.Option(help="load sheet to write, HTML for printing")] = None,
    json: JsonOption = None,
    report: ReportOption = None,
) -> None:
    """Choose measurement postures and loads; PLAN.csv goes to `simulate`, to `shop`, and measured to `identify`."""
    from drake_stiffness.design.job import plan_measurements

    _check_options(criterion, program, process, suspect, krl, beside, dialect)
    inputs = tuple(path for path in (cell, program, process, settings, augment, *(beside or ())) if path is not None)
    check_outputs(output, krl, sheet, json, report, inputs=inputs)
    path = None
    if program is not None and process is not None:

        def path(model: Model) -> tuple[Array, Array]:
            return loaded_path(program, process, model, dialect, beside or ())

    with working() as progress:
        result = plan_measurements(
            cell, postures, criterion, settings, suspect=suspect, campaign=augment, path=path, progress=progress
        )
    page = None
    if report is not None:
        from drake_stiffness.report.design import design_report

        page = design_report(result)
    papers = None
    if krl is not None or sheet is not None:
        papers = _papers(result.text, output.name, cell, krl.stem if krl is not None else "plan")
    write(
        (output, result.text),
        (krl, papers.program if papers else None),
        (sheet, papers.sheet if papers else None),
        (json, json_of(result.to_dict())),
        (report, page),
    )
    for line in papers.warnings if papers else ():
        say(f"warning: {line}")
    _show(result.designed, result.suggestions)
    for line in result.notes:
        say(f"note: {line}")
    say(f"{output}: {len(result.names)} postures, {result.text.count(chr(10)) - 1} steps")


def _check_options(
    criterion: str,
    program: Path | None,
    process: Path | None,
    suspect: str | None,
    krl: Path | None,
    beside: list[Path] | None,
    dialect: str | None,
) -> None:
    """Options that do not go together."""
    if criterion not in CRITERIA:
        raise InputError(f"--criterion: found '{criterion}'; expected one of {', '.join(CRITERIA)}.")
    given = (program is not None) + (process is not None)
    if given != (2 if criterion == "toolpath" else 0):
        raise InputError(
            f"--criterion {criterion}: --program and --process go with criterion toolpath, both of them: the program to be machined and "
            "how it is machined (process.yaml)."
        )
    no_program_of(program, beside, dialect)
    if (criterion == "ds") != (suspect is not None):
        raise InputError(
            f"--criterion {criterion}: --suspect KIND:WHERE goes with criterion ds, such as --suspect gravity_compensator:joint_2."
        )
    if krl is not None:
        from drake_stiffness.shop.plan_program import check_name

        if krl.suffix.lower() != ".src":
            raise InputError(f"--krl: found '{krl.name}'; a controller expects a file that ends in .src.")
        check_name(krl.stem)


def _papers(text: str, name: str, cell: Path, program: str) -> ShopPapers:
    """Robot program and load sheet of a plan that is not written yet: outputs appear together or not at all."""
    from tempfile import TemporaryDirectory

    from drake_stiffness.shop import work as shop

    with TemporaryDirectory() as folder:
        plan = Path(folder) / name
        plan.write_text(text, encoding="utf-8")
        return shop.prepare(plan, cell, name=program)


def loaded_path(
    program: Path, process: Path, model: Model, dialect: str | None = None, beside: Sequence[Path] = ()
) -> tuple[Array, Array]:
    """Postures (n, T) along a program and wrenches (6, T) at the tool centre point."""
    from toolpaths import loaded_path as along
    from toolpaths.formats import read_program
    from toolpaths.process import check_frames, check_model, read_process
    from toolpaths.rotary import declare

    job = read_process(process)
    source = declare(read_program(program, dialect, beside), job.gcode, process)
    check_model(job, model)
    check_frames(job, source, model)
    path = along.loaded_path(source, model, job, lambda what, done, total: None)
    return path.postures.q, path.wrench


def _show(d: Designed, suggestions: list[Suggestion]) -> None:
    """What the plan is worth."""
    from rich.table import Table

    from drake_stiffness import text
    from drake_stiffness.design.summary import predicted_ratios, verdict

    out = console()
    out.print(verdict(d), markup=False)
    rows = predicted_ratios(d)
    table = Table(title="Predicted for the base parameters of interest")
    for name in ("parameter", "assumed", "sigma", "unit", "ratio"):
        table.add_column(name, justify="left" if name in ("parameter", "unit") else "right")
    for row in rows:
        ratio = "-" if row["ratio"] is None else f"{row['ratio']:.3g}"
        table.add_row(row["name"], f"{row['assumed']:.3g}", f"{row['sigma']:.2g}", row["unit"], ratio)
    out.print(table)
    text.show_suggestions(out, suggestions)
