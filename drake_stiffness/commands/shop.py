"""`drake-stiffness shop`: a plan becomes a robot program and a load sheet."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Annotated

import typer

from drake_stiffness.commands.console import JsonOption, check_outputs, json_of, say, working, write
from drake_stiffness.errors import InputError


def shop(
    plan: Annotated[Path, typer.Argument(help="PLAN.csv: postures and loads")],
    cell: Annotated[Path, typer.Option(help="cell.yaml")],
    krl: Annotated[Path | None, typer.Option(help="KRL program to write; the file's name is the program's")] = None,
    sheet: Annotated[Path | None, typer.Option(help="load sheet to write, HTML for printing")] = None,
    ordered: Annotated[Path | None, typer.Option(help="the plan in the order it is driven, CSV")] = None,
    order: Annotated[str, typer.Option(help="plan, short or random")] = "plan",
    seed: Annotated[int, typer.Option(min=0, help="of the random order")] = 0,
    axis: Annotated[list[str] | None, typer.Option(help="word of a joint, A2=joint_2-90; may be repeated")] = None,
    speed_percent: Annotated[int, typer.Option(help="of the axes' speeds, 1 to 50")] = 10,
    tool_number: Annotated[int | None, typer.Option(min=1, max=99, help="TOOL_DATA and LOAD_DATA to switch on")] = None,
    via_deg: Annotated[
        str | None, typer.Option(help="posture to pass between experiments, a number per joint (mm if prismatic)")
    ] = None,
    json: JsonOption = None,
) -> None:
    """Write the robot program and the load sheet of a plan."""
    from drake_stiffness.shop import work as job
    from drake_stiffness.shop.plan_program import check_name

    if krl is None and sheet is None and ordered is None:
        raise InputError("nothing to write: give --krl PROGRAM.src, --sheet SHEET.html or --ordered PLAN.csv.")
    check_outputs(krl, sheet, ordered, json, inputs=(plan, cell))
    if krl is not None:
        if krl.suffix.lower() != ".src":
            raise InputError(f"--krl: found '{krl.name}'; a controller expects a file that ends in .src.")
        check_name(krl.stem)
    if order not in ("plan", "short", "random"):
        raise InputError(f"--order: found '{order}'; expected plan, short or random.")
    via = None if via_deg is None else _numbers(via_deg)
    with working() as progress:
        progress("reading the plan")
        result = job.prepare(
            plan,
            cell,
            name=krl.stem if krl is not None else "plan",
            order=order,  # type: ignore[arg-type]
            seed=seed,
            axes=axis or [],
            speed_percent=speed_percent,
            tool_number=tool_number,
            via=via,
        )
    write(
        (krl, result.program), (sheet, result.sheet), (ordered, result.plan_in_order), (json, json_of(result.to_dict()))
    )
    for line in result.warnings:
        say(f"warning: {line}")
    written = ", ".join(str(path) for path in (krl, sheet, ordered) if path is not None)
    say(
        f"{written}: {len(result.experiments)} experiments, {result.steps} steps; the axis that moves most travels "
        f"{math.degrees(result.travel_rad):.0f} deg in all"
    )


def _numbers(text: str) -> list[float]:
    try:
        return [float(word) for word in text.split(",")]
    except ValueError:
        raise InputError(
            f"--via-deg: found '{text}'; expected numbers with commas between them, one per joint."
        ) from None
