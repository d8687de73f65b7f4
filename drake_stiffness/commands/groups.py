"""`drake-stiffness groups`: what a campaign determines, what merges, what it does not see."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from drake_stiffness.commands.console import JsonOption, ReportOption, check_outputs, console, json_of, working, write
from drake_stiffness.errors import InputError
from drake_stiffness.thresholds import LOWER_RATIO, UPPER_RATIO, check_thresholds


def groups(
    campaign: Annotated[Path, typer.Argument(help="campaign.yaml")],
    upper: Annotated[float, typer.Option(help="Ratio above which a parameter is G1+")] = UPPER_RATIO,
    lower: Annotated[float, typer.Option(help="Ratio below which it is G1-")] = LOWER_RATIO,
    method: Annotated[str, typer.Option(help="sdp or least-squares")] = "sdp",
    per: Annotated[str, typer.Option(help="Units of eigen-directions: value or scale")] = "value",
    json: JsonOption = None,
    report: ReportOption = None,
) -> None:
    """Sort the parameters of a campaign into G1+, G1~, G1-, G2 and G3, with base parameters and relations."""
    from drake_stiffness import jobs
    from drake_stiffness.groups_text import show_groups

    if method not in ("sdp", "least-squares"):
        raise InputError(f"--method: found '{method}'; expected sdp or least-squares.")
    if per not in ("value", "scale"):
        raise InputError(f"--per: found '{per}'; expected value or scale.")
    check_thresholds(upper, lower)
    check_outputs(json, report, inputs=jobs.files_of_campaign(campaign))
    with working() as progress:
        result = jobs.identify_campaign(campaign, method, progress, upper=upper, lower=lower)
    found = result.groups.per(per)  # type: ignore[arg-type]
    page = None
    if report is not None:
        from drake_stiffness.report.groups import groups_report

        page = groups_report(result, found)
    write((json, json_of(found.to_dict() | {"warnings": result.warnings})), (report, page))
    show_groups(console(), found, result.warnings)
