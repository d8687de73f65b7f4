"""Ranks, groups and merged parameters against what geometry says of them."""

import numpy as np
import pytest
from drake_judge import Judge
from synthetic import FORWARD, SIDEWAYS, VERTICAL, heavier, plan, points_of, watched
from three_arms import random_postures, random_wrench

from drake_stiffness.assembly import make_model, spring_effects
from drake_stiffness.cell import Springs
from drake_stiffness.effects import make_effect
from drake_stiffness.effects.effect import Cases
from drake_stiffness.identifiability import analyse, classify, determined, numerical_rank
from drake_stiffness.identification import identify
from drake_stiffness.observation import columns
from drake_stiffness.sensitivity import sensitivity
from drake_stiffness.statistics import goodness, statistics, warnings_of

K6 = np.array([0.33e-6, 0.30e-6, 0.42e-6, 2.8e-6, 2.9e-6, 3.4e-6])


def with_springs(cell, **springs):
    other = cell.model_copy(update={"springs": Springs(**springs)})
    other._path = cell._path
    return other


@pytest.mark.parametrize(
    ("template", "load", "rank"),
    [("full", "wrench", 180), ("symmetric", "wrench", 105), ("full", "force", 162), ("symmetric", "force", 99)],
)
def test_seven_links_and_six_joints_have_the_rank_that_geometry_allows(arms, cells, template, load, rank):
    """A turn about a joint's axis leaves 7 (12) dimensions of symmetric (any) 6x6 matrices alone: 7·21 - 6·7 and 7·36 - 6·12."""
    arm, rng = arms["free"], np.random.default_rng(0)
    cell = with_springs(cells["free"], links="all", template=template)
    model = make_model(cell, arm, spring_effects(cell, arm))
    q = random_postures(arm, 90, rng)
    cases = Cases(q, random_wrench(90, rng, moment=600.0 if load == "wrench" else 0.0), np.array(cell.load_point_m))
    names = np.array(list(model.points))
    A = sensitivity(model, cases, np.repeat(np.arange(90), 3), np.tile(names, 90))[:, :3].reshape(-1, model.x.size)
    weightless = sensitivity(model, cases.unloaded(), np.repeat(np.arange(90), 3), np.tile(names, 90))[:, :3]
    view = analyse((A - weightless.reshape(A.shape)) / 1e-5, coarse=False)
    assert view.rank == rank
    assert view.gap > 1e6


def test_seen_and_unseen_directions_are_orthonormal_and_the_unseen_do_nothing():
    rng = np.random.default_rng(1)
    A = rng.normal(size=(60, 4)) @ rng.normal(size=(4, 7)) * np.array([1, 1e3, 1, 1e-1, 1, 1, 10.0])
    view = analyse(A, coarse=False)
    both = np.hstack([view.seen, view.unseen])
    assert view.rank == 4
    assert np.abs(both.T @ both - np.eye(7)).max() < 1e-12
    assert np.abs(A @ view.unseen).max() < 1e-9 * np.abs(A).max()
    assert np.abs(view.covariance() - np.linalg.pinv(A.T @ A)).max() < 1e-8 * np.abs(view.covariance()).max()
    assert np.sort(view.weight) == pytest.approx(np.sort(np.linalg.svd(A)[1][:4]))
    r = rng.normal(size=60)
    assert view.seen @ view.pseudo_inverse_seen(A, r) == pytest.approx(np.linalg.pinv(A) @ r, rel=1e-6, abs=1e-10)


def test_the_rank_is_where_the_singular_values_drop():
    assert numerical_rank(np.array([5.0, 1.0, 1e-3, 1e-14, 1e-15]), coarse=False)[0] == 3
    assert numerical_rank(np.array([5.0, 1.0, 1e-3]), coarse=False) == (3, float("inf"))
    assert numerical_rank(np.zeros(3), coarse=False)[0] == 0
    # A robot description with right angles of seven digits: exact zeros come out at 1e-8.
    assert numerical_rank(np.array([5.0, 0.042, 2.5e-8, 1.8e-9, 1e-15]), coarse=False)[0] == 2
    assert numerical_rank(np.array([1.0, 1e-5, 1e-9, 1e-16]), coarse=True)[0] in (2, 3)


