"""Clarabel called directly gives what cvxpy gives, for any right-hand side, and says where nothing bounds a value."""

import cvxpy as cp
import numpy as np
import pytest

from drake_stiffness.errors import UntrustworthyError
from drake_stiffness.intervals.cone_program import ConeLeastSquares, block_matrix
from drake_stiffness.intervals.cone_range import ConeRange

# A bound, two pairs and a 3x3 matrix with a structural zero, one unknown outside any cone, one with bounds of its own.
BLOCKS = (
    np.array([[0]]),
    np.array([[1, 2], [2, 3]]),
    np.array([[4, 5, -1], [5, 6, 7], [-1, 7, 8]]),
    np.array([[9, 10], [10, 11]]),
)
N = 14
LOWER, UPPER = np.full(N, -np.inf), np.full(N, np.inf)
LOWER[12], UPPER[12] = -0.2, 0.3
TIGHT = {"tol_gap_abs": 1e-13, "tol_gap_rel": 1e-13, "tol_feas": 1e-12}


def at_the_rim(rng):
    """Unknowns whose matrices are of rank one: noise pushes least squares out of every cone."""
    x = rng.normal(size=N)
    for block in BLOCKS:
        half = rng.normal(size=(block.shape[0], 1))
        x[block[block >= 0]] = (half @ half.T)[block >= 0]
    return x


def problem(seed, without=()):
    rng = np.random.default_rng(seed)
    F = rng.normal(size=(40, N)) * np.logspace(0, 1, N)
    for pair in without:  # the first is not seen, or merges with the second
        F[:, pair[0]] = 0.0 if len(pair) == 1 else 0.5 * F[:, pair[1]]
    return F, F @ at_the_rim(rng) + rng.normal(size=40), rng.normal(size=N)


def in_cvxpy(F, g, c=None, bound=None):
    """The same program as people would write it; its value."""
    x = cp.Variable(N)
    held = [x[12] >= LOWER[12], x[12] <= UPPER[12], x[0] >= 0]
    for block in BLOCKS[1:]:
        held.append(cp.bmat([[x[int(i)] if i >= 0 else 0.0 for i in row] for row in block]) >> 0)
    if c is None:
        whole = cp.Problem(cp.Minimize(cp.norm(F @ x - g)), held)
    else:
        whole = cp.Problem(cp.Minimize(c @ x), [*held, cp.norm(F @ x - g) <= np.sqrt(bound)])
    whole.solve(solver=cp.CLARABEL, **TIGHT)
    return whole.value, x.value


def smallest(x):
    return min(np.linalg.eigvalsh(block_matrix(block, x))[0] for block in BLOCKS)


@pytest.mark.filterwarnings("ignore:Solution may be inaccurate")
def test_least_squares_inside_cones_is_that_of_cvxpy_for_one_right_hand_side_after_the_other():
    F, _, _ = problem(0)
    program = ConeLeastSquares(F, BLOCKS, LOWER, UPPER)
    for seed in range(4):
        g = problem(0)[1] + np.random.default_rng(seed).normal(size=40)
        x = program.solve(g)
        value, reference = in_cvxpy(F, g)
        assert np.linalg.norm(F @ x - g) == pytest.approx(value, rel=1e-7)
        assert x == pytest.approx(reference, abs=2e-5)  # cvxpy's unknowns err by the root of its tolerance
        assert smallest(x) > -1e-7
        assert smallest(program.least_squares(g)) < -1e-3  # the cone had something to do
        assert slope_is_normal(x, g)


def slope_is_normal(x, g):
    """First-order conditions by themselves: no slope along the free unknown, and every block's slope orthogonal to the block."""
    F = problem(0)[0]
    slope = 2 * F.T @ (F @ x - g)
    good = abs(slope[13]) < 1e-5
    for block in BLOCKS:
        dual = np.where(block >= 0, slope[np.maximum(block, 0)], 0.0)
        dual = np.where(np.eye(block.shape[0], dtype=bool), dual, 0.5 * dual)
        matrix = block_matrix(block, x)
        good &= abs((dual * matrix).sum()) < 1e-5 * (1 + np.abs(dual).max() * np.abs(matrix).max())
    return good


def test_an_unconstrained_minimum_inside_the_cone_is_returned_exactly():
    F, _, _ = problem(1)
    inside = np.zeros(N)
    inside[[0, 1, 3, 4, 6, 8, 9, 11]] = 2.0
    g = F @ inside + 1e-3 * np.random.default_rng(0).normal(size=40)
    assert ConeLeastSquares(F, BLOCKS, LOWER, UPPER).solve(g) == pytest.approx(
        np.linalg.lstsq(F, g, rcond=None)[0], abs=1e-11
    )


