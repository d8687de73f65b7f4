"""Base parameters carry everything that readings depend on, and nothing twice."""

import numpy as np
import pytest
from synthetic import FORWARD, SIDEWAYS, VERTICAL, plan, points_of, watched
from test_identifiability import K6, with_springs

from drake_stiffness.assembly import make_model, spring_effects
from drake_stiffness.base_parameters import base_of, base_values, merges, priority, relation, select
from drake_stiffness.eigen_directions import collinear_pairs, eigen_directions
from drake_stiffness.errors import InputError
from drake_stiffness.groups import find_groups
from drake_stiffness.identifiability import analyse, classify
from drake_stiffness.identification import Solution
from drake_stiffness.model import Statistics
from drake_stiffness.observation import columns
from drake_stiffness.thresholds import check_thresholds

LOADS = [VERTICAL, SIDEWAYS, FORWARD]


def observed(tmp_path, cell, arm, judge, loads, seed, postures=12):
    """Observations whose values do not matter: a plan with the readings of the rigid arm."""
    cases = plan(arm, cell, postures, np.random.default_rng(seed), loads)
    folder = tmp_path / f"plan{seed}"
    folder.mkdir()
    return watched(folder, cell, arm, cases, judge.positions(cases, points_of(cell), np.zeros(arm.num_joints)), 1e-5)


def as_solution(model, A, residual, coarse=False):
    return Solution(model, analyse(A, coarse=coarse), A, residual, 1, "QR", (), 0.0)


@pytest.mark.parametrize("template", ["beam", "symmetric"])
def test_any_model_and_its_base_parameters_predict_the_same_for_held_out_loads_too(
    tmp_path, arms, cells, judges, arm_name, template
):
    arm, cell = arms[arm_name], with_springs(cells[arm_name], joints="all", links="all", template=template)
    model = make_model(cell, arm, spring_effects(cell, arm))
    loads = [VERTICAL, SIDEWAYS, FORWARD, (0, 0, 0, 300, 0, 0), (0, 0, 0, 0, 300, 100)]
    A = columns(observed(tmp_path, cell, arm, judges[arm_name], loads, 1, 30), model)
    other = columns(observed(tmp_path, cell, arm, judges[arm_name], loads, 2, 4), model)
    view = analyse(A, coarse=False)
    found = base_of(view, model)
    assert found.base.size == view.algebraic_rank < model.x.size
    assert view.gap > 1e6
    for x in np.random.default_rng(3).normal(size=(5, model.x.size)):
        for matrix in (A, other):
            exact = matrix @ x
            assert np.abs(exact - matrix[:, found.base] @ (found.matrix @ x)).max() < 1e-9 * np.abs(exact).max()


def test_noise_free_readings_give_the_base_values_of_the_true_model(tmp_path, arms, cells, judges):
    """In the linear theory; the true model is drawn at random and goes nowhere but into the readings."""
    arm, cell = arms["kr270"], with_springs(cells["kr270"], joints="all", links="all", template="beam")
    model = make_model(cell, arm, spring_effects(cell, arm))
    A = columns(observed(tmp_path, cell, arm, judges["kr270"], LOADS, 1), model)
    x = np.abs(np.random.default_rng(0).normal(size=model.x.size))
    solution = as_solution(model, A, A @ x)
    found = base_of(solution.identifiability, model)
    cov = solution.identifiability.covariance() * np.outer(model.scales, model.scales)
    values = base_values(solution, found, cov)
    assert values.least_squares == pytest.approx(found.si(model.scales) @ (x * model.scales), rel=1e-8)
    assert (values.model == 0).all()
    # the other way to the covariance: invert the information of the base columns alone
    Ab = A[:, found.base] / model.scales[found.base]
    assert values.covariance == pytest.approx(np.linalg.inv(Ab.T @ Ab), rel=1e-6)
    assert values.sigma == pytest.approx(np.sqrt(np.diag(values.covariance)))


