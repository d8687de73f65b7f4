"""Bad input and hard cases of `diagnose`, on small campaigns with a few harmonics and kinds to try.

The whole catalogue at once is tried in test_diagnosis_report.py and in the blind trials; here it would only cost time.
"""

from dataclasses import replace

import numpy as np
import pytest
from hidden_campaigns import SIGMA_M, STEPS, Done, draw, run, table, with_physics, write
from plants.course import Course
from plants.default_experiment import Experiment
from plants.gear_mesh import Backlash, MeshStiffness

from drake_stiffness.diagnosis import suspects
from drake_stiffness.diagnosis.detection import noncentrality
from drake_stiffness.diagnosis.diagnosis import diagnose
from drake_stiffness.diagnosis.document import diagnosis_document
from drake_stiffness.diagnosis.locate import by_part
from drake_stiffness.diagnosis.signatures import Scene
from drake_stiffness.effects import Effect, Parameter, catalogue, harmonics
from drake_stiffness.errors import InputError
from drake_stiffness.hold_out import posture_groups
from drake_stiffness.identification import identify
from drake_stiffness.start import starting_model
from drake_stiffness.task import read_task

POSTURES = 12
PLAY = ("joint_backlash", "joint_1")


def backlash(width):
    """Play in joint 1, whose torque sideways loads reverse."""
    return with_physics(Backlash(0, width, 50.0, 0.05, 4000.0))


LEFT_OUT = {
    "gravity_compensator", "joint_coupling", "joint_periodic_error", "link_geometry", "force_sensor_misalignment", "payload",
    "joint_zero_offset", "tracker_frame", "reflector_offset",
}  # fmt: skip


def few(patch):
    patch.setattr(harmonics, "HARMONICS", (1, 2, 3, 6))
    whole = suspects.effect_kinds
    patch.setattr(suspects, "effect_kinds", lambda: {k: v for k, v in whole().items() if k not in LEFT_OUT})


@pytest.fixture(autouse=True)
def few_to_try(monkeypatch):
    few(monkeypatch)


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    return tmp_path_factory.mktemp("hard")


@pytest.fixture(scope="module")
def plan():
    return draw(POSTURES, 11)


@pytest.fixture(scope="module")
def clean(plan):
    return run(plan)


@pytest.fixture(scope="module")
def played(plan):
    """0.1 mrad of play in joint 1."""
    return run(plan, backlash(1e-4))


def found(path):
    """(diagnosis, document) of a campaign; the plan of the next experiment is not asked for."""
    d = diagnose(read_task(path), lambda text: None)
    return d, diagnosis_document(d, {}, None)


def named(document):
    return [(e["kind"], e["where"]) for e in document["effects"]]


@pytest.fixture(scope="module")
def usual(folder, played):
    """The plain campaign with play, diagnosed once."""
    with pytest.MonkeyPatch.context() as patch:
        few(patch)
        return found(write(folder / "usual", table(played, 1)))


def test_too_few_experiments_to_hold_any_out_are_refused(folder):
    path = write(folder / "few", table(run(draw(5, 11)), 1))
    with pytest.raises(InputError, match=r"5 postures are too few to hold any out.*at least 6.*--fixed"):
        diagnose(read_task(path), lambda text: None)


def test_every_experiment_an_outlier_is_no_list_of_outliers(folder, clean):
    """Every experiment has one step that was knocked: then the readings are bad as a whole, and no effect is named for it."""
    rng, knocks = np.random.default_rng(3), np.zeros((POSTURES, len(STEPS), 1, 3))
    knocks[np.arange(POSTURES), rng.integers(1, len(STEPS), POSTURES)] = rng.normal(scale=1e-3, size=(POSTURES, 1, 3))
    bad = replace(clean, exact=clean.exact + knocks.reshape(-1, 1, 3))
    d, document = found(write(folder / "outliers", table(bad, 1)))
    assert document["verdict"] in ("unexplained", "partly_explained")
    assert len(d.outliers) <= 2
    assert not [e for e in document["effects"] if e["kind"] != "outliers"]


