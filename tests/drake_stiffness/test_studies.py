"""A study does many jobs as users would one by one, survives what kills a worker, and goes on where it stopped."""

from __future__ import annotations

import csv
import json
import os
import signal
import subprocess
import sys
import time
from collections.abc import Generator, Sequence
from dataclasses import replace
from pathlib import Path

import pytest
from command_line import call
from three_arms import KR270

from drake_stiffness.errors import InputError
from drake_stiffness.studies.grammar import WRITTEN, commands
from drake_stiffness.studies.here import on_this_machine
from drake_stiffness.studies.input_files import named_files
from drake_stiffness.studies.names import names_of
from drake_stiffness.studies.state import State, read_state
from drake_stiffness.studies.study import Begun, begin
from drake_stiffness.studies.study_file import read_study
from drake_stiffness.studies.worker import Task

CELL = (KR270 / "cell_joints_only.yaml").read_text()
KINDS = {"dies.py": "import os, signal\nos.kill(os.getpid(), signal.SIGKILL)\n", "waits.py": "import time\ntime.sleep(600)\n"}  # fmt: skip


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """Two cells, a robot, a campaign and files that are run in a worker."""
    (tmp_path / "kr270.urdf").write_bytes((KR270 / "kr270.urdf").read_bytes())
    (tmp_path / "cells").mkdir()
    for name in ("heavy", "light"):
        mass = "95.0" if name == "heavy" else "5.0"
        text = CELL.replace("mass_kg: 90.0", f"mass_kg: {mass}").replace("kr270.urdf", "../kr270.urdf")
        (tmp_path / "cells" / f"{name}.yaml").write_text(text)
    for name, text in KINDS.items():
        (tmp_path / name).write_text(text)
    return tmp_path


def study_of(folder: Path, text: str) -> Path:
    (folder / "study.yaml").write_text(text)
    return folder / "study.yaml"


def pretending(codes: dict[str, int], done: list[str]):
    """Workers that do nothing but say how the jobs ended."""

    def workers(tasks: Sequence[Task]) -> Generator[State, None, None]:
        for task in tasks:
            task.folder.mkdir(exist_ok=True)
            done.append(task.job.name)
            state = replace(task.started, exit_code=codes.get(task.job.name, 0), seconds=1.0, reason="")
            state.write(task.folder)
            yield state

    return workers


def left(folder: Path, path: Path) -> list[str]:
    """Names of the jobs that another run would do."""
    return [task.job.name for task in begin(read_study(path), folder / "out").tasks]


def test_a_job_is_the_command_as_users_type_it(folder: Path) -> None:
    """Two cells and one that is broken: result, report, log, table, exit codes."""
    (folder / "cells" / "wrong.yaml").write_text(CELL.replace("mass_kg", "mass_g"))
    study_of(folder, "command: inspect\ninputs: cells/*.yaml\noptions: {report: page.html}\nprocesses: 1\n")
    ran = call("study", "study.yaml", "-o", "out", folder=folder)
    assert ran.code == 3
    assert "1 of 3 jobs did not end with exit code 0:\n  wrong: 2, error: " in ran.err
    assert "3 jobs, 0 done before, 3 to do" in ran.err
    assert "tool.mass_g: unknown key" in (folder / "out/wrong/log.txt").read_text()
    assert {path.name for path in (folder / "out/heavy").iterdir()} == {"result.json", "page.html", "log.txt", "state.json"}  # fmt: skip
    typed = call("inspect", "cells/heavy.yaml", "--json", "typed.json", folder=folder)
    assert (folder / "out/heavy/result.json").read_text() == (folder / "typed.json").read_text()
    assert typed.out.splitlines()[0] in (folder / "out/heavy/log.txt").read_text()
    with (folder / "out/study.csv").open() as file:
        rows = {row["job"]: row for row in csv.DictReader(file)}
    assert [rows[name]["exit_code"] for name in ("heavy", "light", "wrong")] == ["0", "0", "2"]
    assert rows["light"]["counts.complete"] == "258"
    assert rows["wrong"]["counts.complete"] == ""
    assert "mass_g" in rows["wrong"]["reason"]
    content = json.loads((folder / "out/study.json").read_text())
    assert (content["exit_codes"], content["unfinished"]) == ({"0": 2, "2": 1}, 0)
    again = call("study", "study.yaml", "-o", "out", "--json", "all.json", folder=folder)
    assert (again.code, "3 done before, 0 to do" in again.err) == (3, True)
    assert json.loads((folder / "all.json").read_text()) == content