def test_joints_stand_for_what_merges_with_them_and_link_entries_only_for_the_rest(tmp_path, arms, cells, judges):
    arm, cell = arms["kr270"], with_springs(cells["kr270"], joints="all", links="all", template="beam")
    model = make_model(cell, arm, spring_effects(cell, arm))
    found = base_of(
        analyse(columns(observed(tmp_path, cell, arm, judges["kr270"], LOADS, 1), model), coarse=False), model
    )
    names = [model.names[i] for i in found.base]
    assert names[:6] == [f"joint_{i}" for i in range(1, 7)]
    classes = priority(model)
    assert set(classes[:6]) == {0}
    assert classes[model.names.index("link_2.k55")] == 1
    assert classes[model.names.index("link_2.k26")] == 2
    row = found.si(model.scales)[2]
    twist = row[model.names.index("link_2.k55")]
    assert twist == pytest.approx(1.0, abs=1e-9)  # a turn about the joint's axis, whoever gives way
    assert "link_2.k55" in merges(model.names, row, 2)
    assert relation(model.names, row, 2).startswith("joint_3 + ")


def test_independent_columns_are_chosen_class_by_class_and_nearly_dependent_ones_last():
    rng = np.random.default_rng(4)
    a, b, c = np.linalg.qr(rng.normal(size=(8, 3)))[0].T
    close = a + 1e-4 * b
    unit = np.stack([a, close / np.linalg.norm(close), c, b], axis=1)
    assert select(unit, np.zeros(4, dtype=int), 3) == [0, 2, 3]  # column 1 is the nearly dependent one
    assert select(unit, np.array([1, 0, 1, 1]), 3) == [1, 2, 3]  # but a lower class goes first
    assert select(unit, np.zeros(4, dtype=int), 0) == []


def test_what_no_reading_depends_on_is_in_no_base_and_flows_into_none():
    A = np.random.default_rng(5).normal(size=(20, 4))
    A[:, 2] = 0.0
    A[:, 3] = 2.0 * A[:, 0] - A[:, 1]
    view = analyse(A, coarse=False)
    assert view.zero.tolist() == [False, False, True, False]
    base = np.array(select(view.unit, np.zeros(4, dtype=int), view.algebraic_rank))
    from drake_stiffness.base_parameters import mapping

    assert base.tolist() == [0, 1]
    assert mapping(view, base) == pytest.approx(np.array([[1, 0, 0, 2.0], [0, 1, 0, -1.0]]), abs=1e-12)


def groups_of(A, x, tmp_model, **limits):
    solution = as_solution(tmp_model.with_x(x * tmp_model.scales), A, np.zeros(len(A)))
    view = solution.identifiability
    s = tmp_model.scales
    cov = (view.covariance() + view.hidden_covariance()) * np.outer(s, s)
    n = x.size
    statistics = Statistics(np.zeros(n), ("",) * n, ((),) * n, cov, view.unseen)
    return find_groups(solution, statistics, **limits)


@pytest.fixture
def six(arms, cells):
    arm, cell = arms["kr270"], with_springs(cells["kr270"], joints="all", links="none")
    return make_model(cell, arm, spring_effects(cell, arm))


def test_thresholds_can_be_set(six):
    A, x = 10.0 * np.eye(8, 6), np.array([1.0, 0.6, 0.4, 0.3, 0.1, 0.0])
    assert groups_of(A, x, six).group == ("G1+", "G1+", "G1~", "G1~", "G1-", "G1-")
    assert groups_of(A, x, six, upper=9.0, lower=3.5).group == ("G1+", "G1~", "G1~", "G1-", "G1-", "G1-")
    view = analyse(A, coarse=False)
    assert classify(view, x, np.full(6, 0.1), upper=9.0, lower=3.5)[1] == "G1~"
    for upper, lower in ((1.0, 2.0), (np.nan, 2.0), (5.0, -1.0)):
        with pytest.raises(InputError, match="--upper"):
            check_thresholds(upper, lower)