def test_an_experiment_with_bad_steps_that_is_bad_as_a_whole_is_one_outlier(folder, clean):
    """A step of E04 was knocked hard, and all its others moved somewhat: the step is found first, then the rest."""
    rng, knocks = np.random.default_rng(5), np.zeros((POSTURES, len(STEPS), 1, 3))
    knocks[3] = rng.normal(scale=2e-5, size=(len(STEPS), 1, 3))
    knocks[3, 3] += 1e-3
    d, document = found(write(folder / "whole", table(replace(clean, exact=clean.exact + knocks.reshape(-1, 1, 3)), 1)))
    assert named(document) == [("outliers", "E04")]
    assert d.verdict == "explained"


@pytest.mark.parametrize(("stated", "ratio"), [(SIGMA_M / 10, 10.0), (SIGMA_M * 10, 0.1)])
def test_noise_stated_tenfold_wrong_is_noticed_and_play_still_named(folder, played, stated, ratio):
    path = write(folder / f"noise_{ratio}", table(played, 1), noise={"position_sigma_mm": stated * 1e3})
    d, document = found(path)
    assert document["gap"]["noise_implausible"]
    assert d.noise.ratio == pytest.approx(ratio, rel=0.06)
    assert document["gap"]["noise_shown_rms_mm"] == pytest.approx(np.sqrt(3) * SIGMA_M * 1e3, rel=0.06)
    assert document["verdict"] == "explained"
    assert named(document)[0] == PLAY


@pytest.mark.parametrize("stated", [SIGMA_M / 10, SIGMA_M * 10])
def test_noise_stated_tenfold_wrong_alone_is_no_missing_effect(folder, clean, stated):
    path = write(folder / f"noise_only_{stated}", table(clean, 1), noise={"position_sigma_mm": stated * 1e3})
    _, document = found(path)
    assert document["gap"]["noise_implausible"]
    assert document["verdict"] == "consistent"


def test_a_constant_time_column_makes_drift_untestable(folder, played):
    rows = table(played, 1)
    place = rows[0].index("time_s")
    rows = [rows[0], *([*row[:place], "0", *row[place + 1 :]] for row in rows[1:])]
    _, document = found(write(folder / "constant", rows))
    lacks = {u["kind"]: u["lacks"] for u in document["untestable"]}
    assert "time_s is constant" in lacks["tracker_drift"]
    assert named(document)[0] == PLAY


def test_the_order_of_rows_says_nothing(folder, played, usual):
    rows = table(played, 1)
    order = np.random.default_rng(0).permutation(len(rows) - 1)
    _, document = found(write(folder / "shuffled", [rows[0], *(rows[1 + k] for k in order)]))
    _, plain = usual
    assert document["verdict"] == plain["verdict"]
    assert named(document) == named(plain)
    for key in ("before_rms_mm", "after_rms_mm", "held_out_before_rms_mm", "held_out_after_rms_mm"):
        assert document["gap"][key] == pytest.approx(plain["gap"][key], rel=1e-4), key


def test_steps_are_listed_in_their_order_although_the_first_posture_lacks_one(folder, played):
    rows = [row for row in table(played, 1) if row[:2] != ["E01", "1"]]
    task = read_task(write(folder / "lacking", rows))
    solution = identify(starting_model(task.model, task.measurements), task.observations())
    places = by_part(Scene(solution.model, task.observations()), solution.residual, 100)["by_step"]
    assert [int(place.name) for place in places] == sorted(STEPS)


def test_what_a_joint_that_never_moved_hides_is_untestable(folder):
    _, document = found(write(folder / "held", table(run(draw(POSTURES, 11, {5: 30.0}), backlash(1e-4)), 1)))
    lacks = {(u["kind"], u["where"]): u["lacks"] for u in document["untestable"]}
    assert "different angles of joint_6" in lacks["joint_mesh_stiffness", "joint_6"]
    assert not any(kind == "joint_mesh_stiffness" and where == "joint_2" for kind, where in lacks)
    assert named(document)[0] == PLAY


def test_two_effects_that_cancel_leave_nothing_to_name(folder, plan):
    """Two meshes of one joint in opposite phase: what is left of each is a few per cent, below the noise."""
    one, other = (MeshStiffness(1, 0.05e-6, 0.1, 2.0, phase) for phase in (0.0, np.pi))
    alone = found(write(folder / "alone", table(run(plan, with_physics(one)), 1)))[1]
    assert ("joint_mesh_stiffness", "joint_2") in named(alone)
    both = found(write(folder / "both", table(run(plan, with_physics(one, other)), 1)))[1]
    assert both["verdict"] == "consistent"
    assert named(both) == []


