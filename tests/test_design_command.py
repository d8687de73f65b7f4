"""`design` as a user runs it: the plan is taken by `simulate`, its readings by `identify`; what is wrong is said."""

import csv
import json

import pytest
from test_commands import KR270, done, run

SETTINGS = "candidates: 150\nrandom_plans: 10\n"


@pytest.fixture
def folder(tmp_path):
    (tmp_path / "DESIGN.yaml").write_text(SETTINGS)
    return tmp_path


def test_from_design_to_model(folder):
    """A plan, a virtual campaign of it, and a model that finds the truth it was simulated with."""
    (folder / "TRUTH.yaml").write_text(
        "effects:\n"
        + "".join(f"- {{kind: joint_compliance, where: joint_{i}, parameters: {{k: {i}.0e-7}}}}\n" for i in range(1, 7))
    )
    cell = KR270 / "cell_joints_only.yaml"
    plan, result = folder / "PLAN.csv", folder / "plan.json"
    out, err = done("design", cell, "-n", 5, "--settings", folder / "DESIGN.yaml", "-o", plan, "--json", result)
    assert "Certified" in out
    assert "PLAN.csv: 5 postures, 35 steps" in err
    done(
        "simulate",
        cell,
        "--truth",
        folder / "TRUTH.yaml",
        "--plan",
        plan,
        "-o",
        folder / "virtual",
        "--noise-mm",
        0.012,
    )
    done("identify", folder / "virtual" / "campaign.yaml", "-o", folder / "model.json")
    found = json.loads((folder / "model.json").read_text())["parameters"]
    promised = {row["name"]: row["sigma"] * 0.012 / 0.015 for row in json.loads(result.read_text())["parameters"]}
    for i, parameter in enumerate(found, start=1):
        assert parameter["sigma"] == pytest.approx(promised[parameter["name"]], rel=1e-3)
        assert abs(parameter["value"] - i * 1e-7) < 5 * parameter["sigma"]


def test_all_outputs_are_written_together(folder):
    paths = [folder / name for name in ("plan.csv", "plan.json", "plan.html", "PLAN_A.src", "sheet.html")]
    options = ["-o", paths[0], "--json", paths[1], "--report", paths[2], "--krl", paths[3], "--sheet", paths[4]]
    done("design", KR270 / "cell.yaml", "-n", 6, "--settings", folder / "DESIGN.yaml", *options)
    rows = list(csv.DictReader(paths[0].open()))
    content = json.loads(paths[1].read_text())
    assert content["experiments"] == list(dict.fromkeys(row["experiment"] for row in rows))
    assert 0.5 < content["efficiency"] <= 1.0
    assert "<svg" not in paths[2].read_text()
    assert 'src="data:image' in paths[2].read_text()
    assert b"DEF PLAN_A" in paths[3].read_bytes()
    for row in rows:
        assert f"{row['experiment']} step {row['step']}".encode() in paths[3].read_bytes()
    assert "E06" in paths[4].read_text()


def test_a_plan_for_a_program_and_one_for_a_suspect(folder):
    shared = ["--settings", folder / "DESIGN.yaml", "-o", folder / "plan.csv", "--json", folder / "plan.json"]
    program = ["--program", KR270 / "pocket.src", "--process", KR270 / "process.yaml"]
    done("design", KR270 / "cell.yaml", "-n", 8, "--criterion", "toolpath", *program, *shared)
    figure = json.loads((folder / "plan.json").read_text())["figure"]
    assert figure["unit"] == "mm"
    assert 1e-4 < figure["value"] < 1e-2
    suspect = ["--criterion", "ds", "--suspect", "gravity_compensator:joint_2:anchor_m=[0.3,0.1],lever_m=0.2"]
    done("design", KR270 / "cell.yaml", "-n", 8, *suspect, *shared)
    result = json.loads((folder / "plan.json").read_text())
    assert result["combinations"] == 34
    assert result["suspect"]["settings"] == {
        "anchor_m": [0.3, 0.1],
        "lever_m": 0.2,
        "lever_deg": 0.0,
        "variant": "spring",
    }


WRONG = {
    "--criterion x": "found 'x'; expected one of a, d, e",
    "--criterion toolpath": "--program and --process go with criterion toolpath",
    "--program p.src": "--program and --process go with",
    "--criterion ds": "--suspect KIND:WHERE goes with criterion ds",
    "--suspect joint_zero_offset:joint_1": "--suspect KIND:WHERE goes with criterion ds",
    "--criterion ds --suspect rust:joint_1": "Kinds: ",
    "--settings nowhere.yaml": "nowhere.yaml: no such file",
    "--krl plan.txt": "ends in .src",
    "--augment nowhere.yaml": "nowhere.yaml: no such file",
}


@pytest.mark.parametrize("options", WRONG)
def test_options_that_do_not_go_together_end_with_exit_code_2(options, folder):
    code, _, err = run("design", KR270 / "cell.yaml", "-n", 6, "-o", folder / "plan.csv", *options.split())
    assert code == 2
    assert WRONG[options] in err
    assert not (folder / "plan.csv").exists()


def test_too_few_postures_are_refused_and_nothing_is_written(folder):
    code, _, err = run(
        "design", KR270 / "cell.yaml", "-n", 1, "--settings", folder / "DESIGN.yaml", "-o", folder / "plan.csv"
    )
    assert code == 2
    assert "at least 3" in err
    assert not (folder / "plan.csv").exists()


def test_identify_says_what_more_postures_would_settle(folder):
    out, _ = done("identify", KR270 / "campaign.yaml", "-o", folder / "model.json", "--json", folder / "out.json")
    assert "What more postures would settle" in out
    suggestions = json.loads((folder / "out.json").read_text())["suggestions"]
    assert all(2 <= s["ratio"] <= 5 for s in suggestions)
