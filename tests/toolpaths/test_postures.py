"""Joints along a path: the branch that was asked for, without jumps, the same from eaik and from Newton's iteration."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from drake_stiffness.arm import forward
from toolpaths import postures as p
from toolpaths.analytic import SixAxes, six_axes
from toolpaths.branches import continuous, flips_along, sides_of
from toolpaths.damped import damped_step
from toolpaths.postures import along_path, least_margin, outside_limits, singularity_margin

CUTTING = np.radians([0.0, -70.0, 120.0, 20.0, -50.0, 5.0])


def flange(arm, q):
    """Poses (N, 3, 3), (N, 3) of postures (n, N)."""
    poses = forward(arm, q)
    return poses.R_E.transpose(2, 0, 1), poses.p_E.T


def smooth(arm, number: int, start=CUTTING, sweep=0.5, seed=2) -> np.ndarray:
    """(n, N) a smooth walk through joint space from a posture."""
    rng = np.random.default_rng(seed)
    t = np.linspace(0.0, 1.0, number)
    direction = rng.uniform(-1, 1, start.size)
    return start[:, None] + sweep * direction[:, None] * np.sin(np.pi * t)


def other_branches(q) -> list[np.ndarray]:
    """Wrist flipped: joint 4 half a turn, joint 5 mirrored, joint 6 half a turn back - the same hand."""
    j1, j2, j3, j4, j5, j6 = q
    return [
        np.array([j1, j2, j3, j4 - np.sign(j4) * np.pi, -j5, j6 - np.sign(j6) * np.pi]),
        np.array([j1, j2, j3, j4 + np.sign(j4) * np.pi, -j5, j6 - np.sign(j6) * np.pi]),
    ]


@pytest.mark.parametrize("q", [CUTTING, np.radians([30.0, -100.0, 60.0, -45.0, 70.0, 120.0])])
def test_the_posture_picks_the_branch(model, q):
    arm = model.arm
    R, x = flange(arm, q[:, None])
    for wanted in (q, *other_branches(q)):
        np.testing.assert_allclose(flange(arm, wanted[:, None])[1], x, atol=1e-12)
        rough = wanted + np.radians([5.0, -4.0, 6.0, -8.0, 7.0, 9.0])
        found = along_path(arm, R, x, rough, {})
        assert found.method == "eaik"
        assert found.reached.all()
        np.testing.assert_allclose(found.q[:, 0], wanted, atol=1e-9)


@pytest.mark.parametrize(
    "near",
    [
        [0, -70, 120, 20, -50, 5],
        [0, 56, -124, 164, -70, -156],  # elbow the other way
        [180, 145, 75, 158, 44, 35],  # facing backwards, reaching over
        [180, -136, -79, -154, -36, -3],  # both
        [-180, 145, 75, -22, -44, -145],  # a whole turn of joint 1 away
    ],
)
def test_shoulder_and_elbow_branches_are_those_of_the_posture(model, near):
    """All of them hold the flange where the first does; whoever asks for one gets that one."""
    arm = replace(model.arm, lower=np.full(6, -2 * np.pi), upper=np.full(6, 2 * np.pi))
    R, x = flange(arm, CUTTING[:, None])
    found = along_path(arm, R, x, np.radians(near) + np.radians([4, -5, 6, 5, -4, 6]), {})
    np.testing.assert_allclose(np.degrees(found.q[:, 0]), near, atol=1.0)
    got_R, got_x = flange(arm, found.q)
    np.testing.assert_allclose(got_x, x, atol=1e-9)
    np.testing.assert_allclose(got_R, R, atol=1e-9)


def test_joints_come_back_along_a_path(model):
    q = smooth(model.arm, 200)
    found = along_path(model.arm, *flange(model.arm, q), CUTTING, {})
    assert found.reached.all()
    np.testing.assert_allclose(found.q, q, atol=1e-8)


def test_a_path_runs_through_half_a_turn_without_a_jump(model):
    """Joint 6 from 170 to 190 degrees, joint 4 from -170 to -190."""
    q = np.repeat(CUTTING[:, None], 41, axis=1)
    q[5] = np.radians(np.linspace(170, 190, 41))
    q[3] = np.radians(np.linspace(-170, -190, 41))
    found = along_path(model.arm, *flange(model.arm, q), q[:, 0], {})
    np.testing.assert_allclose(found.q, q, atol=1e-8)


@pytest.mark.parametrize("turn", [-300.0, 60.0])
def test_the_posture_picks_the_turn_too(model, turn):
    q = CUTTING.copy()
    q[5] = np.radians(60.0)
    start = CUTTING.copy()
    start[5] = np.radians(turn + 10)
    found = along_path(model.arm, *flange(model.arm, q[:, None]), start, {})
    assert np.degrees(found.q[5, 0]) == pytest.approx(turn)


def test_a_turn_that_leaves_the_limits_is_not_taken(model):
    """From 340 degrees on to 360: the limit is 350, so the wrist is found a turn back - a jump, which is a fact."""
    q = CUTTING.copy()
    q[5] = np.radians(0.0)
    start = CUTTING.copy()
    start[5] = np.radians(340.0)
    found = along_path(model.arm, *flange(model.arm, q[:, None]), start, {})
    assert np.degrees(found.q[5, 0]) == pytest.approx(0.0, abs=1e-6)
    assert outside_limits(model.arm, found.q) == []


def test_a_path_that_winds_past_a_limit_is_not_unwound_on_the_way(model):
    """A linear motion cannot jump a turn: the robot would stop at its limit, so that is what must be reported."""
    q = np.repeat(CUTTING[:, None], 31, axis=1)
    q[5] = np.radians(np.linspace(340, 355, 31))
    found = along_path(model.arm, *flange(model.arm, q), q[:, 0], {})
    np.testing.assert_allclose(found.q, q, atol=1e-8)
    assert {joint for _, joint in outside_limits(model.arm, found.q)} == {5}


def test_the_branch_of_the_posture_is_kept_even_where_it_leaves_the_limits(model):
    """Another branch would stay inside, but it is not the one that the user picked: limits are for the caller to report."""
    upper = model.arm.upper.copy()
    upper[2] = np.radians(100.0)
    arm = replace(model.arm, upper=upper)
    q = smooth(arm, 20, sweep=0.2)
    found = along_path(arm, *flange(arm, q), CUTTING, {})
    np.testing.assert_allclose(found.q, q, atol=1e-8)
    assert {joint for _, joint in outside_limits(arm, found.q)} == {2}


@pytest.mark.parametrize("number", [1, 2, 64, 65, 150])
def test_newton_finds_the_joints_that_eaik_finds(model, monkeypatch, number):
    q = smooth(model.arm, number, sweep=0.6)
    R, x = flange(model.arm, q)
    analytic = along_path(model.arm, R, x, CUTTING, {})
    monkeypatch.setattr(p, "six_axes", lambda *_: None)
    newton = along_path(model.arm, R, x, CUTTING, {})
    assert (analytic.method, newton.method) == ("eaik", "newton")
    assert newton.reached.all()
    np.testing.assert_allclose(newton.q, analytic.q, atol=1e-9)


def test_newton_follows_a_long_path_from_pose_to_pose(model, monkeypatch):
    """Joint 1 through 300 degrees, joint 6 through more than a turn: no pose is near the posture that picked the branch."""
    monkeypatch.setattr(p, "six_axes", lambda *_: None)
    q = np.repeat(CUTTING[:, None], 400, axis=1)
    q[0], q[5] = np.radians(np.linspace(-150, 150, 400)), np.radians(np.linspace(-250, 250, 400))
    found = along_path(model.arm, *flange(model.arm, q), q[:, 0], {})
    assert found.reached.all()
    np.testing.assert_allclose(found.q, q, atol=1e-8)


def test_an_arm_that_eaik_does_not_know_is_solved_by_newton(model):
    """A wrist whose axes do not meet."""
    p_PF = model.arm.p_PF.copy()
    p_PF[4] += [0.0, 0.03, 0.02]
    p_PF[5] += [0.0, -0.02, 0.05]
    p_PF[3] += [0.01, 0.04, 0.0]
    axis = model.arm.axis_F.copy()
    axis[1] = [0.1, 1.0, 0.05] / np.linalg.norm([0.1, 1.0, 0.05])
    axis[4] = [0.05, 1.0, 0.1] / np.linalg.norm([0.05, 1.0, 0.1])
    arm = replace(model.arm, p_PF=p_PF, axis_F=axis)
    q = smooth(arm, 90)
    found = along_path(arm, *flange(arm, q), CUTTING + 0.05, {})
    assert found.method == "newton"
    assert found.reached.all()
    np.testing.assert_allclose(found.q, q, atol=1e-8)


@pytest.mark.parametrize("method", ["eaik", "newton"])
def test_poses_out_of_reach_are_the_only_ones_missing(model, monkeypatch, method):
    if method == "newton":
        monkeypatch.setattr(p, "six_axes", lambda *_: None)
    q = smooth(model.arm, 10)
    R, x = flange(model.arm, q)
    x = x.copy()
    x[[3, 7]] += [4.0, 0.0, 0.0]
    found = along_path(model.arm, R, x, CUTTING, {})
    assert np.flatnonzero(~found.reached).tolist() == [3, 7]
    assert np.isnan(found.q[:, [3, 7]]).all()
    reached = found.reached
    np.testing.assert_allclose(found.q[:, reached], q[:, reached], atol=1e-8)


@pytest.mark.parametrize("method", ["eaik", "newton"])
def test_a_pose_a_tenth_of_a_millimetre_out_of_reach_is_out_of_reach(model, monkeypatch, method):
    """Stretched to the full: the wrist's centre cannot go further out. eaik offers nearest misses; they are no answer."""
    if method == "newton":
        monkeypatch.setattr(p, "six_axes", lambda *_: None)
    arm = replace(model.arm, lower=np.full(6, -7.0), upper=np.full(6, 7.0))
    straight = np.arctan2(0.041, 1.2)
    q = np.array([0.1, -0.6, -straight, 0.0, 0.4, 0.0])
    R, x = flange(arm, q[:, None])
    shoulder, wrist = (forward(arm, q[:, None]).p_J[k][:, 0] for k in (1, 5))
    outwards = (wrist - shoulder) / np.linalg.norm(wrist - shoulder)
    start = q + [0, 0, 0.3, 0, 0, 0]
    assert not along_path(arm, R, x + 1e-4 * outwards, start, {}).reached.any()
    assert along_path(arm, R, x - 1e-3 * outwards, start, {}).reached.all()


