"""`drake-stiffness reduce`: reduced models compared on held-out experiments."""

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
from drake_stiffness.errors import InputError, UntrustworthyError

if TYPE_CHECKING:
    from drake_stiffness.model import Model
    from drake_stiffness.reduction.comparison import Comparison
    from drake_stiffness.task import Task


def reduce(
    campaign: Annotated[Path, typer.Argument(help="campaign.yaml")],
    output: Annotated[
        Path | None, typer.Option("-o", "--output", help="write the model of --method, or the recommended one")
    ] = None,
    method: Annotated[
        str, typer.Option(help="all, or names joined by commas: joints m1 m2 m3 sequential base none prior")
    ] = "all",
    upper: Annotated[float, typer.Option(help="v0+: what falls below this ratio is dropped")] = 5.0,
    lower: Annotated[float, typer.Option(help="v0-: sorts what was dropped into G1~ and G1-")] = 2.0,
    fit: Annotated[str, typer.Option(help="how m3, sequential and base are fitted: least-squares or sdp")] = (
        "least-squares"
    ),
    spread: Annotated[float, typer.Option(help="of the beam prior: 0.5 is half a typical link's entry")] = 0.5,
    hold_out: Annotated[
        float | None, typer.Option(help="fraction of postures; default the campaign's own, else 0.25; 0 holds none")
    ] = None,
    seed: Annotated[int, typer.Option(min=0, help="of --hold-out")] = 0,
    json: JsonOption = None,
    report: ReportOption = None,
) -> None:
    """Compare reduced models on held-out experiments, write one of them."""
    from drake_stiffness import jobs
    from drake_stiffness.reduction.comparison import METHODS, compare_reductions

    methods = tuple(METHODS) if method == "all" else tuple(name.strip() for name in method.split(","))
    if fit not in ("least-squares", "sdp"):
        raise InputError(f"--fit: found '{fit}'; expected least-squares or sdp.")
    check_outputs(output, json, report, inputs=jobs.files_of_campaign(campaign))
    with working() as progress:
        task = _task(campaign, hold_out, seed, progress)
        beside = methods if "joints" in methods else ("joints", *methods)
        result = compare_reductions(task, beside, upper, lower, fit=fit, spread=spread, progress=progress)  # type: ignore[arg-type]
    page = None
    if report is not None:
        from drake_stiffness.report.reduction import reduction_report

        page = reduction_report(result)
    model = None if output is None else _chosen(result, methods, task, seed if hold_out else None)
    _show(result)
    write(
        (output, None if model is None else json_of(model.to_dict())), (json, json_of(result.to_dict())), (report, page)
    )
    if model is not None:
        say(f"{output}: {model.fit['reduction']['method']}, {model.x.size} parameters")
        for line in model.doubts():
            say(f"warning: {line}")


def _task(path: Path, fraction: float | None, seed: int, progress: object) -> Task:
    """The campaign with the hold-out that was asked for."""
    from dataclasses import replace

    import numpy as np

    from drake_stiffness.campaign import HoldOut
    from drake_stiffness.hold_out import held_out_experiments
    from drake_stiffness.task import read_task

    task = read_task(path, progress)  # type: ignore[arg-type]
    if fraction is not None and not 0 <= fraction < 1:
        raise InputError(f"--hold-out: found {fraction}; expected a fraction from 0 to below 1.")
    if fraction == 0:
        return replace(task, held=np.zeros(task.held.size, dtype=bool))
    if fraction is None and task.held.any():
        return task
    wanted = HoldOut(fraction=0.25 if fraction is None else fraction, seed=seed)
    return replace(task, held=held_out_experiments(task.measurements, wanted, str(path)))


def _chosen(result: Comparison, methods: tuple[str, ...], task: Task, seed: int | None) -> Model:
    """The model to write: of the one method asked for, or the recommended one."""
    from dataclasses import replace

    from drake_stiffness.jobs import provenance

    name = methods[0] if len(methods) == 1 else result.recommended
    if not name:
        raise InputError("no method is recommended without held-out experiments; name one with --method.")
    rows = [row for row in result.rows if row.method == name]
    if not rows:
        raise InputError(f"--method {name}: this template is the cell's own; take --method none.")
    if rows[0].model is None:
        raise UntrustworthyError(f"{rows[0].label}: {rows[0].note}")
    model = rows[0].model
    if seed is None and task.campaign.hold_out is not None:
        seed = task.campaign.hold_out.seed
    entry = model.fit | {
        "experiments": {"fitted": result.fitted, "held_out": result.held},
        "reduction": {"method": name, "upper": result.upper, "lower": result.lower} | result.choice(rows[0]),
    }
    return replace(model, fit=entry, provenance=provenance(task.files, seed))


def _show(result: Comparison) -> None:
    """The table and the recommendation."""
    from rich.table import Table

    from drake_stiffness.reduction.comparison import RULE
    from drake_stiffness.report.reduction import HEADER, answer, cells

    out = console()
    table = Table(title=f"{result.fitted} experiments fitted, {result.held} held out; v0+ = {result.upper:g}")
    for name in HEADER:
        table.add_column(name, justify="left" if name == "method" else "right")
    for row in result.rows:
        table.add_row(row.method, *(cells(row) if row.model is not None else ["-"] * (len(HEADER) - 1)))
    out.print(table)
    for row in result.rows:
        out.print(f"{row.method}: {row.label}", markup=False)
        if row.note:
            out.print(f"! {row.method}: {row.note}", markup=False)
        between = [d.name for d in row.dropped if result.group(d.ratio) == "G1~"]
        if between:
            out.print(f"! {row.method} drops {len(between)} of class G1~: {', '.join(between)}", markup=False)
    out.print(answer(result), markup=False)
    out.print(RULE, markup=False)
