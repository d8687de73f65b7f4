"""Every wrong input gets a clear answer: exit 2 (wrong input) or 3 (not to be trusted), the place, the value - and nothing left behind.

A case edits one file of a sound job and names what the message must say. `run` compares the folder before and after, so no
case can leave an output, half an output or a temporary file.
"""

from __future__ import annotations

import json
import os
import re
from pathlib import Path

import numpy as np
import pytest
from command_line import Outcome, call

from drake_stiffness.jobs import identify_campaign

KR270 = Path(__file__).parents[1] / "examples" / "kr270"
JOINTS = [f"joint_{k}" for k in range(1, 7)]
COMMANDS = {
    "inspect": ("inspect", "cell.yaml", "--json", "out/inspection.json"),
    "identify": ("identify", "campaign.yaml", "-o", "out/model.json", "--json", "out/result.json"),
    "least": ("identify", "campaign.yaml", "--method", "least-squares", "-o", "out/model.json"),
    "simulate": ("simulate", "cell.yaml", "--truth", "truth.yaml", "--plan", "plan.csv", "-o", "out/virtual"),
    "predict": ("predict", "model.json", "plan.csv", "-o", "out/predicted.csv", "--json", "out/result.json"),
    "compensate": (
        *("compensate", "program.src", "--model", "model.json", "--process", "process.yaml"),
        *("-o", "out/program.src", "--json", "out/result.json"),
    ),
}  # fmt: skip


class Job:
    """A folder with one sound input of every kind: KR 270, joint springs, three experiments, eight waypoints."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder

    def path(self, name: str) -> Path:
        return self.folder / name

    def text(self, name: str) -> str:
        return self.path(name).read_text(encoding="utf-8")

    def write(self, name: str, content: str | bytes) -> None:
        self.path(name).write_bytes(content.encode() if isinstance(content, str) else content)

    def edit(self, name: str, old: str, new: str, count: int = 1) -> None:
        text = self.text(name)
        assert old in text, f"{name} has no {old!r}: the test itself is stale"
        self.write(name, text.replace(old, new, count))

    def cell_of(self, name: str, line: int, column: str, value: str) -> None:
        """Set one cell of a table; the header is line 1."""
        rows = [row.split(",") for row in self.text(name).splitlines()]
        rows[line - 1][rows[0].index(column)] = value
        self.write(name, "\n".join(map(",".join, rows)) + "\n")

    def drop_column(self, name: str, column: str) -> None:
        rows = [row.split(",") for row in self.text(name).splitlines()]
        place = rows[0].index(column)
        self.write(name, "\n".join(",".join(row[:place] + row[place + 1 :]) for row in rows) + "\n")

    def model(self) -> dict:
        return json.loads(self.text("model.json"))

    def files(self) -> dict[str, bytes | None]:
        return {
            str(p.relative_to(self.folder)): p.read_bytes() if p.is_file() else None
            for p in sorted(self.folder.rglob("*"))
        }

    def run(self, command: str, *more: str) -> Outcome:
        """Run a command on this folder; if it fails, the folder must be as it was."""
        before = self.files()
        names = {*before, "out"}
        arguments = [
            str(self.path(a)) if a.split("/")[0] in names else a for a in (*COMMANDS.get(command, (command,)), *more)
        ]
        outcome = call(*arguments)
        assert "Traceback" not in outcome.err + outcome.out
        if outcome.code:
            assert self.files() == before, "a failed command must leave the folder as it was"
        return outcome

    def refused(self, command: str, code: int, *expected: str) -> Outcome:
        outcome = self.run(command)
        assert outcome.code == code, outcome.err
        for fragment in expected:
            assert re.search(fragment, outcome.err), f"{fragment!r} is not in the message:\n{outcome.err}"
        return outcome


CELL = """
robot: {model: kr270.urdf, flange: flange}
gravity_m_per_s2: [0, 0, -9.81]
tool:
  mass_kg: 90.0
  center_of_mass_m: [0.09, 0.01, 0.16]
  tcp: {position_m: [0.18, 0, 0.22], rpy_deg: [180, -90, 0]}
load_point_m: [0.15, 0.05, 0.25]
reference_points_m:
  P1: [0.25, 0.00, 0.10]
  P2: [-0.12, 0.20, 0.05]
  P3: [-0.10, -0.22, 0.15]
springs: {joints: all, links: none, template: beam}
"""
CAMPAIGN = """
cell: cell.yaml
measurements: measurements.csv
noise: {position_sigma_mm: 0.012}
"""
TRUTH = """
effects:
  - {kind: joint_compliance, where: joint_2, parameters: {k: 0.3e-6}}
  - {kind: link_compliance, where: link_2, parameters: {k55: 1e-7}}
"""
PROCESS = """
cell: cell.yaml
workpiece: {position_m: [1.65, -0.10, 0.75], rpy_deg: [0, 0, 0]}
posture_deg: [0, -70, 120, 0, -50, 0]
force:
  constant: {fx_N: 240, fy_N: 180, fz_N: -400, frame: tool}
