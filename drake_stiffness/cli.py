"""The commands. Heavy modules are imported inside them, so that `--help` answers at once."""

from __future__ import annotations

import logging
import math
import os
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from drake_stiffness.errors import InputError, UntrustworthyError

# The matrices here are small: a second BLAS thread costs more than it brings, several times more on a busy machine.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

if TYPE_CHECKING:
    from rich.console import Console

app = typer.Typer(
    no_args_is_help=True,
    add_completion=False,
    pretty_exceptions_enable=False,
    help="Identify how an industrial arm bends under load, say what the measurements show, correct milling programs.",
    epilog="Exit codes: 0 done; 2 the input is wrong; 3 the result must not be trusted; 1 a fault of ours.",
)

JsonOption = Annotated[Path | None, typer.Option("--json", help="Write the result for programs.")]
ReportOption = Annotated[Path | None, typer.Option("--report", help="Write a self-contained HTML report.")]


def main() -> None:
    """Entry point: runs a command and turns what goes wrong into exit codes; no traceback reaches a user."""
    _log_to_stderr()
    try:
        app()
    except InputError as error:
        _say(f"error: {error}")
        sys.exit(2)
    except UntrustworthyError as error:
        _say(f"not trustworthy: {error}")
        sys.exit(3)
    except KeyboardInterrupt:
        _say("interrupted")
        sys.exit(130)
    except Exception as error:
        # The one place that catches everything: a traceback is for us, not for users.
        if os.environ.get("DRAKE_STIFFNESS_DEBUG"):
            raise
        _say(
            f"fault: {type(error).__name__}: {error}. This is a fault of drake-stiffness, not of your input; run again with "
            "DRAKE_STIFFNESS_DEBUG=1 and report what it prints."
        )
        sys.exit(1)


@app.command()
def inspect(
    cell: Annotated[Path, typer.Argument(help="cell.yaml")],
    identifiability: Annotated[bool, typer.Option(help="Ranks over random postures.")] = False,
    json: JsonOption = None,
    report: ReportOption = None,
) -> None:
    """Print the chain, the springs with their frames, and parameter counts."""
    from drake_stiffness import jobs, text

    _check_outputs(json, report, inputs=(cell,))
    with _working() as progress:
        progress("reading the robot")
        result = jobs.inspect(cell, identifiability)
    text.show_inspection(_console(), result)
    page = None
    if report is not None:
        from drake_stiffness.report import inspection_report

        page = inspection_report(result, cell)
    _write((json, _json(result.to_dict())), (report, page))


@app.command()
def simulate(
    cell: Annotated[Path, typer.Argument(help="cell.yaml")],
    truth: Annotated[Path, typer.Option(help="TRUTH.yaml: effects with values")],
    plan: Annotated[Path, typer.Option(help="PLAN.csv: postures and loads")],
    output: Annotated[Path, typer.Option("-o", "--output", help="Folder for the virtual campaign")],
    noise_mm: Annotated[float, typer.Option(min=0.0, help="Standard deviation of one coordinate")] = 0.0,
    seed: Annotated[int, typer.Option(min=0)] = 0,
    json: JsonOption = None,
) -> None:
    """Make a virtual campaign from the loaded equilibrium (for planning; truth is elsewhere)."""
    from drake_stiffness import jobs

    _check_outputs(json, inputs=(cell, truth, plan))
    if output.is_dir():
        _check_outputs(output / "campaign.yaml", output / "measurements.csv", inputs=(cell, truth, plan))
    if not math.isfinite(noise_mm):
        raise InputError(f"--noise-mm: found {noise_mm}; expected a finite number, mm.")
    with _working() as progress:
        progress("simulating")
        result = jobs.simulate(cell, truth, plan, output, noise_mm, seed)
    made = not output.exists()
    try:
        output.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise InputError(f"{output}: cannot be made ({error.strerror}); give a folder that can be written.") from None
    summary = {
        "files": [str(output / name) for name in result.files],
        "displacement_rms_mm": result.displacement_rms_mm,
        "displacement_max_mm": result.displacement_max_mm,
        "noise_mm": noise_mm,
        "seed": seed,
    }
    _write(*((output / name, content) for name, content in result.files.items()), (json, _json(summary)))
    _say(
        f"{output}{' (new)' if made else ''}: {', '.join(result.files)}; displacement {result.displacement_rms_mm:.3f} mm rms, "
        f"{result.displacement_max_mm:.3f} mm at most"
    )


@app.command()
def identify(
    campaign: Annotated[Path, typer.Argument(help="campaign.yaml")],
    output: Annotated[Path, typer.Option("-o", "--output", help="MODEL.json to write")],
    method: Annotated[str, typer.Option(help="sdp or least-squares")] = "sdp",
    json: JsonOption = None,
    report: ReportOption = None,
) -> None:
    """Identify the model of a campaign."""
    from drake_stiffness import jobs, text

    if method not in ("sdp", "least-squares"):
        raise InputError(f"--method: found '{method}'; expected sdp or least-squares.")
    _check_outputs(output, json, report, inputs=jobs.files_of_campaign(campaign))
    with _working() as progress:
        result = jobs.identify_campaign(campaign, method, progress)
    page = None
    if report is not None:
        from drake_stiffness.report import identification_report

        page = identification_report(result)
    content = result.model.to_dict()
    summary = {k: content[k] for k in ("parameters", "fit", "provenance")} | {"warnings": result.warnings}
    _write((output, _json(content)), (json, _json(summary)), (report, page))
    text.show_identification(_console(), result)


