"""The second act of `make demo`: a campaign on an arm that hides something goes in, the diagnosis comes out.

Run alone: python examples/kr270_hidden/act_two.py
"""

from __future__ import annotations

import base64
from pathlib import Path

from rich.console import Console

from drake_stiffness.diagnosis.job import Diagnosed, diagnose_campaign
from drake_stiffness.diagnosis.words import show_diagnosis
from drake_stiffness.files import json_text, write_whole
from drake_stiffness.report.diagnosis import diagnosis_report
from drake_stiffness.report.diagnosis_plots import shape_figure
from drake_stiffness.report.diagnosis_scene import scene_html
from drake_stiffness.report.diagnosis_shape import shapes

HERE = Path(__file__).parent


def act_two(console: Console, folder: Path) -> Diagnosed:
    """Diagnose the campaign beside this file; report, model and result go to `folder`."""
    folder.mkdir(parents=True, exist_ok=True)
    console.print("Another arm of this type hides something that its model does not have. Looking for it ...")
    result = diagnose_campaign(HERE / "campaign.yaml")
    show_diagnosis(console, result)
    result.model.save(folder / "diagnosed_model.json")
    write_whole(folder / "diagnosis.json", json_text(result.document))
    write_whole(folder / "diagnosis.html", diagnosis_report(result))
    write_whole(folder / "diagnosis_scene.html", scene_html(result.diagnosis))
    # The picture of docs/diagnose.md: a data URI of the report, as a file.
    picture = shape_figure(shapes(result.diagnosis, result.diagnosis.search.named[0]))
    write_whole(folder / "diagnosis.svg", base64.b64decode(picture.split(",", 1)[1]))
    console.print(f"What was hidden: {HERE / 'make_campaign.py'} says it.")
    console.print(
        f"Diagnosis: {(folder / 'diagnosis.html').resolve()}; the arm to turn and zoom: diagnosis_scene.html beside it"
    )
    return result


if __name__ == "__main__":
    act_two(Console(highlight=False), Path("out/kr270"))
