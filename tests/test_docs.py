"""What README and docs tell users to do works, and their figures are those the examples give."""

from __future__ import annotations

import re
import shlex
import shutil
import subprocess
import sys
from pathlib import Path

import pytest
from command_line import call

ROOT = Path(__file__).parents[1]
PAGES = ["README.md", *sorted(f"docs/{page.name}" for page in (ROOT / "docs").glob("*.md"))]


@pytest.fixture(scope="module")
def bench(tmp_path_factory):
    """A folder as a user has it: the example's files, a plan and a truth."""
    folder = tmp_path_factory.mktemp("user")
    shutil.copytree(ROOT / "examples" / "kr270", folder, dirs_exist_ok=True)
    rows = (folder / "measurements.csv").read_text().splitlines()
    names = rows[0].split(",")
    kept = [i for i, name in enumerate(names) if name not in ("x_mm", "y_mm", "z_mm")]
    plan = [",".join(row.split(",")[i] for i in kept) for row in rows]
    (folder / "PLAN.csv").write_text("\n".join(plan) + "\n")
    (folder / "TRUTH.yaml").write_text(
        "effects:\n- {kind: joint_compliance, where: joint_2, parameters: {k: 0.3e-6}}\n"
        "- {kind: joint_compliance, where: joint_1, parameters: {k: 0.33e-6}}\n"
    )
    return folder


def commands() -> list[str]:
    """Every drake-stiffness line of the shell blocks, in the order a user reads them, once."""
    found: dict[str, None] = {}
    for page in ("README.md", "docs/howto.md"):
        for block in re.findall(r"```sh\n(.*?)```", (ROOT / page).read_text(), re.DOTALL):
            for line in block.splitlines():
                command = line.split("#")[0].strip()
                if command.startswith("drake-stiffness"):
                    found.setdefault(command)
    return list(found)


def test_every_command_of_the_pages_runs_as_written(bench):
    lines = commands()
    assert len(lines) >= 7
    for line in lines:
        done = call(*shlex.split(line)[1:], folder=bench)
        assert done.code == 0, f"{line}\n{done.err}"


def test_the_python_example_of_the_readme_runs_as_written(tmp_path):
    (block,) = re.findall(r"```python\n(.*?)```", (ROOT / "README.md").read_text(), re.DOTALL)
    shutil.copytree(ROOT / "examples", tmp_path / "examples")
    done = subprocess.run([sys.executable, "-c", block], cwd=tmp_path, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    assert "% predicted" in done.stdout
    assert (tmp_path / "corrected.src").read_bytes() != (ROOT / "examples/kr270/pocket.src").read_bytes()


def test_links_between_pages_lead_somewhere():
    for page in PAGES:
        for target in re.findall(r"\]\(([^)#]+)\)", (ROOT / page).read_text()):
            assert (ROOT / page).parent.joinpath(target).exists(), f"{page} links to {target}"


def test_the_figures_of_the_kr270_page_are_those_the_example_gives(tmp_path):
    sys.path.insert(0, str(ROOT / "examples" / "kr270"))
    from trial import Scenario, run_trial

    trial = run_trial(Scenario("as stated"), tmp_path / "trial")
    page = (ROOT / "docs" / "kr270.md").read_text()
    named = {
        "uncompensated": trial.uncompensated,
        "joints-only model": trial.joints_only,
        "full model (joints and links)": trial.full,
        "oracle (true structure, same data)": trial.oracle,
    }
    for name, error in named.items():
        row = re.search(rf"^\| {re.escape(name)} \| ([\d.]+) \| ([\d.]+) \| ([\d.]+) \| ([\d.]+) %", page, re.MULTILINE)
        assert row is not None, name
        printed = [float(value) for value in row.groups()]
        measured = [error.mean_mm, error.p95_mm, error.max_mm, error.percent_compensated(trial.uncompensated)]
        assert printed == pytest.approx(measured, rel=0.02, abs=6e-5), name
    assert trial.full.mean_mm < 1.5 * trial.oracle.mean_mm
