"""Wires the commands and turns what goes wrong into exit codes."""

from __future__ import annotations

import logging
import os
import sys
import traceback

import typer

from drake_stiffness.commands.compensate import compensate
from drake_stiffness.commands.console import say
from drake_stiffness.commands.design import design
from drake_stiffness.commands.diagnose import diagnose
from drake_stiffness.commands.groups import groups
from drake_stiffness.commands.identify import identify
from drake_stiffness.commands.import_readings import import_
from drake_stiffness.commands.inspect import inspect
from drake_stiffness.commands.intervals import intervals
from drake_stiffness.commands.predict import predict
from drake_stiffness.commands.reduce import reduce
from drake_stiffness.commands.restore import restore
from drake_stiffness.commands.shop import shop
from drake_stiffness.commands.simulate import simulate
from drake_stiffness.commands.single_link import single_link
from drake_stiffness.commands.stiffness_map import stiffness_map
from drake_stiffness.commands.study import study
from drake_stiffness.errors import InputError, UntrustworthyError

# The matrices here are small: a second BLAS thread costs more than it brings, several times more on a busy machine.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

app = typer.Typer(
    no_args_is_help=True,
    add_completion=False,
    pretty_exceptions_enable=False,
    help="Identify how an industrial arm bends under load, say what the measurements show, correct milling programs.",
    epilog="Exit codes: 0 done; 2 the input is wrong; 3 the result must not be trusted; 1 a fault of ours.",
)

app.command("inspect")(inspect)
app.command("simulate")(simulate)
app.command("design")(design)
app.command("identify")(identify)
app.command("groups")(groups)
app.command("reduce")(reduce)
app.command("restore")(restore)
app.command("diagnose")(diagnose)
app.command("predict")(predict)
app.command("intervals")(intervals)
app.command("compensate")(compensate)
app.command("map")(stiffness_map)
app.command("single-link")(single_link)
app.command("shop")(shop)
app.command("import")(import_)
app.command("study")(study)


def main() -> None:
    """Entry point: runs a command and turns what goes wrong into exit codes; no traceback reaches a user."""
    code, words = run()
    if words:
        say(words)
    sys.exit(code)


def run(arguments: list[str] | None = None) -> tuple[int, str]:
    """Run a command line; its exit code and what went wrong in words (nothing if typer has said it already).

    Parameters
    ----------
    arguments
        The words after `drake-stiffness`; those of this process if left out.
    """
    _log_to_stderr()
    try:
        app(arguments)
    except SystemExit as end:  # typer's end of every command
        return (end.code, "") if isinstance(end.code, int) else (0 if end.code is None else 1, str(end.code or ""))
    except InputError as error:
        return 2, f"error: {error}"
    except UntrustworthyError as error:
        return 3, f"not trustworthy: {error}"
    except KeyboardInterrupt:
        return 130, "interrupted"
    except Exception as error:
        # The one place that catches everything: a traceback is for us, not for users.
        if os.environ.get("DRAKE_STIFFNESS_DEBUG"):
            traceback.print_exc()
        return 1, (
            f"fault: {type(error).__name__}: {error}. This is a fault of drake-stiffness, not of your input; run again with "
            "DRAKE_STIFFNESS_DEBUG=1 and report what it prints."
        )
    return 0, ""


class _Warnings(logging.Handler):
    """Warnings of the library, a line each on stderr."""

    def emit(self, record: logging.LogRecord) -> None:
        say(f"{record.levelname.lower()}: {record.getMessage()}")


def _log_to_stderr() -> None:
    logger = logging.getLogger("drake_stiffness")
    logger.handlers = [_Warnings(level=logging.WARNING)]
    logger.propagate = False


if __name__ == "__main__":
    main()
