"""Information functions: their duals bound them everywhere, and say how they grow."""

import itertools

import numpy as np
import pytest

from drake_stiffness.design.criteria import (
    Determinant,
    MeanVariance,
    SmallestEigenvalue,
    Suspect,
    WorstRatio,
    smooth_value,
)

R = 6


def information(rng, size=R, decades=2.0):
    half = rng.normal(size=(size, 2 * size)) * 10 ** rng.uniform(-decades / 2, decades / 2, size)[:, None]
    return half @ half.T


def criteria():
    rng = np.random.default_rng(7)
    A = rng.normal(size=(3, R))
    return {
        "d": Determinant(),
        "a": MeanVariance(np.eye(R) / R),
        "toolpath": MeanVariance(A.T @ A, "toolpath"),
        "e": SmallestEigenvalue(),
        "ratio": WorstRatio(rng.normal(size=(4, R))),
        "ds": Suspect(2),
    }


@pytest.fixture(params=sorted(criteria()))
def criterion(request):
    return criteria()[request.param]


def test_no_information_exceeds_what_a_dual_taken_anywhere_else_allows(criterion):
    """The certificate: phi(X) <= <Z(M), X> for every pair."""
    rng = np.random.default_rng(0)
    matrices = [information(rng) for _ in range(12)]
    for M, X in itertools.product(matrices, matrices):
        for sharpness in (None, 4.0, 300.0):
            assert criterion.value(X) <= (criterion.dual(M, sharpness) * X).sum() * (1 + 1e-9)


def test_the_dual_is_tight_where_it_was_taken_if_there_is_no_kink(criterion):
    M = information(np.random.default_rng(1))
    slack = 1e-9 if criterion.sharpness is None else 0.35
    assert (criterion.dual(M, 2000.0) * M).sum() == pytest.approx(float(criterion.value(M)), rel=slack)


def test_the_direction_of_growth_is_the_derivative(criterion):
    rng = np.random.default_rng(2)
    M, F = information(rng), information(rng)
    h, p = 1e-6 * np.abs(M).max() / np.abs(F).max(), criterion.sharpness
    slope = (smooth_value(criterion, M + h * F, p) - smooth_value(criterion, M - h * F, p)) / (2 * h)
    gradient = criterion.ascent(M, p)
    # Up to a factor: homogeneity fixes it, <gradient, M> = phi.
    gradient *= smooth_value(criterion, M, p) / (gradient * M).sum()
    assert (gradient * F).sum() == pytest.approx(slope, rel=1e-4)


def test_twice_the_readings_are_twice_the_information(criterion):
    M = information(np.random.default_rng(3))
    assert criterion.value(2 * M) == pytest.approx(2 * float(criterion.value(M)), rel=1e-12)


def test_a_stack_of_matrices_has_the_values_of_each(criterion):
    rng = np.random.default_rng(4)
    stack = np.stack([information(rng) for _ in range(5)])
    assert criterion.value(stack) == pytest.approx([float(criterion.value(M)) for M in stack], rel=1e-12)


def test_the_criteria_are_what_their_names_say():
    rng = np.random.default_rng(5)
    M = information(rng)
    V, cases = np.linalg.inv(M), criteria()
    assert cases["d"].value(M) == pytest.approx(np.linalg.det(M) ** (1 / R))
    assert cases["a"].value(M) == pytest.approx(R / np.trace(V))
    assert cases["e"].value(M) == pytest.approx(np.linalg.eigvalsh(M)[0])
    assert cases["ratio"].value(M) == pytest.approx(min(1 / (u @ V @ u) for u in cases["ratio"].u))
    assert cases["toolpath"].value(M) == pytest.approx(1 / np.trace(cases["toolpath"].C @ V))
    # What is left of a suspect when all else is fitted along: the inverse of its block of the covariance.
    assert cases["ds"].value(M) == pytest.approx(np.linalg.det(np.linalg.inv(V[-2:, -2:])) ** 0.5)