def test_the_limit_of_what_is_seen_is_said_and_is_true(folder, plan, clean):
    """Nothing hidden: play in joint 1 is "not detectable above" a width. Half of it is not named, one and a half times is."""
    _, document = found(write(folder / "clean", table(clean, 1)))
    limits = {(x["kind"], x["where"]): x for x in document["not_detectable_above"]}
    width = limits[PLAY]["value"]
    assert limits[PLAY]["unit"] == "rad"
    assert 0 < limits[PLAY]["rms_um"] < SIGMA_M * 1e6
    _, below = found(write(folder / "below", table(run(plan, backlash(0.4 * width)), 1)))
    assert PLAY not in named(below)
    assert below["verdict"] == "consistent"
    _, above = found(write(folder / "above", table(run(plan, backlash(1.8 * width)), 1)))
    assert PLAY in named(above)


def test_the_limit_has_the_power_it_states():
    """Against draws of the F statistic itself."""
    from scipy.special import fdtri

    rng, p, dof, level = np.random.default_rng(0), 3, 60, 1e-4
    size = noncentrality(p, dof, level)
    signal = rng.normal(size=(200_000, p)) + np.array([np.sqrt(size), 0.0, 0.0])
    f = (signal**2).sum(axis=1) / p / (rng.chisquare(dof, 200_000) / dof)
    assert (f > fdtri(p, dof, 1 - level)).mean() == pytest.approx(0.9, abs=0.005)


def test_a_posture_measured_twice_stays_on_one_side(folder, clean, plan):
    """Experiment 1 repeated as experiment 13: both are fitted or both are held out, in the hold-out and in the folds."""
    c = plan.course
    first = c.experiment == 0
    course = Course(
        np.append(c.experiment, np.full(first.sum(), POSTURES)), np.append(c.step, c.step[first]),
        np.append(c.time_s, c.time_s[first] + 1e5),
    )  # fmt: skip
    again = Experiment(*(np.append(a, a[first], axis=0) for a in (plan.q_printed, plan.q, plan.wrench)), course)
    twice = Done(again, np.append(clean.exact, clean.exact[first], axis=0))
    for seed in range(4):
        path = write(folder / f"twice_{seed}", table(twice, 1), hold_out={"fraction": 0.25, "seed": seed})
        held = read_task(path).held
        assert held[0] == held[POSTURES]
    d, document = found(path)
    assert document["verdict"] == "consistent"
    groups = posture_groups(d.observations.measurements.cases)
    folds = d.search.left.folds(0)
    for g in np.unique(groups):
        assert np.unique(folds[groups[d.observations.cluster] == g]).size == 1


class Broken(Effect):
    """A kind whose author made a mistake."""

    kind, station = "broken_idea", "spring"

    @property
    def parameters(self):
        return (Parameter("c", "rad", 1e-6),)

    @classmethod
    def candidates(cls, arm, points):
        yield cls(arm.joint_names[1])

    def deflection(self, arm, carried, cases, x):
        return {1: x[0] * carried.tau_joint[1][:, 5]}


@pytest.fixture
def own_kind():
    """Registers a kind for one test."""
    yield catalogue.register
    for kind in ("broken_idea", "broken_list"):
        catalogue._registered.pop(kind, None)
    catalogue.effect_kinds.cache_clear()


def test_a_candidate_that_raises_fails_alone(folder, played, own_kind):
    own_kind(Broken)
    _, document = found(write(folder / "broken", table(played, 1)))
    assert named(document)[0] == PLAY
    why = {(r["kind"], r["where"]): r["why"] for r in document["rejected"]}
    assert why["broken_idea", "joint_2"].startswith("could not be tried: IndexError")


def test_a_kind_that_cannot_even_list_its_places_fails_alone(folder, played, own_kind):
    class Lost(Broken):
        kind = "broken_list"

        @classmethod
        def candidates(cls, arm, points):
            raise KeyError("no such joint")

    own_kind(Lost)
    _, document = found(write(folder / "lost", table(played, 1)))
    assert named(document)[0] == PLAY
    why = {r["kind"]: r["why"] for r in document["rejected"]}
    assert "KeyError" in why["broken_list"]