def test_what_kills_a_worker_fails_that_job_alone(folder: Path) -> None:
    campaign = f"{KR270 / 'campaign_joints_only.yaml'}"
    path = study_of(
        folder,
        f"jobs:\n- {{name: deadly, command: diagnose, inputs: {campaign}, options: {{kinds: dies.py}}}}\n"
        "- {name: sound, command: single-link, options: {seeds: 1}}\n",
    )
    finished = begin(read_study(path), folder / "out").finish(lambda tasks: on_this_machine(tasks, 2), lambda _: None)
    (failed,) = finished.failed
    assert (failed.name, failed.exit_code) == ("deadly", 1)
    assert "killed by SIGKILL" in failed.reason
    assert read_state(folder / "out/deadly") == failed
    assert left(folder, path) == ["deadly"]


def test_a_study_that_is_killed_takes_its_workers_along_and_goes_on_later(folder: Path) -> None:
    path = study_of(
        folder,
        "jobs:\n- {name: first, command: single-link, options: {seeds: 1}}\n"
        f"- {{name: long, command: diagnose, inputs: {KR270 / 'campaign_joints_only.yaml'}, options: {{kinds: waits.py}}}}\n",
    )
    words = [sys.executable, "-m", "drake_stiffness.cli", "study", "study.yaml", "-o", "out", "--processes", "1"]
    root = str(KR270.parents[1])
    with subprocess.Popen(words, cwd=folder, env=os.environ | {"PYTHONPATH": root}, stderr=subprocess.DEVNULL) as ran:
        children = Path(f"/proc/{ran.pid}/task/{ran.pid}/children")
        if not children.exists():
            ran.kill()
            pytest.skip("this system does not list a process's children")
        _until((folder / "out/long/log.txt").exists)
        workers = [Path("/proc") / pid for pid in children.read_text().split()]
        ran.send_signal(signal.SIGKILL)
    assert workers
    _until(lambda: not any(_alive(worker) for worker in workers))
    assert read_state(folder / "out/long").exit_code is None
    assert left(folder, path) == ["long"]


def _until(what) -> None:
    for _ in range(600):
        if what():
            return
        time.sleep(0.05)
    raise AssertionError(f"{what} did not come true")


def _alive(process: Path) -> bool:
    try:
        return ") Z" not in (process / "stat").read_text()
    except OSError:
        return False


def test_only_what_has_changed_or_did_not_end_is_done_again(folder: Path) -> None:
    """Exit codes 0, 2 and 3 stand; another input, a file it names, another option or a lost result do not."""
    path = study_of(folder, "command: inspect\ninputs: cells/*.yaml\ngrid: {identifiability: [true, false]}\n")
    names = [f"{cell}_identifiability-{value}" for cell in ("heavy", "light") for value in ("True", "False")]
    done: list[str] = []
    codes = dict(zip(names, (0, 1, 2, 3), strict=True))
    begin(read_study(path), folder / "out").finish(pretending(codes, done), lambda _: None)
    assert done == names
    assert left(folder, path) == [names[1]]
    (folder / "cells/light.yaml").write_text(CELL.replace("kr270.urdf", "../kr270.urdf"))
    assert left(folder, path) == names[1:]
    begin(read_study(path), folder / "out").finish(pretending({}, done), lambda _: None)
    assert left(folder, path) == []
    (folder / "kr270.urdf").write_text((folder / "kr270.urdf").read_text() + "\n")
    assert left(folder, path) == names
    begin(read_study(path), folder / "out").finish(pretending({}, done), lambda _: None)
    (folder / "out" / names[0] / "state.json").unlink()
    assert left(folder, path) == [names[0]]
    assert left(folder, study_of(folder, path.read_text() + "options: {report: true}\n")) == names
    with (folder / "out/study.csv").open() as file:
        assert [row["options.identifiability"] for row in csv.DictReader(file)] == ["True", "False", "True", "False"]


def test_an_interrupted_study_keeps_what_has_ended(folder: Path) -> None:
    path = study_of(folder, "command: inspect\ninputs: cells/*.yaml\n")

    def interrupt(state: State) -> None:
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        begin(read_study(path), folder / "out").finish(pretending({}, []), interrupt)
    assert left(folder, path) == ["light"]
    content = json.loads((folder / "out/study.json").read_text())
    assert [job["exit_code"] for job in content["jobs"]] == [0, None]


def test_two_studies_do_not_work_in_one_folder(folder: Path) -> None:
    path = study_of(folder, "command: inspect\ninputs: cells/*.yaml\n")

    def second(state: State) -> None:
        with pytest.raises(InputError, match="another `study` is at work"):
            begin(read_study(path), folder / "out").finish(pretending({}, []), lambda _: None)

    begin(read_study(path), folder / "out").finish(pretending({}, []), second)


def test_a_folder_that_holds_other_things_is_left_alone(folder: Path) -> None:
    path = study_of(folder, "command: inspect\ninputs: cells/*.yaml\n")
    (folder / "out/heavy").mkdir(parents=True)
    (folder / "out/heavy/notes.txt").write_text("mine")
    with pytest.raises(InputError, match=r"heavy: a job would write here, but the folder holds other things"):
        begin(read_study(path), folder / "out")
    assert not (folder / "out/light").exists()


