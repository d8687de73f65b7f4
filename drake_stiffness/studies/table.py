"""The table of a study: a row a job, with the scalar entries of its result."""

from __future__ import annotations

import csv
import io
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

from drake_stiffness.files import json_text, write_together
from drake_stiffness.studies.job import Job
from drake_stiffness.studies.state import PROGRAM, State, result_of

FORMAT = "drake-stiffness-study/1"
_LONGEST_TEXT = 200


def rows_of(jobs: Sequence[Job], states: Mapping[str, State], folder: Path) -> list[dict[str, Any]]:
    """A row a job: name, how it ended, the options that are not the same in all jobs, and what came out."""
    values = {name: {json_text(job.given.get(name)) for job in jobs} for job in jobs for name in job.options}
    varied = [name for name, several in values.items() if len(several) > 1]
    rows = []
    for job in jobs:
        state = states.get(job.name)
        row: dict[str, Any] = {"job": job.name, "command": job.command}
        row |= {"exit_code": state.exit_code if state else None, "seconds": state.seconds if state else None}
        row |= {"reason": state.reason if state else "not run yet"}
        row |= {f"options.{name}": job.given.get(name) for name in varied}
        found = {} if state is None else dict(scalars(result_of(folder / job.name)))
        rows.append(row | {name: value for name, value in found.items() if name not in row})
    return rows


def scalars(result: dict[str, Any], before: str = "") -> Iterator[tuple[str, Any]]:
    """Numbers, truth values and short texts with the keys to them ("fit.residual_rms_mm"); `effects` as one text.

    What files came from and what they are is no result: `provenance` and `format` are left out.
    """
    for key, value in result.items():
        name = f"{before}{key}"
        if name in ("provenance", "format"):
            continue
        if isinstance(value, dict):
            yield from scalars(value, f"{name}.")
        elif name == "effects" and isinstance(value, list) and all(isinstance(e, dict) and "kind" in e for e in value):
            yield name, "; ".join(map(_named, value))
        elif value is None or isinstance(value, bool | int | float) or _is_short(value):
            yield name, value


def _is_short(value: Any) -> bool:
    return isinstance(value, str) and len(value) <= _LONGEST_TEXT and "\n" not in value


def _named(effect: dict[str, Any]) -> str:
    """An effect with those it cannot be told from: "joint_backlash at joint_3 = joint_hysteresis at joint_3"."""
    everything = [effect, *effect.get("confounded_with", [])]
    return " = ".join(dict.fromkeys(f"{e['kind']} at {e['where']}" for e in everything))


def write_table(folder: Path, study: Path, rows: Sequence[dict[str, Any]]) -> dict[str, Any]:
    """Write study.json and study.csv; returns the content of the former."""
    content = {
        "format": FORMAT,
        "program": PROGRAM,
        "study": study.name,
        "exit_codes": {
            str(code): sum(row["exit_code"] == code for row in rows)
            for code in sorted({row["exit_code"] for row in rows} - {None})
        },
        "unfinished": sum(row["exit_code"] is None for row in rows),
        "jobs": list(rows),
    }
    names = dict.fromkeys(name for row in rows for name in row)
    out = io.StringIO()
    table = csv.DictWriter(out, list(names), lineterminator="\n")
    table.writeheader()
    table.writerows(rows)
    write_together([(folder / "study.json", json_text(content)), (folder / "study.csv", out.getvalue())])
    return content
