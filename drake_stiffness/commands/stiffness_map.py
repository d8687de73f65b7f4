"""`drake-stiffness map`: how stiff the cell is place by place, and where a workpiece lies best."""

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
    no_program_of,
    use_kinds,
    working,
    write,
)
from drake_stiffness.errors import InputError

# Half the side of the square that is looked at where no area is given, m.
_AROUND = 0.5
_MOST_PLACES = 20000


def stiffness_map(
    model: Annotated[Path, typer.Option(help="MODEL.json")],
    process: Annotated[Path, typer.Option(help="process.yaml")],
    program: Annotated[Path | None, typer.Option(help="program to place; default: one tool point a place")] = None,
    area: Annotated[
        str | None,
        typer.Option(help="world, metres: x0:x1,y0:y1 or x0:x1,y0:y1,z0:z1; default: a metre around the workpiece"),
    ] = None,
    step_mm: Annotated[float, typer.Option(min=1.0, help="distance of places")] = 100.0,
    output: Annotated[Path | None, typer.Option("-o", "--output", help="table to write, CSV")] = None,
    beside: BesideOption = None,
    dialect: DialectOption = None,
    kinds: KindsOption = None,
    json: JsonOption = None,
    report: ReportOption = None,
) -> None:
    """Map the stiffness of the cell: deflection per 100 N, best place for the workpiece; needs neither Drake nor cvxpy."""
    from drake_stiffness.map_text import show_map
    from drake_stiffness.model import load_model
    from toolpaths.formats import read_program
    from toolpaths.process import check_model, read_process
    from toolpaths.rotary import declare
    from toolpaths.stiffness_map import grid
    from toolpaths.stiffness_map import stiffness_map as run

    use_kinds(kinds)
    no_program_of(program, beside, dialect)
    inputs = tuple(path for path in (model, process, program, *(beside or ())) if path is not None)
    check_outputs(output, json, report, inputs=inputs)
    loaded, job = load_model(model), read_process(process)
    check_model(job, loaded)
    low, high = _box(area, job.workpiece.position_m)
    places = grid(low, high, step_mm * 1e-3)
    if len(places) > _MOST_PLACES:
        raise InputError(
            f"--area and --step-mm make {len(places)} places; at most {_MOST_PLACES} are mapped. Widen the step."
        )
    with working() as progress:
        progress(f"{len(places)} places")
        source = None
        if program is not None:
            source = declare(read_program(program, dialect, beside or ()), job.gcode, process)
        found = run(loaded, job, places, source)
    best = found.best  # refuses an area that cannot be machined before anything is written
    page = None
    if report is not None:
        from drake_stiffness.report.stiffness_map import map_report

        page = map_report(found, loaded, job)
    write((output, found.csv()), (json, json_of(found.to_dict())), (report, page))
    show_map(console(), found, best)


def _box(area: str | None, around: tuple[float, float, float]) -> tuple[list[float], list[float]]:
    """Corners of the area, m."""
    if area is None:
        x, y, z = around
        return [x - _AROUND, y - _AROUND, z], [x + _AROUND, y + _AROUND, z]
    expected = "expected x0:x1,y0:y1 or x0:x1,y0:y1,z0:z1 in metres of the world frame, for example 1.2:2.0,-0.5:0.5"
    try:
        ends = [tuple(float(end) for end in part.split(":")) for part in area.split(",")]
    except ValueError:
        raise InputError(f"--area: found '{area}'; {expected}.") from None
    if len(ends) not in (2, 3) or any(len(pair) not in (1, 2) or pair[0] > pair[-1] for pair in ends):
        raise InputError(f"--area: found '{area}'; {expected}, the smaller end first.")
    if len(ends) == 2:
        ends.append((around[2],))
    if any(abs(end) > 100 for pair in ends for end in pair):
        raise InputError(f"--area: found '{area}', more than 100 m away; {expected} (not millimetres).")
    return [pair[0] for pair in ends], [pair[-1] for pair in ends]
