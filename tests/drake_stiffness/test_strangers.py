"""Forms that the catalogue lacks: they take names away that stand in for them, and only those."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from hidden_campaigns import draw, run, table, with_physics, write
from plants.creep import Creep
from plants.dress_pack import DressPack
from plants.friction import DahlFriction

from drake_stiffness.diagnosis.diagnosis import diagnose
from drake_stiffness.diagnosis.document import diagnosis_document
from drake_stiffness.diagnosis.doubts import _against, pull_like
from drake_stiffness.diagnosis.evidence import basis_of
from drake_stiffness.diagnosis.naming import remaining
from drake_stiffness.diagnosis.signatures import Scene, signature
from drake_stiffness.diagnosis.strangers import Stranger, crept, likeness, score, strangers
from drake_stiffness.diagnosis.words import limits_in_words
from drake_stiffness.effects import effect_kinds, harmonics
from drake_stiffness.effects.catalogue import make_effect
from drake_stiffness.identification import identify
from drake_stiffness.observation import whitened
from drake_stiffness.start import starting_model
from drake_stiffness.task import read_task

POSTURES = 10


@pytest.fixture(autouse=True)
def few_harmonics(monkeypatch):
    monkeypatch.setattr(harmonics, "HARMONICS", (1, 2, 3))


@pytest.fixture(scope="module")
def plan():
    return draw(POSTURES, 5)


def found(path):
    d = diagnose(read_task(path), lambda text: None)
    return d, diagnosis_document(d, {}, None)


def test_creep_is_not_called_friction_even_where_all_steps_take_as_long(tmp_path, plan):
    """25 s a step throughout: time says nothing that the order of steps does not."""
    creeping = run(plan, with_physics(Creep(1, 0.015e-6, 40.0)))
    _, document = found(write(tmp_path, table(creeping, 2)))
    assert document["verdict"] == "unexplained"
    assert document["effects"] == []
    withdrawn = {(r["kind"], r["where"]): r["why"] for r in document["rejected"]}
    assert "creep in joint_2" in withdrawn["joint_hysteresis", "joint_2"]
    assert "creep in joint_2" in document["where_in_words"]["after"]
    assert all(np.isfinite(limit["rms_um"]) for limit in document["not_detectable_above"])


def test_friction_that_develops_keeps_its_name(tmp_path, plan):
    """Dahl's friction is no play operator either, but nothing outside the catalogue resembles it more."""
    rubbing = run(plan, with_physics(DahlFriction(1, 0.05e-6, 400.0, steepness=10.0)))
    d, document = found(write(tmp_path, table(rubbing, 2)))
    assert [(e["kind"], e["where"]) for e in document["effects"]] == [("joint_hysteresis", "joint_2")]
    assert document["verdict"] == "explained"
    assert d.withdrawn == {}


def test_a_hose_looks_more_like_a_pull_across_joints_than_like_any_error_of_one(tmp_path, plan):
    """In positions; from link 4 to the flange, with a pull that goes with the square of its length."""
    hose = DressPack(3, np.array([0.1, 0.2, 0.1]), np.array([0.05, -0.1, 0.12]), 400.0, 0.8)
    pulled = run(plan, lambda world: world.with_arm(pulls=(hose,)))
    task = read_task(write(tmp_path, table(replace(pulled, exact=run(plan).exact), 2), quantity="position"))
    scene = Scene(starting_model(task.model, task.measurements), task.observations())
    change = np.zeros((pulled.exact[..., 0].size, 6, 1))
    change[:, :3, 0] = (pulled.exact - run(plan).exact).reshape(-1, 3)
    true = whitened(scene.o, change)[:, 0]

    def share(S):
        Q = basis_of(S)
        return np.linalg.norm(Q.T @ true) ** 2 / (true @ true)

    pulls = {s.what: share(s.variants[0]) for s in strangers(scene) if "pull" in s.what}
    errors = [share(signature(scene, e)) for e in effect_kinds()["joint_periodic_error"].candidates(task.model.arm, {})]
    assert max(pulls, key=pulls.__getitem__).startswith("a pull across joint_4, joint_5 and joint_6")
    assert max(pulls.values()) > 0.95
    assert 1 - max(pulls.values()) < 0.1 * (1 - max(errors)), f"{max(pulls.values())}"


def test_a_spring_between_two_links_turns_their_joint_once_a_turn():
    """From a pin on one link to one on the next, without free length, by the slope of its energy: why the warning is given."""
    q = np.linspace(-3.0, 3.0, 61)
    far = np.array([0.4 + 0.3 * np.cos(q) - 0.1 * np.sin(q), 0.2 + 0.3 * np.sin(q) + 0.1 * np.cos(q)])
    torque = -np.gradient(0.5 * (far**2).sum(axis=0), q)[1:-1]

    def left(harmonic: float) -> float:
        waves = np.column_stack([np.sin(harmonic * q), np.cos(harmonic * q)])[1:-1]
        return float(
            np.linalg.norm(torque - waves @ np.linalg.lstsq(waves, torque, rcond=None)[0]) / np.linalg.norm(torque)
        )

    assert left(1.0) < 1e-3
    assert left(2.0) > 0.9


