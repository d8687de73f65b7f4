"""`drake-stiffness compensate`: a milling program is corrected."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from drake_stiffness.commands.console import (
    JsonOption,
    KindsOption,
    ReportOption,
    check_outputs,
    console,
    json_of,
    use_kinds,
    working,
    write,
)


def compensate(
    program: Annotated[Path, typer.Argument(help="KRL .src or CSV waypoints")],
    model: Annotated[Path, typer.Option(help="MODEL.json")],
    process: Annotated[Path, typer.Option(help="process.yaml")],
    output: Annotated[Path, typer.Option("-o", "--output", help="corrected program to write")],
    allow_insert: Annotated[bool, typer.Option(help="Insert words a correction needs and a line lacks.")] = False,
    keep_refused: Annotated[bool, typer.Option(help="Leave motions that cannot be corrected as they are.")] = False,
    dialect: Annotated[str | None, typer.Option(help="krl or csv; default: told from the content")] = None,
    kinds: KindsOption = None,
    json: JsonOption = None,
    report: ReportOption = None,
) -> None:
    """Correct a milling program; needs neither Drake nor cvxpy."""
    from drake_stiffness import text
    from drake_stiffness.model import load_model
    from toolpaths.formats import read_program
    from toolpaths.job import compensate as run
    from toolpaths.process import read_process

    use_kinds(kinds)
    check_outputs(output, json, report, inputs=(program, model, process))
    loaded, job = load_model(model), read_process(process)
    with working() as progress:
        progress("reading the program")
        source = read_program(program, dialect)
        result = run(
            source,
            loaded,
            job,
            allow_insert=allow_insert,
            keep_refused=keep_refused,
            progress=lambda what, done, total: progress(f"{what}: {done} of {total}"),
        )
    page = None
    if report is not None:
        from drake_stiffness.report import compensation_report

        page = compensation_report(result, loaded)
    write(*result.files(output), (json, json_of(result.to_dict())), (report, page))
    text.show_compensation(console(), result, output)
