"""Commands as users type them, run in this process: starting Python and importing Drake anew would cost seconds each."""

from __future__ import annotations

import contextlib
import io
import logging
import os
import sys
from dataclasses import dataclass
from pathlib import Path
from unittest import mock

import pytest

from drake_stiffness import cli


@dataclass(frozen=True)
class Outcome:
    """Exit code and what was printed."""

    code: int
    out: str
    err: str


def call(*arguments: object, folder: Path | None = None) -> Outcome:
    """`drake-stiffness` with these arguments, in a folder, as its entry point runs it."""
    out, err = io.StringIO(), io.StringIO()
    logger = logging.getLogger("drake_stiffness")
    before = logger.handlers, logger.propagate
    try:
        with (
            contextlib.chdir(folder or Path.cwd()),
            mock.patch.object(sys, "argv", ["drake-stiffness", *map(str, arguments)]),
            mock.patch.dict(os.environ, {"DRAKE_STIFFNESS_DEBUG": "", "COLUMNS": "200"}),
            contextlib.redirect_stdout(out),
            contextlib.redirect_stderr(err),
            pytest.raises(SystemExit) as end,
        ):
            cli.main()
    finally:
        logger.handlers, logger.propagate = before
    return Outcome(int(end.value.code or 0), out.getvalue(), err.getvalue())