@pytest.mark.filterwarnings("ignore:Solution may be inaccurate")
@pytest.mark.parametrize("without", [(), ((3,),), ((11, 8),)])
def test_a_fit_whose_data_lack_a_direction_is_finite_and_as_good_as_any(without):
    F, g, _ = problem(2, without)
    x = ConeLeastSquares(F, BLOCKS, LOWER, UPPER).solve(g)
    assert np.isfinite(x).all()
    assert np.abs(x).max() < 1e4
    assert np.linalg.norm(F @ x - g) == pytest.approx(in_cvxpy(F, g)[0], rel=2e-7)


@pytest.mark.filterwarnings("ignore:Solution may be inaccurate")
@pytest.mark.parametrize("without", [(), ((8,),), ((11, 8),)])
def test_extremes_within_a_rise_of_chi_square_are_those_of_cvxpy(without):
    F, g, c = problem(3, without)
    program = ConeRange(F, BLOCKS, LOWER, UPPER)
    c[[8, 7, 10, 11]] = 0.0
    x = program.solve(g)
    bound = float(((F @ x - g) ** 2).sum()) + 3.84
    low, high = program.extreme(c, g, 3.84)
    assert low == pytest.approx(in_cvxpy(F, g, c, bound)[0], rel=1e-6)
    assert high == pytest.approx(-in_cvxpy(F, g, -c, bound)[0], rel=1e-6)


def test_without_an_active_cone_extremes_are_those_of_the_ellipsoid():
    F, _, c = problem(4)
    inside = np.zeros(N)
    inside[[0, 1, 3, 4, 6, 8, 9, 11]] = 5.0
    low, high = ConeRange(10 * F, BLOCKS, LOWER, UPPER).extreme(c, 10 * F @ inside, 3.84)
    half = np.sqrt(3.84 * c @ np.linalg.inv(100 * F.T @ F) @ c)
    assert (low, high) == pytest.approx((c @ inside - half, c @ inside + half), rel=1e-7)


def test_held_at_the_end_of_its_range_a_value_costs_exactly_the_rise():
    F, g, c = problem(6)
    program = ConeRange(F, BLOCKS, LOWER, UPPER)
    least = np.linalg.norm(F @ program.solve(g) - g) ** 2
    held = ConeLeastSquares(F, BLOCKS, LOWER, UPPER, equal=c)
    for end in program.extreme(c, g, 3.84):
        x = held.solve(g, end)
        assert c @ x == pytest.approx(end, rel=1e-8)
        assert np.linalg.norm(F @ x - g) ** 2 - least == pytest.approx(3.84, rel=1e-5)
        small = ConeLeastSquares(
            F, BLOCKS, LOWER, UPPER, equal=1e-12 * c
        )  # the same in units of metres per newton, say
        assert c @ small.solve(g, 1e-12 * end) == pytest.approx(end, rel=1e-8)


def test_what_neither_data_nor_cone_bound_is_infinite():
    F, g, _ = problem(5, ((3,), (13,)))
    program = ConeRange(F, BLOCKS, LOWER, UPPER)
    unit = np.eye(N)
    assert program.extreme(unit[13], g, 3.84) == (-np.inf, np.inf)  # no cone speaks of it
    low, high = program.extreme(unit[3], g, 3.84)  # a diagonal entry without data
    assert np.isfinite(low)
    assert high == np.inf
    low, high = program.extreme(unit[2], g, 3.84)  # the data see this one
    assert np.isfinite([low, high]).all()


def test_a_pair_of_which_only_one_diagonal_entry_is_seen_leaves_the_other_two_unbounded():
    # The rim curves away: k22 grows as the square of k26, no straight line leaves the cone that way.
    F, g = np.array([[10.0, 0.0, 0.0]]), np.array([20.0])
    program = ConeRange(F, [np.array([[0, 1], [1, 2]])])
    assert program.extreme(np.array([0.0, 1.0, 0.0]), g, 3.84) == (-np.inf, np.inf)
    low, high = program.extreme(np.array([1.0, 0.0, 0.0]), g, 3.84)
    assert (low, high) == pytest.approx((2 - 0.1 * np.sqrt(3.84), 2 + 0.1 * np.sqrt(3.84)), rel=1e-6)


def test_bounds_that_exclude_each_other_are_refused():
    with pytest.raises(UntrustworthyError, match="ended as"):
        ConeLeastSquares(np.eye(2), [np.array([[0]])], np.array([-1.0, 3.0]), np.array([-0.5, 4.0])).solve(np.zeros(2))
