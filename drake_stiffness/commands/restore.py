"""`drake-stiffness restore`: the complete model from its identifiable part and limits of link sections."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from drake_stiffness.commands.console import (
    JsonOption,
    ReportOption,
    check_outputs,
    console,
    json_of,
    say,
    working,
    write,
)
from drake_stiffness.errors import InputError

if TYPE_CHECKING:
    from rich.console import Console

    from drake_stiffness.model import Model
    from drake_stiffness.restoration.restoration import Restoration
    from drake_stiffness.task import Task

# Columns of a terminal that has room for the rules.
_WIDE = 150


def restore(
    model: Annotated[Path, typer.Argument(help="MODEL.json")],
    output: Annotated[Path, typer.Option("-o", "--output", help="RESTORED.json to write")],
    sections: Annotated[
        Path | None, typer.Option(help="SECTIONS.yaml; without it, limits that cover common castings")
    ] = None,
    campaign: Annotated[
        Path | None, typer.Option(help="campaign.yaml of the model; needed for a reduced model, shows held-out errors")
    ] = None,
    json: JsonOption = None,
    report: ReportOption = None,
) -> None:
    """Restore removed and unidentified compliances as intervals from beam mechanics."""
    from drake_stiffness.jobs import provenance
    from drake_stiffness.model import load_model
    from drake_stiffness.restoration import restoration
    from drake_stiffness.restoration.sections import Sections, read_sections
    from drake_stiffness.task import read_task

    given = tuple(path for path in (model, sections, campaign) if path is not None)
    check_outputs(output, json, report, inputs=given)
    loaded = load_model(model)
    stated = Sections() if sections is None else read_sections(sections)
    with working() as progress:
        task = None if campaign is None else read_task(campaign, progress)
        if task is not None:
            _check_origin(loaded, model, task)
        progress("restoring")
        result = restoration.restore(loaded, stated, None if task is None else task.observations())
        errors = None if task is None or not task.held.any() else restoration.held_out(loaded, result.model, task)
    files = {"model": model, "sections": sections, "campaign": campaign}
    made = provenance({name: path for name, path in files.items() if path is not None}, None)
    content = result.model.to_dict()
    content["provenance"] = loaded.provenance | {"restoration": {key: made[key] for key in ("program", "inputs")}}
    page = None
    if report is not None:
        from drake_stiffness.report.restoration import restoration_report

        page = restoration_report(result, loaded, errors)
    summary = result.to_dict() | {"held_out_rms_mm": None if errors is None else list(errors)}
    write((output, json_of(content)), (json, json_of(summary)), (report, page))
    for line in loaded.doubts():
        say(f"warning: said of the model when it was identified: {line}")
    for line in result.notes:
        say(f"note: {line}")
    _show(console(), result, errors)


def _check_origin(loaded: Model, model: Path, task: Task) -> None:
    """Raise InputError unless the model was identified from this campaign's readings."""
    from drake_stiffness.files import sha256

    made = loaded.provenance.get("inputs", {}).get("measurements", {})
    if made.get("sha256") != sha256(task.table_path):
        raise InputError(
            f"--campaign {task.path}: its readings ({task.table_path}) are not those that {model} was identified from "
            f"({made.get('file', 'unknown')}, another SHA-256). Give the campaign of the model, or identify it again."
        )


def _show(console: Console, result: Restoration, errors: tuple[float, float] | None) -> None:
    """Restored entries with their intervals, and what the restoration did to the rest."""
    from rich.table import Table

    wide = console.width >= _WIDE
    table = Table(title=f"{result.number.size} entries: {result.label}")
    for name in ("entry", "low", "value", "high", "unit", *(("low is held by", "high is held by") if wide else ())):
        table.add_column(name, justify="right" if name in ("low", "value", "high") else "left", no_wrap=True)
    for entry, held in zip(result.model.restored, result.rules, strict=True):
        numbers = (f"{entry[key]:.3g}" for key in ("low", "value", "high"))
        strongest = [words.split(" and ")[0] for words in held] if wide else []
        table.add_row(entry["name"], *numbers, entry["unit"], *strongest)
    console.print(table)
    if not wide:
        console.print("What holds each end: in RESTORED.json (restored, from), the report, or a wider terminal.")
    moved = f"moved by {result.departure:.2g} sigma of all together" if result.departure else "untouched"
    console.print(
        f"Identified combinations: {moved}. Every link matrix is positive definite (smallest over largest eigenvalue "
        f"{min(result.smallest.values()):.1e}, in units of the components' scales)."
    )
    if errors is not None:
        console.print(f"Held-out postures: {errors[0]:.4f} mm rms before, {errors[1]:.4f} mm rms restored.")
