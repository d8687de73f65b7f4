"""A name must hold to the end: beside the others, and on readings that took no part."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hidden_campaigns import draw, run, table, with_physics, write
from plants.gear_mesh import Backlash

from drake_stiffness.diagnosis import suspects
from drake_stiffness.diagnosis.bench import Bench, Named
from drake_stiffness.diagnosis.confirmation import held_out
from drake_stiffness.diagnosis.diagnosis import diagnose
from drake_stiffness.diagnosis.document import diagnosis_document
from drake_stiffness.diagnosis.doubts import unrefuted
from drake_stiffness.diagnosis.naming import try_all
from drake_stiffness.diagnosis.proof import Stands, proven
from drake_stiffness.diagnosis.search import Search, weighed
from drake_stiffness.diagnosis.suspects import separate_untestable
from drake_stiffness.diagnosis.words import meaning
from drake_stiffness.effects import harmonics
from drake_stiffness.identification import identify
from drake_stiffness.observation import columns, measured, predicted
from drake_stiffness.start import starting_model
from drake_stiffness.task import read_task

PLAY, HELD = "joint_backlash at joint_1", ("E03", "E06", "E09")
TRIED = ("joint_backlash", "joint_hysteresis", "joint_mesh_stiffness", "tracker_drift")


@pytest.fixture(autouse=True)
def few_to_try(monkeypatch):
    monkeypatch.setattr(harmonics, "HARMONICS", (1, 2, 3))
    whole = suspects.effect_kinds
    monkeypatch.setattr(suspects, "effect_kinds", lambda: {k: v for k, v in whole().items() if k in TRIED})


@pytest.fixture(scope="module")
def plan():
    return draw(12, 11)


@pytest.fixture(scope="module")
def played(plan):
    """0.1 mrad of play in joint 1, whose torque sideways loads reverse."""
    return run(plan, with_physics(Backlash(0, 1e-4, 50.0, 0.05, 4000.0)))


def named_so(task, who, *names):
    """A search that has named these, right or wrong, from experiments `who`."""
    o = task.observations(who)
    base = identify(starting_model(task.model, task.measurements), o)
    able, _ = separate_untestable(suspects.suspects(base.model), base.model, task.measurements, True)
    bench = Bench(base, o, able, 0, lambda text: None)
    first = try_all(bench.left(()), able, 0)
    tested = {t.suspect.name: t for t in (*first.passed, *first.failed)}
    named = tuple(Named(tested[name].effect, tested[name], (), first.level) for name in names)
    effects = [n.effect for n in named]
    return Search(bench, bench.fit(effects), named, first, first, bench.left(effects), {})


def test_a_name_that_another_makes_needless_goes(tmp_path, played):
    needless = "joint_mesh_stiffness at joint_1"
    found = named_so(read_task(write(tmp_path, table(played, 1))), np.ones(12, dtype=bool), PLAY, needless)
    names = [n.tested.suspect.name for n in weighed(found).named]
    assert names[0] == PLAY
    assert needless not in names


def test_the_best_of_a_class_leads_it_and_is_in_the_model(tmp_path, played):
    """Friction is all that joined; play in the same joint may be as well, and explains clearly more."""
    found = named_so(
        read_task(write(tmp_path, table(played, 1))), np.ones(12, dtype=bool), "joint_hysteresis at joint_1"
    )
    better = weighed(found)
    assert [n.tested.suspect.name for n in better.named] == [PLAY]
    assert any(e is better.named[0].effect for e in better.solution.model.effects)
    assert better.left.r @ better.left.r < found.left.r @ found.left.r
    friction = [
        t for t in (*better.last.passed, *better.last.failed) if t.suspect.name == "joint_hysteresis at joint_1"
    ]
    assert len(friction) == 1, "it is held against the model that now has the play"


def test_a_name_that_unseen_readings_speak_against_goes_alone(tmp_path, plan, played):
    """Three experiments decide: where they have the play its name stays; where they lack it, it goes."""
    held = np.isin([f"E{e + 1:02d}" for e in plan.course.experiment], HELD)
    lacking = replace(played, exact=np.where(held[:, None, None], run(plan).exact, played.exact))
    for n, done in enumerate((played, lacking)):
        task = read_task(write(tmp_path / str(n), table(done, 1)))
        unseen = np.isin(task.measurements.experiments, HELD)
        found = named_so(task, ~unseen, PLAY)
        kept, gone = unrefuted(found, task.observations(unseen), 1.0)
        assert [m.tested.suspect.name for m in kept.named] == ([PLAY] if n == 0 else [])
        assert list(gone) == ([] if n == 0 else [PLAY])
        assert kept.solution is found.bench.fit([m.effect for m in kept.named])


def test_surprise_is_the_log_density_of_readings_under_noise_and_the_parameters_uncertainty(tmp_path, played):
    task = read_task(write(tmp_path, table(played, 1)))
    unseen = np.isin(task.measurements.experiments, HELD)
    o = task.observations(unseen)
    found = named_so(task, ~unseen, PLAY)
    differences = []
    for solution in (found.bench.base, found.solution):
        A, half = columns(o, solution.model), solution.identifiability.seen / solution.identifiability.weight
        V = 4.0 * (np.eye(o.rows) + A @ (half @ half.T) @ A.T)
        r = measured(o) - predicted(o, solution.model)
        density = float(r @ np.linalg.solve(V, r)) + np.linalg.slogdet(V)[1]
        differences.append(held_out(solution, o, 2.0)[0].surprise - density)
    assert differences[0] == pytest.approx(differences[1], abs=1e-5)


@pytest.mark.parametrize("everywhere", [True, False])
def test_what_unseen_experiments_do_not_show_does_not_stand(tmp_path, plan, played, everywhere):
    """Play that the held-out experiments lack is no property of the arm, however sure the others make it."""
    held = np.isin([f"E{e + 1:02d}" for e in plan.course.experiment], HELD)
    exact = played.exact if everywhere else np.where(held[:, None, None], run(plan).exact, played.exact)
    path = write(tmp_path, table(replace(played, exact=exact), 1), hold_out={"experiments": list(HELD)})
    d = diagnose(read_task(path), lambda text: None)
    assert [n.tested.suspect.name for n in d.search.named] == ([PLAY] if everywhere else [])
    if not everywhere:
        assert "readings that took no part" in d.withdrawn[PLAY] or "of the gap on unseen" in d.withdrawn[PLAY]
        assert d.verdict == "unexplained"


def test_a_step_that_alone_shows_an_effect_may_be_an_outlier_or_that_effect(tmp_path, plan):
    """Of all loads one turns the torque of joint 2 against the weight: either its gear has play, or that reading is wrong."""
    path = write(
        tmp_path,
        table(run(plan, with_physics(Backlash(1, 1e-4, 50.0, 0.0, 4000.0))), 1),
        hold_out={"experiments": list(HELD)},
    )
    d = diagnose(read_task(path), lambda text: None)
    assert [(x.name, x.instead) for x in d.outliers] == [("E12:13", ("joint_backlash at joint_2",))]
    document = diagnosis_document(d, {}, None)
    (entry,) = document["effects"]
    assert entry["confounded_with"] == [{"kind": "joint_backlash", "where": "joint_2"}]
    assert ("joint_backlash", "joint_2") not in [(r["kind"], r["where"]) for r in document["rejected"]], (
        "what may be is not ruled out"
    )
    assert document["verdict"] == "explained"
    assert meaning(document).startswith("without what was left out as outliers")


def on_trial(task, unseen, *names, withdrawn=()):
    """What `proven` makes of a search that named these, and what the held-out readings say of each name alone."""
    found = named_so(task, ~unseen, *names)
    o = task.observations(unseen)
    before = held_out(found.bench.base, o)[0]
    return proven(Stands(found, dict.fromkeys(withdrawn, "no form fits"), {}, ()), before, o, 1.0)


def falls_of(task, unseen):
    """By how much the unseen readings are less probable with each suspect (twice the log), of those that the fitted ones lend anything to."""
    o, whole = task.observations(unseen), named_so(task, ~unseen)
    base = held_out(whole.bench.base, o)[0].surprise
    able = [t for t in (*whole.first.passed, *whole.first.failed) if t.suspect.name != PLAY and t.explained > 4]
    return {t.suspect.name: held_out(whole.bench.fit([t.effect]), o)[0].surprise - base for t in able}


def speaks_against(task, unseen):
    falls = falls_of(task, unseen)
    worst = max(falls, key=falls.__getitem__)
    assert falls[worst] > 6, "nothing here is refuted: another plan of experiments is needed"
    return worst


def test_a_refuted_name_makes_room_for_the_one_that_unseen_readings_bear_out(tmp_path, played):
    task = read_task(write(tmp_path, table(played, 1)))
    unseen = np.isin(task.measurements.experiments, HELD)
    wrong = speaks_against(task, unseen)
    stands = on_trial(task, unseen, wrong)
    assert [n.tested.suspect.name for n in stands.search.named] == [PLAY]
    assert "readings that took no part" in stands.withdrawn[wrong]
    assert not any(wrong == t.suspect.name for n in stands.search.named for t in n.confounded), "it is out of question"
    assert stands.lost == (), "the play explains what it did"


def test_where_a_form_that_the_catalogue_lacks_did_better_no_other_name_is_sought(tmp_path, played):
    task = read_task(write(tmp_path, table(played, 1)))
    unseen = np.isin(task.measurements.experiments, HELD)
    stands = on_trial(task, unseen, speaks_against(task, unseen), withdrawn=["joint_coupling at joint_1+joint_2"])
    assert stands.search.named == ()


def test_what_comes_in_place_of_a_refuted_name_must_be_borne_out(tmp_path, plan, played):
    """The held-out experiments lack the play: they do not speak against it so much, but never for it."""
    held = np.isin([f"E{e + 1:02d}" for e in plan.course.experiment], HELD)
    lacking = replace(played, exact=np.where(held[:, None, None], run(plan).exact, played.exact))
    task = read_task(write(tmp_path, table(lacking, 1)))
    unseen = np.isin(task.measurements.experiments, HELD)
    stands = on_trial(task, unseen, PLAY)
    assert stands.search.named == ()
    assert PLAY in [n.tested.suspect.name for n in stands.lost]


def test_a_first_name_may_be_of_no_account_to_unseen_readings_a_second_choice_may_not(tmp_path, played):
    task = read_task(write(tmp_path, table(played, 1)))
    unseen = np.isin(task.measurements.experiments, HELD)
    falls, o = falls_of(task, unseen), task.observations(unseen)
    vague = min(falls, key=lambda name: abs(falls[name]))
    assert abs(falls[vague]) < 4
    found = named_so(task, ~unseen, vague)
    assert unrefuted(found, o, 1.0)[1] == {}
    assert unrefuted(found, o, 1.0, {vague})[1] == {}
    assert "clearly more probable" in unrefuted(found, o, 1.0, set())[1][vague] or falls[vague] > 0
    assert unrefuted(found, o, 1.0, set())[0].named == ()