"""


@pytest.fixture(scope="session")
def sound(tmp_path_factory):
    """The files of a sound job by name."""
    folder = tmp_path_factory.mktemp("sound")
    rows = (KR270 / "measurements.csv").read_text().splitlines()
    readings = [rows[0], *(r for r in rows[1:] if r.startswith(("E01", "E02", "E03")))]
    wide = rows[0].split(",").index("fz_N") + 1
    plan = [",".join(r.split(",")[:wide]) for r in readings[:22]]
    program = [r for r in (KR270 / "pocket.src").read_text().splitlines() if r.startswith("LIN")][:8]
    files = {
        "kr270.urdf": (KR270 / "kr270.urdf").read_text(),
        "cell.yaml": CELL,
        "campaign.yaml": CAMPAIGN,
        "measurements.csv": "\n".join(readings) + "\n",
        "plan.csv": "\n".join(plan) + "\n",
        "truth.yaml": TRUTH,
        "process.yaml": PROCESS,
        "program.src": "\n".join(["DEF a()", "$BASE = BASE_DATA[1]", *program, "END"]) + "\n",
    }
    for name, text in files.items():
        (folder / name).write_text(text)
    identify_campaign(folder / "campaign.yaml").model.save(folder / "model.json")
    return {**files, "model.json": (folder / "model.json").read_text()}


@pytest.fixture
def job(sound, tmp_path):
    for name, text in sound.items():
        (tmp_path / name).write_text(text)
    (tmp_path / "out").mkdir()
    return Job(tmp_path)


@pytest.mark.parametrize("command", list(COMMANDS))
def test_the_job_that_the_cases_spoil_is_sound(job, command):
    outcome = job.run(command)
    assert outcome.code == 0, outcome.err
    assert any(job.path("out").iterdir())


# -- every kind of file: not there, a folder, empty, blank, binary ------------------------------------------------------

READS = [
    ("cell.yaml", "inspect"),
    ("kr270.urdf", "inspect"),
    ("campaign.yaml", "identify"),
    ("measurements.csv", "identify"),
    ("truth.yaml", "simulate"),
    ("plan.csv", "simulate"),
    ("model.json", "predict"),
    ("plan.csv", "predict"),
    ("process.yaml", "compensate"),
    ("program.src", "compensate"),
    ("forces.csv", "compensate"),
]


def _with_force_table(job):
    job.edit(
        "process.yaml",
        "constant: {fx_N: 240, fy_N: 180, fz_N: -400, frame: tool}",
        "{table: forces.csv, frame: tool}".strip("{}").replace(", ", "\n  "),
    )
    job.write("forces.csv", "fx_N,fz_N\n" + "10,-200\n" * 8)


@pytest.mark.parametrize(("name", "command"), READS)
@pytest.mark.parametrize(
    ("content", "says"),
    [
        (None, "no such file|cannot be read"),
        ("folder", "folder|[Dd]irectory"),
        (b"", "empty"),
        (b" \r\n\t\n", "empty|holds only"),
        (b"\xef\xbb\xbf", ""),
        (bytes(range(256)) * 4, ""),
        (b"\x00\x01\x02\x03", ""),
        (b",,,\n,,,\n", ""),
        (b"[1, 2, 3]\n", ""),
    ],
    ids=["missing", "folder", "zero bytes", "blank", "only a byte-order mark", "binary", "control", "commas", "a list"],
)
def test_a_file_that_is_none_is_named(job, name, command, content, says):
    if name == "forces.csv":
        _with_force_table(job)
    job.path(name).unlink()
    if content == "folder":
        job.path(name).mkdir()
    elif content is not None:
        job.write(name, content)
    job.refused(command, 2, re.escape(name), says)


# -- YAML ---------------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("command", "name", "old", "new", "says"),
    [
        ("identify", "campaign.yaml", "noise:", "noize:", ["noize: unknown key", "'noise'"]),
        ("identify", "campaign.yaml", "0.012}", "0.012, seed: 3}", ["noise.seed: unknown key", "3"]),
        ("identify", "campaign.yaml", "position_sigma_mm", "position_sigma_um", ["noise.position_sigma_um", "position_sigma_mm"]),
        ("identify", "campaign.yaml", "0.012", "0", ["noise.position_sigma_mm", "found 0", "greater than 0"]),
        ("identify", "campaign.yaml", "0.012", "-0.1", ["noise.position_sigma_mm", "found -0.1"]),
        ("identify", "campaign.yaml", "0.012", ".nan", ["noise.position_sigma_mm", "found nan", "finite"]),
        ("identify", "campaign.yaml", "0.012", "1e999", ["noise.position_sigma_mm", "found inf", "finite"]),
        ("identify", "campaign.yaml", "0.012", "1" + "0" * 400, ["noise.position_sigma_mm"]),
        ("identify", "campaign.yaml", "0.012", "1" + "0" * 5000, ["campaign.yaml"]),
        ("identify", "campaign.yaml", "0.012", "a bit", ["noise.position_sigma_mm", "found 'a bit'"]),
        ("identify", "campaign.yaml", "0.012", "2024-13-45", ["campaign.yaml"]),
        ("identify", "campaign.yaml", "{position_sigma_mm: 0.012}", "[0.012]", [r"noise: found \[0.012\]"]),
        ("identify", "campaign.yaml", "{position_sigma_mm: 0.012}", "", ["noise: found None"]),
        ("identify", "campaign.yaml", "noise: {position_sigma_mm: 0.012}", "", ["noise: missing"]),
        ("identify", "campaign.yaml", "noise:", "? [a, b]\n: 3\nnoise:", ["campaign.yaml"]),
        ("identify", "campaign.yaml", "noise:", "cell: other.yaml\nnoise:", ["line 4", "'cell' is written twice"]),
        ("identify", "campaign.yaml", "{position_sigma_mm: 0.012}", "{position_sigma_mm: 0.012", ["line 5", "not valid YAML"]),
        ("identify", "campaign.yaml", "noise:", "\tnoise:", ["line 4, column 1", "not valid YAML"]),
        ("identify", "campaign.yaml", "noise:", "noise: &a [*a]\nx:", ["campaign.yaml"]),
        ("identify", "campaign.yaml", "noise:", "quantity: speed\nnoise:", ["quantity: found 'speed'", "displacement"]),
        ("identify", "campaign.yaml", "noise:", "estimate: [everything]\nnoise:", ["estimate.0: found 'everything'"]),
        ("identify", "campaign.yaml", "noise:", "hold_out: {experiments: [E99]}\nnoise:", ["hold_out.experiments", "E99", "E01"]),
        ("identify", "campaign.yaml", "noise:", "hold_out: {experiments: [E01, E02, E03]}\nnoise:", ["hold_out", "no experiment"]),
        ("identify", "campaign.yaml", "noise:", "hold_out: {fraction: 1.5}\nnoise:", ["hold_out.fraction", "1.5"]),
        ("identify", "campaign.yaml", "noise:", "hold_out: {fraction: 0.5, experiments: [E01]}\nnoise:", ["hold_out", "either"]),
        ("identify", "campaign.yaml", "noise:", "hold_out: {seed: 1}\nnoise:", ["hold_out", "either"]),
        ("identify", "campaign.yaml", "noise:", "hold_out: {fraction: 0.4, seed: -1}\nnoise:", ["hold_out.seed", "-1"]),
        ("identify", "campaign.yaml", "cell: cell.yaml", "cell: nowhere.yaml", ["nowhere.yaml", "no such file"]),
        ("identify", "campaign.yaml", "cell: cell.yaml", "cell: ''", [""]),
        ("inspect", "cell.yaml", "mass_kg", "mass_g", ["tool.mass_g: unknown key", "90", "'mass_kg'"]),
        ("inspect", "cell.yaml", "load_point_m", "load_point_mm", ["load_point_mm: unknown key", "'load_point_m'"]),
        ("inspect", "cell.yaml", "rpy_deg", "rpy_rad", ["tool.tcp.rpy_rad", "rpy_deg"]),
        ("inspect", "cell.yaml", "90.0", "90 kg", ["tool.mass_kg", "found '90 kg'", "number"]),
        ("inspect", "cell.yaml", "90.0", "-90", ["tool.mass_kg", "found -90"]),
        ("inspect", "cell.yaml", "[0, 0, -9.81]", "[0, 0, -9810]", ["gravity_m_per_s2", "9810", "mm/s"]),
        ("inspect", "cell.yaml", "[0, 0, -9.81]", "[0, -9.81]", ["gravity_m_per_s2"]),
        ("inspect", "cell.yaml", "[0, 0, -9.81]", "9.81", ["gravity_m_per_s2", "found 9.81"]),
        ("inspect", "cell.yaml", "P2:", "p1:", ["reference_points_m", "'P1' and 'p1'"]),
        ("inspect", "cell.yaml", "flange: flange", "flange: hand", ["kr270.urdf", "'hand'", "flange"]),
        ("inspect", "cell.yaml", "flange: flange", "flange: flange, joints: [joint_1, joint_9]", ["robot.joints", "'joint_9'", "does not exist"]),
        ("inspect", "cell.yaml", "flange: flange", "flange: flange, joints: [Joint_1]", ["'Joint_1'", "'joint_1'"]),
        ("inspect", "cell.yaml", "flange: flange", "flange: flange, joints: [joint_2, joint_1]", ["base to flange", "joint_1, joint_2"]),
        ("inspect", "cell.yaml", "flange: flange", "flange: flange, joints: [joint_1, joint_1]", ["twice", "joint_1"]),
        ("inspect", "cell.yaml", "flange: flange", "flange: flange, joints: []", ["no movable joint|robot.joints"]),
        ("inspect", "cell.yaml", "joints: all", "joints: [joint_9]", ["springs.joints", "'joint_9'", "joint_6"]),
        ("inspect", "cell.yaml", "joints: all", "joints: some", ["springs.joints", "'some'"]),
        ("inspect", "cell.yaml", "links: none", "links: [Link_2]", ["springs.links", "'Link_2'", "'link_2'"]),
        ("inspect", "cell.yaml", "template: beam", "template: round", ["springs.template", "'round'", "symmetric"]),
        ("inspect", "cell.yaml", "template: beam", "template: beam, beam_axes: {link_9: x}", ["beam_axes", "'link_9'"]),
        ("inspect", "cell.yaml", "template: beam", "template: beam, beam_axes: {link_2: w}", ["beam_axes.link_2", "'w'"]),
        ("inspect", "cell.yaml", "model: kr270.urdf", "model: nowhere.urdf", ["nowhere.urdf", "no such file"]),
        ("inspect", "cell.yaml", "model: kr270.urdf", "model: package://nowhere/arm.urdf", ["package:", "nowhere"]),
        ("identify", "cell.yaml", "links: none, template: beam", "links: all, template: full", ["'full'", "least-squares", "cone"]),
        ("identify", "cell.yaml", "joints: all", "joints: none", ["nothing to identify", "cell.yaml"]),
        ("simulate", "truth.yaml", "joint_compliance", "joint_softness", ["effects.0", "'joint_softness'", "joint_compliance"]),
        ("simulate", "truth.yaml", "where: joint_2", "where: joint_9", ["joint_9", "joint_6"]),
        ("simulate", "truth.yaml", "where: link_2", "where: base_link", ["base_link", "base_compliance"]),
        ("simulate", "truth.yaml", "{k:", "{q:", ["effects.0", "'q'", "k .rad"]),
        ("simulate", "truth.yaml", "{k55: 1e-7}", "{k55: -1e-7}", ["effects.1", "link_2", "positive semidefinite"]),
        ("simulate", "truth.yaml", "{k55: 1e-7}", "{k55: 1e-7, k35: 1e-3}", ["effects.1", "positive semidefinite"]),
        ("simulate", "truth.yaml", "0.3e-6", ".inf", ["effects.0.parameters.k", "inf"]),
        ("simulate", "truth.yaml", "0.3e-6", "soft", ["effects.0.parameters.k", "'soft'"]),
        ("simulate", "truth.yaml", "effects:", "efects:", ["efects: unknown key", "'effects'"]),
        ("compensate", "process.yaml", "posture_deg", "posture_rad", ["posture_rad: unknown key", "'posture_deg'"]),
        ("compensate", "process.yaml", "fx_N", "fx_kN", ["force.constant.fx_kN", "fx_N"]),
        ("compensate", "process.yaml", "frame: tool", "frame: flange", ["force.constant.frame", "'flange'", "workpiece"]),
        ("compensate", "process.yaml", ", frame: tool", "", ["force.constant.frame", "missing"]),
        ("compensate", "process.yaml", "[0, -70, 120, 0, -50, 0]", "[0, -70, 120, 0, -50]", ["posture_deg has 5 numbers", "6 revolute"]),
        ("compensate", "process.yaml", "[0, -70, 120, 0, -50, 0]", "[0, -70, 120, 0, -50, .nan]", ["posture_deg.5", "nan"]),
        ("compensate", "process.yaml", "force:", "reference: sag\nforce:", ["reference", "'sag'", "rigid"]),
        ("compensate", "process.yaml", "force:", "external_axes: {E1: slide}\nforce:", ["external_axes", "'slide'", "joint_1"]),
        ("compensate", "process.yaml", "force:", "external_axes: {E7: joint_1}\nforce:", ["external_axes", "'E7'", "E1"]),
        ("compensate", "process.yaml", "force:", "external_axes: {E1: joint_1}\nforce:", ["program.src, line 3", "E1", "joint_1"]),
        ("compensate", "process.yaml", "constant:", "table: forces.csv\n  constant:", ["force", "exactly one"]),
        ("compensate", "process.yaml", "constant: {fx_N: 240, fy_N: 180, fz_N: -400, frame: tool}", "{}", ["force", ""]),
        ("compensate", "process.yaml", "cell: cell.yaml", "cell: nowhere.yaml", ["nowhere.yaml", "no such file"]),
    ],
)  # fmt: skip
def test_yaml(job, command, name, old, new, says):
    job.edit(name, old, new)
    if name == "truth.yaml" and "link_2" in new + old and "positive" in "".join(says):
        assert "SI" in job.refused(command, 2, *says).err
    else:
        job.refused(command, 2, *says)
    if name in ("campaign.yaml", "cell.yaml", "process.yaml") and ": unknown key" in says[0]:
        job.refused(command, 2, re.escape(name))


def test_numbers_in_yaml_may_have_an_exponent_without_a_point_or_sign(job):
    job.edit("truth.yaml", "0.3e-6", "3e-7")
    job.edit("cell.yaml", "90.0", "9e1")
    assert job.run("simulate").code == 0
    assert job.run("inspect").code == 0


def test_a_yaml_file_in_another_encoding(job):
    job.write("campaign.yaml", "# gr\u00fc\u00dfe\n".encode("latin-1") + CAMPAIGN.encode())
    job.refused("identify", 2, "campaign.yaml", "byte 4", "UTF-8")


# -- tables -------------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("value", ["nan", "NaN", "inf", "-inf", "1e400", "", "abc", "1.2.3", "0x10", "1;5"])
@pytest.mark.parametrize("column", ["x_mm", "joint_4_deg", "fz_N"])
def test_a_cell_that_is_no_number_is_named_by_line_and_column(job, value, column):
    if column == "fz_N" and value == "":
        return  # an empty wrench cell is zero
    job.cell_of("measurements.csv", 12, column, value)
    job.refused("identify", 2, "measurements.csv, line 12", f"column '{column}'", re.escape(value or "empty"))


@pytest.mark.parametrize(
    ("line", "column", "value", "says"),
    [
        (9, "step", "1.5", ["line 9", "'step'", "1.5", "whole number"]),
        (9, "step", "-1", ["line 9", "'step'", "-1", "whole number"]),
        (9, "step", "1e30", ["line 9", "'step'"]),
        (9, "experiment", " ", ["line 9", "'experiment'", "empty"]),
        (9, "point", "P9", ["line 9", "'point'", "'P9'", "P1, P2, P3"]),
        (9, "point", "p1", ["line 9", "'p1'", "P1"]),
        (9, "point", "", ["line 9", "'point'", "P1"]),
        (9, "point", "P1", ["line 9", "second row", "E01", "step 2", "P1", "line 8"]),
        (9, "fz_N", "-2400", ["line 9", "line 8", "other joints or loads", "E01"]),
        (9, "joint_3_deg", "70", ["line 9", "line 8", "other joints or loads", "E01"]),
    ],
)
def test_rows_that_cannot_be(job, line, column, value, says):
    job.cell_of("measurements.csv", line, column, value)
    job.refused("identify", 2, "measurements.csv", *says)


def test_an_experiment_is_one_posture(job):
    for line in (8, 9, 10):
        job.cell_of("measurements.csv", line, "joint_3_deg", "70")
    job.refused("identify", 2, "measurements.csv", "'E01'", "'joint_3'", "step 0 and step 2")


@pytest.mark.parametrize("column", ["experiment", "step", "point", *(f"{j}_deg" for j in JOINTS), "y_mm"])
def test_a_missing_column_is_named(job, column):
    job.drop_column("measurements.csv", column)
    job.refused("identify", 2, "measurements.csv", f"missing column '{column}'")


@pytest.mark.parametrize(
    ("old", "new", "says"),
    [
        ("joint_3_deg", "joint_3_grad", ["joint_3_grad", "'joint_3_(deg|rad)'"]),
        ("joint_3_deg", "joint_3_mm", ["joint_3_mm", "'joint_3_(deg|rad)'"]),
        ("joint_3_deg", "joint_3", ["'joint_3'", "'joint_3_(deg|rad)'"]),
        ("joint_3_deg", "Joint_3_deg", ["Joint_3_deg", "'joint_3_deg'"]),
        ("joint_6_deg", "joint_7_deg", ["joint_7_deg", "joint"]),
        ("fz_N", "fz_lbf", ["fz_lbf", "fz_N"]),
        ("fz_N", "fz_n", ["fz_n", "fz_N"]),
        ("x_mm", "x_cm", ["x_cm", "x_mm"]),
        ("x_mm", "x_deg", ["x_deg", "x_mm"]),
        ("note", "remark", ["remark", "note"]),
        ("note", "joint_1_rad", ["joint_1_deg and joint_1_rad", "twice"]),
        ("note", "x_mm", ["'x_mm' appears twice", "line 1"]),
        ("note", "dx_mm", ["both positions .* and displacements"]),
        ("note", "rx_mrad", ["rx_mrad, ry_mrad and rz_mrad"]),
        ("experiment,", "", ["line 2", "cells"]),
        (",", ";", ["line 1|missing column"]),
    ],
)
def test_wrong_columns(job, old, new, says):
    if new in ("joint_1_rad", "dx_mm", "rx_mrad"):
        job.write("measurements.csv", job.text("measurements.csv").replace("simulated", "0"))
    job.edit("measurements.csv", old, new, count=-1 if old == "," else 1)
    job.refused("identify", 2, "measurements.csv", *says)


def test_lines_are_counted_as_an_editor_counts_them(job):
    """Blank lines, and a note with a line break inside its quotes."""
    lines = job.text("measurements.csv").splitlines()
    lines[3] = lines[3].replace("simulated", '"two\nlines"')
    lines.insert(2, "")
    job.write("measurements.csv", "\n".join(lines) + "\n")
    text = job.text("measurements.csv").splitlines()
    text[9] = text[9].replace(",simulated", "!,simulated")
    job.write("measurements.csv", "\n".join(text) + "\n")
    job.refused("identify", 2, "measurements.csv, line 10, column 'z_mm'")


def test_a_table_without_rows(job):
    job.write("measurements.csv", job.text("measurements.csv").splitlines()[0] + "\n")
    job.refused("identify", 2, "measurements.csv", "no rows")


def test_a_ragged_row_and_an_open_quote(job):
    whole = job.text("measurements.csv")
    job.write("measurements.csv", whole.replace("0.000,0.000,-1250.000", "0,000,0.000,-1250.000", 1))
    job.refused("identify", 2, "measurements.csv, line 5", "18 cells", "17 columns")
    job.write("measurements.csv", whole.replace("simulated", '"simulated', 1))
    job.refused("identify", 2, "measurements.csv, line", "CSV")


@pytest.mark.parametrize("weight", ["2", "0.5", "-1"])
def test_weights_are_one_or_zero(job, weight):
    job.edit("measurements.csv", "note", "weight")
    job.write("measurements.csv", job.text("measurements.csv").replace("simulated", "1"))
    job.cell_of("measurements.csv", 7, "weight", weight)
    job.refused("identify", 2, "measurements.csv, line 7, column 'weight'", weight)
    job.write(
        "measurements.csv", re.sub(r",[^,]*\n", ",0\n", job.text("measurements.csv")).replace(",0\n", ",weight\n", 1)
    )
    job.refused("identify", 2, "measurements.csv", "every row has weight 0")


def test_displacements_need_an_unloaded_step(job):
    header, *rows = job.text("measurements.csv").splitlines()
    # steps 0, 3 and 6 of the campaign are the unloaded ones
    kept = [r for r in rows if not (r.startswith("E02") and r.split(",")[1] in "036")]
    job.write("measurements.csv", "\n".join([header, *kept]) + "\n")
    job.refused("identify", 2, "measurements.csv", "'E02'", "no unloaded step", "quantity: position")


def test_displacement_columns_are_no_positions(job):
    job.edit("measurements.csv", "x_mm,y_mm,z_mm", "dx_mm,dy_mm,dz_mm")
    job.edit("campaign.yaml", "noise:", "quantity: position\nnoise:")
    job.refused("identify", 2, "measurements.csv", "quantity", "dx, dy, dz")


def test_orientations_need_their_noise(job):
    job.edit("measurements.csv", "time_s", "rx_mrad,ry_mrad,rz_mrad")
    job.write("measurements.csv", re.sub(r"(?m)^(E\d+,\d,P\d,)[^,]*", r"\g<1>0,0,0", job.text("measurements.csv")))
    job.refused("identify", 2, "measurements.csv", "noise.orientation_sigma_mrad")
    job.cell_of("measurements.csv", 6, "ry_mrad", "")
    job.refused("identify", 2, "measurements.csv, line 6", "rx, ry and rz")


@pytest.mark.filterwarnings("ignore::RuntimeWarning")
@pytest.mark.parametrize("column", ["joint_2_deg", "fz_N", "x_mm"])
@pytest.mark.parametrize("value", ["1e30", "1e200", "-1e308"])
def test_numbers_beyond_all_reason_are_no_fault_of_the_program(job, column, value):
    """Refused, or fitted with a loud word about the misfit; whatever overflows on the way."""
    rows = job.text("measurements.csv").splitlines()
    for line in range(2, len(rows) + 1):
        if column != "fz_N" or rows[line - 1].split(",")[12] != "0.000":
            job.cell_of("measurements.csv", line, column, value)
    outcome = job.run("identify")
    assert outcome.code in (0, 2, 3), outcome.err
    assert outcome.code or "NOISE REJECTED" in outcome.out


@pytest.mark.filterwarnings("ignore::RuntimeWarning")
@pytest.mark.parametrize("value", ["1e9", "1e30", "1e308"])
@pytest.mark.parametrize("command", ["simulate", "predict"])
def test_loads_beyond_all_reason_have_no_equilibrium(job, command, value):
    for line in (5, 6, 7):
        job.cell_of("plan.csv", line, "fz_N", value)
    assert job.run(command).code in (2, 3)


def test_a_plan_and_a_prediction_read_the_same_errors(job):
    job.cell_of("plan.csv", 4, "joint_2_deg", "left")
    for command in ("simulate", "predict"):
        job.refused(command, 2, "plan.csv, line 4, column 'joint_2_deg'", "'left'")


# -- robot descriptions ---------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("old", "new", "says"),
    [
        ("</robot>", "", ["kr270.urdf"]),
        ('joint name="joint_2"', 'joint name="Joint_1"', ["'joint_1' and 'Joint_1'", "upper and lower case"]),
        ('name="joint_2" type="revolute"', 'name="joint_2" type="bendy"', ["kr270.urdf", "bendy"]),
        ('<child link="link_3"/>', '<child link="link_33"/>', ["kr270.urdf", "link_33"]),
        ('<axis xyz="0 0 -1"/>', '<axis xyz="0 0 0"/>', ["kr270.urdf", "axis|joint_1"]),
        ('<mass value="226.0"/>', '<mass value="heavy"/>', ["kr270.urdf"]),
    ],
)  # fmt: skip
def test_robot_descriptions(job, old, new, says):
    job.edit("kr270.urdf", old, new)
    job.refused("inspect", 2, *says)


def test_a_package_that_is_not_there(job):
    job.write("arm.dmd.yaml", "directives:\n- add_model: {name: arm, file: 'package://nowhere/arm.urdf'}\n")
    job.edit("cell.yaml", "kr270.urdf", "arm.dmd.yaml")
    job.refused("inspect", 2, "arm.dmd.yaml", "nowhere", "package")


def test_a_beam_without_length_asks_for_its_axis(job):
    job.edit("kr270.urdf", '<origin xyz="0.35 0 0"/>\n    <axis', '<origin xyz="0 0 0"/>\n    <axis')
    job.edit("cell.yaml", "links: none", "links: [link_1]")
    job.refused("inspect", 2, "link_1", "zero length", "beam_axes")
    job.edit("cell.yaml", "template: beam", "template: beam, beam_axes: {link_1: x}")
    assert job.run("inspect").code == 0


@pytest.mark.parametrize("where", ["meshes/arm.stl", "package://nowhere/arm.stl", "file:///nowhere/arm.obj"])
@pytest.mark.parametrize("use", ["visual", "collision"])
def test_a_missing_mesh_is_a_warning(job, where, use):
    mesh = f'<{use}><geometry><mesh filename="{where}"/></geometry></{use}>'
    job.edit("kr270.urdf", '<link name="link_3">', f'<link name="link_3">{mesh}')
    outcome = job.run("identify")
    assert outcome.code == 0, outcome.err
    assert re.search(f"warning: .*kr270.urdf.*{re.escape(where)}", outcome.err)


def test_a_posture_outside_the_limits_is_a_warning_with_its_row(job):
    for line in range(2, 23):
        job.cell_of("measurements.csv", line, "joint_5_deg", "-126.5")
    job.edit(
        "campaign.yaml", "0.012", "1000"
    )  # the readings no longer fit that posture; that is not what is tried here
    outcome = job.run("identify")
    assert outcome.code == 0, outcome.err
    assert re.search(
        r"warning: .*measurements.csv, line 2: joint 'joint_5' stands at -126.5 deg.*-125 .. 125", outcome.err
    )


# -- models ---------------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("share", [0.0005, 0.1, 0.3, 0.5, 0.7, 0.9, 0.999])
def test_a_truncated_model(job, share):
    whole = job.text("model.json")
    job.write("model.json", whole[: int(share * len(whole))])
    job.refused("predict", 2, "model.json", "truncated", "line")
    job.refused("compensate", 2, "model.json", "truncated")


@pytest.mark.parametrize("content", ["[]", "{}", '"model"', "3", "null", '{"format": "drake-stiffness-model/2"}'])
def test_a_json_file_that_is_no_model(job, content):
    job.write("model.json", content)
    job.refused("predict", 2, "model.json", "format", "drake-stiffness-model/1")


@pytest.mark.parametrize("key", ["cell", "arm", "effects", "parameters", "fit", "provenance"])
def test_a_model_lacks_a_part(job, key):
    model = job.model()
    del model[key]
    job.write("model.json", json.dumps(model))
    job.refused("predict", 2, "model.json", key)


def _set(path, value):
    def change(model):
        *way, last = path
        for step in way:
            model = model[step]
        model[last] = value

    return change


@pytest.mark.parametrize(
    "change",
    [
        _set(("effects", 0, "kind"), "joint_softness"),
        _set(("effects", 0, "where"), "joint_9"),
        _set(("effects", 0, "parameters"), {}),
        _set(("effects", 0, "parameters", "k", "value"), None),
        _set(("effects", 0, "parameters", "k", "value"), "soft"),
        _set(("effects", 0, "settings"), {"colour": "red"}),
        _set(("effects",), {}),
        _set(("effects",), None),
        _set(("arm", "axis_F"), [[0, 0, 1]]),
        _set(("arm", "p_PF"), [[0, 0, 1]]),
        _set(("arm", "mass_kg"), 3),
        _set(("arm", "gravity"), [0, 0]),
        _set(("arm", "joint_names"), ["a"]),
        _set(("arm", "lower"), []),
        _set(("arm",), []),
        _set(("cell",), []),
        _set(("cell", "tool"), {}),
        _set(("cell", "reference_points_m"), {}),
        _set(("cell", "reference_points_m", "P1"), [1]),
        _set(("cell", "load_point_m"), 0),
        _set(("covariance", "parameters"), ["joint_1"]),
        _set(("covariance", "parameters"), ["x"] * 6),
        _set(("covariance", "matrix"), [[1]]),
        _set(("parameters",), []),
        _set(("parameters", 0, "group"), None),
        _set(("parameters", 0, "name"), "joint_9"),
        _set(("not_identified", "directions"), [[1, 2]]),
        _set(("fit",), []),
    ],
)
def test_a_model_with_a_damaged_part_is_the_input_s_fault(job, change):
    model = job.model()
    change(model)
    job.write("model.json", json.dumps(model))
    for command in ("predict", "compensate"):
        outcome = job.run(command)
        # Where a part is not needed the command may well run; it must never call it a fault of the program.
        assert outcome.code in (0, 2), outcome.err
        if outcome.code == 2:
            assert re.search("model.json|in the model", outcome.err), outcome.err
        else:
            for path in job.path("out").iterdir():
                assert "nan" not in path.read_text(encoding="latin-1").casefold()
                assert "null" not in path.read_text(encoding="latin-1").replace('"error_rms_mm": null', "")
                path.unlink()


@pytest.mark.parametrize(
    ("old", "new", "key"),
    [
        ("mass_kg: 90.0", "mass_kg: 91.0", "tool.mass_kg"),
        ("position_m: [0.18, 0, 0.22]", "position_m: [0.18, 0, 0.23]", "tool.tcp.position_m"),
        ("rpy_deg: [180, -90, 0]", "rpy_deg: [180, 90, 0]", "tool.tcp.rpy_deg"),
        ("center_of_mass_m: [0.09", "center_of_mass_m: [0.08", "tool.center_of_mass_m"),
        ("model: kr270.urdf", "model: kr300.urdf", "robot.model"),
        ("flange: flange", "flange: link_6", "robot.flange"),
        ("-9.81", "9.81", "gravity_m_per_s2"),
    ],
)
def test_a_model_of_another_cell(job, old, new, key):
    job.edit("cell.yaml", old, new)
    job.refused("compensate", 2, "process.yaml", "cell.yaml", re.escape(key), "another cell")


def test_a_model_of_the_same_cell_with_other_springs_is_accepted(job):
    job.edit("cell.yaml", "links: none", "links: all")
    assert job.run("compensate").code == 0


# -- programs -------------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("line", "says"),
    [
        ("LIN XP1 C_DIS", ["'XP1", "named point"]),
        ("LIN {X a+1,Y 20.0,Z -14.0,A 0.0,B -5.0,C 164.0}", ["a\\+1", "literal"]),
        ("LIN_REL {X 10}", ["relative"]),
        ("CIRC {X 1,Y 2},P5", ["P5|known"]),
        ("LIN {X 1.2.3,Y 2}", ["1.2.3"]),
        ("LIN {X 38.182,Y 20.000", ["not closed"]),
        ("IF x THEN LIN {X 1} ENDIF", ["motion inside another statement"]),
        ("$IPO_MODE = #TCP", ["IPO_MODE"]),
        ("$ROBROOT = {X 0,Y 0,Z 0,A 0,B 0,C 0}", ["ROBROOT"]),
        ("$BASE = {X 1650,Y -100,Z 760,A 0,B 0,C 0}", ["BASE", "workpiece", "10.000 mm"]),
        ("$TOOL = {X 180,Y 0,Z 220,A 0,B 0,C 0}", ["TOOL", "tool.tcp"]),
        ("$BASE = p:q", ["BASE", "computed"]),
        ("$BASE.X = 3", ["BASE", "computed|partly"]),
    ],
)
def test_a_construct_that_cannot_be_corrected_safely(job, line, says):
    lines = job.text("program.src").splitlines()
    lines.insert(4, line)
    job.write("program.src", "\n".join(lines) + "\n")
    job.refused("compensate", 2, "program.src, line 5", *says)


def test_frames_in_the_program_that_agree_are_used(job):
    lines = job.text("program.src").splitlines()
    lines.insert(1, "$BASE = {X 1650.0,Y -100.0,Z 750.0,A 0,B 0,C 0}")
    lines.insert(2, "$TOOL = {X 180.0,Y 0,Z 220.0,A 0,B -90,C 180}")
    job.write("program.src", "\n".join(lines) + "\n")
    outcome = job.run("compensate")
    assert outcome.code == 0, outcome.err


def test_a_word_that_the_correction_needs_and_the_line_lacks(job):
    job.edit("program.src", "LIN {X 38.182,Y 20.000,", "LIN {X 38.182,")
    job.refused("compensate", 2, "program.src, line 4", "needs Y", "--allow-insert", "--keep-refused")
    assert job.run("compensate", "--allow-insert").code == 0
    assert b"Y " in job.path("out/program.src").read_bytes().splitlines()[3]
    for path in job.path("out").iterdir():
        path.unlink()
    assert job.run("compensate", "--keep-refused").code == 0
    assert job.path("out/program.src").read_text().splitlines()[3] == job.text("program.src").splitlines()[3]
    # line 3 gives line 4 its Y: where 4 must stay as it is, 3 must too
    assert [r["line"] for r in json.loads(job.text("out/result.json"))["refused"]] == [3, 4]
    assert job.path("out/program.src").read_text().splitlines()[2] == job.text("program.src").splitlines()[2]


@pytest.mark.parametrize(
    ("content", "says"),
    [
        ("DEF a()\nWAIT SEC 1\nEND\n", ["no motion"]),
        ("DEF a()\nPTP {X 1,Y 2,Z 3,A 0,B 0,C 0}\nEND\n", ["nothing to correct"]),
        ("LIN {X 1,Y 2,Z 3,A 0,B 0,C 0}\rLIN {X 2}\r", ["carriage return"]),
        ("G1 X1 Y2\n", ["program.src"]),
    ],
)
def test_programs_with_nothing_to_correct(job, content, says):
    job.write("program.src", content)
    job.refused("compensate", 2, "program.src", *says)


@pytest.mark.parametrize(
    ("content", "says"),
    [
        ("x_mm,y_mm\n1,2\n", ["line 1", "z_mm"]),
        ("x_mm,y_mm,z_cm\n1,2,3\n", ["line 1", "z_cm"]),
        ("x_mm,y_mm,z_mm,a_deg\n1,2,3,4\n", ["line 1", "b_deg, c_deg"]),
        ("x_mm,y_mm,z_mm\n1,2,3\n1,zwei,3\n", ["line 3", "zwei"]),
        ("x_mm,y_mm,z_mm\n1,2,3\n1,nan,3\n", ["line 3", "nan"]),
        ("x_mm,y_mm,z_mm\n1,2\n", ["line 2", "2 cells"]),
        ("x_mm,y_mm,z_mm\n", ["no rows"]),
        ("x_mm,y_mm,z_mm,x_m\n1,2,3,4\n", ["line 1", "twice"]),
        ("x_mm,y_mm,z_mm,kind\n1,2,3,CIRC\n", ["line 2", "CIRC", "LIN"]),
    ],
)
def test_waypoint_tables(job, content, says):
    job.write("program.csv", content)
    before = job.files()
    _, program, *rest = COMMANDS["compensate"]
    arguments = [program.replace(".src", ".csv"), *rest]
    outcome = call("compensate", *(str(job.path(a)) if "." in a else a for a in arguments))
    assert outcome.code == 2, outcome.err
    assert job.files() == before
    for fragment in ("program.csv", *says):
        assert re.search(fragment, outcome.err), outcome.err


def test_an_unknown_dialect(job):
    outcome = job.run("compensate", "--dialect", "heidenhain")
    assert outcome.code == 2
    assert "heidenhain" in outcome.err
    assert "krl, csv" in outcome.err
    assert "apt, gcode" in outcome.err


@pytest.mark.parametrize(
    ("table", "says"),
    [
        ("fx_N,fz_N\n" + "1,2\n" * 7, ["forces.csv", "7 rows", "8 corrected motions"]),
        ("fx_N,fz_N\n" + "1,2\n" * 9, ["forces.csv", "9 rows", "8 corrected motions"]),
        ("fx_lbf,fz_N\n" + "1,2\n" * 8, ["forces.csv", "fx_lbf"]),
        ("fx_N,fx_kN\n" + "1,2\n" * 8, ["forces.csv", "twice"]),
        ("fx_N,fz_N\n" + "1,2\n" * 3 + "1,\n" + "1,2\n" * 4, ["forces.csv, line 5", "'fz_N'", "empty"]),
        ("fx_N,fz_N\n" + "1,2\n" * 3 + "1,nan\n" + "1,2\n" * 4, ["forces.csv, line 5", "'fz_N'", "nan"]),
        ("fx_N\n", ["forces.csv", "no rows"]),
    ],
)
def test_force_tables(job, table, says):
    _with_force_table(job)
    assert job.run("compensate").code == 0
    for path in job.path("out").iterdir():
        path.unlink()
    job.write("forces.csv", table)
    job.refused("compensate", 2, *says)


def test_path_axes_that_are_not_defined(job):
    """Feed straight along the tool's axis: a force along x of the path has no direction."""
    job.edit("process.yaml", "frame: tool", "frame: path")
    assert job.run("compensate").code == 0
    for path in job.path("out").iterdir():
        path.unlink()
    lines = job.text("program.src").splitlines()
    lines[5:5] = [lines[4]]  # the same waypoint twice
    job.write("program.src", "\n".join(lines) + "\n")
    job.refused("compensate", 2, "program.src, line 6", "path axes")


