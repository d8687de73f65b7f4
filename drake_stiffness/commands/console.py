"""What all commands share: options, progress, messages, outputs that are written whole or not at all."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from drake_stiffness.errors import InputError

if TYPE_CHECKING:
    from rich.console import Console

JsonOption = Annotated[Path | None, typer.Option("--json", help="Write the result for programs.")]
ReportOption = Annotated[Path | None, typer.Option("--report", help="Write a self-contained HTML report.")]
KindsOption = Annotated[
    list[Path] | None,
    typer.Option("--kinds", help="Python file that registers kinds of effects; it is run. May be given several times."),
]
DialectOption = Annotated[
    str | None,
    typer.Option(
        help="of the program: krl, rapid, fanuc, urscript, val3, apt, gcode, csv, parquet; default: told from the content"
    ),
]
BesideOption = Annotated[
    list[Path] | None,
    typer.Option(
        "--with",
        metavar="FILE",
        help="Further file of the program that holds points (RAPID module, KRL .dat); several times if need be.",
    ),
]


def no_program_of(program: Path | None, beside: list[Path] | None, dialect: str | None) -> None:
    """Refuse options that say how to read a program where none is given."""
    if program is None and (beside or dialect):
        raise InputError(f"{'--with' if beside else '--dialect'}: there is no program; name it with --program PROGRAM.")


def console() -> Console:
    """The terminal that results go to."""
    from rich.console import Console

    return Console(highlight=False)


@contextmanager
def working() -> Iterator[Any]:
    """A line on stderr that says what is being done; a plain no-op where stderr is no terminal."""
    from rich.console import Console
    from rich.progress import Progress, SpinnerColumn, TextColumn, TimeElapsedColumn

    console = Console(stderr=True)
    columns = (SpinnerColumn(), TextColumn("{task.description}"), TimeElapsedColumn())
    with Progress(*columns, console=console, transient=True, disable=not console.is_terminal) as bar:
        task = bar.add_task("starting", total=None)
        yield lambda text: bar.update(task, description=text)


def use_kinds(files: list[Path] | None) -> None:
    """Make the kinds of the user's files known."""
    from drake_stiffness.effects.catalogue import load_kinds

    for path in files or ():
        load_kinds(path)


def say(message: str) -> None:
    """A message to the user, on stderr."""
    typer.echo(message, err=True)


def write(*outputs: tuple[Path | None, bytes | str | Path | None]) -> None:
    """Write all outputs that were asked for, or none."""
    from drake_stiffness.files import write_together

    write_together([(path, content) for path, content in outputs if path is not None and content is not None])


def json_of(content: object) -> str:
    """JSON without NaN."""
    from drake_stiffness.files import json_text

    return json_text(content)


def check_outputs(*paths: Path | None, inputs: tuple[Path, ...] = ()) -> None:
    """Say what is wrong with outputs before the work, not after it."""
    given = [path.resolve() for path in paths if path is not None]
    for twice in (path for i, path in enumerate(given) if path in given[:i]):
        raise InputError(
            f"{twice}: this is given for two outputs; one would replace the other. Give each a name of its own."
        )
    for path in paths:
        if path is not None and any(path.resolve() == other.resolve() for other in inputs):
            raise InputError(f"{path}: this is an input; give the result another name, the original is needed again.")
        if path is not None and not path.absolute().parent.is_dir():
            raise InputError(f"{path}: the folder {path.absolute().parent} does not exist; make it first.")
        if path is not None and path.is_dir():
            raise InputError(f"{path}: this is a folder; expected the name of a file to write.")
