"""Candidates: inside limits, clear of boxes, and telling what the observation matrix of their plan tells."""

from dataclasses import replace

import numpy as np
import pytest
from synthetic import noise, points_of

from drake_stiffness.arm import forward
from drake_stiffness.assembly import make_model, spring_effects
from drake_stiffness.campaign import read_measurements
from drake_stiffness.design.candidates import draw_candidates, effect_rows, spring_rows, step_pattern
from drake_stiffness.design.plan_table import experiment_names, plan_text
from drake_stiffness.design.settings import Design, load_options, payload_force, posture_ranges, read_design
from drake_stiffness.design.workspace import acceptable
from drake_stiffness.errors import InputError
from drake_stiffness.observation import columns, observe
from drake_stiffness.sensitivity import sensitivity
from drake_stiffness.simulation import simulate_readings


@pytest.fixture
def model(arms, cells, arm_name):
    return make_model(cells[arm_name], arms[arm_name], spring_effects(cells[arm_name], arms[arm_name]))


def settings(folder, text):
    (folder / "DESIGN.yaml").write_text(text)
    return read_design(folder / "DESIGN.yaml")


def test_candidates_stay_inside_limits_and_above_the_floor(model):
    c = draw_candidates(model, Design(candidates=500))
    arm = model.arm
    assert (c.q >= arm.lower[:, None] - 1e-9).all()
    assert (c.q <= arm.upper[:, None] + 1e-9).all()
    places = forward(arm, c.q)
    tips = places.points(np.array([*model.points.values(), model.load_point, model.tcp[1]]))
    assert (tips[:, 2] >= 0).all()
    assert c.q.std(axis=1).min() > 0.05


def test_the_information_of_candidates_is_that_of_the_observation_matrix_of_their_plan(model, tmp_path):
    """The plan written, read back as measurements and linearised by `observation`: the same A^T A."""
    arm, sigma, points = model.arm, 2e-5, tuple(model.points)
    some = draw_candidates(model, Design(candidates=20)).take(np.arange(4))
    (tmp_path / "PLAN.csv").write_text(plan_text(arm, some, experiment_names(4)))
    plan = read_measurements(tmp_path / "PLAN.csv", arm, points, model.load_point, readings=False)
    assert plan.cases.q == pytest.approx(some.cases(model.load_point).q, abs=1e-12)
    assert plan.cases.wrench == pytest.approx(some.cases(model.load_point).wrench, abs=5.1e-4)  # half a printed digit
    read = simulate_readings(model, plan.cases, plan.case, plan.point)
    object.__setattr__(plan, "position", read.p.T)
    A = columns(observe(plan, True, noise(sigma)), model)
    for rows in (spring_rows(model, some, sigma), effect_rows(model, some, sigma)):
        B = rows.reshape(-1, model.x.size)
        np.testing.assert_allclose(B.T @ B, A.T @ A, rtol=1e-5, atol=3e-6 * (A.T @ A).max())


def test_how_the_arm_settles_is_shared_by_the_points_of_a_step(arms, cells):
    """Weighting by the covariance sigma^2 1 + settling^2 (all ones over the points of a step), written out."""
    cell, arm = cells["kr270"], arms["kr270"]
    model = make_model(cell, arm, spring_effects(cell, arm))
    some = draw_candidates(model, Design(candidates=20)).take(np.arange(1))
    sigma, settling = 2e-5, 7e-5
    cases = some.cases(model.load_point)
    P, S = len(model.points), some.pattern.shape[0]
    point = np.tile(np.array(list(model.points)), S)
    a = sensitivity(model, cases, np.repeat(np.arange(S), P), point)[:, :3].reshape(S * P * 3, -1)
    same = np.kron(np.eye(S), np.kron(np.ones((P, P)), np.eye(3)))
    W = np.linalg.inv(sigma**2 * np.eye(S * P * 3) + settling**2 * same)
    free = np.kron(np.ones((S, 1)), np.eye(P * 3))  # the unloaded place of every point
    expected = a.T @ (W - W @ free @ np.linalg.inv(free.T @ W @ free) @ free.T @ W) @ a
    B = spring_rows(model, some, sigma, settling)[0]
    np.testing.assert_allclose(B.T @ B, expected, rtol=1e-8, atol=1e-9 * expected.max())


