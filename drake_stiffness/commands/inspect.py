"""`drake-stiffness inspect`: what a cell is."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from drake_stiffness.commands.console import JsonOption, ReportOption, check_outputs, console, json_of, working, write


def inspect(
    cell: Annotated[Path, typer.Argument(help="cell.yaml")],
    identifiability: Annotated[bool, typer.Option(help="Ranks over random postures.")] = False,
    json: JsonOption = None,
    report: ReportOption = None,
) -> None:
    """Print the chain, the springs with their frames, and parameter counts."""
    from drake_stiffness import jobs, text

    check_outputs(json, report, inputs=(cell,))
    with working() as progress:
        progress("reading the robot")
        result = jobs.inspect(cell, identifiability)
    text.show_inspection(console(), result)
    page = None
    if report is not None:
        from drake_stiffness.report import inspection_report

        page = inspection_report(result, cell)
    write((json, json_of(result.to_dict())), (report, page))