@app.command()
def predict(
    model: Annotated[Path, typer.Argument(help="MODEL.json")],
    measurements: Annotated[Path, typer.Argument(help="postures and loads, with or without readings")],
    output: Annotated[Path, typer.Option("-o", "--output", help="table to write")],
    json: JsonOption = None,
) -> None:
    """Predict displacements for the rows of a table; needs neither Drake nor cvxpy."""
    from drake_stiffness import jobs
    from drake_stiffness.model import load_model
    from drake_stiffness.support import REFUSE_ABOVE, WARN_ABOVE

    _check_outputs(output, json, inputs=(model, measurements))
    loaded = load_model(model)
    with _working() as progress:
        progress("predicting")
        result = jobs.predict(loaded, measurements)
    share = float(result.unsupported.max(initial=0.0))
    beyond = int((result.unsupported > REFUSE_ABOVE).sum())
    summary: dict[str, Any] = {
        "rows": result.rows,
        "predicted_rms_mm": result.rms_mm,
        "error_rms_mm": result.error_rms_mm,
        "unsupported_share_max": share,
        "unsupported_rows": beyond,
        "warnings": loaded.doubts(),
    }
    _write((output, result.text), (json, _json(summary)))
    for line in loaded.doubts():
        _say(f"warning: said of the model when it was identified: {line}")
    _say(f"{output}: {result.rows} predictions, {result.rms_mm:.3f} mm rms")
    if result.error_rms_mm == result.error_rms_mm:
        _say(f"measured minus predicted: {result.error_rms_mm:.4f} mm rms")
    if beyond:
        raise UntrustworthyError(
            f"{beyond} of {result.rows} predictions leave what the campaign identified: up to {100 * share:.0f} % of them rests on "
            f"compliances that its loads and postures never showed (column predicted_unsupported_share of {output})."
        )
    if share > WARN_ABOVE:
        _say(f"warning: up to {100 * share:.0f} % of a prediction is not supported by the model's campaign")


@app.command()
def compensate(
    program: Annotated[Path, typer.Argument(help="KRL .src or CSV waypoints")],
    model: Annotated[Path, typer.Option(help="MODEL.json")],
    process: Annotated[Path, typer.Option(help="process.yaml")],
    output: Annotated[Path, typer.Option("-o", "--output", help="corrected program to write")],
    allow_insert: Annotated[bool, typer.Option(help="Insert words a correction needs and a line lacks.")] = False,
    keep_refused: Annotated[bool, typer.Option(help="Leave motions that cannot be corrected as they are.")] = False,
    dialect: Annotated[str | None, typer.Option(help="krl or csv; default: told from the content")] = None,
    json: JsonOption = None,
    report: ReportOption = None,
) -> None:
    """Correct a milling program; needs neither Drake nor cvxpy."""
    from drake_stiffness import text
    from drake_stiffness.model import load_model
    from toolpaths.formats import read_program
    from toolpaths.job import compensate as run
    from toolpaths.process import read_process

    _check_outputs(output, json, report, inputs=(program, model, process))
    loaded, job = load_model(model), read_process(process)
    with _working() as progress:
        progress("reading the program")
        source = read_program(program, dialect)
        result = run(
            source,
            loaded,
            job,
            allow_insert=allow_insert,
            keep_refused=keep_refused,
            progress=lambda what, done, total: progress(f"{what}: {done} of {total}"),
        )
    page = None
    if report is not None:
        from drake_stiffness.report import compensation_report

        page = compensation_report(result, loaded)
    _write((output, result.raw), (json, _json(result.to_dict())), (report, page))
    text.show_compensation(_console(), result, output)


def _console() -> Console:
    from rich.console import Console

    return Console(highlight=False)


@contextmanager
def _working() -> Iterator[Any]:
    """A line on stderr that says what is being done; a plain no-op where stderr is no terminal."""
    from rich.console import Console
    from rich.progress import Progress, SpinnerColumn, TextColumn, TimeElapsedColumn

    console = Console(stderr=True)
    columns = (SpinnerColumn(), TextColumn("{task.description}"), TimeElapsedColumn())
    with Progress(*columns, console=console, transient=True, disable=not console.is_terminal) as bar:
        task = bar.add_task("starting", total=None)
        yield lambda text: bar.update(task, description=text)


def _say(message: str) -> None:
    typer.echo(message, err=True)


def _write(*outputs: tuple[Path | None, bytes | str | None]) -> None:
    """Write all outputs that were asked for, or none."""
    from drake_stiffness.files import write_together

    write_together([(path, content) for path, content in outputs if path is not None and content is not None])


def _json(content: object) -> str:
    from drake_stiffness.files import json_text

    return json_text(content)


def _check_outputs(*paths: Path | None, inputs: tuple[Path, ...] = ()) -> None:
    """Say what is wrong with outputs before the work, not after it."""
    for path in paths:
        if path is not None and any(path.resolve() == other.resolve() for other in inputs):
            raise InputError(f"{path}: this is an input; give the result another name, the original is needed again.")
        if path is not None and not path.absolute().parent.is_dir():
            raise InputError(f"{path}: the folder {path.absolute().parent} does not exist; make it first.")
        if path is not None and path.is_dir():
            raise InputError(f"{path}: this is a folder; expected the name of a file to write.")


class _Warnings(logging.Handler):
    """Warnings of the library, a line each on stderr."""

    def emit(self, record: logging.LogRecord) -> None:
        _say(f"{record.levelname.lower()}: {record.getMessage()}")


def _log_to_stderr() -> None:
    logger = logging.getLogger("drake_stiffness")
    logger.handlers = [_Warnings(level=logging.WARNING)]
    logger.propagate = False


if __name__ == "__main__":
    main()