def test_loads_rise_in_steps_and_come_off_in_between():
    assert step_pattern(2, (0.5, 1.0)).tolist() == [[0, 0], [0.5, 0], [1, 0], [0, 0], [0, 0.5], [0, 1], [0, 0]]


def test_unstated_loads_suit_the_arm(arms):
    """About what the makers call payload, or less: a KR 270 carries 270 kg."""
    assert 0.5 * 270 * 9.81 < payload_force(arms["kr270"]) < 270 * 9.81
    assert payload_force(arms["free"]) < 0.5 * payload_force(arms["kr270"])


def test_down_is_where_gravity_points(arms):
    always, options = load_options(Design(), arms["track"])
    g = arms["track"].gravity
    assert always[:3, 0] == pytest.approx(payload_force(arms["track"]) * g / np.linalg.norm(g), abs=0.01)
    assert np.abs(g @ options[:3]).max() < 0.1
    assert np.linalg.norm(options[:3], axis=0) == pytest.approx(payload_force(arms["track"]), rel=1e-4)


def test_explicit_loads_are_taken_as_stated(model, tmp_path):
    text = (
        "loads: {down_N: 0, horizontal_N: 0, vectors: [{force_N: [100, 0, 50], moment_Nm: [0, 30, 0]}], per_posture: 1}"
    )
    c = draw_candidates(model, settings(tmp_path, text + "\ncandidates: 20"))
    assert np.unique(c.full.reshape(-1, 6), axis=0).tolist() == [[100, 0, 50, 0, 30, 0]]
    plan = plan_text(model.arm, c.take(np.arange(2)), ("A", "B"))
    assert "my_Nm" in plan.splitlines()[0]


def test_no_part_of_the_arm_enters_a_keep_out_box(arms, cells, tmp_path):
    cell, arm = cells["kr270"], arms["kr270"]
    model = make_model(cell, arm, spring_effects(cell, arm))
    text = "candidates: 400\nkeep_out_boxes: [{min_m: [0.5, -3, -1], max_m: [3.5, 3, 3]}]"
    boxed = settings(tmp_path, text)
    c = draw_candidates(model, boxed)
    assert c.share < 0.8
    poses = forward(arm, c.q)
    flange_points = np.vstack([points_of(cell), cell.load_point_m, cell.tool.tcp.position_m])
    places = [*poses.points(flange_points), *poses.p_J, poses.p_E]
    # Along the links as well: half way between frames.
    places += [(a + b) / 2 for a, b in zip(poses.p_J[:-1], poses.p_J[1:], strict=True)]
    for p in places:
        p = np.broadcast_to(p, (3, c.number))
        inside = (p[0] >= 0.5) & (p[0] <= 3.5) & (np.abs(p[1]) <= 3) & (p[2] >= -1) & (p[2] <= 3)
        assert not inside.any()


def test_a_link_that_crosses_a_thin_box_counts_though_its_ends_are_outside(arms, cells, tmp_path):
    """A plate across the upper arm of a stretched KR 270."""
    cell, arm = cells["kr270"], arms["kr270"]
    q = np.radians([[0.0, -90.0, 90.0, 0.0, 0.0, 0.0]]).T
    poses = forward(arm, q)
    shoulder, elbow = poses.p_J[1][:, 0], poses.p_J[2][:, 0]
    middle = 0.5 * (shoulder + elbow)
    box = f"keep_out_boxes: [{{min_m: {(middle - 0.1).tolist()}, max_m: {(middle + 0.1).tolist()}}}]"
    arguments = (q, points_of(cell), np.array(cell.load_point_m), np.array(cell.tool.tcp.position_m))
    assert acceptable(arm, Design(), *arguments).all()
    assert not acceptable(arm, settings(tmp_path, box), *arguments).any()