def test_a_nearest_miss_that_is_nearer_than_the_solution_is_not_followed(model, monkeypatch):
    """At row 5 eaik is made to offer, besides the solutions, the very posture of row 4."""
    q = smooth(model.arm, 12)
    R, x = flange(model.arm, q)
    true = SixAxes.candidates

    def with_a_miss(solver, *poses):
        found = true(solver, *poses)
        miss = np.full((6, 1, found.shape[2]), np.nan)
        miss[:, 0, 5] = q[:, 4]
        return np.concatenate([miss, found], axis=1)

    monkeypatch.setattr(SixAxes, "candidates", with_a_miss)
    found = along_path(model.arm, R, x, CUTTING, {})
    assert found.reached.all()
    np.testing.assert_allclose(found.q, q, atol=1e-8)


# -- following a branch ---------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("often", [0.0, 0.01, 0.6])
def test_a_branch_is_followed_through_any_order_of_the_solutions(often):
    """Eight curves, their columns shuffled anew at some rows, more than a block of them; some solutions missing."""
    rng, N = np.random.default_rng(4), 5000
    t = np.linspace(0, 3, N)
    curves = rng.uniform(-2.5, 2.5, (6, 8, 1)) + 0.2 * np.sin(t + rng.uniform(0, 6, (6, 8, 1)))
    order = np.empty((8, N), dtype=int)
    now = np.arange(8)
    for row, shuffled in enumerate(rng.random(N) < often):
        now = rng.permutation(8) if shuffled else now
        order[:, row] = now
    given = np.stack([np.take_along_axis(curves[i], order, axis=0) for i in range(6)])
    missing = (rng.random((8, N)) < 0.2) & (order != 3)
    given[:, missing] = np.nan
    limit = np.full(6, 6.0)
    np.testing.assert_allclose(continuous(given, curves[:, 3, 0], -limit, limit), curves[:, 3], atol=1e-12)


