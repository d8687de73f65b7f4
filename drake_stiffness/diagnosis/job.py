"""`diagnose` as a function of files."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from drake_stiffness import statistics as st
from drake_stiffness.diagnosis.diagnosis import Diagnosis, diagnose, task_seed
from drake_stiffness.diagnosis.document import diagnosis_document
from drake_stiffness.diagnosis.next_experiment import next_experiment
from drake_stiffness.errors import InputError
from drake_stiffness.jobs import provenance
from drake_stiffness.model import Model, load_model
from drake_stiffness.model_form import model_form
from drake_stiffness.semidefinite import smallest_eigenvalue
from drake_stiffness.task import Task, quiet, read_task


@dataclass(frozen=True, eq=False)
class Diagnosed:
    """What `diagnose` hands back.

    Attributes
    ----------
    task : Task
    diagnosis : Diagnosis
    model : Model
        The base model with the named effects, all values refitted.
    document : dict
        The content of `diagnosis.json`.
    """

    task: Task
    diagnosis: Diagnosis
    model: Model
    document: dict[str, Any]


def diagnose_campaign(
    path: Path | str, model: Path | None = None, progress: Callable[[str], None] = quiet
) -> Diagnosed:
    """Diagnose a campaign (command `diagnose`)."""
    task = read_task(path, progress)
    d = diagnose(task, progress, _start(task, model))
    final = _model(task, d)
    assert final.statistics is not None
    sigma = dict(zip(final.names, final.statistics.sigma.tolist(), strict=True))
    progress("planning the next experiment")
    plan = next_experiment(task, d)
    return Diagnosed(task, d, final, diagnosis_document(d, sigma, None if plan is None else plan.to_dict()))


def _start(task: Task, path: Path | None) -> Model | None:
    """The task's model with the values that a stored model has for the same parameters."""
    if path is None:
        return None
    stored = load_model(path)
    if stored.arm.joint_names != task.arm.joint_names:
        raise InputError(
            f"{path}: a model of joints {', '.join(stored.arm.joint_names)}; the campaign is of {', '.join(task.arm.joint_names)}."
        )
    known = dict(zip(stored.names, stored.x.tolist(), strict=True))
    model = task.model
    return model.with_x(np.array([known.get(name, x) for name, x in zip(model.names, model.x, strict=True)]))


def _model(task: Task, d: Diagnosis) -> Model:
    """The final model with its statistics."""
    solution, o = d.search.solution, d.observations
    fit = st.goodness(solution, o)
    numbers, how = st.statistics(solution, o, fit)
    entry = st.fit_entry(solution, fit, d.after.rms_mm, "sdp", smallest_eigenvalue(solution.model), how)
    entry["quantity"] = task.campaign.quantity
    entry["model_form"] = model_form(solution, numbers, o)
    entry["warnings"] = st.warnings_of(solution, numbers, fit, o, how)
    entry["diagnosis"] = {"verdict": d.verdict, "named": [n.tested.suspect.name for n in d.search.named]}
    return st.attach(solution, numbers, entry, provenance(task.files, task_seed(task)))