@pytest.mark.parametrize(
    ("settings", "words"),
    [
        ({"harmonic": 1.0}, "a hose or a spring that pulls across joint_5"),
        ({"harmonic": [1.0, 16.0]}, "a hose or a spring that pulls across joint_5, for its part of one period a turn"),
        ({"harmonic": 2.0}, ""),
        ({"harmonic": 1.0, "prismatic": True}, ""),
    ],
)
def test_an_error_of_one_period_a_turn_is_named_with_what_else_would_do_so(settings, words):
    assert pull_like(make_effect("joint_periodic_error", "joint_5", settings)) == words


@pytest.mark.parametrize(
    ("others", "speaks"),
    [
        ([], True),
        ([make_effect("joint_periodic_error", "joint_5", {"harmonic": 2.0})], True),
        ([make_effect("joint_zero_offset", "joint_5", {})], True),
        ([make_effect("joint_compliance", "joint_5", {})], False),
        ([make_effect("payload", "tool", {})], False),
    ],
)
def test_a_hose_speaks_against_what_carries_no_load_and_against_nothing_that_may_be_a_spring_or_a_weight(
    others, speaks
):
    tested = [SimpleNamespace(effect=e) for e in (make_effect("link_geometry", "joint_4", {}), *others)]
    hose, other = Stranger("a hose", (), like_weight=True), Stranger("creep", ())
    named = [SimpleNamespace(tested=tested[0], confounded=tested[1:])]
    assert _against([hose, other], named) == ([hose, other] if speaks else [other])


def test_a_kelvin_element_follows_with_its_time(tmp_path, plan):
    """Against the plant's own, which goes step by step."""
    task = read_task(write(tmp_path, table(run(plan), 2)))
    scene = Scene(task.model, task.observations())
    c = scene.cases
    tau = np.random.default_rng(0).normal(size=c.number)
    elapsed = np.where(c.step > 0, np.diff(c.time_s, prepend=0.0), 0.0)
    ours = crept(tau, elapsed, scene, 40.0)
    from plants.course import Course

    course = Course(c.experiment, c.step, c.time_s)
    torque = np.zeros((6, c.number))
    torque[1] = tau
    theirs = Creep(1, 1.0, 40.0).turn(torque, np.zeros((c.number, 6)), course)[1]
    np.testing.assert_allclose(ours, theirs, atol=1e-12)


def test_noise_resembles_no_form(tmp_path, plan):
    task = read_task(write(tmp_path, table(run(plan), 2)))
    solution = identify(task.model, task.observations(), "sdp")
    scene = Scene(solution.model, task.observations())
    left = remaining(scene, solution.residual, solution.identifiability.seen)
    best = likeness(left, strangers(scene), left.per_dof)[0]
    assert best.p_value > 1e-5
    assert score(30.0, 3, 10, 2.0) == pytest.approx(15.0 - 6.0 - 2 * np.log(10))


def test_limits_are_said_a_line_a_kind():
    limits = [
        {"kind": "joint_backlash", "where": w, "rms_um": r, "parameter": "width", "value": v, "unit": "rad"}
        for w, r, v in (("joint_2", 3.04, 2.0e-5), ("joint_1", 1.5, 1e-5))
    ]
    (line,) = limits_in_words(limits)
    assert "joint_backlash" in line
    assert line.index("1.5 um rms at joint_1") < line.index("3 um rms at joint_2")
    assert "mrad" in line


def test_a_turn_of_a_joint_moves_what_the_others_carry(tmp_path, plan):
    """Signatures against what the effect really does in the loaded equilibrium: a compensator stiff enough to shift the posture."""
    from drake_stiffness.diagnosis.signatures import extended, signature
    from drake_stiffness.observation import predicted

    task = read_task(write(tmp_path, table(run(plan), 2)))
    solution = identify(task.model, task.observations(), "sdp")
    scene = Scene(solution.model, task.observations())
    effect = make_effect("gravity_compensator", "joint_2", {"anchor_m": [0.5, 0.1], "lever_m": 0.15})
    x = np.array([1e5, 5e4])
    S = signature(scene, effect) @ (x / [p.scale for p in effect.parameters])
    true = predicted(scene.o, extended(solution.model, effect, x)) - predicted(scene.o, solution.model)
    # A few per cent are left to second order.
    assert np.linalg.norm(S - true) < 0.05 * np.linalg.norm(true)