def test_groups_follow_the_ratio_of_value_to_sigma():
    view = analyse(np.diag([1e3, 1e3, 1e3, 0.0]), coarse=False)
    sigma = np.array([1e-3, 1e-3, 1e-3, 1.0])
    assert classify(view, np.array([5.1e-3, -4.9e-3, 1.9e-3, 9.0]), sigma) == ("G1+", "G1~", "G1-", "G2")
    assert determined(view).tolist() == [True, True, True, False]


def fit(tmp_path, cell, arm, judge, effects, cases, sigma=1e-5, k=K6, **options):
    p = judge.positions(cases, points_of(cell), k)
    o = watched(tmp_path, cell, arm, cases, p + sigma * np.random.default_rng(2).normal(size=p.shape), sigma, **options)
    solution = identify(make_model(cell, arm, effects), o)
    quality = goodness(solution, o)
    stats, how = statistics(solution, o, quality)
    return solution, stats, warnings_of(solution, stats, quality, o, how)


def test_a_vertical_first_joint_merges_with_the_twist_of_the_base(tmp_path, arms, cells, judges):
    arm, cell = arms["kr270"], with_springs(cells["kr270"], joints="all", links=["base_link"], template="beam")
    cases = plan(arm, cell, 8, np.random.default_rng(3), [VERTICAL, SIDEWAYS, FORWARD])
    solution, stats, warnings = fit(tmp_path, cell, arm, judges["kr270"], spring_effects(cell, arm), cases)
    by_name = dict(
        zip(solution.model.names, zip(stats.group, stats.merged_with, stats.sigma, strict=True), strict=True)
    )
    twist = "base_link.k66"
    assert by_name["joint_1"][0] == by_name[twist][0] == "G3"
    assert twist in by_name["joint_1"][1]
    assert "joint_1" in by_name[twist][1]
    assert np.isnan(by_name["joint_1"][2])
    for joint in ("joint_2", "joint_3", "joint_4", "joint_5", "joint_6"):
        assert by_name[joint][0] == "G1+", joint
        assert by_name[joint][1] == ()
    assert any(line.startswith("MERGED") for line in warnings)


def test_a_joint_that_no_load_turns_is_g2_and_said_loudly(tmp_path, arms, cells, judges):
    """Weight and vertical loads have no moment about a vertical axis."""
    arm, cell = arms["kr270"], with_springs(cells["kr270"], joints="all", links="none")
    cases = plan(arm, cell, 6, np.random.default_rng(4), [VERTICAL, (0, 0, 1500.0)])
    solution, stats, warnings = fit(tmp_path, cell, arm, judges["kr270"], spring_effects(cell, arm), cases)
    assert stats.group[0] == "G2"
    assert np.isnan(stats.sigma[0])
    assert any("NOT SEEN" in line and "joint_1" in line for line in warnings)
    assert not any("NOT SEEN" in line and "joint_2" in line for line in warnings)
    assert stats.group[1] == "G1+"
    assert solution.model.x[0] == 0.0


def test_a_requested_effect_that_the_data_cannot_see_is_warned_of_not_dropped(tmp_path, arms, cells, judges):
    arm, cell = arms["kr270"], with_springs(cells["kr270"], joints="all", links="none")
    cases = plan(arm, cell, 6, np.random.default_rng(5), [VERTICAL, SIDEWAYS])
    effects = [*spring_effects(cell, arm), make_effect("reflector_offset", "P3")]
    p = judges["kr270"].positions(cases, points_of(cell)[:2], K6)
    o = watched(tmp_path, cell, arm, cases, p, 1e-5, displacement=False)
    solution = identify(make_model(cell, arm, effects), o)
    quality = goodness(solution, o)
    stats, how = statistics(solution, o, quality)
    assert stats.group[-3:] == ("G2", "G2", "G2")
    assert any("NOT SEEN" in line and "P3" in line for line in warnings_of(solution, stats, quality, o, how))
    assert solution.model.names[-3:] == tuple(f"P3.reflector_offset.d{c}" for c in "xyz")


