"""`drake-stiffness predict`: displacements by a stored model."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

import typer

from drake_stiffness.commands.console import (
    JsonOption,
    KindsOption,
    check_outputs,
    json_of,
    say,
    use_kinds,
    working,
    write,
)
from drake_stiffness.errors import UntrustworthyError


def predict(
    model: Annotated[Path, typer.Argument(help="MODEL.json")],
    measurements: Annotated[Path, typer.Argument(help="postures and loads, with or without readings")],
    output: Annotated[Path, typer.Option("-o", "--output", help="table to write")],
    kinds: KindsOption = None,
    json: JsonOption = None,
) -> None:
    """Predict displacements for the rows of a table; needs neither Drake nor cvxpy."""
    from drake_stiffness import jobs
    from drake_stiffness.model import load_model
    from drake_stiffness.support import REFUSE_ABOVE, WARN_ABOVE

    use_kinds(kinds)
    check_outputs(output, json, inputs=(model, measurements))
    loaded = load_model(model)
    with working() as progress:
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
    write((output, result.text), (json, json_of(summary)))
    for line in loaded.doubts():
        say(f"warning: said of the model when it was identified: {line}")
    say(f"{output}: {result.rows} predictions, {result.rms_mm:.3f} mm rms")
    if result.error_rms_mm == result.error_rms_mm:
        say(f"measured minus predicted: {result.error_rms_mm:.4f} mm rms")
    if beyond:
        raise UntrustworthyError(
            f"{beyond} of {result.rows} predictions leave what the campaign identified: up to {100 * share:.0f} % of them rests on "
            f"compliances that its loads and postures never showed (column predicted_unsupported_share of {output})."
        )
    if share > WARN_ABOVE:
        say(f"warning: up to {100 * share:.0f} % of a prediction is not supported by the model's campaign")
