"""`drake-stiffness simulate`: a virtual campaign."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Annotated

import typer

from drake_stiffness.commands.console import (
    JsonOption,
    KindsOption,
    check_outputs,
    json_of,
    say,
    use_kinds,
    working,
    write,
)
from drake_stiffness.errors import InputError


def simulate(
    cell: Annotated[Path, typer.Argument(help="cell.yaml")],
    truth: Annotated[Path, typer.Option(help="TRUTH.yaml: effects with values")],
    plan: Annotated[Path, typer.Option(help="PLAN.csv: postures and loads")],
    output: Annotated[Path, typer.Option("-o", "--output", help="Folder for the virtual campaign")],
    noise_mm: Annotated[float, typer.Option(min=0.0, help="Standard deviation of one coordinate")] = 0.0,
    seed: Annotated[int, typer.Option(min=0)] = 0,
    kinds: KindsOption = None,
    json: JsonOption = None,
) -> None:
    """Make a virtual campaign from the loaded equilibrium (for planning; truth is elsewhere)."""
    from drake_stiffness import jobs

    use_kinds(kinds)
    check_outputs(json, inputs=(cell, truth, plan))
    if output.is_dir():
        check_outputs(output / "campaign.yaml", output / "measurements.csv", inputs=(cell, truth, plan))
    if not math.isfinite(noise_mm):
        raise InputError(f"--noise-mm: found {noise_mm}; expected a finite number, mm.")
    with working() as progress:
        progress("simulating")
        result = jobs.simulate(cell, truth, plan, output, noise_mm, seed)
    made = not output.exists()
    try:
        output.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise InputError(f"{output}: cannot be made ({error.strerror}); give a folder that can be written.") from None
    summary = {
        "files": [str(output / name) for name in result.files],
        "displacement_rms_mm": result.displacement_rms_mm,
        "displacement_max_mm": result.displacement_max_mm,
        "noise_mm": noise_mm,
        "seed": seed,
    }
    write(*((output / name, content) for name, content in result.files.items()), (json, json_of(summary)))
    say(
        f"{output}{' (new)' if made else ''}: {', '.join(result.files)}; displacement {result.displacement_rms_mm:.3f} mm rms, "
        f"{result.displacement_max_mm:.3f} mm at most"
    )