def test_a_payload_error_is_seen_through_springs_that_were_unknown_at_the_start(tmp_path, arms, cells, judges):
    """On the rigid arm where identification starts, weight moves nothing; that is no proof that the data cannot see it."""
    arm, cell = arms["kr270"], with_springs(cells["kr270"], joints="all", links="none")
    cases = plan(arm, cell, 8, np.random.default_rng(8), [VERTICAL, SIDEWAYS, FORWARD])
    x = np.array([15.0, 2.0, -1.0, 3.0])
    p = Judge(heavier(cell, x)).positions(cases, points_of(cell), K6)
    effects = [*spring_effects(cell, arm), make_effect("payload", "tool")]
    o = watched(tmp_path, cell, arm, cases, p, 1e-5, displacement=False)
    solution = identify(make_model(cell, arm, effects), o)
    quality = goodness(solution, o)
    stats, how = statistics(solution, o, quality)
    assert not any("NOT SEEN" in line for line in warnings_of(solution, stats, quality, o, how))
    assert solution.model.x == pytest.approx(np.concatenate([K6, x]), rel=1e-4)


def test_negative_compliances_of_least_squares_are_flagged(tmp_path, arms, cells, judges):
    arm, cell = arms["kr270"], with_springs(cells["kr270"], joints="all", links="none")
    cases = plan(arm, cell, 3, np.random.default_rng(6), [VERTICAL, SIDEWAYS])
    p = judges["kr270"].positions(cases, points_of(cell), K6)
    rest = judges["kr270"].positions(cases.unloaded(), points_of(cell), K6)
    o = watched(tmp_path, cell, arm, cases, 2 * rest - p, 1e-5)  # everything bends the wrong way
    solution = identify(make_model(cell, arm, spring_effects(cell, arm)), o, "least-squares")
    quality = goodness(solution, o)
    stats, how = statistics(solution, o, quality)
    lines = warnings_of(solution, stats, quality, o, how)
    assert sum("NOT PHYSICAL" in line and "negative" in line for line in lines) >= 5
    bounded = identify(make_model(cell, arm, spring_effects(cell, arm)), o, "sdp")
    assert (bounded.model.x >= 0).all()
    assert len(bounded.active) >= 5
    lines = warnings_of(bounded, stats, quality, o, how)
    assert any(line.startswith("BOUNDED") for line in lines)
    assert not any("NOT PHYSICAL" in line for line in lines)


def test_columns_of_one_campaign_are_in_units_of_noise_and_scale(tmp_path, arms, cells, judges):
    arm, cell = arms["kr270"], with_springs(cells["kr270"], joints="all", links="none")
    cases = plan(arm, cell, 3, np.random.default_rng(7), [VERTICAL, SIDEWAYS])
    p = judges["kr270"].positions(cases, points_of(cell), K6)
    model = make_model(cell, arm, spring_effects(cell, arm))
    coarse, fine = (columns(watched(tmp_path, cell, arm, cases, p, s), model) for s in (1e-5, 1e-6))
    assert fine == pytest.approx(10 * coarse, rel=1e-12)


def test_a_decomposition_that_does_not_come_to_rest_is_done_another_way(monkeypatch):
    """LAPACK's divide and conquer gave up on a matrix of one example; the ranks must not depend on which algorithm found them."""
    rng = np.random.default_rng(4)
    A = rng.normal(size=(40, 6)) @ rng.normal(size=(6, 12))
    usual = analyse(A, coarse=False)

    whole = np.linalg.svd

    def gives_up(matrix, *args, **kwargs):
        if matrix.shape == (12, 12):
            raise np.linalg.LinAlgError("SVD did not converge")
        return whole(matrix, *args, **kwargs)

    monkeypatch.setattr(np.linalg, "svd", gives_up)
    other = analyse(A, coarse=False)
    assert other.rank == usual.rank == 6
    np.testing.assert_allclose(other.seen @ other.seen.T, usual.seen @ usual.seen.T, atol=1e-10)