def test_jobs_are_named_after_what_differs_and_keep_their_names() -> None:
    pattern = ["campaigns/*/campaign.yaml"]
    assert names_of(["campaigns/E1/campaign.yaml", "campaigns/E2/campaign.yaml"], pattern) == ["E1", "E2"]
    assert names_of(["campaigns/E1/campaign.yaml"], pattern) == ["E1"]
    assert names_of(["a/x.csv", "a/y 1.csv"], ["a/*.csv"]) == ["x", "y-1"]
    assert names_of(["may/a/c.yaml", "june/a/c.yaml"], ["may/*/c.yaml", "june/*/c.yaml"]) == ["may-a", "june-a"]
    assert names_of(["r/1/2/c.yaml", "r/c.yaml"], ["r/**/c.yaml"]) == ["1-2", "c"]
    assert names_of(["model.json"], ["model.json"]) == ["model"]


def test_lines_are_those_of_the_command_line(folder: Path) -> None:
    """Arguments that all jobs share by name, files relative to the study, outputs into the job's folder."""
    for name in ("model.json", "a.csv", "pocket.src", "process.yaml"):
        (folder / name).write_text("x")
    path = study_of(
        folder,
        "jobs:\n- {name: p, command: predict, inputs: a.csv, options: {model: model.json}}\n"
        "- {name: c, command: compensate, inputs: pocket.src, options: {model: model.json, process: process.yaml,\n"
        "   spin: stiffest, linear: true, dry-run: false, points: true}}\n"
        "- {name: i, command: intervals, inputs: cells/heavy.yaml, options: {parameter: [joint_1, joint_2], all: false}}\n"
        "- {name: s, command: simulate, inputs: cells/heavy.yaml, options: {truth: model.json, plan: a.csv, seed: 3}}\n",
    )
    to = Path("/there")
    lines = [job.line(to) for job in read_study(path).jobs]
    f = str(folder)
    assert lines[0] == ["predict", "--output", "/there/predicted.csv", "--json", "/there/result.json", "--", f"{f}/model.json", f"{f}/a.csv"]  # fmt: skip
    assert lines[1] == [
        *("compensate", f"--model={f}/model.json", f"--process={f}/process.yaml", "--output", "/there/pocket.src"),
        *("--linear", "--spin=stiffest", "--points", "/there/points.csv", "--json", "/there/result.json"),
        *("--", f"{f}/pocket.src"),
    ]
    assert lines[2][:4] == ["intervals", "--parameter=joint_1", "--parameter=joint_2", "--json"]
    assert lines[3][:5] == ["simulate", f"--truth={f}/model.json", f"--plan={f}/a.csv", "--output", "/there"]


def test_every_option_that_names_a_file_to_write_is_known_as_such() -> None:
    """A new output option of a command must not be taken for an input."""
    inputs = {p.name for several in commands().values() for p in several if p.is_input}
    assert inputs <= {
        *("augment", "campaign", "cell", "deflection", "kinds", "map_file", "measured", "measurements", "model"),
        *("plan", "process", "program", "sections", "settings", "truth", "with"),
    }
    written = {p.name for several in commands().values() for p in several if p.kind is Path} - inputs
    assert written == set(WRITTEN)


