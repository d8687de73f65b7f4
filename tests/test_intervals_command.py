"""`drake-stiffness intervals`: JSON for programs, a page for people, wrong questions refused before the work."""

import json
from pathlib import Path

import pytest
from typer.testing import CliRunner

from drake_stiffness.cli import app
from drake_stiffness.errors import InputError

CAMPAIGN = Path(__file__).parents[1] / "examples" / "kr270" / "campaign.yaml"


def run(*args):
    return CliRunner().invoke(app, ["intervals", str(CAMPAIGN), *map(str, args)])


def test_parameters_and_base_parameters_come_with_status_ends_and_eq_14(tmp_path):
    result = run("--parameter", "joint_1", "--base", "--json", tmp_path / "i.json", "--report", tmp_path / "i.html")
    assert result.exit_code == 0, result.output
    content = json.loads((tmp_path / "i.json").read_text())
    (joint,) = content["parameters"]
    assert joint["status"] == "bounded, not identified"
    assert joint["low"] == 0.0
    assert joint["sigma"] is None
    assert joint["eq14_low"] is None
    assert len(content["base"]) == 32
    assert all(one["low"] < one["value"] < one["high"] for one in content["base"])
    assert any("BOUNDED" in line for line in content["warnings"])
    page = (tmp_path / "i.html").read_text()
    assert "bounded, not identified" in page
    assert page.count("<figure") == 2


@pytest.mark.parametrize(
    ("args", "says"),
    [
        (("--parameter", "joint_1", "--all"), "give one of them"),
        (("--base", "--all"), "--base --parameter joint_1"),
        (("--level", "95"), "between 0 and 1"),
        (("--json", "nowhere/at/all.json"), "does not exist"),
    ],
)
def test_wrong_questions_are_refused(args, says):
    result = run(*args)
    assert isinstance(result.exception, InputError)
    assert says in str(result.exception)
