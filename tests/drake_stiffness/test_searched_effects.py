"""Effects with constants that are searched: drifts that settle or grow, friction that never slips, a spring whose ends nobody told."""

import numpy as np
import pytest

from drake_stiffness.effects import effect_kinds, make_effect
from drake_stiffness.effects.drift import TrackerDrift
from drake_stiffness.effects.effect import Carried, Cases, Reading
from drake_stiffness.effects.gravity_compensator import GravityCompensator
from drake_stiffness.errors import InputError


def drifted(time_s, v, **settings):
    """How far the readings of three points in every case have moved."""
    n = time_s.size
    cases = Cases(np.zeros((6, n)), np.zeros((6, n)), np.zeros(3), np.zeros(n, dtype=int), np.arange(n), time_s)
    case = np.repeat(np.arange(n), 3)
    start = Reading(np.ones((3, 3 * n)), np.tile(np.eye(3)[:, :, None], 3 * n), np.full(3 * n, "P"), case)
    moved = make_effect("tracker_drift", "tracker", settings).on_reading(start, cases, np.asarray(v))
    return (moved.p - start.p)[:, ::3]


@pytest.mark.parametrize("T", [600.0, 4800.0, -4800.0])
def test_the_rate_of_a_drift_decays_or_grows_with_its_time_constant(T):
    time, v = np.linspace(0.0, 7200.0, 200_001), np.array([3e-8, -1e-8, 2e-8])
    rate = np.exp(-time / T)
    travelled = np.concatenate([[0.0], np.cumsum((rate[1:] + rate[:-1]) / 2 * np.diff(time))])
    some = np.arange(0, time.size, 20_000)
    np.testing.assert_allclose(
        drifted(time[some], v, settling_s=T), v[:, None] * travelled[some], rtol=1e-6, atol=1e-18
    )


def test_a_drift_that_settles_late_is_steady_and_an_unknown_time_is_the_start():
    time, v = np.array([0.0, 1800.0, np.nan, 7200.0]), np.array([3e-8, -1e-8, 2e-8])
    np.testing.assert_allclose(drifted(time, v), v[:, None] * [0.0, 1800.0, 0.0, 7200.0])
    np.testing.assert_allclose(drifted(time, v, settling_s=1e9), drifted(time, v), rtol=1e-5)


@pytest.mark.parametrize("T", [0.0, 59.0, -59.0, float("nan"), "fast"])
def test_a_drift_that_settles_at_once_is_refused(T):
    with pytest.raises(InputError, match=r"found settling_s: .*; expected a time of at least 60 s"):
        make_effect("tracker_drift", "tracker", {"settling_s": T})


def carrying(tau):
    """Joint 2 carries these torques."""
    torque = np.zeros((6, len(tau)))
    torque[1] = tau
    return Carried(torque, [None] * 7, np.zeros_like(torque))


def turned(effect, arm, tau):
    n = len(tau)
    cases = Cases(np.zeros((6, n)), np.zeros((6, n)), np.zeros(3), np.zeros(n, dtype=int), np.arange(n))
    return effect.deflection(arm, carrying(tau), cases, np.ones(1))[1]


@pytest.mark.parametrize(
    ("settings", "factor"),
    [({"form": "quadratic"}, 4.0), ({"form": "cubic"}, 8.0), ({"form": "contact"}, 2 ** (2 / 3))],
)
def test_a_spring_that_hardens_turns_by_a_power_of_the_torque_and_back(arms, settings, factor):
    effect = make_effect("joint_hardening", "joint_2", settings)
    once, twice, back = turned(effect, arms["kr270"], [900.0, 1800.0, -900.0])
    assert twice / once == pytest.approx(factor, rel=1e-4)
    assert back == -once


def test_a_soft_start_ends_at_its_knee(arms):
    effect = make_effect("joint_hardening", "joint_2", {"form": "two_slopes", "knee": 300.0})
    np.testing.assert_allclose(
        turned(effect, arms["kr270"], [-900.0, 150.0, 300.0, 900.0]), [-300.0, 150.0, 300.0, 300.0]
    )


@pytest.mark.parametrize(
    ("tau", "shown"),
    [(np.linspace(-900, 900, 50), True), (np.linspace(400, 900, 50), False), (np.full(50, 90.0), False)],
)
def test_a_knee_shows_where_loads_lie_on_both_sides_of_it(arms, tau, shown):
    effect = make_effect("joint_hardening", "joint_2", {"form": "two_slopes", "knee": 350.0})
    assert effect.idle(arms["kr270"], carrying(tau)) is not shown


