"""STUDY.yaml: a command over many files, a grid of options, or jobs one by one; all of it checked before anything runs."""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import dataclass
from itertools import product
from pathlib import Path
from typing import Annotated, Any

from pydantic import BeforeValidator, Field

from drake_stiffness.errors import InputError
from drake_stiffness.files import Document, did_you_mean, read_yaml, short
from drake_stiffness.studies.grammar import WRITTEN, Parameter, commands
from drake_stiffness.studies.job import Job, written_by
from drake_stiffness.studies.names import files_of, label, names_of

_NAME = re.compile(r"[\w+][\w.+ -]*")


def _plain(value: Any) -> Any:
    for one in value if isinstance(value, list) else [value]:
        if not isinstance(one, bool | int | float | str):
            raise ValueError("expected true, false, a number, a word or a list of them")
    return value


def _list(value: Any) -> Any:
    return value if isinstance(value, list) or value is None else [value]


Value = Annotated[Any, BeforeValidator(_plain)]
Paths = Annotated[list[str], BeforeValidator(_list)]


class JobEntry(Document):
    """One job of `jobs`."""

    name: str
    command: str | None = None
    inputs: Paths = Field(default_factory=list)
    options: dict[str, Value] = Field(default_factory=dict)


class StudyFile(Document):
    """STUDY.yaml."""

    command: str | None = None
    inputs: Annotated[list[str] | None, BeforeValidator(_list)] = Field(default=None, min_length=1)
    options: dict[str, Value] = Field(default_factory=dict)
    grid: dict[str, Annotated[list[Value], BeforeValidator(_list), Field(min_length=1)]] = Field(default_factory=dict)
    jobs: list[JobEntry] | None = Field(default=None, min_length=1)
    processes: int | None = Field(default=None, ge=1)


@dataclass(frozen=True)
class Study:
    """A study file that was read.

    Attributes
    ----------
    path
    jobs
        In the order of the file, names unlike each other.
    processes
        How many run at a time on this machine; nothing for one a core.
    """

    path: Path
    jobs: tuple[Job, ...]
    processes: int | None


@dataclass(frozen=True)
class _Entry:
    """Where a job comes from before a grid multiplies it.

    Attributes
    ----------
    key
        Of the study file, for messages.
    values
        Of options: key path, name and value.
    """

    name: str
    key: str
    command: str
    inputs: tuple[str, ...]
    values: tuple[tuple[str, str, Any], ...]


def read_study(path: Path | str) -> Study:
    """Read a study file and make its jobs.

    Raises
    ------
    InputError
        If the file does not fit, a command or option is unknown, a file is not there, a pattern matches nothing, or two
        jobs have one name.
    """
    path = Path(path)
    document = read_yaml(path, StudyFile, "a study (STUDY.yaml)")
    reader = _Reader(path, path.absolute().parent)
    jobs = [job for entry in reader.entries(document) for job in reader.jobs(entry, document.grid)]
    seen: dict[str, Job] = {}
    for job in jobs:
        if not _NAME.fullmatch(job.name) or job.name.casefold() in ("study.json", "study.csv"):
            raise InputError(
                f"{path}: the job's name '{job.name}' cannot be that of a folder here; expected letters, digits, '_', '-', '+' and "
                "'.', the first a letter or digit. Give it another with jobs: [{name: ..}]."
            )
        if job.name.casefold() in seen:
            raise InputError(
                f"{path}: two jobs have the name '{job.name}', and a folder holds one. Name them apart with jobs: [{{name: ..}}], or "
                "take away what stands twice in inputs or grid."
            )
        seen[job.name.casefold()] = job
    return Study(path, tuple(jobs), document.processes)


