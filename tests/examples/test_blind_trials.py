"""Blind trials: what is hidden is what it says it is, and the program on trial finds, abstains and keeps quiet."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from blind_trials.classes import likenesses
from blind_trials.generator import Trial, make_trial, truth_of, write_files
from blind_trials.hidden_around import DRAWS, places
from blind_trials.oracle import Oracle, detected, power, spring_columns
from blind_trials.records import read_records
from blind_trials.run import diagnose_files, members
from blind_trials.score import bounds, less_chance, report
from blind_trials.setting import Setting, make_setting
from plants.course import Course
from plants.friction import DahlFriction
from plants.gear_mesh import Backlash
from plants.windup import SoftStart
from scipy.stats import norm

FEW = 12


@pytest.fixture(scope="module")
def setting() -> Setting:
    return make_setting("light_arm", "displacement", False, FEW, 0)


@pytest.fixture(scope="module")
def oracle(setting: Setting) -> Oracle:
    return Oracle(setting, np.ones(FEW, dtype=bool), spring_columns(setting))


def diagnosed(trial: Trial, folder: Path) -> dict[str, Any]:
    return diagnose_files(write_files(trial, folder))["document"]


def one_after_the_other(torque: list[float]) -> tuple[np.ndarray, Course]:
    count = len(torque)
    return np.array([torque]), Course(np.zeros(count, dtype=int), np.arange(count), np.zeros(count))


def test_friction_holds_back_by_its_breakaway_and_leaves_a_loop() -> None:
    friction = DahlFriction(0, 1e-6, breakaway=50.0, steepness=20.0)
    torque, course = one_after_the_other([0.0, 1000.0, 500.0, 0.0, -1000.0, 0.0])
    held = friction.turn(torque, np.zeros((6, 1)), course)[0] / -1e-6
    # Far from where the load turned, all of the breakaway is there, against the motion.
    np.testing.assert_allclose(held, [0.0, 50.0, -50.0, -50.0, -50.0, 50.0], atol=0.1)
    small, course = one_after_the_other([0.0, 1.0])
    # Before it breaks away the joint is 21 times stiffer: of 1 N m friction takes 20/21.
    assert friction.turn(small, np.zeros((2, 1)), course)[0, 1] == pytest.approx(-20 / 21 * 1e-6, rel=0.03)


def test_history_follows_the_steps_and_not_the_rows() -> None:
    friction = DahlFriction(0, 1e-6, breakaway=50.0)
    torque, course = one_after_the_other([0.0, 300.0, 100.0, 250.0])
    mixed = np.array([2, 0, 3, 1])
    other = Course(course.experiment[mixed], course.step[mixed], course.time_s[mixed])
    expected = friction.turn(torque, np.zeros((4, 1)), course)[:, mixed]
    np.testing.assert_array_equal(friction.turn(torque[:, mixed], np.zeros((4, 1)), other), expected)


def test_backlash_is_as_wide_as_it_says_and_a_soft_start_levels_off() -> None:
    torque, course = one_after_the_other([-100.0, 0.0, 100.0])
    turned = Backlash(0, 2e-4, 5.0, 0.0, 100.0).turn(torque, np.zeros((3, 1)), course)[0]
    np.testing.assert_allclose(turned, [-1e-4, 0.0, 1e-4])
    torque, course = one_after_the_other([10.0, 300.0, 900.0])
    soft = SoftStart(0, 1e-6, 100.0).turn(torque, np.zeros((3, 1)), course)[0] * 1e6
    assert soft[0] == pytest.approx(10.0, rel=0.05)
    np.testing.assert_allclose(soft[1:], 100.0, rtol=0.01)


def test_what_the_base_model_can_absorb_is_not_visible(oracle: Oracle) -> None:
    """A factor on the force is one on all compliances; softer joints are the base model's own parameters."""
    rng = np.random.default_rng(0)
    for kind, where, most in (("scale", "", 1e-2), ("joint_hardening", "axis_3", 1.0)):
        hidden = DRAWS[kind](oracle.setting, where, rng)
        raw = np.linalg.norm(
            oracle.whitened(oracle.setting.read(hidden.change(oracle.setting.world, 1.0)) - oracle.clean)
        )
        left = np.linalg.norm(oracle.signature(hidden))
        assert left < most * raw
        assert raw > 0.5


