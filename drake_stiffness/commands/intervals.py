"""`drake-stiffness intervals`: how far every value may lie, physics included."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

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
    from drake_stiffness.identification import Solution
    from drake_stiffness.intervals.interval import Interval
    from drake_stiffness.observation import Observations
    from drake_stiffness.task import Task


def intervals(
    campaign: Annotated[Path, typer.Argument(help="campaign.yaml")],
    parameter: Annotated[list[str] | None, typer.Option(help="One parameter; may be repeated.")] = None,
    every: Annotated[bool, typer.Option("--all", help="All parameters (the default).")] = False,
    base: Annotated[bool, typer.Option("--base", help="The combinations that the readings determine.")] = False,
    deflection: Annotated[
        Path | None, typer.Option(help="PLAN.csv: the deflections at its poses, loads and points.")
    ] = None,
    level: Annotated[float, typer.Option(help="Probability that an interval covers the truth.")] = 0.95,
    json: JsonOption = None,
    report: ReportOption = None,
) -> None:
    """Profile-likelihood intervals: identified, bounded by physics alone, or unbounded."""
    from drake_stiffness.jobs import files_of_campaign, provenance
    from drake_stiffness.task import read_task
    from drake_stiffness.text import show_intervals

    if every and parameter:
        raise InputError("--all and --parameter: give one of them; --all is every parameter already.")
    if every and base:
        raise InputError(
            "--all and --base: give one of them. --all is every parameter on its own, --base the combinations that the readings determine; "
            "single parameters can stand beside the latter: --base --parameter joint_1."
        )
    if not 0.0 < level < 1.0:
        raise InputError(f"--level: found {level:g}; expected a probability between 0 and 1, 0.95 say.")
    inputs = (*files_of_campaign(campaign), *([deflection] if deflection else []))
    check_outputs(json, report, inputs=inputs)
    with working() as progress:
        task = read_task(campaign, progress)
        solution, observations = _solved(task, progress)
        found: dict[str, tuple[Interval, ...]] = {}
        if every or parameter or not (base or deflection):
            progress("intervals of parameters")
            found["parameters"] = _of_parameters(solution, observations, parameter, level)
        if base:
            progress("intervals of base parameters")
            found["base"] = _of_base(solution, observations, level)
        if deflection is not None:
            progress("intervals of deflections")
            found["deflections"] = _of_deflections(solution, observations, task, deflection, level)
    warnings = _warnings(found)
    made = provenance({**task.files, **({"plan": deflection} if deflection else {})}, None)
    content: dict[str, Any] = {"level": level}
    content |= {part: [_entry(one) for one in some] for part, some in found.items()}
    content |= {"warnings": warnings, "provenance": made}
    page = None
    if report is not None:
        from drake_stiffness.report.intervals import intervals_report

        page = intervals_report(found, level, campaign.name, warnings)
    write((json, json_of(content)), (report, page))
    show_intervals(console(), found)
    for line in warnings:
        say(f"warning: {line}")


def _solved(task: Task, progress: Any) -> tuple[Solution, Observations]:
    from drake_stiffness.campaign import naming_the_step
    from drake_stiffness.identification import identify
    from drake_stiffness.start import starting_model

    fitted, observations = task.taking_part(), task.observations()
    with naming_the_step(fitted):
        return identify(starting_model(task.model, fitted), observations, "sdp", progress), observations


def _of_parameters(solution: Solution, o: Observations, names: list[str] | None, level: float) -> tuple[Interval, ...]:
    from drake_stiffness.intervals.profile import profile_intervals

    return profile_intervals(solution, o, names or None, level)


def _of_base(solution: Solution, o: Observations, level: float) -> tuple[Interval, ...]:
    from drake_stiffness.intervals.profile import base_combinations, profile_intervals

    return profile_intervals(solution, o, base_combinations(solution), level)


def _of_deflections(solution: Solution, o: Observations, task: Task, plan: Path, level: float) -> tuple[Interval, ...]:
    import numpy as np

    from drake_stiffness.campaign import naming_the_step, read_measurements
    from drake_stiffness.intervals.deflection import deflection_intervals

    model = solution.model
    m = read_measurements(plan, task.arm, tuple(model.points), model.load_point, readings=False)
    loaded = np.flatnonzero(~m.unloaded[m.case])
    if not loaded.size:
        raise InputError(f"{plan}: every row is unloaded; a deflection needs a wrench (fx_N .. mz_Nm).")
    case, point = m.case[loaded], m.point[loaded]
    experiment, step = m.cases.experiment, m.cases.step
    names = [f"{m.experiments[experiment[i]]}:{step[i]} {p}" for i, p in zip(case, point, strict=True)]
    with naming_the_step(m):
        return deflection_intervals(solution, o, m.cases, case, point, names, level)


def _entry(one: Interval) -> dict[str, Any]:
    """An interval in SI; null stands for infinite ends and for what (14) does not give."""
    low, high = one.plain
    return {
        "name": one.name,
        "unit": one.unit,
        "value": one.value,
        "low": one.low,
        "high": one.high,
        "status": one.status,
        "sigma": one.sigma,
        "profile_low": one.profile[0],
        "profile_high": one.profile[1],
        "eq14_low": low,
        "eq14_high": high,
        "noise_factor": one.noise_factor,
    }


def _warnings(found: dict[str, tuple[Interval, ...]]) -> list[str]:
    """What the intervals rest on that is not evidence."""
    everything = [one for some in found.values() for one in some]
    lines = []
    factor = max((one.noise_factor for one in everything), default=1.0)
    if factor != 1.0:
        lines.append(
            f"NOISE REJECTED: chi-square rejects the stated noise; intervals are widened by the root of chi-square per degree of freedom "
            f"({factor**0.5:.3g}), which is honest only if what is missing acts like noise."
        )
    for part, some in found.items():
        loose = sum(one.status == "bounded, not identified" for one in some)
        free = sum(one.status == "unbounded" for one in some)
        if loose:
            lines.append(
                f"BOUNDED, NOT IDENTIFIED: {loose} of {len(some)} {part} have ends only because compliances are positive semidefinite; "
                "no reading tells where in between the value lies."
            )
        if free:
            lines.append(f"UNBOUNDED: nothing limits {free} of {len(some)} {part}, neither readings nor physics.")
    return lines
