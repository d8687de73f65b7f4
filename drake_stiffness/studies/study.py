"""A study from beginning to end: what is done already, the rest, the table."""

from __future__ import annotations

from collections.abc import Callable, Generator, Sequence
from contextlib import closing
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from drake_stiffness.errors import InputError
from drake_stiffness.studies.input_files import Hashes
from drake_stiffness.studies.job import Job
from drake_stiffness.studies.state import PROGRAM, State, alone_in, check_folder, read_state
from drake_stiffness.studies.study_file import Study
from drake_stiffness.studies.table import rows_of, write_table
from drake_stiffness.studies.worker import Task

#: Does tasks somewhere; hands back their states as they end.
Workers = Callable[[Sequence[Task]], Generator[State, None, None]]


@dataclass(frozen=True)
class Finished:
    """A study that is done.

    Attributes
    ----------
    content
        Of study.json.
    failed
        States of the jobs that did not end with 0, in the order of the study.
    """

    content: dict[str, Any]
    failed: tuple[State, ...]


@dataclass(frozen=True)
class Begun:
    """A study and what another run of it has done already.

    Attributes
    ----------
    study
    folder
    done
        States that stand, by name.
    tasks
        What is left.
    """

    study: Study
    folder: Path
    done: dict[str, State]
    tasks: tuple[Task, ...]

    @property
    def other_programs(self) -> set[str]:
        """Versions of the program, other than this one, that did what is done."""
        return {state.program for state in self.done.values()} - {PROGRAM}

    def finish(self, workers: Workers, tell: Callable[[State], None]) -> Finished:
        """Do what is left. Interrupted, it keeps what has ended; study.json and study.csv are written all the same."""
        states = dict(self.done)
        with alone_in(self.folder):
            try:
                with closing(workers(self.tasks)) as ended:
                    for state in ended:
                        states[state.name] = state
                        tell(state)
            finally:
                rows = rows_of(self.study.jobs, states, self.folder)
                content = write_table(self.folder, self.study.path, rows)
        in_order = (states[job.name] for job in self.study.jobs)
        return Finished(content, tuple(state for state in in_order if state.exit_code != 0))


def begin(study: Study, folder: Path) -> Begun:
    """Look at what a folder holds of a study; makes the folder.

    Raises
    ------
    InputError
        If the folder cannot be made, or a job's folder holds something else.
    """
    folder = folder.absolute()
    for job in study.jobs:
        check_folder(folder / job.name)
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise InputError(f"{folder}: cannot be made ({error.strerror}); give a folder that can be written.") from None
    hashes = Hashes()
    done: dict[str, State] = {}
    tasks = []
    for job in study.jobs:
        inputs, state = hashes.of(job), read_state(folder / job.name)
        if state is not None and state.stands(job.description, inputs, folder / job.name):
            done[job.name] = state
        else:
            tasks.append(Task(job, folder / job.name, _started(job, inputs)))
    return Begun(study, folder, done, tuple(tasks))


def _started(job: Job, inputs: dict[str, str]) -> State:
    return State(job.name, None, None, "did not end", job.description, inputs, PROGRAM)
