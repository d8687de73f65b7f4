"""What a UR10's geometry alone lacks, found on one series of readings, and whether it holds on another.

Run: python examples/ur10/diagnose.py FOLDER_B FOLDER_C [--svg FILE]

Each folder holds cell.yaml, campaign.yaml and what they name (the UR10 series of the ipa-robot-accuracy set, rewritten in the format of
docs/reference.md), with rigid springs: geometry only. `diagnose` runs on B. Then what it named is taken off the readings of C with
B's values, geometry is fitted to a half of C as if it had never been otherwise, and the other half says whether that helped.
"""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
from rich.console import Console
from rich.table import Table

from drake_stiffness.diagnosis.job import Diagnosed, diagnose_campaign
from drake_stiffness.diagnosis.signatures import extended
from drake_stiffness.diagnosis.words import show_diagnosis
from drake_stiffness.effects import Effect
from drake_stiffness.identification import identify
from drake_stiffness.model import Model
from drake_stiffness.observation import residual_m, restrict
from drake_stiffness.simulation import simulate_readings
from drake_stiffness.start import starting_model
from drake_stiffness.task import Task, read_task


def moved_by(model: Model, kept: list[bool], task: Task) -> np.ndarray:
    """(M, 3) by how much the effects that are not kept move the readings of a campaign, m."""
    m = task.measurements
    without = model.subset(kept)
    ends = [simulate_readings(x, m.cases, m.case, m.point).p for x in (model, without)]
    return np.asarray((ends[0] - ends[1]).T)


def geometry(task: Task, taken_off: np.ndarray | float = 0.0, further: Sequence[Effect] = ()) -> tuple[Model, float]:
    """Geometry and further effects fitted to one half, and the 3-D RMS on the other, mm."""
    m = task.measurements
    assert m.position is not None
    task = replace(task, measurements=replace(m, position=m.position - taken_off))
    fit = identify(starting_model(task.model, restrict(task.measurements, ~task.held)), task.observations(~task.held))
    if further:
        model = fit.model
        for effect in further:
            model = extended(model, effect)
        fit = identify(model, task.observations(~task.held))
    r = residual_m(task.observations(task.held), fit.model)
    return fit.model, float(np.sqrt((r**2).sum(axis=0).mean())) * 1e3


def transfer(found: Diagnosed, task: Task) -> list[tuple[str, float]]:
    """Held-out RMS on another series: geometry alone, with what was named on the first and its values, with its form and own values."""
    named = [n.effect for n in found.diagnosis.search.named]
    own, rms = geometry(task)
    rows = [("geometry alone", rms)]
    # Tracker, reflector and geometry are those of the series at hand; only what was named keeps the first one's values.
    known = dict(zip(own.names, own.x.tolist(), strict=True))
    model = found.model
    model = model.with_x(np.array([known.get(name, x) for name, x in zip(model.names, model.x, strict=True)]))
    wanted = [("with all that B named", named), *((f"{e.kind} at {e.where}", [e]) for e in named)]
    for label, effects in wanted:
        kept = [e not in effects for e in model.effects]
        rows.append((label, geometry(task, moved_by(model, kept, task))[1]))
    form = [e for e in named if e.kind in ("joint_compliance", "joint_periodic_error")]
    rows.append(("compliance and harmonics of B, values of its own", geometry(task, further=form)[1]))
    return rows


def main() -> None:
    """Print the diagnosis of B and how it does on C."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("series", type=Path, nargs=2, metavar="FOLDER")
    parser.add_argument("--svg", type=Path, help="figure to write")
    arguments = parser.parse_args()
    console, log = Console(highlight=False), Console(stderr=True, highlight=False)
    found = diagnose_campaign(
        arguments.series[0] / "campaign.yaml", progress=lambda text: log.print(text, markup=False)
    )
    show_diagnosis(console, found)
    rows = transfer(found, read_task(arguments.series[1] / "campaign.yaml"))
    table = Table(title="The other series, held-out half: geometry refitted, effects with the first one's values")
    table.add_column("model")
    table.add_column("3-D RMS, mm", justify="right")
    for label, rms in rows:
        table.add_row(label, f"{rms:.4f}")
    console.print(table)
    if arguments.svg:
        from figure import draw

        draw(found.task, found.diagnosis.search.base.model, found.model, rows, arguments.svg)


if __name__ == "__main__":
    main()