# -- exit 3: waypoints and equilibria ---------------------------------------------------------------------------------------


def test_waypoints_out_of_reach_are_named_by_line(job):
    lines = job.text("program.src").splitlines()
    for line in (5, 8):
        lines[line - 1] = lines[line - 1].replace("LIN {X ", "LIN {X 30")
    job.write("program.src", "\n".join(lines) + "\n")
    job.refused("compensate", 3, "program.src", "2 lines out of reach", "line 5, 8")


def test_waypoints_outside_the_limits_are_named_by_line(job):
    """The branch that posture_deg picks leaves the limits. Another branch would not: it is not what was asked for."""
    model = job.model()
    model["arm"]["upper"][2] = float(np.radians(100.0))
    job.write("model.json", json.dumps(model))
    job.refused("compensate", 3, "program.src", "outside the joint limits", "joint_3", "line 3, 4, 5, 6, 7, 8, 9, 10")


@pytest.mark.parametrize(("joint_5", "code"), [(0.01, 3), (0.2, 3), (2.0, 0), (-2.0, 0)])
def test_waypoints_at_a_singularity_are_named_by_line(job, joint_5, code):
    """The tool's axis along the forearm: joints 4 and 6 turn about one line. Two degrees off, the arm can be steered."""
    from drake_stiffness.model import load_model
    from toolpaths.compensation import bench_of
    from toolpaths.orientation import abc_from_rotation

    bench = bench_of(load_model(job.path("model.json")), "unloaded", False)
    R, p = bench.commanded(np.radians([[0.0, -70.0, 120.0, 0.0, joint_5, 0.0]]).T)
    x, y, z = (p[:, 0] - [1.65, -0.10, 0.75]) * 1e3
    a, b, c = abc_from_rotation(R.transpose(2, 0, 1), np.zeros((1, 3)))[0]
    lines = ["DEF a()", "", "", f"LIN {{X {x:.6f},Y {y:.6f},Z {z:.6f},A {a:.6f},B {b:.6f},C {c:.6f}}}"]
    job.write("program.src", "\n".join(lines) + "\n")
    process = job.text("process.yaml").replace("0, -70, 120, 0, -50, 0", f"0, -70, 120, 0, {joint_5}, 0")
    job.write("process.yaml", process)
    if code:
        job.refused("compensate", code, "program.src", "1 line at a singularity", "line 4")
    else:
        outcome = job.run("compensate")
        assert outcome.code == 0, outcome.err


