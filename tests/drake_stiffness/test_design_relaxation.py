"""Relaxation, certificate, rounding, exchange: held against brute force and against a convex program."""

import itertools

import numpy as np
import pytest
from test_design_criteria import criteria

from drake_stiffness.design.criteria import Determinant
from drake_stiffness.design.exchange import exchange, rounded_plan
from drake_stiffness.design.information import Information, gather
from drake_stiffness.design.relaxation import capped, relax, relaxed_by_cvxpy, upper_bound

NAMES = ("a", "d", "ds", "e", "ratio", "toolpath")


def pool(number, rng, size=6, rows=3, start=0.0):
    B = rng.normal(size=(number, rows, size)) * np.logspace(0, 1.0, size)
    return gather(B, np.eye(size), start * np.eye(size))


def best_of_all(information, criterion, n):
    return max(
        float(criterion.value(information.plan(list(chosen))))
        for chosen in itertools.combinations(range(information.number), n)
    )


@pytest.mark.parametrize("name", NAMES)
def test_no_plan_at_all_exceeds_the_certified_bound(name):
    information = pool(11, np.random.default_rng(1))
    criterion = criteria()[name]
    for n in (3, 5, 9):
        found = relax(information, criterion, n)
        assert best_of_all(information, criterion, n) <= found.bound * (1 + 1e-9)
        assert found.value <= found.bound * (1 + 1e-9)


@pytest.mark.parametrize("name", NAMES)
def test_the_relaxation_agrees_with_a_convex_program(name):
    information = pool(40, np.random.default_rng(2), start=0.3)
    criterion = criteria()[name]
    mine, (value, weights) = relax(information, criterion, 8), relaxed_by_cvxpy(information, criterion, 8)
    assert mine.value == pytest.approx(value, rel=4e-3)
    assert value <= mine.bound * (1 + 1e-6)
    assert weights.sum() == pytest.approx(8, abs=1e-5)
    assert mine.bound < 1.01 * value


@pytest.mark.parametrize("name", NAMES)
def test_rounding_and_exchange_come_near_the_best_plan_of_all(name):
    rng = np.random.default_rng(3)
    information, criterion, n = pool(13, rng), criteria()[name], 5
    chosen = exchange(information, criterion, rounded_plan(relax(information, criterion, n).x, n))
    best = best_of_all(information, criterion, n)
    assert len(set(chosen.tolist())) == n
    # Exchange ends where no single swap helps: the optimum, or within a few percent of it.
    assert 0.93 * best <= criterion.value(information.plan(chosen)) <= best * (1 + 1e-9)


def test_exchange_never_makes_a_plan_worse_and_mends_a_bad_one():
    rng = np.random.default_rng(4)
    information, criterion = pool(60, rng), Determinant()
    worst = np.arange(8)
    before = criterion.value(information.plan(worst))
    found = relax(information, criterion, 8)
    after = criterion.value(information.plan(exchange(information, criterion, worst)))
    assert before < after <= found.bound
    assert after > 0.97 * found.bound


def test_a_plan_that_starts_singular_is_led_out_of_it():
    """The first postures all see the same direction; exchange must not stumble over singular matrices."""
    rng = np.random.default_rng(5)
    information = pool(30, rng, rows=2)
    blind = np.repeat(information.packed[:1], 6, axis=0)
    stuck = Information(np.concatenate([blind, information.packed]), information.start)
    chosen = exchange(stuck, Determinant(), np.arange(6))
    assert np.linalg.matrix_rank(stuck.plan(chosen)) == 6


def test_the_derivative_of_the_determinant_is_its_variance_function():
    """d log det / d x_i = tr(M^-1 F_i), by finite differences of the weights."""
    information = pool(9, np.random.default_rng(6))
    x = np.random.default_rng(7).uniform(0.2, 1.0, 9)
    M = information.total(x)
    predicted = information.inner(np.linalg.inv(M))
    for i in range(9):
        h = 1e-5 * np.eye(9)[i]
        ends = [np.linalg.slogdet(information.total(x + s * h))[1] for s in (1, -1)]
        assert predicted[i] == pytest.approx((ends[0] - ends[1]) / 2e-5, rel=1e-6)


def test_information_adds_up():
    rng = np.random.default_rng(8)
    B, basis = rng.normal(size=(7, 4, 5)), np.linalg.qr(rng.normal(size=(5, 3)))[0]
    information = gather(B, basis, 2.0 * np.eye(3))
    each = [basis.T @ b.T @ b @ basis for b in B]
    x = rng.uniform(size=7)
    assert information.total(x) == pytest.approx(2 * np.eye(3) + sum(w * F for w, F in zip(x, each, strict=True)))
    assert information.plan([1, 4]) == pytest.approx(2 * np.eye(3) + each[1] + each[4])
    Z = rng.normal(size=(3, 3))
    Z = Z + Z.T
    assert information.inner(Z) == pytest.approx([(Z * F).sum() for F in each])
    assert upper_bound(information, Z, 2) == pytest.approx(
        2 * np.trace(Z) + sum(sorted((Z * F).sum() for F in each)[-2:])
    )


def test_weights_are_scaled_and_cut_at_one():
    x = capped(np.array([8.0, 4.0, 1.0, 1.0, 2.0]), 3)
    assert x == pytest.approx([1, 1, 0.25, 0.25, 0.5])