def test_a_job_depends_on_the_files_that_its_files_name(folder: Path) -> None:
    assert [path.resolve() for path in named_files(folder / "cells/heavy.yaml")] == [folder / "kr270.urdf"]
    (folder / "part.src").write_text("x")
    (folder / "part.dat").write_text("x")
    assert list(named_files(folder / "part.src")) == [folder / "part.dat"]
    for name in ("main.mod", "points.mod"):
        (folder / name).write_text("x")
    assert list(named_files(folder / "main.mod")) == []
    (folder / "cell.pgf").write_text("<Module>main.mod</Module><Module>points.mod</Module>")
    assert list(named_files(folder / "main.mod")) == [folder / "cell.pgf"]
    assert folder / "points.mod" in named_files(folder / "cell.pgf")
    (folder / "bad.yaml").write_text("a: [")
    assert list(named_files(folder / "bad.yaml")) == []


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("inputs: cells/*.yaml", ["command: missing", "inspect, simulate"]),
        ("command: inspekt\ninputs: cells/*.yaml", ["command: found 'inspekt'", "Did you mean 'inspect'?"]),
        ("command: study\ninputs: cells/*.yaml", ["command: found 'study'"]),
        ("command: inspect\ninputs: cells/*.yml", ["inputs: 'cells/*.yml' matches no file below", "relative to the study"]),
        ("command: inspect\ninputs: [cells/heavy.yaml, none.yaml]", ["inputs.1: 'none.yaml' matches no file"]),
        ("command: inspect\ninputs: []", ["inputs: found []"]),
        ("command: inspect\ninputs: 3", ["inputs.0: found 3", "expected a valid string"]),
        ("command: inspect", ["inputs: found 0 files a job; `inspect` takes cell"]),
        ("command: predict\ninputs: cells/*.yaml", ["found 1 file a job; `predict` takes model, measurements", "in options"]),
        ("command: inspect\ninputs: cells/*.yaml\noptions: {reprot: true}", ["options.reprot: `inspect` has no such option. Did you mean 'report'?"]),
        ("command: inspect\ninputs: cells/*.yaml\noptions: {identifiability: 3}", ["options.identifiability: found 3; expected true or false"]),
        ("command: inspect\ninputs: cells/*.yaml\noptions: {report: ../page.html}", ["options.report: found '../page.html'", "name of a file"]),
        ("command: inspect\ninputs: cells/*.yaml\noptions: {json: a.json}", ["options.json: the result of every job is written as result.json"]),
        ("command: inspect\ninputs: cells/*.yaml\noptions: {report: null}", ["options.report: found None"]),
        ("command: identify\ninputs: cells/*.yaml\noptions: {output: false}", ["options.output: found False; the command needs it"]),
        ("command: simulate\ninputs: cells/*.yaml\noptions: {seed: -1}", ["options.seed: found -1; expected a whole number, at least 0"]),
        ("command: simulate\ninputs: cells/*.yaml\noptions: {seed: 1}", ["options: `simulate` needs truth and plan"]),
        ("command: diagnose\ninputs: cells/*.yaml\noptions: {model: m.json}", ["options.model: 'm.json' is no file below"]),
        ("command: inspect\ninputs: [cells/*.yaml, cells/heavy.yaml]", ["two jobs have the name 'heavy'"]),
        ("command: inspect\ninputs: cells/*.yaml\ngrid: {identifiability: []}", ["grid.identifiability: found []"]),
        ("command: inspect\ninputs: cells/*.yaml\ngrid: {report: [true, false]}", ["grid.report: this names what is written"]),
        ("command: inspect\ninputs: cells/*.yaml\njobs: [{name: a, inputs: cells/heavy.yaml}]", ["inputs: there are jobs too"]),
        ("command: inspect\njobs: [{name: a/b, inputs: cells/heavy.yaml}]", ["the job's name 'a/b'"]),
        ("jobs: [{name: a, command: inspect, inputs: cells/none.yaml}]", ["jobs.0.inputs: 'cells/none.yaml' is no file"]),
        ("jobs: [{name: a, command: inspct, inputs: cells/heavy.yaml}]", ["jobs.0.command: found 'inspct'"]),
        ("jobs: [{name: a, command: inspect, inputs: cells/heavy.yaml, options: {n: 1}}]", ["jobs.0.options.n: `inspect` has no such option"]),
        ("command: inspect\ninputs: cells/*.yaml\nprocesses: 0", ["processes: found 0", "greater than or equal to 1"]),
        ("command: inspect\ninputs: cells/*.yaml\nproceses: 2", ["proceses: unknown key", "Did you mean 'processes'?"]),
    ],
)  # fmt: skip
def test_a_bad_study_is_refused_before_anything_runs(folder: Path, text: str, says: list[str]) -> None:
    study_of(folder, text + "\n")
    ran = call("study", "study.yaml", "-o", "out", folder=folder)
    assert ran.code == 2, ran.err
    for fragment in ["study.yaml: ", *says]:
        assert fragment in ran.err
    assert not (folder / "out").exists()


def test_a_cluster_needs_dask_and_says_so(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "distributed", None)
    study_of(folder, "command: inspect\ninputs: cells/*.yaml\n")
    ran = call("study", "study.yaml", "-o", "out", "--scheduler", "tcp://127.0.0.1:1", folder=folder)
    assert ran.code == 2
    assert "pip install 'drake-stiffness[cluster]'" in ran.err


def test_a_cluster_does_the_jobs_too(folder: Path) -> None:
    distributed = pytest.importorskip("distributed", reason="dask is not installed: no cluster was tried")
    from drake_stiffness.studies.cluster import on_cluster

    path = study_of(folder, "command: single-link\ngrid: {seeds: [1, 2]}\n")
    with distributed.LocalCluster(n_workers=1, threads_per_worker=2, dashboard_address=None) as cluster:
        begun: Begun = begin(read_study(path), folder / "out")
        finished = begun.finish(lambda tasks: on_cluster(tasks, cluster.scheduler_address), lambda _: None)
    assert finished.failed == ()
    assert (folder / "out/seeds-2/result.json").exists()
