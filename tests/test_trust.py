"""What must not be trusted is not passed on in silence: one move among many, models known to be bad, frames that change."""

from __future__ import annotations

import json
import shutil
import sys
from pathlib import Path

import pytest
import yaml

from drake_stiffness import cli

KR270 = Path(__file__).parents[1] / "examples" / "kr270"


@pytest.fixture
def folder(tmp_path):
    """The KR 270 example with joints only and readings under vertical loads alone: joint 1 was never seen."""
    shutil.copytree(KR270, tmp_path / "job")
    folder = tmp_path / "job"
    rows = (folder / "measurements.csv").read_text().splitlines()
    place = {name: i for i, name in enumerate(rows[0].split(","))}
    vertical = [r for r in rows[1:] if not any(float(r.split(",")[place[f]]) for f in ("fx_N", "fy_N"))]
    (folder / "measurements.csv").write_text("\n".join([rows[0], *vertical]) + "\n")
    return folder


@pytest.fixture
def run(folder, monkeypatch, capsys):
    """Run a command in the folder; exit code and what stderr says."""

    def command(*words: str) -> tuple[int, str]:
        monkeypatch.chdir(folder)
        monkeypatch.setattr(sys, "argv", ["drake-stiffness", *words])
        with pytest.raises(SystemExit) as end:
            cli.main()
        return int(end.value.code or 0), capsys.readouterr().err

    return command


def program(folder: Path, lines: list[str]) -> None:
    (folder / "p.src").write_text("DEF p()\n" + "\n".join(lines) + "\nEND\n")


def moves(number: int) -> list[str]:
    return [f"LIN {{X {20 + 0.2 * i:.3f},Y 20.000,Z 0.000,A 0.000,B 0.000,C 180.000}}" for i in range(number)]


def process(folder: Path, **changes: object) -> None:
    content = yaml.safe_load((folder / "process.yaml").read_text()) | changes
    (folder / "p.yaml").write_text(yaml.safe_dump(content))


COMPENSATE = ("compensate", "p.src", "--model", "m.json", "--process", "p.yaml", "-o", "out.src")


def test_one_sideways_move_among_a_thousand_is_found(folder, run):
    assert run("identify", "campaign_joints_only.yaml", "-o", "m.json")[0] == 0
    program(folder, moves(1000))
    process(folder, cell=None, force={"table": "f.csv", "frame": "world"})
    table = ["fx_N,fy_N,fz_N", *["0,0,-500"] * 1000]
    (folder / "f.csv").write_text("\n".join(table) + "\n")
    assert run(*COMPENSATE)[0] == 0
    (folder / "out.src").unlink()
    table[637] = "0,500,0"
    (folder / "f.csv").write_text("\n".join(table) + "\n")
    code, said = run(*COMPENSATE)
    assert code == 3
    assert "line 638" in said
    assert "does not support" in said
    assert not (folder / "out.src").exists()


def test_forces_of_the_wrong_sign_make_a_model_that_machines_nothing(folder, run):
    """Least squares finds springs that push back; the semidefinite program finds none at all."""
    text = (KR270 / "measurements.csv").read_text().splitlines()
    place = {name: i for i, name in enumerate(text[0].split(","))}
    rows = [r.split(",") for r in text[1:]]
    for row in rows:
        for f in ("fx_N", "fy_N", "fz_N"):
            row[place[f]] = str(-float(row[place[f]]))
    (folder / "measurements.csv").write_text("\n".join([text[0], *(",".join(r) for r in rows)]) + "\n")
    program(folder, moves(3))
    process(folder, cell=None)
    for method, why in (("least-squares", "negative beyond doubt"), ("sdp", "all its compliances are zero")):
        assert run("identify", "campaign_joints_only.yaml", "-o", "m.json", "--method", method)[0] == 0
        code, said = run(*COMPENSATE)
        assert (code, why in said) == (3, True), said
        code, said = run("predict", "m.json", "measurements.csv", "-o", "out.csv")
        assert "NOISE REJECTED" in said