def test_springs_too_soft_for_the_load(job):
    """Weight alone, the arm above joint 2, which gives way faster than it is pushed back: no model, program or table."""
    job.write("plan.csv", "\n".join(job.text("plan.csv").splitlines()[:4]) + "\n")
    job.edit("truth.yaml", "0.3e-6", "3e-3")
    job.refused("simulate", 3, "posture", "joint_2 -40.3", "load", "no stable equilibrium")
    model = job.model()
    model["effects"][1]["parameters"]["k"]["value"] = 3e-3
    job.write("model.json", json.dumps(model))
    job.refused("predict", 2, "model.json", "joint_2", "another compliance than effects")  # one of three places changed
    model["springs"][1]["compliance"], model["parameters"][1]["value"] = [[3e-3]], 3e-3
    job.write("model.json", json.dumps(model))
    job.refused("predict", 3, "posture", "joint_2 -40.3", "load", "no stable equilibrium")
    job.refused("compensate", 3, "posture", "joint_2", "load", "stable|converge")


@pytest.mark.parametrize("command", ["simulate", "predict"])
def test_the_case_that_has_no_equilibrium_is_the_one_named(job, command):
    """One absurd load among sound ones: posture and load of that one, not of the first."""
    for line in (11, 12, 13):
        assert job.text("plan.csv").splitlines()[line - 1].startswith("E01,3")
        job.cell_of("plan.csv", line, "fz_N", "-7.0e9")
    job.refused(command, 3, "experiment .E01., step 3", "-7")


