"""Profile-likelihood intervals: those of eq. (14) far from every constraint, honest near one, and frank about what nobody measured."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from drake_stiffness.campaign import Noise
from drake_stiffness.errors import InputError
from drake_stiffness.identification import identify
from drake_stiffness.intervals.cone_program import ConeLeastSquares
from drake_stiffness.intervals.cone_range import ConeRange
from drake_stiffness.intervals.deflection import deflection_intervals
from drake_stiffness.intervals.interval import Combination, quantile
from drake_stiffness.intervals.profile import base_combinations, extremes, problem_of, profile_curves, profile_intervals
from drake_stiffness.observation import observe, restrict
from drake_stiffness.simulation import simulate_displacement, simulate_readings
from drake_stiffness.task import read_task

KR270 = Path(__file__).parents[2] / "examples" / "kr270"
Q = quantile(0.95)


def solved(name):
    task = read_task(KR270 / name)
    o = task.observations()
    return task, identify(task.model, o), o


@pytest.fixture(scope="module")
def joints():
    return solved("campaign_joints_only.yaml")


@pytest.fixture(scope="module")
def links():
    return solved("campaign.yaml")


def accepting_noise(solution, o):
    """The joints-only model does not explain this arm, so its chi-square is large; here the noise is stated as large."""
    factor = problem_of(solution, o).noise_factor
    return replace(o, sigma_p=o.sigma_p * factor**0.5) if factor > 1 else o


def test_far_from_every_constraint_intervals_are_those_of_eq_14(joints):
    task, solution, o = joints
    louder = accepting_noise(solution, o)
    solution = identify(task.model, louder)
    assert not solution.active
    for one in profile_intervals(solution, louder):
        assert one.status == "identified"
        assert one.noise_factor == 1.0
        assert (one.low, one.high) == pytest.approx(one.plain, rel=1e-6)
        assert one.low < one.value < one.high
        assert one.high - one.low == pytest.approx(2 * 1.959964 * one.sigma, rel=1e-6)


def test_rejected_noise_widens_intervals_by_the_root_of_chi_square_and_says_so(joints):
    task, solution, o = joints
    quiet, louder = profile_intervals(solution, o), accepting_noise(solution, o)
    assert quiet[0].noise_factor > 10
    wide = profile_intervals(identify(task.model, louder), louder)
    for one, other in zip(quiet, wide, strict=True):
        assert one.high - one.low == pytest.approx(other.high - other.low, rel=1e-3)


def test_every_parameter_of_the_beam_model_is_bounded_but_hardly_one_is_identified(links):
    _, solution, o = links
    found = {one.name: one for one in profile_intervals(solution, o)}
    assert {name for name, one in found.items() if one.status == "identified"} == {"base_link.k15", "base_link.k24"}
    assert all(one.status != "unbounded" for one in found.values())
    for one in found.values():
        assert one.low - 1e-9 * abs(one.high) <= one.value <= one.high + 1e-9 * abs(one.high)
    # joint_1 and the base's twist merge fully: either may be all of their sum, or nothing of it.
    assert found["joint_1"].low == found["base_link.k66"].low == 0.0
    assert found["joint_1"].high == pytest.approx(found["base_link.k66"].high, rel=1e-6)
    assert np.isnan(found["joint_1"].sigma)


def test_base_parameters_are_identified_and_differ_from_eq_14_only_where_a_cone_is_near(links):
    _, solution, o = links
    found = profile_intervals(solution, o, base_combinations(solution))
    assert all(one.status == "identified" for one in found)
    plain = np.array([one.plain for one in found])
    ends = np.array([one.profile for one in found])
    width = plain[:, 1] - plain[:, 0]
    apart = np.abs(ends - plain).max(axis=1) / width
    assert (apart < 1e-6).sum() >= 15
    assert apart.max() > 0.05
    # Here least squares itself is inside the cones, so a cone can only take something away.
    assert (ends[:, 0] > plain[:, 0] - 1e-6 * width).all()
    # What is stated is never narrower than the profile, nor than (14) cut to what the cones can reach.
    stated = np.array([(one.low, one.high) for one in found])
    assert (stated[:, 0] <= ends[:, 0]).all()
    assert (stated[:, 1] >= ends[:, 1]).all()
    reach = np.where(stated[:, 0] == 0.0, 0.0, plain[:, 0])
    assert (stated[:, 0] <= reach + 1e-6 * width).all()
    assert (ends[:, 1] < plain[:, 1] + 1e-6 * width).all()


def test_what_neither_readings_nor_physics_bound_is_unbounded(tmp_path):
    text = (KR270 / "campaign_joints_only.yaml").read_text()
    for name in ("cell_joints_only.yaml", "measurements.csv"):
        text = text.replace(name, str(KR270 / name))
    (tmp_path / "campaign.yaml").write_text(text + "\ntracker_frame: unknown\n")
    task = read_task(tmp_path / "campaign.yaml")
    o = task.observations()
    found = {one.name: one for one in profile_intervals(identify(task.model, o), o)}
    where = next(
        one for name, one in found.items() if name.endswith("dx")
    )  # displacements do not show where a tracker stands
    assert where.status == "unbounded"
    assert (where.low, where.high) == (-np.inf, np.inf)
    assert found["joint_2"].status == "identified"


def test_a_joint_that_no_load_turns_may_be_as_soft_as_it_likes(joints):
    task, _, _ = joints
    m = task.taking_part()
    wrench = np.zeros_like(m.cases.wrench)
    wrench[2] = -2500.0 * (m.cases.step > 0)
    m = replace(m, cases=replace(m.cases, wrench=wrench))
    truth = task.model.with_x(np.array([0.33, 0.302, 0.406, 3.002, 3.303, 2.365]) * 1e-6)
    m = replace(m, position=simulate_readings(truth, m.cases, m.case, m.point).p.T)
    o = observe(restrict(m, np.arange(len(m.experiments)) < 12), True, Noise(position_sigma_mm=0.015))
    solution = identify(task.model, o)
    first = profile_intervals(solution, o, ["joint_1"])[0]
    assert first.status == "unbounded"
    assert first.low == 0.0
    # A sideways pull at the first posture: how far it goes nobody can say; a vertical one is known.
    cases = m.cases.take(np.array([0, 0]))
    pull = np.zeros((6, 2))
    pull[1, 0], pull[2, 1] = 2000.0, -2000.0
    cases = replace(cases, wrench=pull)
    point = np.array(["P1", "P1"])
    found = deflection_intervals(solution, o, cases, np.arange(2), point, ["sideways", "down"])
    assert {one.status for one in found[:3]} >= {"unbounded"}
    assert found[5].status == "identified"
    assert found[5].value == pytest.approx(simulate_displacement(solution.model, cases, np.arange(2), point).dp[2, 1])


def test_a_profile_is_a_nest_of_intervals_and_processes_share_it_without_changing_it(links):
    _, solution, o = links
    some = base_combinations(solution)[:3]
    grid = np.array([0.5, 1.0, Q, 6.0])
    rises, ends = profile_curves(solution, o, some, grid, processes=1)
    assert rises is not None
    assert (np.diff(ends[:, :, 0], axis=1) < 0).all()
    assert (np.diff(ends[:, :, 1], axis=1) > 0).all()
    at_level = profile_intervals(solution, o, some)
    assert ends[:, 2] == pytest.approx(np.array([(one.low, one.high) for one in at_level]), rel=1e-7)
    problem = problem_of(solution, o)
    C = np.array([c.weights * solution.model.scales for c in some])
    assert extremes(problem, C, grid, processes=2) == pytest.approx(extremes(problem, C, grid, processes=1), rel=1e-9)


def test_a_difference_of_two_parameters_can_be_asked_for_by_hand(joints):
    _, solution, o = joints
    weights = np.zeros(6)
    weights[1], weights[2] = 1.0, -1.0
    one = profile_intervals(solution, o, [Combination("joint_2 less joint_3", "rad/(N m)", weights)])[0]
    assert one.value == pytest.approx(solution.model.x[1] - solution.model.x[2])
    assert one.status == "identified"


def test_unknown_names_and_levels_are_refused(joints):
    _, solution, o = joints
    with pytest.raises(InputError, match=r"'joint_9'.*joint_1"):
        profile_intervals(solution, o, ["joint_9"])
    with pytest.raises(InputError, match="between 0 and 1"):
        profile_intervals(solution, o, level=95)


@pytest.mark.parametrize(
    ("truth", "least"),
    [((20.0, 20, 0, 20), 0.93), ((0.0, 20, 0, 20), 0.94), ((0.5, 4, 2, 1), 0.94), ((0.0, 0, 0, 0), 0.94)],
)
def test_intervals_cover_the_truth_as_promised_and_more_often_near_a_constraint(truth, least):
    """One bounded unknown and a 2x2 block, inside and at the rim. 300 seeds: three binomial deviations are allowed for."""
    F = np.random.default_rng(0).normal(size=(12, 4)) * 0.4
    blocks, seeds = [np.array([[0]]), np.array([[1, 2], [2, 3]])], 300
    program, unit = ConeLeastSquares(F, blocks), np.eye(4)
    held = [ConeLeastSquares(F, blocks, equal=c) for c in unit]
    hits = np.zeros(4)
    for seed in range(seeds):
        g = F @ truth + np.random.default_rng(seed).normal(size=12)
        best = np.sum((F @ program.solve(g) - g) ** 2)
        for i in range(4):
            # At the tip of a cone a value fixed at zero leaves no inside; a hair beside it is as good.
            at = truth[i] + (1e-6 if i in (1, 3) else 0.0)
            hits[i] += np.sum((F @ held[i].solve(g, at) - g) ** 2) - best <= Q
    slack = 3 * np.sqrt(0.05 * 0.95 / seeds)
    assert (hits / seeds > least - slack).all()
    if truth[0] == 20.0:
        assert (hits / seeds < 0.97 + slack).all()


def test_one_bounded_unknown_has_the_profile_of_the_closed_form():
    """chi2 = (y - mu)^2 - min(y, 0)^2: from y = -1 the end is where (mu + 1)^2 = 1 + q."""
    program = ConeRange(np.eye(1), [np.array([[0]])])
    for y in (-2.0, -1.0, 0.0, 1.0, 4.0):
        low, high = program.extreme(np.ones(1), np.array([y]), Q)
        assert high == pytest.approx(y + np.sqrt(Q + min(y, 0.0) ** 2), abs=1e-6)
        assert low == pytest.approx(max(0.0, y - np.sqrt(Q)), abs=1e-6)