@pytest.mark.parametrize("free", [6, 7])
def test_a_step_of_joints_makes_the_motion_asked_for_and_no_more(free):
    rng = np.random.default_rng(9)
    J, twist = rng.normal(size=(free, 6, 50)) + 5 * np.eye(free, 6)[:, :, None], rng.normal(size=(6, 50))
    step = damped_step(J, twist)
    for i in range(50):
        np.testing.assert_allclose(step[:, i], np.linalg.lstsq(J[:, :, i].T, twist[:, i])[0], rtol=1e-6, atol=1e-8)
    J[0] = 0.0  # an arm that has lost a direction: no joint runs away
    J[1] = J[2]
    assert np.abs(damped_step(J, 1e-8 * twist)).max() < 1.0


# -- seven joints -----------------------------------------------------------------------------------------------------------


def test_a_slide_driven_by_the_program(track_model):
    arm = track_model.arm
    q = np.vstack([np.linspace(-1.0, 1.5, 50), smooth(arm, 50)])
    found = along_path(arm, *flange(arm, q), np.concatenate([[0.0], CUTTING]), {0: q[0]})
    assert found.method == "eaik"
    assert found.reached.all()
    np.testing.assert_allclose(found.q, q, atol=1e-8)


def test_a_slide_that_nothing_drives_stands_where_the_posture_says(track_model):
    arm = track_model.arm
    q = np.vstack([np.full(20, 0.7), smooth(arm, 20)])
    R, x = flange(arm, q)
    found = along_path(arm, R, x, np.concatenate([[0.7], CUTTING]), {})
    np.testing.assert_allclose(found.q, q, atol=1e-8)
    elsewhere = along_path(arm, R, x, np.concatenate([[0.6], CUTTING]), {})
    assert elsewhere.reached.all()
    np.testing.assert_array_equal(elsewhere.q[0], 0.6)
    np.testing.assert_allclose(flange(arm, elsewhere.q)[1], x, atol=1e-9)


