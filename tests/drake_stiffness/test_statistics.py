"""Held-out errors and chi-square against what noise alone must give."""

import numpy as np
import pytest
from synthetic import SIDEWAYS, VERTICAL, plan, points_of, table, watched

from drake_stiffness.assembly import make_model
from drake_stiffness.effects.compliance import JointCompliance
from drake_stiffness.identification import identify
from drake_stiffness.statistics import goodness, held_out_errors, rms_mm

K6 = np.array([0.33e-6, 0.30e-6, 0.42e-6, 2.8e-6, 2.9e-6, 3.4e-6])
SIGMA = 20e-6


def joints(cell, arm, x=None):
    return make_model(cell, arm, [JointCompliance(name) for name in arm.joint_names], x)


@pytest.mark.parametrize("rest", [1, 3])
def test_the_held_out_error_of_the_true_model_is_noise_with_that_of_its_own_reference(
    tmp_path, arms, cells, judges, rest
):
    """Loaded minus the mean of m unloaded readings: sqrt(3) sigma sqrt(1 + 1/m), whatever the places of the points."""
    arm, cell, rng = arms["kr270"], cells["kr270"], np.random.default_rng(rest)
    cases = plan(arm, cell, 40, rng, [VERTICAL, SIDEWAYS], rest=rest)
    p = judges["kr270"].positions(cases, points_of(cell), K6)
    off = rng.normal(0, 1e-3, (40, 3, 3))[cases.experiment].transpose(1, 2, 0)  # unloaded positions are free
    m = table(tmp_path, cell, arm, cases, p + off + SIGMA * rng.normal(size=p.shape))
    error = held_out_errors(joints(cell, arm, K6), m, True)
    assert error.shape == (3, 40 * 2 * 3)
    expected = np.sqrt(3) * SIGMA * 1e3 * np.sqrt(1 + 1 / rest)
    assert rms_mm(error) == pytest.approx(expected, rel=5 / np.sqrt(2 * 3 * 120))
    # loaded readings alone count, and no reading of another experiment enters
    m.position[np.flatnonzero(m.cases.experiment[m.case] == 0)] += 5.0
    assert held_out_errors(joints(cell, arm, K6), m, True) == pytest.approx(error, abs=1e-12)


def test_held_out_positions_count_all_of_them_as_they_are(tmp_path, arms, cells, judges):
    arm, cell, rng = arms["kr270"], cells["kr270"], np.random.default_rng(5)
    cases = plan(arm, cell, 5, rng, [VERTICAL])
    p = judges["kr270"].positions(cases, points_of(cell), K6)
    m = table(tmp_path, cell, arm, cases, p + np.array([3e-4, 0, 4e-4])[:, None])
    error = held_out_errors(joints(cell, arm, K6), m, False)
    assert error.shape == (3, m.case.size)
    assert rms_mm(error) == pytest.approx(0.5, abs=1e-6)


def test_rms_is_of_the_length_of_the_error_vector():
    assert rms_mm(np.array([[3e-3, 0.0], [4e-3, 0.0], [0.0, 5e-3]])) == pytest.approx(5.0)
    assert np.isnan(rms_mm(np.zeros((3, 0))))


def test_chi_square_counts_free_references_and_rank_as_fitted(tmp_path, arms, cells, judges):
    arm, cell, rng = arms["kr270"], cells["kr270"], np.random.default_rng(6)
    cases = plan(arm, cell, 12, rng, [VERTICAL, SIDEWAYS])
    p = judges["kr270"].positions(cases, points_of(cell), K6)
    o = watched(tmp_path, cell, arm, cases, p + SIGMA * rng.normal(size=p.shape), SIGMA)
    fit = goodness(identify(joints(cell, arm), o), o)
    assert fit.dof == 3 * 3 * 3 * 12 - 3 * 3 * 12 - 6
    assert fit.chi2_per_dof == pytest.approx(1.0, abs=5 * np.sqrt(2 / fit.dof))
    assert not fit.rejected
    # residuals are smaller than noise by what the references and the joints take
    share = fit.dof / (3 * 3 * 3 * 12)
    assert fit.residual_rms_mm == pytest.approx(np.sqrt(3 * share) * SIGMA * 1e3, rel=0.12)


def test_too_few_readings_leave_no_check(tmp_path, arms, cells, judges):
    arm, cell = arms["kr270"], cells["kr270"]
    cases = plan(arm, cell, 1, np.random.default_rng(7), [VERTICAL])
    p = judges["kr270"].positions(cases, points_of(cell), K6)[:1]
    o = watched(tmp_path, cell, arm, cases, p, SIGMA)
    fit = goodness(identify(joints(cell, arm), o), o)
    assert fit.dof <= 0
    assert np.isnan(fit.chi2_per_dof)
    assert not fit.rejected