def test_identification_that_does_not_come_to_rest_or_fit_is_not_written(job):
    """Readings a thousand times too far (mm taken for m): whatever happens, no model is written as if all were well."""
    job.edit("measurements.csv", "x_mm,y_mm,z_mm", "x_m,y_m,z_m")
    outcome = job.run("identify")
    if outcome.code == 0:
        assert "NOISE REJECTED" in outcome.out
        assert json.loads(job.text("out/model.json"))["fit"]["noise_rejected"] is True
    else:
        assert outcome.code == 3, outcome.err


# -- outputs --------------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("command", ["inspect", "identify", "predict", "compensate"])
def test_an_output_folder_that_is_missing_is_said_before_the_work(job, command):
    job.path("out").rmdir()
    outcome = job.run(command)
    assert outcome.code == 2
    assert "folder" in outcome.err
    assert "out" in outcome.err


@pytest.mark.parametrize("command", ["inspect", "identify", "predict", "compensate"])
@pytest.mark.parametrize("which", [0, 1])
def test_an_output_that_is_a_folder(job, command, which):
    """Neither the output nor the result beside it is written."""
    outputs = [a for a in COMMANDS[command] if a.startswith("out/")]
    if which >= len(outputs):
        return
    job.path(outputs[which]).mkdir()
    job.refused(command, 2, re.escape(Path(outputs[which]).name))