@pytest.mark.parametrize(
    ("settings", "words"),
    [
        ({"form": "cube"}, "found form: 'cube'; expected quadratic, cubic, contact, two_slopes"),
        ({"form": "two_slopes"}, "found form: two_slopes with knee: None; expected a torque above zero"),
        ({"form": "two_slopes", "knee": -3.0}, "with knee: -3.0; expected a torque above zero"),
        ({"form": "two_slopes", "knee": float("inf")}, "with knee: inf; expected a torque above zero"),
        ({"form": "two_slopes", "knee": "stiff"}, "with knee: 'stiff'; expected a torque above zero"),
        ({"form": "cubic", "knee": 300.0}, "found form: cubic with knee: 300.0; expected .* none where it is another"),
    ],
)
def test_a_form_of_hardening_that_is_not_known_is_not_taken_for_another(settings, words):
    with pytest.raises(InputError, match=words):
        make_effect("joint_hardening", "joint_2", settings)


@pytest.mark.parametrize("kind", ["tracker_drift", "joint_hardening"])
def test_all_constants_that_a_search_tries_come_back_from_a_file(arms, kind):
    tried = list(effect_kinds()[kind].candidates(arms["kr270"], {}))
    assert len(tried) > 1
    for effect in (*tried, *(near for own in tried for near in own.neighbours(0.5))):
        assert make_effect(effect.kind, effect.where, effect.settings()).settings() == effect.settings()


@pytest.mark.parametrize(("largest", "slips"), [(99.0, False), (101.0, True)])
def test_friction_that_never_slips_is_a_spring_of_the_load_alone(arms, largest, slips):
    """Weight holds 2000 N m; what the loads add stays below what the joint slips at, or not, however they follow each other."""
    arm, n = arms["kr270"], 9
    tau, weight = np.zeros((6, n)), np.zeros((6, n))
    weight[1] = 2000.0
    tau[1] = 2000.0 + largest * np.array([0.0, 0.5, 1.0, 0.2, -1.0, 0.0, 1.0, -0.3, 0.1])
    carried = Carried(tau, [None] * 7, weight)
    cases = Cases(np.zeros((6, n)), np.zeros((6, n)), np.zeros(3), np.zeros(n, dtype=int), np.arange(n))
    friction = make_effect("joint_hysteresis", "joint_2", {"threshold": 100.0})
    turned = friction.deflection(arm, carried, cases, np.array([1e-4]))[1]
    spring = 1e-4 * (weight[1] - tau[1]) / 100.0
    assert np.allclose(turned, spring, atol=1e-12) is not slips
    assert friction.idle(arm, carried) is not slips


@pytest.mark.parametrize("scale", [0.3, 4.0])
def test_what_is_said_of_a_spring_with_unknown_ends_does_not_depend_on_their_scale(scale):
    q, x = np.linspace(-2.0, 1.0, 9), np.array([1.2e5, 4e4])
    here = GravityCompensator("joint_2", (0.6, 0.1), 0.2, 30.0)
    there = GravityCompensator("joint_2", (0.6 * scale, 0.1 * scale), 0.2 * scale, 30.0)
    x_there = np.array([x[0] / scale**2, x[1] / scale])
    np.testing.assert_allclose(there.moment(q, x_there), here.moment(q, x), rtol=1e-12)
    for name, (value, unit) in here.derived(x).items():
        assert there.derived(x_there)[name] == (pytest.approx(value, rel=1e-12), unit)
    assert set(here.conventional) == {p.name for p in here.parameters}


def test_a_torque_does_not_say_which_end_of_its_spring_is_the_farther_one():
    q, x = np.linspace(-2.0, 1.0, 9), np.array([1.2e5, 4e4])
    far, near = GravityCompensator("j", (0.6, 0.0), 0.2, 30.0), GravityCompensator("j", (0.2, 0.0), 0.6, 30.0)
    np.testing.assert_allclose(far.moment(q, x), near.moment(q, x), rtol=1e-12)
    assert far.derived(x) == near.derived(x)


def test_a_clock_that_counts_from_1970_loses_nothing_of_a_drift():
    """The rate is counted from the first reading: 1.7e9 s times it would swamp every micrometre."""
    start, time_s = 1.7e9, np.array([0.0, 900.0, 1800.0])
    n = time_s.size
    reading = Reading(np.zeros((3, n)), np.zeros((3, 3, n)), np.array(["P"] * n), np.arange(n))
    late, early = (
        Cases(np.zeros((6, n)), np.zeros((6, n)), np.zeros(3), np.zeros(n, dtype=int), np.arange(n), t)
        for t in (start + time_s, time_s)
    )
    for drift in (TrackerDrift(), TrackerDrift(settling_s=-4800.0)):
        there = drift.timed_from(start).on_reading(reading, late, np.array([1e-8, 0.0, 0.0]))
        here = drift.on_reading(reading, early, np.array([1e-8, 0.0, 0.0]))
        np.testing.assert_allclose(there.p, here.p, atol=1e-15)
        assert 0.8e-5 < here.p[0, 1] < 1.1e-5
