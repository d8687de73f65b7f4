"""`drake-stiffness diagnose`: where simulation and measurement disagree, and what is missing."""

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


def diagnose(
    campaign: Annotated[Path, typer.Argument(help="campaign.yaml")],
    output: Annotated[
        Path | None, typer.Option("-o", "--output", help="MODEL.json to write, named effects included")
    ] = None,
    model: Annotated[Path | None, typer.Option(help="MODEL.json that the springs start from")] = None,
    fixed: Annotated[
        bool,
        typer.Option("--fixed", help="Refit nothing: is the model of --model still true, and if not, what changed?"),
    ] = False,
    scene: Annotated[
        Path | None, typer.Option(help="HTML page to write: the arm and its residuals in 3-D (Meshcat, 2 MB)")
    ] = None,
    kinds: KindsOption = None,
    json: JsonOption = None,
    report: ReportOption = None,
) -> None:
    """Find where simulation and measurement disagree, name the missing effect, add it, show the gap shrink."""
    from drake_stiffness import jobs
    from drake_stiffness.diagnosis.job import diagnose_campaign
    from drake_stiffness.diagnosis.words import show_diagnosis

    use_kinds(kinds)
    if fixed:
        _recheck(campaign, output, model, json, report, scene)
        return
    check_outputs(output, json, report, scene, inputs=(*jobs.files_of_campaign(campaign), *([model] if model else [])))
    with working() as progress:
        result = diagnose_campaign(campaign, model, progress)
    page = None
    if report is not None:
        from drake_stiffness.report.diagnosis import diagnosis_report

        page = diagnosis_report(result)
    space = None
    if scene is not None:
        from drake_stiffness.report.diagnosis_scene import scene_html

        space = scene_html(result.diagnosis)
    model_text, document = json_of(result.model.to_dict()), json_of(result.document)
    write((output, model_text), (json, document), (report, page), (scene, space))
    show_diagnosis(console(), result)


def _recheck(
    campaign: Path, output: Path | None, model: Path | None, json: Path | None, report: Path | None, scene: Path | None
) -> None:
    """Hold a stored model against a short campaign."""
    from drake_stiffness import jobs
    from drake_stiffness.diagnosis.recheck_job import recheck_campaign
    from drake_stiffness.diagnosis.recheck_words import show_recheck
    from drake_stiffness.errors import InputError

    if model is None:
        raise InputError("--fixed asks whether a stored model is still true: name it with --model MODEL.json.")
    check_outputs(output, json, report, scene, inputs=(*jobs.files_of_campaign(campaign), model))
    with working() as progress:
        result = recheck_campaign(campaign, model, progress)
    page = None
    if report is not None:
        from drake_stiffness.report.recheck import recheck_report

        page = recheck_report(result)
    space = None
    if scene is not None:
        from drake_stiffness.report.diagnosis_scene import scene_between

        found = result.recheck
        space = scene_between(found.left.scene.model, found.settled.model, found.left.scene.o)
    model_text, document = json_of(result.model.to_dict()), json_of(result.document)
    write((output, model_text), (json, document), (report, page), (scene, space))
    show_recheck(console(), result)
