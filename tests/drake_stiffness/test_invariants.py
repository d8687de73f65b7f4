"""Ranks from algebra alone: what joints leave unchanged, held against observation matrices over random postures."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from three_arms import random_postures, random_wrench

from drake_stiffness import jobs, text
from drake_stiffness.assembly import make_model
from drake_stiffness.effects import Cases
from drake_stiffness.inspection import complete_effects, inspect_cell
from drake_stiffness.invariants import (
    algebraic_rank,
    blind_to_forces,
    chain_rank,
    invariant_forms,
    motion,
    null_space,
    unseen_conditions,
)
from drake_stiffness.report import inspection_report
from drake_stiffness.sensitivity import sensitivity
from drake_stiffness.special_points import axes_through, motion_read, why_lower

KR270 = Path(__file__).parents[2] / "examples" / "kr270" / "cell.yaml"


@pytest.mark.parametrize(
    ("prismatic", "template", "dimension"),
    [(False, "full", 12), (False, "symmetric", 7), (True, "full", 20), (True, "symmetric", 11)],
)
def test_a_joint_leaves_this_many_matrices_unchanged_by_motions_of_any_size(prismatic, template, dimension):
    forms = invariant_forms(prismatic, template)
    assert forms.shape == (dimension, 6, 6)
    assert np.linalg.matrix_rank(forms.reshape(dimension, 36)) == dimension
    for amount in (0.3, -1.7, 2.9):
        Ad = finite_motion(prismatic, amount)
        assert Ad @ forms @ Ad.T == pytest.approx(forms, abs=1e-12)
    # and no other matrix is: averages over motions (rotations) or what a random motion keeps have the same dimension
    rng = np.random.default_rng(1)
    basis = rng.normal(size=(36, 6, 6)) if template == "full" else symmetric(rng.normal(size=(21, 6, 6)))
    Ad = finite_motion(prismatic, 1.1)
    change = (Ad @ basis @ Ad.T - basis).reshape(len(basis), 36)
    assert len(basis) - np.linalg.matrix_rank(change, tol=1e-9) == dimension


def finite_motion(prismatic, amount):
    """Twists (translation, rotation) in axes that turned about, or slid along, z."""
    c, s = np.cos(amount), np.sin(amount)
    R = np.array([[c, -s, 0], [s, c, 0], [0, 0, 1.0]])
    shift = amount * np.array([[0, -1.0, 0], [1, 0, 0], [0, 0, 0]])
    zero = np.zeros((3, 3))
    return np.block([[np.eye(3), shift], [zero, np.eye(3)]]) if prismatic else np.block([[R, zero], [zero, R]])


def symmetric(matrices):
    return matrices + matrices.swapaxes(1, 2)


@pytest.mark.parametrize("prismatic", [False, True])
def test_the_joints_own_spring_is_among_them(prismatic):
    spring = np.zeros((6, 6))
    spring[2 if prismatic else 5, 2 if prismatic else 5] = 1
    forms = invariant_forms(prismatic, "symmetric").reshape(-1, 36)
    share, *_ = np.linalg.lstsq(forms.T, spring.ravel(), rcond=None)
    assert forms.T @ share == pytest.approx(spring.ravel(), abs=1e-12)


def test_any_axis_gives_the_same_dimension():
    axis = np.array([0.3, -0.5, 0.8]) / np.linalg.norm([0.3, -0.5, 0.8])
    for prismatic, dimension in ((False, 12), (True, 20)):
        ad = motion(prismatic, axis)
        derivative = np.kron(ad, np.eye(6)) + np.kron(np.eye(6), ad)
        assert 36 - np.linalg.matrix_rank(derivative, tol=1e-9) == dimension


def test_the_null_space_is_exact_in_whole_numbers():
    matrix = np.array([[2, 4, 6, 0], [1, 2, 3, 7], [3, 6, 9, 7]])
    basis = null_space(matrix)
    assert basis.dtype.kind == "i"
    assert basis.shape == (2, 4)
    assert (matrix @ basis.T == 0).all()
    assert null_space(np.eye(3, dtype=int)).shape == (0, 3)


def test_six_revolute_joints_show_105_of_153_and_180_of_258():
    six = [False] * 6
    assert algebraic_rank(six, "symmetric") == 7 * 21 - 6 * 7 == 105
    assert algebraic_rank(six, "full") == 7 * 36 - 6 * 12 == 180
    assert algebraic_rank([True, *six], "symmetric") == 8 * 21 - 6 * 7 - 11 == 115
    assert algebraic_rank([True, *six], "full") == 8 * 36 - 6 * 12 - 20 == 196
    assert algebraic_rank(six, "beam") is None
    assert (blind_to_forces("full"), blind_to_forces("symmetric")) == (18, 6)


@pytest.fixture(scope="module")
def inspected(cells, arms):
    return {name: inspect_cell(cells[name], arms[name], identifiability=True).identifiable for name in arms}


def test_ranks_over_random_postures_are_those_of_algebra_for_three_arms(inspected, arm_name):
    for entry in inspected[arm_name]:
        by_algebra = entry["load"] == "wrench" and entry["template"] != "beam"
        assert entry["algebraic_rank"] == (entry["rank"] if by_algebra else None)
        assert entry["special_points"] is None
        assert entry["singular_gap"] > 1e6


def test_beam_ranks_need_no_posture_either(inspected, cells, arms, arm_name):
    cell, arm = cells[arm_name], arms[arm_name]
    for template in ("full", "symmetric", "beam"):
        effects = complete_effects(cell, arm, template)[arm.num_joints :]
        rank, gap = chain_rank(arm, [effect.basis for effect in effects])
        (entry,) = [e for e in inspected[arm_name] if (e["template"], e["load"]) == (template, "wrench")]
        assert rank == entry["rank"]
        assert gap > 1e6


@pytest.mark.parametrize("template", ["full", "symmetric", "beam"])
def test_what_algebra_says_is_never_seen_moves_no_reading(cells, arms, arm_name, template):
    """The unseen compliances themselves, not only how many they are."""
    cell, arm = cells[arm_name], replace(arms[arm_name], gravity=np.zeros(3))
    effects = complete_effects(cell, arm, template)
    conditions = unseen_conditions(arm, [effect.basis for effect in effects[arm.num_joints :]])
    length = np.linalg.norm(conditions, axis=0)
    rank, _ = chain_rank(arm, [effect.basis for effect in effects[arm.num_joints :]])
    unseen = np.linalg.svd(conditions / length)[2][rank:].T / length[:, None]
    model, rng = make_model(cell, arm, effects), np.random.default_rng(3)
    cases = Cases(random_postures(arm, 10, rng), random_wrench(10, rng, 1.0, 1.0), model.load_point)
    A = sensitivity(model, cases, np.arange(10), np.full(10, next(iter(cell.reference_points_m)))) / model.scales
    seen = np.abs(A).max() * np.abs(unseen).max()
    assert np.abs(A @ unseen).max() < 1e-10 * seen


def moved(cell, load=None, points=None):
    return cell.model_copy(
        update={"load_point_m": load or cell.load_point_m, "reference_points_m": points or cell.reference_points_m}
    )


def ranks(cell, arm):
    found = inspect_cell(cell, arm, identifiability=True).identifiable
    return {(e["template"], e["load"]): e for e in found}


def test_a_load_point_on_the_last_axis_shows_less_under_forces_and_is_named(cells, arms):
    found = ranks(moved(cells["kr270"], load=(0.0, 0.0, 0.25)), arms["kr270"])
    assert (found["full", "force"]["rank"], found["symmetric", "force"]["rank"]) == (162 - 12, 99 - 4)
    assert "load point lies on the axis of joint_6" in found["symmetric", "force"]["special_points"]
    for template, rank in (("full", 180), ("symmetric", 105)):
        assert found[template, "wrench"]["rank"] == rank
        assert found[template, "wrench"]["special_points"] is None


def test_one_reading_point_shows_no_rotation_and_is_named(cells, arms):
    found = ranks(moved(cells["kr270"], points={"P1": (0.25, 0.0, 0.1)}), arms["kr270"])
    assert (found["full", "wrench"]["rank"], found["symmetric", "wrench"]["rank"]) == (180 - 18, 105 - 6)
    assert found["full", "wrench"]["algebraic_rank"] == 180
    assert "rotations of the flange are not seen" in found["full", "wrench"]["special_points"]


def test_axes_that_pass_through_a_point_in_every_posture(arms):
    arm = arms["kr270"]
    assert axes_through(arm, np.array([0.1, 0.0, 0.0])) == ()
    assert axes_through(arm, np.array([0.0, 0.0, 0.7])) == ("joint_6",)
    assert axes_through(arm, np.array([0.0, 0.0, -0.24])) == ("joint_4", "joint_5", "joint_6")


def test_what_points_read_of_a_motion():
    a, b = np.array([0.1, 0.2, 0.3]), np.array([0.4, 0.1, 0.3])
    assert motion_read(np.array([a])) == 3
    assert motion_read(np.array([a, a])) == 3
    assert motion_read(np.array([a, b])) == 5
    assert motion_read(np.array([a, b, 2 * b - a])) == 5
    assert motion_read(np.array([a, b, a + [0, 0, 0.1]])) == 6


def test_sentences_name_every_reason(arms):
    arm, on, off = arms["kr270"], np.array([0.0, 0, 0.2]), np.array([0.1, 0, 0.2])
    both = why_lower(arm, on, np.array([on]), moments=False)
    for words in ("One place alone", "it lies on the axis of joint_6", "the load point lies", "reciprocity"):
        assert words in both
    assert "load point" not in why_lower(arm, on, np.array([off]), moments=True)
    line = why_lower(arm, off, np.array([on, 2 * on]), moments=True)
    assert line.startswith("The reference points lie on one line")
    assert "the line lies on the axis of joint_6" in line
    assert why_lower(arm, off, np.array([on, off, off + 0.1 * np.eye(3)[1]]), moments=True).startswith(
        "No reason known"
    )


def test_terminal_and_report_show_algebra_and_sentences(cells, arms, capsys):
    from rich.console import Console

    result = inspect_cell(moved(cells["kr270"], load=(0.0, 0.0, 0.25)), arms["kr270"], identifiability=True)
    text.show_inspection(Console(width=200), result)
    shown = capsys.readouterr().out
    page = inspection_report(result, KR270)
    for words in ("rank by algebra", "105", "less than other points would show", "axis of joint_6"):
        assert words in shown
        assert words in page
    assert "less than other points would show" not in inspection_report(jobs.inspect(KR270), KR270)
