"""A prediction says how much of it was never observed, and how sure the rest is."""

import numpy as np
import pytest
from synthetic import FORWARD, SIDEWAYS, VERTICAL, noise, plan, points_of, table, watched

from drake_stiffness.assembly import make_model
from drake_stiffness.effects.compliance import JointCompliance
from drake_stiffness.identification import identify
from drake_stiffness.observation import observe
from drake_stiffness.simulation import simulate_displacement
from drake_stiffness.statistics import attach, goodness, statistics
from drake_stiffness.support import REFUSE_ABOVE, WARN_ABOVE, displacement_support, position_support

K6 = np.array([0.33e-6, 0.30e-6, 0.42e-6, 2.8e-6, 2.9e-6, 3.4e-6])
SIGMA = 12e-6


def joints(cell, arm):
    return make_model(cell, arm, [JointCompliance(name) for name in arm.joint_names])


def identified(cell, arm, o):
    solution = identify(joints(cell, arm), o)
    fit = goodness(solution, o)
    return attach(solution, statistics(solution, o, fit)[0], {}, {})


def every(cases, model):
    names, number = np.array(list(model.points)), cases.number
    return np.repeat(np.arange(number), names.size), np.tile(names, number)


@pytest.fixture
def world(arms, cells, judges):
    return arms["kr270"], cells["kr270"], judges["kr270"], np.random.default_rng(0)


def test_sideways_predictions_from_vertical_loads_rest_on_nothing_for_joint_1(tmp_path, world):
    arm, cell, judge, rng = world
    cases = plan(arm, cell, 6, rng, [VERTICAL])
    model = identified(
        cell, arm, watched(tmp_path, cell, arm, cases, judge.positions(cases, points_of(cell), K6), SIGMA)
    )
    down, aside = plan(arm, cell, 4, rng, [VERTICAL]), plan(arm, cell, 4, rng, [SIDEWAYS, FORWARD])
    assert displacement_support(model, down, *every(down, model)).unsupported.max() < 1e-6
    case, point = every(aside, model)
    share = displacement_support(model, aside, case, point).unsupported
    loaded = aside.step[case] > 0
    assert np.median(share[loaded]) > WARN_ABOVE
    assert share[loaded].max() > REFUSE_ABOVE
    assert (share <= 1 + 1e-9).all()
    # the share along joint 1 alone, by hand: its displacement against all displacements in the same units
    assert share[~loaded].max() == 0.0


def test_a_campaign_that_pushed_all_ways_supports_its_predictions(tmp_path, world):
    arm, cell, judge, rng = world
    cases = plan(arm, cell, 6, rng, [VERTICAL, SIDEWAYS, FORWARD])
    model = identified(
        cell, arm, watched(tmp_path, cell, arm, cases, judge.positions(cases, points_of(cell), K6), SIGMA)
    )
    new = plan(arm, cell, 4, rng, [VERTICAL, SIDEWAYS, FORWARD])
    assert displacement_support(model, new, *every(new, model)).unsupported.max() == 0.0


def test_the_stated_sigma_of_a_prediction_is_its_scatter_over_campaigns(tmp_path, world):
    from dataclasses import replace

    arm, cell, judge, rng = world
    cases = plan(arm, cell, 4, rng, [VERTICAL, SIDEWAYS])
    m = table(tmp_path, cell, arm, cases, judge.positions(cases, points_of(cell), K6))
    new = plan(arm, cell, 2, rng, [FORWARD])
    drawn = []
    for _ in range(80):
        o = observe(replace(m, position=m.position + SIGMA * rng.normal(size=m.position.shape)), True, noise(SIGMA))
        model = identify(joints(cell, arm).with_x(K6), o, "least-squares").model
        drawn.append(simulate_displacement(model, new, *every(new, model)).dp.T)
    stated = displacement_support(identified(cell, arm, observe(m, True, noise(SIGMA))), new, *every(new, model)).sigma
    moving = stated > 0.2 * stated.max()
    assert moving.sum() > 5
    ratio = np.std(drawn, axis=0)[moving] / stated[moving]
    assert ratio == pytest.approx(1.0, abs=5 / np.sqrt(2 * 80))


def test_a_position_depends_on_weight_too_and_a_model_without_statistics_says_nothing(tmp_path, world):
    arm, cell, judge, rng = world
    cases = plan(arm, cell, 4, rng, [VERTICAL, SIDEWAYS])
    o = watched(tmp_path, cell, arm, cases, judge.positions(cases, points_of(cell), K6), SIGMA)
    model = identified(cell, arm, o)
    rest = cases.take(np.flatnonzero(cases.step == 0))
    assert position_support(model, rest, *every(rest, model)).sigma.max() > 0
    assert displacement_support(model, rest, *every(rest, model)).sigma.max() == 0
    bare = displacement_support(model.with_x(K6), cases, *every(cases, model))
    assert np.isnan(bare.sigma).all()
    assert (bare.unsupported == 0).all()
