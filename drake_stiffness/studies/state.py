"""What stays of a job beside its results: `state.json`, written when it ends. Another run of the study goes by it."""

from __future__ import annotations

import json
import os
import shutil
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

import drake_stiffness
from drake_stiffness.errors import InputError
from drake_stiffness.files import json_text, write_whole

FORMAT = "drake-stiffness-job/1"
PROGRAM = f"drake-stiffness {drake_stiffness.__version__}"
STATE, LOG = "state.json", "log.txt"
#: Exit codes that another run with the same inputs would give again.
_FINAL = (0, 2, 3)


@dataclass(frozen=True)
class State:
    """How a job ended.

    Attributes
    ----------
    name
    exit_code
        As the command's; nothing while it has not ended.
    seconds
    reason
        Why it did not end with 0.
    description
        SHA-256 of what was to be done.
    inputs
        SHA-256 of the files that were read.
    program
    files
        Names of what it left in its folder.
    """

    name: str
    exit_code: int | None
    seconds: float | None
    reason: str
    description: str
    inputs: dict[str, str]
    program: str
    files: list[str] = field(default_factory=list)

    def stands(self, description: str, inputs: dict[str, str], folder: Path) -> bool:
        """Whether it is the end of this job, on these files, and what it left is still there."""
        same = self.description == description and self.inputs == inputs
        return same and self.exit_code in _FINAL and all((folder / name).exists() for name in self.files)

    def write(self, folder: Path) -> None:
        """Into the job's folder, whole or not at all."""
        write_whole(folder / STATE, json_text({"format": FORMAT, **asdict(self)}))


def read_state(folder: Path) -> State | None:
    """The state in a folder, or nothing if there is none or it does not tell."""
    try:
        content = json.loads((folder / STATE).read_text(encoding="utf-8"))
    except (OSError, ValueError):
        return None
    if not isinstance(content, dict) or content.pop("format", None) != FORMAT:
        return None
    try:
        return State(**content)
    except TypeError:
        return None


def check_folder(folder: Path) -> None:
    """Raise InputError if a job's folder holds what no study put there: it would be emptied."""
    if folder.is_dir() and any(folder.iterdir()) and not (folder / STATE).is_file():
        raise InputError(
            f"{folder}: a job would write here, but the folder holds other things (there is no {STATE}). Give -o another folder."
        )
    if folder.exists() and not folder.is_dir():
        raise InputError(f"{folder}: a job would make a folder here, but this is a file. Give -o another folder.")


def clear(folder: Path) -> None:
    """Make a job's folder, or empty it but for its state."""
    folder.mkdir(exist_ok=True)
    for entry in folder.iterdir():
        if entry.is_dir() and not entry.is_symlink():
            shutil.rmtree(entry)
        elif entry.name != STATE:
            entry.unlink()


def left_in(folder: Path) -> list[str]:
    """Names of what a job left in its folder."""
    return sorted(entry.name for entry in folder.iterdir() if entry.name != STATE)


@contextmanager
def alone_in(folder: Path) -> Iterator[None]:
    """Refuse to run a study in a folder where another run of it is at work (on systems that can lock files)."""
    try:
        import fcntl
    except ImportError:  # Windows
        yield
        return
    with (folder / ".lock").open("w") as file:
        try:
            fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            raise InputError(
                f"{folder}: another `study` is at work in this folder. Wait until it is done, or give -o another folder."
            ) from None
        file.write(f"{os.getpid()}\n")
        yield


def result_of(folder: Path) -> dict[str, Any]:
    """The result that a job wrote, empty if it wrote none."""
    try:
        content = json.loads((folder / "result.json").read_text(encoding="utf-8"))
    except (OSError, ValueError):
        return {}
    return content if isinstance(content, dict) else {}
