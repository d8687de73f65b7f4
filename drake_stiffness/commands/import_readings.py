"""`drake-stiffness import`: readings exported by a tracker become measurements.csv."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from drake_stiffness.commands.console import JsonOption, check_outputs, console, json_of, say, working, write


def import_(
    map_file: Annotated[Path, typer.Argument(metavar="MAP", help="MAP.yaml: what the columns mean")],
    output: Annotated[Path, typer.Option("-o", "--output", help="measurements.csv to write")],
    json: JsonOption = None,
) -> None:
    """Read a tracker's export, a force log and a robot log into measurements.csv."""
    from drake_stiffness.importing.readings import files_of_map, import_readings

    check_outputs(output, json, inputs=files_of_map(map_file))
    with working() as progress:
        progress("reading the exported files")
        result = import_readings(map_file)
    write((output, result.text), (json, json_of(result.to_dict())))
    out = console()
    out.print(
        f"{output}: {result.rows} readings of {', '.join(result.points)}; {result.experiments} experiments, "
        f"{result.steps} steps.",
        markup=False,
    )
    for what, sigma in (
        ("samples of one step", result.sample_sigma_mm),
        ("steps that repeat a load", result.repeat_sigma_mm),
    ):
        if sigma == sigma:
            out.print(f"Noise of a coordinate seen from {what}: {sigma:.4f} mm.", markup=False)
    for head, lines in (
        ("left out as flagged", result.dropped),
        ("left out, belongs nowhere", result.unmatched),
        ("not read", result.missing),
    ):
        for line in lines:
            out.print(f"! {head}: {line}", markup=False)
    for line in result.warnings:
        say(f"warning: {line}")
