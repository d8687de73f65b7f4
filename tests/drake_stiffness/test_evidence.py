"""Evidence on experiments that a fit did not see: against the same written out, and what it does to candidates."""

from __future__ import annotations

import numpy as np
import pytest

from drake_stiffness.diagnosis.evidence import _PRIOR, cross_validated

FOLDS, ROWS = 4, 24


@pytest.fixture
def rng():
    return np.random.default_rng(7)


@pytest.fixture
def fold():
    return np.repeat(np.arange(FOLDS), ROWS // FOLDS)


def beside(A, S):
    """What is left of S beside A."""
    return S - A @ np.linalg.lstsq(A, S, rcond=None)[0]


def gain(A, variants, r, fold):
    return cross_validated(A, [np.zeros((r.size, 0))], r, fold) - cross_validated(A, variants, r, fold)


@pytest.mark.parametrize("columns", [1, 3])
def test_evidence_is_the_error_on_unseen_experiments_in_units_of_what_the_base_may_leave(rng, fold, columns):
    A, r = rng.normal(size=(ROWS, 3)), rng.normal(size=ROWS)
    S = beside(A, rng.normal(size=(ROWS, columns)))
    total = 0.0
    for f in range(FOLDS):
        own = fold == f
        # A prior of S: rows that are hardly there.
        prior = np.hstack([np.zeros((columns, 3)), np.linalg.cholesky(S.T @ S / _PRIOR).T])
        X = np.vstack([np.hstack([A, S])[~own], prior])
        z = np.linalg.lstsq(X, np.concatenate([r[~own], np.zeros(columns)]), rcond=None)[0]
        e = r[own] - np.hstack([A, S])[own] @ z
        V = np.eye(own.sum()) + A[own] @ np.linalg.inv(A[~own].T @ A[~own]) @ A[own].T
        total += e @ np.linalg.solve(V, e)
    assert cross_validated(A, [S], r, fold) == pytest.approx(total, rel=1e-9)


def test_dependent_columns_count_once(rng, fold):
    A, r = rng.normal(size=(ROWS, 3)), rng.normal(size=ROWS)
    S = beside(A, rng.normal(size=(ROWS, 1)))
    assert cross_validated(A, [np.hstack([S, 2 * S])], r, fold) == pytest.approx(
        cross_validated(A, [S], r, fold), rel=1e-6
    )


def test_what_only_one_experiment_shows_predicts_no_other(rng, fold):
    A, S = np.zeros((ROWS, 0)), np.zeros((ROWS, 1))
    S[fold == 0, 0] = 1.0
    assert gain(A, [S], 5 * S[:, 0] + rng.normal(size=ROWS), fold) == pytest.approx(0.0, abs=1e-9)


def test_what_all_experiments_show_gains_nearly_all_that_it_explains(rng, fold):
    A = rng.normal(size=(ROWS, 3))
    S = beside(A, rng.normal(size=(ROWS, 1)))
    r = 4 * S[:, 0]
    assert 0.8 * float(r @ r) < gain(A, [S], r, fold) < 1.2 * float(r @ r)


def test_a_direction_that_the_others_hardly_see_decides_nothing(rng, fold):
    """Plain squares would be all about it: the base model's own error there is as large as anything."""
    A = rng.normal(size=(ROWS, 1)) * np.where(fold == 0, 100.0, 0.01)[:, None]
    S = beside(A, rng.normal(size=(ROWS, 1)))
    r = rng.normal(size=ROWS)
    assert abs(gain(A, [S], r, fold)) < 20  # an error of a hundredth of the weak rows makes squares of 1e8 in fold 0


def test_of_several_constants_the_others_choose(rng, fold):
    """What fits a fold by itself must not choose its own constant."""
    A = np.zeros((ROWS, 0))
    true, chance = rng.normal(size=(ROWS, 1)), rng.normal(size=(ROWS, 1))
    r = 3 * true[:, 0] + rng.normal(size=ROWS)
    assert gain(A, [true, chance], r, fold) == pytest.approx(gain(A, [true], r, fold), abs=1e-9)
