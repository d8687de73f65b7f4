"""A stored model predicts and compensates where neither Drake nor cvxpy is installed; what needs them says so."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest

from drake_stiffness.jobs import identify_campaign

KR270 = Path(__file__).parents[1] / "examples" / "kr270"

# An interpreter in which these packages do not exist. Anything that imports them, at any time, meets ImportError.
BLOCK = """
import importlib.abc, sys

class Absent(importlib.abc.MetaPathFinder):
    def find_spec(self, name, path=None, target=None):
        if name.partition(".")[0] in {blocked!r}:
            raise ModuleNotFoundError(f"No module named {{name!r}}", name=name)

sys.meta_path.insert(0, Absent())
"""
MAIN = """
from drake_stiffness.cli import main
main()
"""
ABSENT = ("pydrake", "cvxpy", "clarabel", "scs", "osqp", "matplotlib")


def python(code: str, *arguments, cwd: Path) -> subprocess.CompletedProcess[str]:
    environment = {k: v for k, v in os.environ.items() if k != "DRAKE_STIFFNESS_DEBUG"}
    return subprocess.run(
        [sys.executable, "-c", code, *map(str, arguments)], cwd=cwd, env=environment, capture_output=True, text=True
    )


def run(*arguments, cwd: Path, blocked=ABSENT) -> subprocess.CompletedProcess[str]:
    return python(BLOCK.format(blocked=blocked) + MAIN, *arguments, cwd=cwd)


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """A stored model, a plan, a short program, a process that names its cell - and no robot description."""
    folder = tmp_path_factory.mktemp("elsewhere")
    identify_campaign(KR270 / "campaign_joints_only.yaml").model.save(folder / "model.json")
    rows = (KR270 / "measurements.csv").read_text().splitlines()
    (folder / "measurements.csv").write_text("\n".join(rows[:22]) + "\n")
    (folder / "cell.yaml").write_text((KR270 / "cell_joints_only.yaml").read_text())
    (folder / "process.yaml").write_text((KR270 / "process.yaml").read_text())
    lines = [line for line in (KR270 / "pocket.src").read_text().splitlines() if line.startswith(("LIN", "CIRC"))]
    (folder / "program.src").write_text("\n".join(["$BASE = BASE_DATA[1]", *lines[:5], lines[-5]]) + "\n")
    (folder / "campaign.yaml").write_text((KR270 / "campaign_joints_only.yaml").read_text())
    return folder


def test_the_blocked_packages_really_are_absent(folder):
    for name in ("pydrake", "cvxpy"):
        found = python(BLOCK.format(blocked=ABSENT) + f"import {name}", cwd=folder)
        assert "ModuleNotFoundError" in found.stderr


def test_predict_runs(folder):
    result = run("predict", "model.json", "measurements.csv", "-o", "p.csv", "--json", "p.json", cwd=folder)
    assert result.returncode == 0, result.stderr
    summary = json.loads((folder / "p.json").read_text())
    assert summary["rows"] == 21
    assert 1 < summary["predicted_rms_mm"] < 10
    assert "predicted_dz_mm" in (folder / "p.csv").read_text().splitlines()[0]


def test_compensate_runs_and_writes_what_it_writes_with_drake(folder, tmp_path):
    arguments = ("compensate", "program.src", "--model", "model.json", "--process", "process.yaml", "-o")
    result = run(*arguments, tmp_path / "without.src", "--json", tmp_path / "c.json", cwd=folder)
    assert result.returncode == 0, result.stderr
    assert json.loads((tmp_path / "c.json").read_text())["percent_compensated"] > 99
    result = run(*arguments, tmp_path / "with.src", cwd=folder, blocked=())
    assert result.returncode == 0, result.stderr
    assert (tmp_path / "without.src").read_bytes() == (tmp_path / "with.src").read_bytes()
    assert (tmp_path / "without.src").read_bytes() != (folder / "program.src").read_bytes()


def test_compensate_runs_without_eaik_too(folder, tmp_path):
    """Newton on the arm's Jacobian takes over where the analytic inverse has no wheel."""
    arguments = ("compensate", "program.src", "--model", "model.json", "--process", "process.yaml", "-o")
    with_eaik, without = (tmp_path / "with.src", ()), (tmp_path / "without.src", (*ABSENT, "eaik"))
    for output, blocked in (with_eaik, without):
        result = run(*arguments, output, "--json", tmp_path / "c.json", cwd=folder, blocked=blocked)
        assert result.returncode == 0, result.stderr
    assert json.loads((tmp_path / "c.json").read_text())["inverse_kinematics"] == "newton"
    assert with_eaik[0].read_bytes() == without[0].read_bytes()


def test_no_reader_cutter_or_probe_needs_what_is_absent(folder):
    """Every module of toolpaths, and the commands that shops use beside `compensate` itself."""
    everything = (
        "import pkgutil, importlib, toolpaths\n"
        "found = [m.name for m in pkgutil.walk_packages(toolpaths.__path__, 'toolpaths.')]\n"
        "print(len([importlib.import_module(name) for name in found]))\n"
    )
    result = python(BLOCK.format(blocked=(*ABSENT, "pyarrow", "eaik")) + everything, cwd=folder)
    assert int(result.stdout) > 80, result.stderr
    stiffness = ("map", "--model", "model.json", "--process", "process.yaml", "--step-mm", 600, "-o", "map.csv")
    result = run(*stiffness, cwd=folder)
    assert result.returncode == 0, result.stderr


@pytest.mark.parametrize(
    ("arguments", "blocked", "says"),
    [
        (("inspect", KR270 / "cell.yaml"), ABSENT, "Drake is not installed"),
        (("identify", KR270 / "campaign_joints_only.yaml", "-o", "new.json"), ABSENT, "Drake is not installed"),
        # The first solve is exact without a cone; the full arm's cone binds, and that takes cvxpy.
        (("identify", KR270 / "campaign.yaml", "-o", "new.json"), ("cvxpy", "clarabel"), "cvxpy"),
    ],
)
def test_what_needs_them_says_so(folder, arguments, blocked, says):
    before = sorted(folder.iterdir())
    result = run(*arguments, cwd=folder, blocked=blocked)
    assert result.returncode == 2, result.stderr
    assert says in result.stderr
    assert "installed" in result.stderr
    assert "Traceback" not in result.stderr
    assert sorted(folder.iterdir()) == before


def test_the_command_line_imports_nothing_heavy(tmp_path):
    code = (
        "import sys\nfrom drake_stiffness import cli\n"
        "heavy = ('pydrake', 'cvxpy', 'matplotlib', 'scipy', 'numpy', 'eaik', 'yaml', 'pydantic')\n"
        "print([name for name in heavy if name in sys.modules])\n"
    )
    result = python(code, cwd=tmp_path)
    assert result.stdout.strip() == "[]", result.stderr
