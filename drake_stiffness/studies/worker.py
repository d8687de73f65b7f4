"""What a worker process does with a job: the command as users type it, its words in a log, and how it ended."""

from __future__ import annotations

import os
import sys
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path

from drake_stiffness.errors import InputError
from drake_stiffness.studies.job import Job
from drake_stiffness.studies.state import LOG, PROGRAM, State, clear, left_in

#: Libraries of matrices that read it once, when they are loaded.
ONE_THREAD = {f"{name}_NUM_THREADS": "1" for name in ("OPENBLAS", "OMP", "MKL", "VECLIB_MAXIMUM")}
#: Tables in a log need not fit a terminal.
_LOG_WIDTH = "140"
_one_at_a_time = threading.Lock()


@dataclass(frozen=True)
class Task:
    """A job with its folder and its state before it runs.

    Attributes
    ----------
    job
    folder
        Absolute; the one it is in exists.
    started
        The state that stays if it never ends.
    """

    job: Job
    folder: Path
    started: State

    def lost(self, reason: str, seconds: float | None = None) -> State:
        """The state of a job whose worker died."""
        files = left_in(self.folder) if self.folder.is_dir() else []
        return replace(self.started, exit_code=1, reason=reason, seconds=seconds, files=files)


def perform(task: Task) -> State:
    """Do a job in its folder, emptied before; its state is in the folder and handed back.

    Raises
    ------
    InputError
        If this worker cannot do any job of the study: another version of the program, or a file system of its own.
    """
    from joblib import parallel_config

    from drake_stiffness import cli
    from drake_stiffness.commands.console import say
    from drake_stiffness.effects.catalogue import kinds_forgotten

    if task.started.program != PROGRAM:
        raise InputError(
            f"a worker on {_host()} has {PROGRAM}, the study {task.started.program}; install one version everywhere."
        )
    if not task.folder.parent.is_dir():
        raise InputError(
            f"a worker on {_host()} does not see {task.folder.parent}; the study's files and -o must be on a file system that all "
            "workers share, at the same path."
        )
    with _one_at_a_time:  # what is printed belongs to the process, not to a thread
        clear(task.folder)
        task.started.write(task.folder)
        start = time.monotonic()
        with _logged(task.folder / LOG), kinds_forgotten(), parallel_config(backend="sequential"):
            code, words = cli.run(task.job.line(task.folder))
            if words:
                say(words)
        reason = words or ("" if code == 0 else f"see {LOG}")
        ended = replace(
            task.started,
            exit_code=code,
            seconds=round(time.monotonic() - start, 3),
            reason=reason,
            files=left_in(task.folder),
        )
        ended.write(task.folder)
    return ended


@contextmanager
def _logged(path: Path) -> Iterator[None]:
    """All that this process prints goes to a file, what libraries in C print too."""
    width = os.environ.get("COLUMNS")
    os.environ["COLUMNS"] = _LOG_WIDTH
    streams = (sys.stdout, sys.stderr)
    kept = [os.dup(number) for number in (1, 2)]
    with path.open("wb") as file:
        try:
            for number, stream in enumerate(streams, 1):
                stream.flush()
                os.dup2(file.fileno(), number)
            yield
        finally:
            for number, (stream, old) in enumerate(zip(streams, kept, strict=True), 1):
                stream.flush()
                os.dup2(old, number)
                os.close(old)
            if width is None:
                del os.environ["COLUMNS"]
            else:
                os.environ["COLUMNS"] = width


def _host() -> str:
    from socket import gethostname

    return gethostname()