def test_every_effect_that_can_be_hidden_grows_with_its_size(oracle: Oracle) -> None:
    rng = np.random.default_rng(1)
    for kind, draw in DRAWS.items():
        for where in places(oracle.setting, kind)[:1]:
            hidden = draw(oracle.setting, where, rng)
            once, twice = (
                oracle.whitened(oracle.setting.read(hidden.change(oracle.setting.world, s)) - oracle.clean)
                for s in (1.0, 2.0)
            )
            assert np.linalg.norm(once) > 0, kind
            if kind not in ("reflector_offset", "payload", "dress_pack"):  # hardly seen in displacements
                np.testing.assert_allclose(np.linalg.norm(twice), 2 * np.linalg.norm(once), rtol=0.1, err_msg=kind)


def test_the_oracles_power_is_the_published_one() -> None:
    for parameters, expected in ((1, 0.87), (2, 0.79), (6, 0.58), (8, 0.51)):
        assert power(5.0, parameters, 1e-4) == pytest.approx(expected, abs=0.01)
    assert detected(np.array([3.0, 4.0]), np.array([3.0, 4.0]), 1e-4) == (5.0, True)


def test_clopper_and_pearson() -> None:
    assert bounds(0, 300)[1] == pytest.approx(0.0122, abs=1e-4)
    assert bounds(300, 300) == (pytest.approx(0.9878, abs=1e-4), 1.0)


def test_a_hidden_effect_has_the_visible_size_that_was_asked_for(tmp_path: Path) -> None:
    trial = make_trial(7, "one", arm="light_arm", kind="joint_backlash", sigma=30.0, postures=FEW)
    truth = truth_of(trial)["hidden"][0]
    assert truth["sigma"] == pytest.approx(30.0, rel=1e-3)
    assert truth["oracle_z"] == pytest.approx(30.0, abs=4.0)
    # The plant's noise and references: what is left is chi-square with these degrees of freedom, shifted by 30 squared.
    whole = truth_of(trial)
    assert whole["left_over_chi2"] == pytest.approx(whole["left_over_dof"] + 900.0, rel=0.15)
    assert {p.name for p in write_files(trial, tmp_path).parent.iterdir()} == {
        "campaign.yaml",
        "cell.yaml",
        "light_arm.urdf",
        "measurements.csv",
    }


@pytest.fixture
def few_harmonics(monkeypatch: pytest.MonkeyPatch) -> None:
    """All kinds at all places, but not sixty harmonics of each: what is tested here needs none of them."""
    from drake_stiffness.effects import harmonics

    monkeypatch.setattr(harmonics, "HARMONICS", (1, 2, 3, 6))


@pytest.mark.usefixtures("few_harmonics")
def test_a_strong_single_effect_is_named(tmp_path: Path) -> None:
    trial = make_trial(4, "one", arm="light_arm", kind="joint_backlash", sigma=25.0, postures=FEW)
    said = diagnosed(trial, tmp_path)
    assert any(trial.placed[0].hidden.name in members(entry) for entry in said["effects"])


@pytest.mark.usefixtures("few_harmonics")
def test_nothing_hidden_is_consistent(tmp_path: Path) -> None:
    trial = make_trial(7, "none", arm="light_arm", postures=FEW)
    said = diagnosed(trial, tmp_path)
    assert (said["verdict"], said["effects"]) == ("consistent", [])


@pytest.mark.usefixtures("few_harmonics")
def test_what_the_catalogue_lacks_is_not_named_with_confidence(tmp_path: Path) -> None:
    trial = make_trial(4, "unknown", arm="light_arm", kind="uneven_link", sigma=12.0, postures=FEW)
    said = diagnosed(trial, tmp_path)
    assert said["verdict"] in ("unexplained", "partly_explained")


@pytest.mark.parametrize("arm", ["light_arm", "track_arm"])
def test_the_base_model_can_hold_the_truth_when_nothing_is_hidden(arm: str, tmp_path: Path) -> None:
    """Links run along their joint frames there, so the template "beam" is the true form: nothing is left to name."""
    from drake_stiffness.identification import identify
    from drake_stiffness.task import read_task

    s = make_setting(arm, "displacement", True, FEW, 1)
    everyone = Oracle(s, np.ones(FEW, dtype=bool), np.zeros((0, 0, 0, 0)))
    nothing = Trial(0, "none", s, everyone, everyone, (), (), s.read(s.world, exact=True), np.arange(FEW) < 1)
    task = read_task(write_files(nothing, tmp_path))
    assert np.linalg.norm(identify(task.model, task.observations(), "sdp").residual) < 0.3