def test_a_direction_that_the_noise_hides_is_no_estimate_whatever_stands_there(six):
    A = np.diag([100.0, 100, 100, 100, 100, 0.01])
    found = groups_of(A, np.array([1.0, 1, 1, 1, 1, 5000.0]), six)  # 50 sigma, but not fitted
    assert found.group[-1] == "G1-"
    assert found.values.hidden.tolist() == [False] * 5 + [True]
    assert found.hidden_directions() == [{"joint_6": pytest.approx(1.0)}]
    assert any(line.startswith("HIDDEN") and "joint_6" in line for line in found.warnings())


def test_of_two_parallel_columns_only_the_sum_is_known_and_that_is_said(six):
    rng = np.random.default_rng(7)
    A = 100.0 * rng.normal(size=(40, 6))
    A[:, 5] = A[:, 4] + 0.02 * rng.normal(size=40) * 100
    found = groups_of(A / 60, np.array([1.0, 1, 1, 1, 0.6, 0.5]), six)
    assert max(found.ratio[4:]) < 5
    pair = found.pairs[0]
    assert (found.base_names[pair.first], found.base_names[pair.second]) == ("joint_5", "joint_6")
    assert pair.says == "sum known"
    assert pair.known_ratio > 5
    assert found.combination(pair).startswith("joint_5 + 1")
    weakest = int(found.directions.ratio.argmin())
    assert set(found.directions.named(weakest, found.base_names)) == {"joint_5", "joint_6"}
    assert any(line.startswith("COLLINEAR") for line in found.warnings())


def test_two_large_values_that_undo_each_other_are_said_too(six):
    rng = np.random.default_rng(8)
    A = rng.normal(size=(40, 6))
    A[:, 5] = A[:, 4] + 0.05 * rng.normal(size=40)
    found = groups_of(A, np.array([1.0, 1, 1, 1, 40.0, -40.05]), six)
    assert min(found.ratio[4:]) > 5
    assert found.pairs[0].says == "cancelling"
    assert any("undo each other" in line for line in found.warnings())


@pytest.mark.parametrize("per", ["value", "scale"])
def test_eigen_directions_are_estimated_independently_and_carry_all_of_chi_square(per):
    rng = np.random.default_rng(9)
    half = rng.normal(size=(5, 5))
    cov, x, unit = half @ half.T, rng.normal(size=5), np.array([1.0, 2.0, 0.5, 1.0, 3.0])
    d = eigen_directions(x, cov, unit, per)
    size = unit if per == "scale" else np.abs(x)
    joint = d.parts.T @ (cov / np.outer(size, size)) @ d.parts
    assert joint == pytest.approx(np.diag(d.sigma**2), abs=1e-10 * np.abs(joint).max())
    assert (d.ratio**2).sum() == pytest.approx(x @ np.linalg.solve(cov, x))  # the same in every unit
    assert collinear_pairs(x, np.diag(np.diag(cov)), unit, np.zeros(5, dtype=bool)) == []


def test_readings_with_noise_give_z_scores_of_one_on_base_parameters(tmp_path, arms, cells, judges):
    arm, cell = arms["kr270"], with_springs(cells["kr270"], joints="all", links=["link_2"], template="beam")
    model = make_model(cell, arm, spring_effects(cell, arm))
    A = columns(observed(tmp_path, cell, arm, judges["kr270"], LOADS, 1), model)
    x = np.concatenate([K6, np.zeros(8)]) / model.scales
    found = base_of(analyse(A, coarse=False), model)
    cov = analyse(A, coarse=False).covariance() * np.outer(model.scales, model.scales)
    rng, z = np.random.default_rng(0), []
    truth = found.si(model.scales) @ (x * model.scales)
    for _ in range(200):
        values = base_values(as_solution(model, A, A @ x + rng.normal(size=len(A))), found, cov)
        z.append((values.least_squares - truth) / values.sigma)
    assert np.std(z) == pytest.approx(1.0, abs=0.05)
