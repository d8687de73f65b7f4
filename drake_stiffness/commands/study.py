"""`drake-stiffness study`: many jobs; resumes where it stopped."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from datetime import timedelta
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from drake_stiffness.commands.console import JsonOption, check_outputs, json_of, say, write

if TYPE_CHECKING:
    from drake_stiffness.studies.state import State
    from drake_stiffness.studies.study import Begun

#: So many jobs that did not end with 0 are named.
_NAMED = 10


def study(
    file: Annotated[Path, typer.Argument(metavar="STUDY", help="STUDY.yaml: a command, and the files it is for")],
    output: Annotated[Path, typer.Option("-o", "--output", help="Folder for results, one below it for every job")],
    scheduler: Annotated[
        str | None, typer.Option(metavar="ADDRESS", help="Dask scheduler whose workers do the jobs, tcp://host:8786")
    ] = None,
    processes: Annotated[
        int | None, typer.Option(min=1, help="Jobs at a time; default the study's own number, else one a core")
    ] = None,
    json: JsonOption = None,
) -> None:
    """Run many jobs of the other commands; a second run does what is left, or what has changed."""
    from drake_stiffness.studies.study import begin
    from drake_stiffness.studies.study_file import read_study

    check_outputs(json, inputs=(file,))
    wanted = read_study(file)
    begun = begin(wanted, output)
    left = len(begun.tasks)
    say(f"{output}: {len(wanted.jobs)} jobs, {len(begun.done)} done before, {left} to do")
    for program in sorted(begun.other_programs):
        say(f"note: some were done by {program}; delete their folders to have them done by this version")
    if scheduler is None:
        from joblib import cpu_count

        from drake_stiffness.studies.here import on_this_machine

        count = processes or wanted.processes or cpu_count()
        workers = lambda tasks: on_this_machine(tasks, count)  # noqa: E731
    else:
        from drake_stiffness.studies.cluster import on_cluster

        workers = lambda tasks: on_cluster(tasks, scheduler)  # noqa: E731
    try:
        with _progress(begun) as tell:
            finished = begun.finish(workers, tell)
    except KeyboardInterrupt:
        say(f"interrupted; what has ended stays in {output}, and the same command does the rest")
        raise typer.Exit(130) from None
    write((json, json_of(finished.content)))
    say(f"{output}: study.json, study.csv")
    if finished.failed:
        say(_failures(finished.failed, len(wanted.jobs)))
        raise typer.Exit(3)


def _failures(failed: tuple[State, ...], jobs: int) -> str:
    lines = [f"  {state.name}: {state.exit_code}, {state.reason.splitlines()[0]}" for state in failed[:_NAMED]]
    more = [f"  and {len(failed) - _NAMED} more (study.csv)"] if len(failed) > _NAMED else []
    return "\n".join([f"{len(failed)} of {jobs} jobs did not end with exit code 0:", *lines, *more])


@contextmanager
def _progress(begun: Begun) -> Iterator[Callable[[State], None]]:
    """Jobs done and left with the time expected, on stderr: a bar on a terminal, elsewhere a line for every job."""
    from rich.console import Console
    from rich.progress import (
        BarColumn,
        MofNCompleteColumn,
        Progress,
        TextColumn,
        TimeElapsedColumn,
        TimeRemainingColumn,
    )

    console = Console(stderr=True)
    total, started, ended = len(begun.tasks), time.monotonic(), 0
    columns = (MofNCompleteColumn(), BarColumn(), TimeElapsedColumn(), TextColumn("left"), TimeRemainingColumn())
    shown = console.is_terminal
    # Jobs may take hours: the time expected goes by all that have ended, not by those of the last half minute.
    with Progress(
        *columns, console=console, transient=True, disable=not shown, speed_estimate_period=float("inf")
    ) as bar:
        task = bar.add_task("", total=total)

        def tell(state: State) -> None:
            nonlocal ended
            ended += 1
            bar.advance(task)
            if not shown:
                left = (time.monotonic() - started) / ended * (total - ended)
                took = "" if state.seconds is None else f" after {state.seconds:.1f} s"
                say(
                    f"{ended}/{total} {state.name}: {state.exit_code}{took}; {total - ended} left, about {timedelta(seconds=round(left))}"
                )
            elif state.exit_code:
                bar.console.print(f"{state.name}: {state.exit_code}, {state.reason}", markup=False)

        yield tell