def test_a_driven_joint_inside_the_chain_is_left_to_newton(track_model):
    arm = track_model.arm
    q = np.vstack([np.linspace(0, 0.3, 30), smooth(arm, 30)])
    found = along_path(arm, *flange(arm, q), np.concatenate([[0.0], CUTTING]), {4: q[4]})
    assert found.method == "newton"
    assert found.reached.all()
    np.testing.assert_array_equal(found.q[4], q[4])
    np.testing.assert_allclose(flange(arm, found.q)[1], flange(arm, q)[1], atol=1e-8)


# -- limits and singularities -------------------------------------------------------------------------------------------------


def test_outside_limits_names_row_and_joint(model):
    q = np.repeat(CUTTING[:, None], 3, axis=1)
    assert outside_limits(model.arm, q) == []
    q[1, 2] = model.arm.upper[1] + 1e-6
    q[4, 0] = model.arm.lower[4] - 1e-6
    assert sorted(outside_limits(model.arm, q)) == [(0, 4), (2, 1)]
    q[1, 2], q[4, 0] = model.arm.upper[1], model.arm.lower[4]
    assert outside_limits(model.arm, q) == []


def test_the_margin_vanishes_where_the_arm_loses_a_direction(model):
    wrist = np.radians([[0.0, -70.0, 120.0, 20.0, 0.0, 5.0]]).T
    elbow = np.array([[0.0, -1.0, -np.arctan2(0.041, 1.2), 0.3, 0.5, 0.2]]).T
    # the wrist's centre on the axis of joint 1, which then moves it nowhere
    trial = np.repeat(np.radians([[0.0, -120.0, 0.0, 20.0, 60.0, 5.0]]).T, 20001, axis=1)
    trial[2] = np.linspace(0.3, 1.5, 20001)
    overhead = trial[:, [np.abs(forward(model.arm, trial).p_J[4][0]).argmin()]]
    assert singularity_margin(model.arm, CUTTING[:, None])[0] > 0.05
    for singular, limit in ((wrist, 1e-12), (elbow, 1e-12), (overhead, 1e-3)):
        assert singularity_margin(model.arm, singular)[0] < limit
    near = wrist.copy()
    near[4] = np.radians(2.0)
    assert 5e-3 < singularity_margin(model.arm, near)[0] < 0.05


