"""`drake-stiffness identify`: a campaign becomes a model."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from drake_stiffness.commands.console import JsonOption, ReportOption, check_outputs, console, json_of, working, write
from drake_stiffness.errors import InputError


def identify(
    campaign: Annotated[Path, typer.Argument(help="campaign.yaml")],
    output: Annotated[Path, typer.Option("-o", "--output", help="MODEL.json to write")],
    method: Annotated[str, typer.Option(help="sdp or least-squares")] = "sdp",
    json: JsonOption = None,
    report: ReportOption = None,
) -> None:
    """Identify the model of a campaign."""
    from drake_stiffness import jobs, text

    if method not in ("sdp", "least-squares"):
        raise InputError(f"--method: found '{method}'; expected sdp or least-squares.")
    check_outputs(output, json, report, inputs=jobs.files_of_campaign(campaign))
    with working() as progress:
        result = jobs.identify_campaign(campaign, method, progress)
    page = None
    if report is not None:
        from drake_stiffness.report import identification_report

        page = identification_report(result)
    content = result.model.to_dict()
    summary = {k: content[k] for k in ("parameters", "fit", "provenance")} | {"warnings": result.warnings}
    write((output, json_of(content)), (json, json_of(summary)), (report, page))
    text.show_identification(console(), result)