@dataclass(frozen=True)
class _Reader:
    """Makes jobs of a study file; knows where it is for messages and paths."""

    path: Path
    base: Path

    def refuse(self, key: str, words: str) -> InputError:
        return InputError(f"{self.path}: {key}: {words}")

    def entries(self, d: StudyFile) -> Iterator[_Entry]:
        """What a grid multiplies: an entry of `jobs`, or a file of `inputs`."""
        shared = tuple((f"options.{name}", _word(name), value) for name, value in d.options.items())
        if d.jobs is not None:
            if d.inputs is not None:
                raise self.refuse(
                    "inputs", "there are jobs too, and each has inputs of its own; take away one of both."
                )
            for k, entry in enumerate(d.jobs):
                own = [(f"jobs.{k}.options.{name}", _word(name), value) for name, value in entry.options.items()]
                command = self._command(entry.command or d.command, f"jobs.{k}.command" if entry.command else "command")
                yield _Entry(entry.name, f"jobs.{k}.inputs", command, tuple(entry.inputs), (*shared, *own))
            return
        command = self._command(d.command, "command")
        if d.inputs is None:
            yield _Entry("" if d.grid else command, "inputs", command, (), shared)
            return
        keys = [f"inputs.{k}" for k in range(len(d.inputs))] if len(d.inputs) > 1 else ["inputs"]
        files = [file for key, pattern in zip(keys, d.inputs, strict=True) for file in self._files(pattern, key)]
        for name, file in zip(names_of(files, d.inputs), files, strict=True):
            yield _Entry(name, "inputs", command, (file,), shared)

    def jobs(self, entry: _Entry, grid: dict[str, list[Any]]) -> Iterator[Job]:
        """The jobs of an entry: one for every combination of the grid."""
        parameters = {p.name: p for p in commands()[entry.command]}
        axes = [self._axis(parameters, entry.command, f"grid.{name}", _word(name), grid[name]) for name in grid]
        for chosen in product(*axes):
            words = [entry.name] * bool(entry.name) + [f"{name}-{text}" for _, name, _, text in chosen]
            values = [*entry.values, *(value[:3] for value in chosen)]
            yield self._job("_".join(words), entry, parameters, values)

    def _axis(
        self, parameters: dict[str, Parameter], command: str, key: str, name: str, values: list[Any]
    ) -> list[tuple[str, str, Any, str]]:
        """Key path, name, value and label of the values of a grid's key; patterns of files become files."""
        p = self._parameter(parameters, command, key, name)
        if name in WRITTEN:
            raise self.refuse(key, "this names what is written, and makes no other job; it belongs to options.")
        if not p.is_input:
            return [(key, name, value, label(str(value))) for value in values]
        for value in values:
            self._fits(p, key, value)
        patterns = [value for value in values if isinstance(value, str)]
        files = [file for pattern in patterns for file in self._files(pattern, key)]
        return [(key, name, file, text) for file, text in zip(files, names_of(files, patterns), strict=True)]

    def _job(
        self, name: str, entry: _Entry, parameters: dict[str, Parameter], values: list[tuple[str, str, Any]]
    ) -> Job:
        given, wanted = self._values(entry, parameters, values)
        open_ = [p for p in parameters.values() if not p.flag and p.name not in given]
        if len(entry.inputs) != len(open_):
            expected = ", ".join(p.name for p in parameters.values() if not p.flag) or "no files"
            count = f"{len(entry.inputs)} {'file' if len(entry.inputs) == 1 else 'files'} a job"
            raise self.refuse(
                entry.key,
                f"found {count}; `{entry.command}` takes {expected}. What all jobs share can stand in options by its name.",
            )
        for p, text in zip(open_, entry.inputs, strict=True):
            self._exists(entry.key, text)
            given[p.name] = text
        lacking = [p.name for p in parameters.values() if p.required and p.name not in given and p.name not in WRITTEN]
        if lacking:
            raise self.refuse(
                "options", f"`{entry.command}` needs {' and '.join(lacking)}; add {lacking[0]}: .. there."
            )
        inputs = [given[p.name] for p in parameters.values() if not p.flag]
        return Job(name, entry.command, given, written_by(entry.command, wanted, inputs), self.base)

    def _values(
        self, entry: _Entry, parameters: dict[str, Parameter], values: list[tuple[str, str, Any]]
    ) -> tuple[dict[str, Any], dict[str, bool | str]]:
        """What is given to the command, and which outputs are wanted; later values stand for earlier ones."""
        given: dict[str, Any] = {}
        wanted: dict[str, bool | str] = {}
        for key, name, value in values:
            p = self._parameter(parameters, entry.command, key, name)
            if name in WRITTEN:
                self._written(p, key, value)
                wanted[name] = value
                continue
            self._fits(p, key, value)
            for text in value if isinstance(value, list) else [value]:
                if p.is_input:
                    self._exists(key, text)
            given[name] = value
        return given, wanted

    def _command(self, name: str | None, key: str) -> str:
        if name is None:
            raise self.refuse(key, f"missing; add the key 'command', one of {', '.join(commands())}.")
        if name not in commands():
            raise self.refuse(
                key, f"found '{name}'; expected one of {', '.join(commands())}.{did_you_mean(name, commands())}"
            )
        return name

    def _parameter(self, parameters: dict[str, Parameter], command: str, key: str, name: str) -> Parameter:
        if name not in parameters:
            raise self.refuse(
                key,
                f"`{command}` has no such option.{did_you_mean(name, parameters)} Known: {', '.join(parameters)}.",
            )
        return parameters[name]

    def _fits(self, p: Parameter, key: str, value: Any) -> None:
        fault = p.fault(value)
        if fault:
            raise self.refuse(key, f"found {short(value)}; {fault}. Mend this value.")

    def _written(self, p: Parameter, key: str, value: Any) -> None:
        if p.name == "json":
            raise self.refuse(key, "the result of every job is written as result.json; take this away.")
        if value is False and p.required:
            raise self.refuse(key, "found False; the command needs it. Take this away, or give the file a name.")
        plain = isinstance(value, str) and _NAME.fullmatch(value) and value not in ("state.json", "log.txt")
        if not isinstance(value, bool) and not plain:
            raise self.refuse(
                key,
                f"found {short(value)}; expected true, false or the name of a file, which is put into the job's folder.",
            )

    def _files(self, pattern: str, key: str) -> list[str]:
        found = files_of(pattern, self.base)
        if not found:
            raise self.refuse(
                key,
                f"'{pattern}' matches no file below {self.base}. Mend the pattern; it is relative to the study file.",
            )
        return found

    def _exists(self, key: str, text: str) -> None:
        if not (self.base / text).is_file():
            raise self.refuse(
                key, f"'{text}' is no file below {self.base}. Mend the path; it is relative to the study file."
            )


def _word(name: str) -> str:
    """Options may be written as on the command line, `noise-mm`."""
    return name.replace("-", "_")