def test_the_margin_does_not_depend_on_the_size_of_the_arm(model):
    arm = model.arm
    doubled = replace(arm, p_PF=2 * arm.p_PF)
    q = smooth(arm, 5)
    np.testing.assert_allclose(singularity_margin(doubled, q), singularity_margin(arm, q), rtol=1e-9)


def test_the_least_margin_is_the_smallest_of_all(model, track_model):
    """Along smooth paths, with a singular posture between two that are known, and where neighbours have nothing in common."""
    rng = np.random.default_rng(6)
    through = smooth(model.arm, 300)
    through[4] = np.radians(np.linspace(-31, 29, 300))
    scattered = rng.uniform(-2, 2, (7, 100))
    alone = CUTTING[:, None]
    for arm, q in (
        (model.arm, smooth(model.arm, 500)),
        (model.arm, through),
        (track_model.arm, scattered),
        (model.arm, alone),
    ):
        assert least_margin(arm, q) == pytest.approx(singularity_margin(arm, q).min(), abs=1e-12)


# -- branches that the program names --------------------------------------------------------------------------------------


def test_a_branch_that_the_program_changes_is_followed_and_the_others_are_kept(model):
    """A point-to-point motion between two cuts turns the wrist over; the poses alone do not show it."""
    arm = model.arm
    q = smooth(arm, 40)
    R, x = flange(arm, q)
    status = np.full((42, 3), -1, dtype=np.int32)  # rows 0 and 21 are point-to-point motions
    status[0], status[21] = (0, 1, 0), (0, 1, 1)
    rows = np.setdiff1d(np.arange(42), [0, 21])
    found = along_path(arm, R, x, CUTTING, {}, flips_along(status, rows))
    assert found.reached.all()
    np.testing.assert_allclose(found.q[:, :20], q[:, :20], atol=1e-8)
    np.testing.assert_allclose(found.q[:3, 20:], q[:3, 20:], atol=1e-8)
    np.testing.assert_allclose(found.q[4, 20:], -q[4, 20:], atol=1e-8)
    assert np.abs(np.diff(found.q[:, 20:], axis=1)).max() < 0.1


def test_sides_are_those_of_the_arm_not_of_its_zeros(model):
    """The eight solutions of one pose are the eight ways to choose shoulder, elbow and wrist."""
    arm = model.arm
    R, x = flange(arm, CUTTING[:, None])
    branches = six_axes(arm, [], list(range(6))).branches(R, x, CUTTING[:, None])
    whole = branches[:, ~np.isnan(branches[0, :, 0]), 0]
    sides = sides_of(arm, list(range(6)), whole)
    assert whole.shape[1] == 8
    assert len({tuple(column) for column in sides.T.tolist()}) == 8


def test_a_flip_where_no_solution_is_belongs_to_the_next_row_that_has_one():
    turned = np.zeros((6, 2, 4))
    turned[4, 0], turned[4, 1] = 0.5, -0.5
    turned[:, :, 1] = np.nan
    sides = np.zeros((3, 2, 4), dtype=bool)
    sides[2, 1] = True
    flips = np.zeros((3, 4), dtype=bool)
    flips[2, 1] = True
    limit = np.full(6, 3.0)
    found = continuous(turned, np.array([0, 0, 0, 0, 0.4, 0.0]), -limit, limit, sides, flips)
    np.testing.assert_array_equal(found[4], [0.5, np.nan, -0.5, -0.5])
