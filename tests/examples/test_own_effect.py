"""A user's kind in a file of its own: found by diagnosis in the data of a plant that does not know it, and refused when it is wrong."""

import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from drake_stiffness.diagnosis.job import diagnose_campaign
from drake_stiffness.effects import catalogue, effect_kinds
from drake_stiffness.effects.catalogue import load_kinds
from drake_stiffness.errors import InputError
from drake_stiffness.model import load_model

EXAMPLE = Path(__file__).parents[2] / "examples" / "own_effect"
HEAD = "from drake_stiffness.effects import Effect, register\n"


@pytest.fixture(autouse=True)
def _forget():
    """Kinds of files are known to the whole process; other tests count kinds."""
    yield
    catalogue._registered.clear()
    effect_kinds.cache_clear()


def test_the_committed_campaign_is_what_the_example_makes():
    from own_effect.make_campaign import make_table

    assert (EXAMPLE / "measurements.csv").read_text(encoding="utf-8") == make_table()


def test_diagnosis_names_the_users_kind_alone_with_its_true_values_and_the_model_file_needs_the_kind(tmp_path):
    assert load_kinds(EXAMPLE / "joint_creep.py") == ("joint_creep",)
    result = diagnose_campaign(EXAMPLE / "campaign.yaml")
    document = result.document
    assert document["verdict"] == "explained"
    (entry,) = document["effects"]
    assert (entry["kind"], entry["where"], entry["confounded_with"]) == ("joint_creep", "joint_2", [])
    k = entry["parameters"]["k"]
    assert abs(k["value"] - 0.06e-6) < 4 * k["sigma"]
    assert entry["settings"]["relaxation_s"] == pytest.approx(80.0, rel=0.1)
    gap = document["gap"]
    assert gap["held_out_before_rms_mm"] > 2.5 * gap["noise_rms_mm"]
    assert gap["held_out_p_value_after"] > 0.001
    result.model.save(tmp_path / "model.json")
    assert load_model(tmp_path / "model.json").x.tolist() == result.model.x.tolist()
    catalogue._registered.clear()
    effect_kinds.cache_clear()
    with pytest.raises(InputError, match=r"joint_creep.*--kinds FILE\.py"):
        load_model(tmp_path / "model.json")


def test_without_times_the_users_kind_is_settled_at_once(arm_of_example):
    load_kinds(EXAMPLE / "joint_creep.py")
    from drake_stiffness.effects import make_effect
    from drake_stiffness.effects.effect import Carried, Cases

    effect = make_effect("joint_creep", "joint_2", {"relaxation_s": 50.0})
    tau = np.outer(np.arange(6.0), np.ones(3))
    cases = Cases(np.zeros((6, 3)), np.zeros((6, 3)), np.zeros(3))
    theta = effect.deflection(arm_of_example, Carried(tau, [], tau), cases, np.array([2.0]))
    assert theta[1].tolist() == [2.0, 2.0, 2.0]


@pytest.fixture(scope="module")
def arm_of_example():
    from drake_stiffness.cell import read_cell
    from drake_stiffness.plant import build_arm

    return build_arm(read_cell(EXAMPLE / "cell.yaml"))


def test_the_same_file_twice_is_one_kind():
    assert load_kinds(EXAMPLE / "joint_creep.py") == load_kinds(EXAMPLE / "joint_creep.py")


def test_what_one_job_registers_the_next_in_its_process_does_not_know():
    with catalogue.kinds_forgotten():
        load_kinds(EXAMPLE / "joint_creep.py")
        assert "joint_creep" in catalogue.effect_kinds()
    assert "joint_creep" not in catalogue.effect_kinds()
    assert not catalogue._registered


WRONG = {
    "nothing registered": ("x = 1\n", "registers no kind"),
    "a fault on a line": ("x = 1\ny = x / 0\n", "line 2: the file fails with ZeroDivisionError"),
    "no Python": ("def f(:\n", "line 1: the file fails with SyntaxError"),
    "no effect": (HEAD + "@register\nclass A:\n    kind = 'a'\n", "not an Effect class"),
    "no name": (HEAD + "@register\nclass A(Effect):\n    station = 'spring'\n", "found kind = None"),
    "no station": (HEAD + "@register\nclass A(Effect):\n    kind, station = 'a', 'moon'\n", "found station = 'moon'"),
    "a need nobody knows": (
        HEAD + "@register\nclass A(Effect):\n    kind, station, needs = 'a', 'spring', ('luck',)\n",
        "luck",
    ),
    "a taken name": (
        HEAD + "@register\nclass A(Effect):\n    kind, station = 'payload', 'arm'\n",
        "'payload' exists already",
    ),
}


@pytest.mark.parametrize("case", WRONG)
def test_a_wrong_file_is_refused_with_what_to_mend(tmp_path, case):
    text, message = WRONG[case]
    path = tmp_path / "kinds.py"
    path.write_text(text)
    with pytest.raises(InputError, match=message) as found:
        load_kinds(path)
    assert "kinds.py" in str(found.value)
    assert not catalogue._registered


@pytest.mark.parametrize("name", ["missing.py", "notes.txt"])
def test_what_is_no_python_file_is_refused(tmp_path, name):
    (tmp_path / "notes.txt").write_text("x")
    with pytest.raises(InputError, match="expected a Python file"):
        load_kinds(tmp_path / name)


def test_a_command_takes_the_kind_from_its_file_and_says_so_when_it_does_not_have_it(tmp_path):
    """`simulate` with a truth of the user's kind."""
    truth = tmp_path / "TRUTH.yaml"
    truth.write_text(
        "effects:\n- {kind: joint_compliance, where: joint_2, parameters: {k: 0.3e-6}}\n"
        "- {kind: joint_creep, where: joint_2, parameters: {k: 0.06e-6}, settings: {relaxation_s: 80.0}}\n"
    )
    rows = (EXAMPLE / "measurements.csv").read_text().splitlines()[:55]
    plan = tmp_path / "PLAN.csv"
    plan.write_text("\n".join(",".join(row.split(",")[:-3]) for row in rows) + "\n")
    words = [sys.executable, "-m", "drake_stiffness.cli", "simulate", str(EXAMPLE / "cell.yaml")]
    words += ["--truth", str(truth), "--plan", str(plan), "-o", str(tmp_path / "out")]
    without = subprocess.run(words, capture_output=True, text=True, check=False)
    assert without.returncode == 2
    assert "--kinds FILE.py" in without.stderr
    done = subprocess.run(
        [*words, "--kinds", str(EXAMPLE / "joint_creep.py")], capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stderr
