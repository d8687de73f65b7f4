"""A name must hold to the end: beside the others, and on readings that took no part."""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np
import pytest
from hidden_campaigns import draw, run, table, with_physics, write
from plants.gear_mesh import Backlash
from rich.console import Console

from drake_stiffness.diagnosis import diagnosis, refutation, suspects
from drake_stiffness.diagnosis.bench import Bench, Named
from drake_stiffness.diagnosis.confirmation import held_out
from drake_stiffness.diagnosis.diagnosis import diagnose
from drake_stiffness.diagnosis.document import diagnosis_document
from drake_stiffness.diagnosis.generic import fit_process
from drake_stiffness.diagnosis.job import diagnose_campaign
from drake_stiffness.diagnosis.naming import try_all
from drake_stiffness.diagnosis.refutation import Stands, borne_out, of_fitting_form, speaks_against
from drake_stiffness.diagnosis.search import Search, weighed
from drake_stiffness.diagnosis.suspects import separate_untestable
from drake_stiffness.diagnosis.words import meaning, show_diagnosis
from drake_stiffness.effects import harmonics
from drake_stiffness.identification import identify
from drake_stiffness.observation import columns, measured, predicted
from drake_stiffness.start import starting_model
from drake_stiffness.task import Task, read_task

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


def test_who_is_barred_does_not_lead_a_class_and_stays_in_it(tmp_path, played):
    friction = "joint_hysteresis at joint_1"
    found = named_so(read_task(write(tmp_path, table(played, 1))), np.ones(12, dtype=bool), friction)
    (n,) = weighed(found, (), frozenset({PLAY})).named
    assert n.tested.suspect.name != PLAY
    assert PLAY in {t.suspect.name for t in n.confounded}


def test_a_name_that_unseen_readings_speak_against_goes_alone(tmp_path, plan, played):
    """Three experiments decide: where they have the play its name stays; where they lack it, it goes."""
    held = np.isin([f"E{e + 1:02d}" for e in plan.course.experiment], HELD)
    lacking = replace(played, exact=np.where(held[:, None, None], run(plan).exact, played.exact))
    for n, done in enumerate((played, lacking)):
        task = read_task(write(tmp_path / str(n), table(done, 1)))
        unseen = np.isin(task.measurements.experiments, HELD)
        found = named_so(task, ~unseen, PLAY)
        against = speaks_against(found, task.observations(unseen), 1.0)
        assert (against is None) == (n == 0)
        if against is not None:
            assert against.name == PLAY
            assert "readings that took no part" in against.why


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
    done = diagnose_campaign(path)
    d, console = done.diagnosis, Console(record=True, width=400)
    show_diagnosis(console, done)
    assert [n.tested.suspect.name for n in d.search.named] == ([PLAY] if everywhere else [])
    assert (f"Withdrawn: {PLAY}; {d.withdrawn.get(PLAY)}" in console.export_text()) == (not everywhere)
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


def falls_of(task, unseen):
    """By how much the unseen readings are less probable with each suspect (twice the log), of those that the fitted ones lend anything to."""
    o, whole = task.observations(unseen), named_so(task, ~unseen)
    base = held_out(whole.bench.base, o)[0].surprise
    able = [t for t in (*whole.first.passed, *whole.first.failed) if t.suspect.name != PLAY and t.explained > 4]
    return {t.suspect.name: held_out(whole.bench.fit([t.effect]), o)[0].surprise - base for t in able}


@dataclass
class Trial:
    """A first search that found some names, and what every search anew finds; none of them is right or wrong but by the readings."""

    task: Task
    unseen: np.ndarray
    wrong: str
    vague: str
    asked: list = field(default_factory=list)

    def found(self, names, p_value=1e-30):
        found = named_so(self.task, ~self.unseen, *names)
        return replace(found, named=tuple(replace(n, tested=replace(n.tested, p_value=p_value)) for n in found.named))

    def of(self, monkeypatch, first, *later, withdrawn=(), p_value=1e-30):
        rounds = iter(later)

        def search(bench, known, barred):
            self.asked.append(({s.name for s in bench.found}, set(barred)))
            return self.found(next(rounds))

        monkeypatch.setattr(refutation, "search", search)
        monkeypatch.setattr(refutation, "weighed", lambda found, known, barred: found)
        monkeypatch.setattr(refutation, "stand_ins", lambda found, left: ({}, {}))
        monkeypatch.setattr(refutation, "wrong_forms", lambda named, process: {})
        monkeypatch.setattr(refutation, "doubtful_names", lambda *rest: {})
        found = self.found(first, p_value)
        o = self.task.observations(self.unseen)
        stands = replace(of_fitting_form(found), withdrawn=dict.fromkeys(withdrawn, "its form does not fit"))
        return borne_out(stands, held_out(found.bench.base, o)[0], o, 1.0)