def test_records_are_read_back_and_scored(tmp_path: Path) -> None:
    entry = {"kind": "joint_backlash", "where": "j", "confounded_with": [{"kind": "tracker_drift", "where": "tracker"}]}
    hidden = {
        "kind": "tracker_drift",
        "where": "tracker",
        "known": True,
        "sigma": 9.0,
        "sigma_kept": 8.0,
        "sigma_alone": 9.0,
    }
    record = {
        "truth": {
            "seed": 1,
            "plan": "one",
            "arm": "kr270",
            "quantity": "displacement",
            "links": True,
            "hidden": [{**hidden, "oracle_z": 9.1, "oracle_z_kept": 8.2}],
        },
        "document": {
            "verdict": "explained",
            "effects": [entry],
            "untestable": [],
            "gap": {"held_out_p_value_after": 0.4},
        },
        "level": 1e-4,
        "seconds": 1.0,
    }
    (tmp_path / "one_1.json").write_text(json.dumps(record))
    (read,) = read_records(tmp_path)
    assert read.outcome(read.hidden[0]) == "found"
    assert read.wrong == ()
    assert "1/1 = 100 %" in report([read])


def test_the_oracles_class_of_a_weak_effect_holds_what_noise_hides_of_the_difference(tmp_path: Path) -> None:
    truth = {"kind": "scale", "where": "force_or_tracker", "known": True, "sigma": 9.0, "sigma_alone": 9.0}
    truth |= {"oracle_z": 9.0, "oracle_z_kept": 9.0}
    setting = {"seed": 1, "plan": "one", "arm": "kr270", "quantity": "position", "links": False}
    said = {"verdict": "explained", "effects": [], "untestable": [], "gap": {"held_out_p_value_after": 0.4}}
    # Of the payload's like a tenth of the effect's square is missing; at 6 sigma that is 1.9, at 9 it is 2.8 sigma.
    like = {"scale at force_or_tracker": 1.0, "payload at tool": 0.9**0.5, "joint_zero_offset at joint_2": 0.97}
    sizes = []
    for sigma in (6.0, 9.0):
        record = {
            "truth": {**setting, "hidden": [{**truth, "sigma_kept": sigma}]},
            "document": said,
            "level": 1e-4,
            "seconds": 1.0,
        }
        record["likenesses"] = {"scale at force_or_tracker": like}
        (tmp_path / "one_1.json").write_text(json.dumps(record))
        (read,) = read_records(tmp_path)
        assert "payload at tool" not in read.class_of(read.hidden[0], noise=False)
        sizes.append(len(read.class_of(read.hidden[0], noise=True)))
    assert sizes == [3, 2]


def test_the_oracles_class_holds_what_carries_the_true_signature_and_no_more(oracle: Oracle) -> None:
    rng = np.random.default_rng(4)
    hidden = DRAWS["joint_compliance"](oracle.setting, "axis_3", rng)
    # Softer in a joint that the base model already makes soft: nothing is left, so try a link that it holds rigid.
    raw = oracle.whitened(oracle.setting.read(hidden.change(oracle.setting.world, 1.0)) - oracle.clean)
    assert np.linalg.norm(oracle.signature(hidden)) < 1e-3 * np.linalg.norm(raw)
    hidden = DRAWS["link_compliance"](oracle.setting, "upper_arm", rng)
    suspects = {"joint_backlash at axis_3", "tracker_frame at tracker", "link_compliance at upper_arm"}
    like = likenesses(oracle, hidden, suspects, rng)
    assert like.keys() == suspects
    assert like.pop("link_compliance at upper_arm") == 1.0
    assert max(like.values()) < 0.95


def test_the_luck_of_the_readings_is_taken_out_of_the_power():
    """A finder that is as good as the oracle's test, but misses one effect in ten."""
    rng, level, sigma, trials = np.random.default_rng(1), 1e-4, 4.0, 40
    told = power(sigma, 1, level)
    raw, less = [], []
    for _ in range(300):
        same = np.abs(sigma + rng.normal(size=trials)) > norm.isf(level / 2)
        found = same & (rng.random(trials) > 0.1)
        text = less_chance(list(found), list(same), [told] * trials, [told] * trials)
        less.append(float(text.split(" +- ")[0]))
        raw.append(100 * (found.mean() - told))
    assert abs(np.mean(less) + 10 * told) < 1.0
    assert np.std(less) < 0.6 * np.std(raw)
