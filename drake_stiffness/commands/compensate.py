"""`drake-stiffness compensate`: a milling program is corrected."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from drake_stiffness.commands.console import (
    BesideOption,
    DialectOption,
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


def compensate(
    program: Annotated[
        Path, typer.Argument(help="KRL, RAPID, Fanuc .ls, URScript, VAL3 .pgx, APT, G-code or waypoints")
    ],
    model: Annotated[Path, typer.Option(help="MODEL.json")],
    process: Annotated[Path, typer.Option(help="process.yaml")],
    output: Annotated[
        Path | None, typer.Option("-o", "--output", help="corrected program to write; not needed with --dry-run")
    ] = None,
    beside: BesideOption = None,
    allow_insert: Annotated[bool, typer.Option(help="Insert words a correction needs and a line lacks.")] = False,
    keep_refused: Annotated[bool, typer.Option(help="Leave motions that cannot be corrected as they are.")] = False,
    linearise: Annotated[
        float | None,
        typer.Option(
            metavar="TOL", help="Replace arcs of G-code and APT by straight moves within TOL mm of them first."
        ),
    ] = None,
    linear: Annotated[
        bool, typer.Option("--linear", help="Superpose deflections instead of finding the loaded equilibrium: quicker.")
    ] = False,
    spin: Annotated[
        str, typer.Option(help="keep, or stiffest: turn the tool about its axis where the arm bends least")
    ] = "keep",
    dialect: DialectOption = None,
    dry_run: Annotated[
        bool, typer.Option("--dry-run", help="Do everything, exit code included, but write no program.")
    ] = False,
    measured: Annotated[
        Path | None, typer.Option(help="CSV of what a probe found on the cut part: its deviation is corrected too.")
    ] = None,
    cut_with: Annotated[
        str,
        typer.Option(
            help="What cut the probed part: uncorrected (PROGRAM itself) or corrected (what this makes of it)"
        ),
    ] = "uncorrected",
    handover: Annotated[
        Path | None, typer.Option(help="Folder to write what the probe found into, as a campaign for `diagnose`.")
    ] = None,
    points: Annotated[
        Path | None, typer.Option(help="CSV to write: every point with its residual and interval.")
    ] = None,
    scene: Annotated[
        Path | None, typer.Option(help="HTML page to write: arm and path in 3-D (Meshcat, 2 MB; needs Drake)")
    ] = None,
    kinds: KindsOption = None,
    json: JsonOption = None,
    report: ReportOption = None,
) -> None:
    """Correct a milling program; needs neither Drake nor cvxpy (but for --scene)."""
    from drake_stiffness import text
    from drake_stiffness.model import load_model
    from toolpaths.account.points_table import points_csv
    from toolpaths.formats import naming_notes, read_program
    from toolpaths.job import compensate as run
    from toolpaths.linearise import linearise as linearised
    from toolpaths.long_programs import compensate_file
    from toolpaths.probing.probe import read_probe
    from toolpaths.process import read_process

    if spin not in ("keep", "stiffest"):
        raise InputError(f"--spin: found '{spin}'; expected keep or stiffest.")
    if cut_with not in ("uncorrected", "corrected"):
        raise InputError(f"--cut-with: found '{cut_with}'; expected uncorrected or corrected.")
    if output is None and not dry_run:
        raise InputError("-o OUT is missing: name the corrected program, or try with --dry-run.")
    if handover is not None and measured is None:
        raise InputError("--handover: there is nothing to hand over without --measured PROBE.csv.")
    use_kinds(kinds)
    inputs = (program, model, process, *(beside or ()), *([measured] if measured else []))
    check_outputs(output, json, report, points, scene, handover and handover / "campaign.yaml", inputs=inputs)
    probe = read_probe(measured) if measured else None
    loaded, job = load_model(model), read_process(process)
    with working() as progress:
        progress("reading the program")

        def said(what: str, done: int, total: int) -> None:
            progress(f"{what}: {done} of {total}" if total else f"{what}: {done}")

        in_pieces = linearise is None and spin == "keep" and probe is None and points is None and not beside
        if in_pieces:
            result = compensate_file(
                program,
                loaded,
                job,
                dialect=dialect,
                allow_insert=allow_insert,
                keep_refused=keep_refused,
                linear=linear,
                output=None if dry_run else output,
                progress=said,
            )
        else:
            source = read_program(program, dialect, beside or ())
            if linearise is not None:
                source = linearised(source, linearise)
            result = run(
                source,
                loaded,
                job,
                allow_insert=allow_insert,
                keep_refused=keep_refused,
                linear=linear,
                spin=spin,  # type: ignore[arg-type]
                probe=probe,
                cut_with=cut_with,  # type: ignore[arg-type]
                progress=said,
            )
    result.notes.extend(naming_notes(result.program, output) if output is not None else ())
    page = space = None
    if report is not None:
        from drake_stiffness.report import compensation_report

        page = compensation_report(result, loaded)
    if scene is not None:
        from drake_stiffness.report.compensation_scene import scene_html

        space = scene_html(result, loaded)
    passed_on: list[tuple[Path, str]] = []
    if handover is not None and result.learnt is not None:
        from toolpaths.probing.handover import campaign_files

        files = campaign_files(loaded, job, result.path, result.learnt)
        passed_on = [(handover / name, content) for name, content in files.items()]
    programs = [] if output is None or dry_run else result.files(output)
    table = points_csv(result) if points is not None else None
    write(
        *programs,
        *passed_on,
        (json, json_of(result.to_dict())),
        (report, page),
        (scene, space),
        (points, table),
    )
    text.show_compensation(console(), result, None if dry_run else output)
