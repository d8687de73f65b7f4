"""`drake-stiffness identify`: a campaign becomes a model."""

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
from drake_stiffness.errors import InputError
from drake_stiffness.thresholds import LOWER_RATIO, UPPER_RATIO, check_thresholds


def identify(
    campaign: Annotated[Path, typer.Argument(help="campaign.yaml")],
    output: Annotated[Path, typer.Option("-o", "--output", help="MODEL.json to write")],
    method: Annotated[str, typer.Option(help="sdp or least-squares")] = "sdp",
    upper: Annotated[float, typer.Option(help="Ratio above which a parameter is G1+")] = UPPER_RATIO,
    lower: Annotated[float, typer.Option(help="Ratio below which it is G1-")] = LOWER_RATIO,
    kinds: KindsOption = None,
    json: JsonOption = None,
    report: ReportOption = None,
) -> None:
    """Identify the model of a campaign."""
    from drake_stiffness import jobs, text
    from drake_stiffness.design.augmentation import what_more

    if method not in ("sdp", "least-squares"):
        raise InputError(f"--method: found '{method}'; expected sdp or least-squares.")
    check_thresholds(upper, lower)
    use_kinds(kinds)
    check_outputs(output, json, report, inputs=jobs.files_of_campaign(campaign))
    with working() as progress:
        result = jobs.identify_campaign(campaign, method, progress, upper=upper, lower=lower)
    page = None
    if report is not None:
        from drake_stiffness.report import identification_report

        page = identification_report(result)
    with working() as progress:
        progress("what more postures would settle")
        sigma = result.campaign.noise.position_sigma_mm
        suggestions = what_more(result.model, result.groups, result.measurements, sigma)
    content = result.model.to_dict()
    summary = {k: content[k] for k in ("parameters", "fit", "provenance")} | {"warnings": result.warnings}
    summary["suggestions"] = [suggestion.to_dict() for suggestion in suggestions]
    write((output, json_of(content)), (json, json_of(summary)), (report, page))
    text.show_identification(console(), result)
    text.show_suggestions(console(), suggestions)