def test_a_virtual_campaign_where_a_file_stands(job):
    job.write("out/virtual", "a file")
    job.refused("simulate", 2, "virtual", "folder")


@pytest.mark.skipif(os.geteuid() == 0, reason="root may write anywhere")
def test_an_output_folder_that_cannot_be_written(job):
    job.path("out").chmod(0o500)
    job.refused("identify", 2, "model.json", "cannot be written")
    job.path("out").chmod(0o700)


def test_writing_that_fails_leaves_nothing(job, monkeypatch):
    """A disk that fills up: the rename never happens, and the temporary file is taken away."""

    def full(*_):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(os, "replace", full)
    job.refused("predict", 2, "predicted.csv", "No space left")
    job.refused("identify", 2, "model.json", "No space left")


@pytest.mark.parametrize("command", ["identify", "predict", "compensate"])
def test_an_output_that_existed_stays_when_the_job_fails(job, command):
    output = next(a for a in COMMANDS[command] if a.startswith("out/"))
    job.write(output, "what was there")
    spoilt = {"identify": "campaign.yaml", "predict": "plan.csv", "compensate": "process.yaml"}[command]
    job.write(spoilt, "nonsense")
    job.refused(command, 2, spoilt)
    assert job.text(output) == "what was there"


# -- the command line -------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("arguments", "says"),
    [
        (["identify"], "campaign"),
        (["identify", "campaign.yaml"], "output"),
        (["identify", "campaign.yaml", "-o", "out/m.json", "--method", "magic"], "magic"),
        (["identfy", "campaign.yaml"], "identfy"),
        (["predict", "model.json", "-o", "out/p.csv"], "(?i)measurements"),
        (["simulate", "cell.yaml", "--truth", "truth.yaml", "--plan", "plan.csv", "-o", "out/v", "--noise-mm", "-1"], "noise"),
        (["simulate", "cell.yaml", "--truth", "truth.yaml", "--plan", "plan.csv", "-o", "out/v", "--noise-mm", "nan"], "noise"),
        (["simulate", "cell.yaml", "--truth", "truth.yaml", "--plan", "plan.csv", "-o", "out/v", "--noise-mm", "inf"], "noise"),
        (["simulate", "cell.yaml", "--truth", "truth.yaml", "--plan", "plan.csv", "-o", "out/v", "--noise-mm", "0.1", "--seed", "-3"], "seed"),
    ],
)  # fmt: skip
def test_wrong_arguments(job, arguments, says):
    before = job.files()
    outcome = call(*(str(job.path(a)) if re.search(r"\.\w+$|/", a) and a != "0.1" else a for a in arguments))
    assert outcome.code == 2, outcome.err
    assert re.search(says, outcome.err), outcome.err
    assert job.files() == before


def test_a_fault_of_ours_is_exit_1_and_no_traceback(job, monkeypatch):
    def broken(*_, **__):
        raise ZeroDivisionError("a slip")

    monkeypatch.setattr("drake_stiffness.jobs.predict", broken)
    outcome = job.run("predict")
    assert outcome.code == 1
    assert "a slip" in outcome.err
    assert "DRAKE_STIFFNESS_DEBUG" in outcome.err