def test_a_campaign_without_any_load_supports_nothing(folder, run):
    text = (KR270 / "measurements.csv").read_text().splitlines()
    unloaded = [r for r in text[1:] if r.split(",")[1] in ("0", "3", "6")]
    (folder / "measurements.csv").write_text("\n".join([text[0], *unloaded]) + "\n")
    code, _ = run("identify", "campaign_joints_only.yaml", "-o", "m.json", "--json", "r.json")
    assert code == 0
    assert json.loads((folder / "r.json").read_text())["warnings"][0].startswith("NOTHING SEEN")
    shutil.copyfile(KR270 / "measurements.csv", folder / "all.csv")
    assert run("predict", "m.json", "all.csv", "-o", "out.csv")[0] == 3


def test_base_or_tool_may_not_change_between_corrected_motions(folder, run):
    assert run("identify", "campaign_joints_only.yaml", "-o", "m.json")[0] == 0
    process(folder, cell=None, force={"constant": {"fz_N": -500.0, "frame": "world"}})
    first, second = moves(2)
    program(folder, ["$BASE = BASE_DATA[1]", first, "$BASE = BASE_DATA[1]", second])
    assert run(*COMPENSATE)[0] == 0
    for change in ("$BASE = BASE_DATA[7]", "$TOOL = TOOL_DATA[2]"):
        program(folder, ["$BASE = BASE_DATA[1]", "$TOOL = TOOL_DATA[1]", first, change, second])
        code, said = run(*COMPENSATE)
        assert code == 2
        assert "line 5" in said
        assert "changes between corrected motions" in said


def test_the_feed_is_not_known_after_a_move_in_joint_space(folder, run):
    assert run("identify", "campaign_joints_only.yaml", "-o", "m.json")[0] == 0
    process(folder, cell=None, force={"constant": {"fx_N": 1.0, "fz_N": -500.0, "frame": "path"}})
    first, second = moves(2)
    program(folder, [first, second])
    code, said = run(*COMPENSATE)
    assert code == 0, said
    program(folder, [first, second, "PTP {A1 0,A2 -70,A3 120,A4 0,A5 -50,A6 0}", second])
    code, said = run(*COMPENSATE)
    assert code == 2
    assert "line 5" in said
    assert "path axes" in said


def test_no_output_may_replace_an_input(folder, run):
    assert run("identify", "campaign_joints_only.yaml", "-o", "m.json")[0] == 0
    program(folder, moves(2))
    process(folder, cell=None, force={"constant": {"fz_N": -500.0, "frame": "world"}})
    before = (folder / "p.src").read_bytes()
    for words in (
        ("compensate", "p.src", "--model", "m.json", "--process", "p.yaml", "-o", "p.src"),
        ("identify", "campaign_joints_only.yaml", "-o", "measurements.csv"),
        ("predict", "m.json", "measurements.csv", "-o", "m.json"),
        ("inspect", "cell.yaml", "--json", "cell.yaml"),
    ):
        code, said = run(*words)
        assert code == 2
        assert "this is an input" in said
    assert (folder / "p.src").read_bytes() == before


def test_a_robot_file_that_has_changed_is_another_cell(folder, run):
    assert run("identify", "campaign_joints_only.yaml", "-o", "m.json")[0] == 0
    program(folder, moves(2))
    process(folder, cell="cell_joints_only.yaml", force={"constant": {"fz_N": -500.0, "frame": "world"}})
    assert run(*COMPENSATE)[0] == 0
    urdf = folder / "kr270.urdf"
    urdf.write_text(urdf.read_text().replace("1.15", "1.25", 1))
    code, said = run(*COMPENSATE)
    assert code == 2
    assert "another cell" in said


def test_of_several_outputs_all_are_written_or_none(folder, run):
    """The second output cannot be written, so the first does not appear."""
    (folder / "locked").mkdir()
    code, said = run("identify", "campaign_joints_only.yaml", "-o", "m.json", "--json", "/proc/x.json")
    assert code == 2
    assert "/proc/x.json" in said
    assert not (folder / "m.json").exists()
    assert not [p for p in folder.iterdir() if p.name.startswith(".m.json")]