def test_a_tracker_must_see_every_point(arms, cells, tmp_path):
    cell, arm = cells["kr270"], arms["kr270"]
    model = make_model(cell, arm, spring_effects(cell, arm))
    cone = "tracker: {position_m: [6, 0, 1.5], towards_m: [2, 0, 1.5], half_angle_deg: 20}\ncandidates: 300"
    c = draw_candidates(model, settings(tmp_path, cone))
    p = forward(arm, c.q).points(points_of(cell))
    away = 6 - p[:, 0]
    assert (np.hypot(p[:, 1], p[:, 2] - 1.5) <= np.tan(np.radians(20)) * away + 1e-9).all()


def test_ranges_narrow_the_limits_in_the_units_of_the_plan(arms, cells, tmp_path):
    cell, arm = cells["track"], arms["track"]
    model = make_model(cell, arm, spring_effects(cell, arm))
    c = draw_candidates(
        model, settings(tmp_path, "candidates: 200\njoint_ranges: {track_mm: [500, 800], roll_deg: [-10, 20]}")
    )
    assert (c.q[0] >= 0.5 - 1e-12).all()
    assert (c.q[0] <= 0.8 + 1e-12).all()
    roll = np.degrees(c.q[arm.joint_names.index("roll")])
    assert roll.min() > -10.001
    assert roll.max() < 20.001


def test_postures_near_singular_ones_can_be_left_out(arms, cells, tmp_path):
    cell, arm = cells["kr270"], arms["kr270"]
    model = make_model(cell, arm, spring_effects(cell, arm))
    c = draw_candidates(model, settings(tmp_path, "candidates: 300\nsingular_margin: 0.15"))
    # A wrist whose axes 4 and 6 fall together is singular.
    assert np.abs(np.sin(c.q[4])).min() > 0.05


def test_a_joint_that_turns_several_times_is_drawn_from_one_turn(arms):
    lower, upper = posture_ranges(Design(), arms["kr270"])
    assert np.degrees([lower[3], upper[3]]) == pytest.approx([-180, 180])


BAD = {
    "joint_ranges: {joint_9_deg: [0, 10]}": r"joint_ranges.joint_9_deg: no such joint .* joint_1_deg",
    "joint_ranges: {joint_1_mm: [0, 10]}": r"joint_ranges.joint_1_mm: no such joint with such a unit",
    "joint_ranges: {joint_1_deg: [10, 0]}": r"smaller end first \(deg\)",
    "joint_ranges: {joint_1_deg: [0, 400]}": r"limits are -185 .. 185 deg",
    "keep_out_boxes: [{min_m: [0, 0, 0], max_m: [1, 1, 0]}]": r"keep_out_boxes.0: .*beyond min_m",
    "keep_out_boxes: [{min_m: [-9, -9, -9], max_m: [9, 9, 9]}]": r"only 0 of .* Check keep_out_boxes",
    "loads: {down_N: 0, horizontal_N: 0}": r"all of them are zero; give down_N",
    "loads: {levels: [1.0, 0.5]}": r"loads.levels|rising shares",
    "loads: {per_posture: 12}": r"between 1 and 9",
    "loads: {vectors: [{force_N: [0, 0, 0]}]}": r"no load; write at least one",
    "loads: {down_kN: 2}": r"unknown key.*Did you mean 'down_N'",
    "candidates: 3": r"candidates: found 3",
    "floor: 0": r"unknown key.*floor_m",
    "tracker: {position_m: [0, 0, 0], towards_m: [0, 0, 0], half_angle_deg: 20}": r"towards_m",
    "noise: {position_sigma_mm: 0}": r"noise.position_sigma_mm: found 0",
}


@pytest.mark.parametrize("text", BAD, ids=[t[:30] for t in BAD])
def test_what_is_wrong_with_settings_is_said(text, arms, cells, tmp_path):
    cell, arm = cells["kr270"], arms["kr270"]
    model = make_model(cell, arm, spring_effects(cell, arm))
    with pytest.raises(InputError, match=BAD[text]) as caught:
        draw_candidates(model, settings(tmp_path, text))
    assert "DESIGN.yaml" in str(caught.value)


def test_an_arm_without_masses_still_gets_loads(arms):
    massless = replace(arms["kr270"], mass_kg=np.zeros(7), tool_mass_kg=0.0)
    assert 10 < payload_force(massless) < 1000
