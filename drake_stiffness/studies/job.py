"""A job of a study: a command with its arguments and options, and the command line that does it in a folder."""

from __future__ import annotations

import hashlib
import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from drake_stiffness.studies.grammar import OUTPUTS, WRITTEN, Parameter, commands


@dataclass(frozen=True)
class Job:
    """A command as users type it, its outputs to be written into a folder of its own.

    Attributes
    ----------
    name
        Of the job and of its folder.
    command
    given
        Values by the names of arguments and options; files as paths relative to `base`.
    written
        Names of output files by option.
    base
        The folder of the study file.
    """

    name: str
    command: str
    given: dict[str, Any]
    written: dict[str, str]
    base: Path

    @property
    def description(self) -> str:
        """SHA-256 of what is to be done, wherever the study stands."""
        content = {"command": self.command, "given": self.given, "written": self.written}
        return hashlib.sha256(json.dumps(content, sort_keys=True).encode()).hexdigest()

    @property
    def options(self) -> list[str]:
        """Names of the options it is given, files left out."""
        return [p.name for p in commands()[self.command] if p.flag and not p.is_input and p.name in self.given]

    def input_files(self) -> list[Path]:
        """The files it is given, absolute."""
        parameters = [p for p in commands()[self.command] if p.is_input and p.name in self.given]
        return [self._path(value) for p in parameters for value in _listed(self.given[p.name])]

    def line(self, folder: Path) -> list[str]:
        """Words of the command line whose outputs go to a folder."""
        words, arguments = [self.command], []
        for p in commands()[self.command]:
            if p.name in self.written:
                words += [p.flag, str(folder / self.written[p.name])]
            elif p.name in self.given and not p.flag:
                arguments.append(str(self._path(self.given[p.name])))
            elif p.name in self.given:
                words += self._option(p)
        return [*words, "--", *arguments]

    def _option(self, p: Parameter) -> list[str]:
        value = self.given[p.name]
        if p.kind is bool:
            return [p.flag] if value else []
        values = [self._path(v) if p.kind is Path else _printed(v, p.kind) for v in _listed(value)]
        return [f"{p.flag}={value}" for value in values]

    def _path(self, text: str) -> Path:
        return self.base / text


def written_by(command: str, wanted: dict[str, bool | str], inputs: list[str]) -> dict[str, str]:
    """Names of the files that a command writes: its output and its result always, others if wanted.

    Parameters
    ----------
    wanted
        By option: true for the usual name, false for nothing, or a name.
    inputs
        Its arguments: a corrected program keeps its name.
    """
    out = {}
    for p in commands()[command]:
        if p.name in WRITTEN:
            value = wanted.get(p.name, p.name in ("output", "json"))
            usual = OUTPUTS.get(command, "") or Path(inputs[0]).name if p.name == "output" else WRITTEN[p.name]
            if value:
                out[p.name] = usual if value is True else str(value)
    return out


def _listed(value: Any) -> list[Any]:
    return value if isinstance(value, list) else [value]


def _printed(value: Any, kind: type) -> str:
    return str(int(value)) if kind is int else str(value)