@pytest.fixture
def trial(tmp_path, played):
    task = read_task(write(tmp_path, table(played, 1)))
    unseen = np.isin(task.measurements.experiments, HELD)
    falls = falls_of(task, unseen)
    wrong, vague = max(falls, key=falls.__getitem__), min(falls, key=lambda name: abs(falls[name]))
    assert falls[wrong] > 6, "another plan of experiments is needed: nothing is refuted"
    assert abs(falls[vague]) < 4, "another plan of experiments is needed: nothing is of no account"
    return Trial(task, unseen, wrong, vague)


def names(stands):
    return [n.tested.suspect.name for n in stands.search.named]


def test_a_refuted_name_makes_room_for_the_one_that_unseen_readings_bear_out(trial, monkeypatch):
    stands = trial.of(monkeypatch, [trial.wrong], [PLAY])
    assert names(stands) == [PLAY]
    [(tried, barred)] = trial.asked
    assert trial.wrong not in tried
    assert barred == {trial.wrong}
    assert "predicted worse" in stands.withdrawn[trial.wrong]
    assert stands.refuted == {trial.wrong}
    assert stands.lost == (), "the play explains what it did"
    assert trial.wrong in {s.name for s in stands.search.tried}, "it was tried against the base model"


def test_what_a_refuted_name_explained_is_lost_where_nothing_takes_its_place(trial, monkeypatch):
    stands = trial.of(monkeypatch, [trial.wrong], [])
    assert names(stands) == []
    assert [n.tested.suspect.name for n in stands.lost] == [trial.wrong]


def test_a_name_that_just_passed_and_is_refuted_was_chance(trial, monkeypatch):
    level = trial.found([]).first.level
    assert trial.of(monkeypatch, [trial.wrong], [], p_value=0.1 * level).lost == ()


def test_a_second_choice_must_be_borne_out_a_first_one_only_not_refuted(trial, monkeypatch):
    assert names(trial.of(monkeypatch, [trial.vague])) == [trial.vague]
    assert names(trial.of(monkeypatch, [trial.vague, trial.wrong], [PLAY, trial.vague])) == [PLAY, trial.vague]
    trial.asked.clear()
    stands = trial.of(monkeypatch, [trial.wrong], [trial.vague], [])
    assert names(stands) == []
    assert "ten times as probable" in stands.withdrawn[trial.vague]
    (_, (tried, barred)) = trial.asked
    assert barred == {trial.wrong, trial.vague}
    assert trial.vague in tried, "nothing refutes it: it stays in the classes of others"


def test_companions_of_a_refuted_name_are_judged_beside_what_takes_its_place(trial, monkeypatch):
    """A name that unseen readings refute while a strong effect is missing stands beside that effect."""
    stands = trial.of(monkeypatch, [trial.wrong, trial.vague], [PLAY, trial.vague])
    assert set(names(stands)) == {PLAY, trial.vague}
    assert trial.vague not in stands.withdrawn


def test_where_a_form_does_not_fit_no_other_name_is_sought(trial, monkeypatch):
    stands = trial.of(monkeypatch, [trial.wrong], withdrawn=["joint_coupling at joint_1+joint_2"])
    assert names(stands) == []
    assert trial.asked == []
    assert stands.search.solution is stands.search.bench.fit([]), "refitted without it"


def test_the_search_starts_anew_five_times_at_most(trial, monkeypatch):
    stands = trial.of(monkeypatch, *([trial.wrong] for _ in range(6)))
    assert names(stands) == []
    assert len(trial.asked) == 5


def test_play_is_found_behind_a_wrong_name_by_the_search_itself(trial):
    found, o = trial.found([trial.wrong]), trial.task.observations(trial.unseen)
    first = Stands(found, fit_process(found.left, found.solution.identifiability.seen), {}, frozenset(), {}, ())
    stands = borne_out(first, held_out(found.bench.base, o)[0], o, 1.0)
    assert names(stands) == [PLAY]
    assert not any(trial.wrong == t.suspect.name for n in stands.search.named for t in n.confounded)


@pytest.mark.parametrize("anew", [True, False])
def test_what_sticks_out_of_held_out_readings_is_looked_for_again_after_a_search_anew(
    tmp_path, played, monkeypatch, anew
):
    """Held-out experiments that show the play most stick out of a model without it, and not out of the one that was found anew."""
    held = ["E02", "E04", "E07"]
    task = read_task(write(tmp_path, table(played, 1), hold_out={"experiments": held}))
    unseen = np.isin(task.measurements.experiments, held)
    right, first = named_so(task, ~unseen, PLAY), named_so(task, ~unseen)

    def found_anew(stands, before, o_held, ratio):
        return replace(stands, search=right, anew=anew)

    monkeypatch.setattr(diagnosis, "weighed", lambda found, known: first)
    monkeypatch.setattr(diagnosis, "borne_out", found_anew)
    d = diagnose(task, lambda text: None)
    told = [x.name for x in d.outliers] + [name for name in d.withdrawn if name.startswith("outliers")]
    assert (told == []) == anew
