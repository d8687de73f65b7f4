"""The source paper's single-link example: prints that fit together, closed forms, and a thousand draws."""

from __future__ import annotations

import json
import math

import numpy as np
import pytest
from typer.testing import CliRunner

from drake_stiffness.cli import app
from drake_stiffness.errors import InputError
from drake_stiffness.report.single_link import single_link_report
from drake_stiffness.report.single_link_tables import all_tables
from drake_stiffness.single_link.example import (
    LOAD,
    is_definite,
    linear_fit,
    noise_setting,
    observation_matrix,
    reduction,
    single_link,
    unit_loads,
)
from drake_stiffness.single_link.prints import NONZERO, PRINTED_17, PRINTED_18, PRINTED_25, names_of, reconstruct
from drake_stiffness.single_link.study import METHODS, semidefinite_fits, study_single_link

NINE = ("k22", "k26", "k33", "k35", "k44", "k53", "k55", "k62", "k66")


@pytest.fixture(scope="module")
def printed():
    return single_link(noise_setting("printed"))


@pytest.fixture(scope="module")
def stated():
    return single_link(noise_setting("stated"))


@pytest.fixture(scope="module")
def study(printed):
    return study_single_link(printed, seeds=1000)


# -- what is printed ----------------------------------------------------------------------------------------------------


def test_the_prints_leave_one_noise_and_it_is_not_the_stated_one():
    found, stated = reconstruct(), noise_setting("stated")
    assert found.sigma == pytest.approx([2.5e-7, 2.5e-6], rel=1e-12)
    assert (found.sigma_high / found.sigma_low - 1 < 0.004).all()
    assert stated.position_m / LOAD > 9 * found.sigma_high[0]
    assert stated.rotation_rad / LOAD > 9 * found.sigma_high[1]
    noise = noise_setting("printed")
    assert (noise.position_m, noise.rotation_rad) == pytest.approx((2.5e-6, 2.5e-5))


def test_matrix_15_is_symmetric_positive_definite_and_within_the_rounding_of_every_print(printed):
    found, k = reconstruct(), printed.truth
    assert np.array_equal(k, k.T)
    assert np.linalg.eigvalsh(k)[0] == pytest.approx(4.5e-8)
    assert (np.abs(k) >= found.low - 1e-15).all()
    assert (np.abs(k) <= found.high + 1e-15).all()
    assert k[2, 4] < 0 < k[1, 5]
    assert k[np.triu_indices(6)][np.flatnonzero(k[np.triu_indices(6)])] == pytest.approx(
        [4.5e-8, 8.0e-5, 3.98e-4, 3.65e-5, -1.71e-4, 3.76e-3, 1.09e-3, 2.65e-3]
    )


def test_our_ratios_round_to_those_of_eq_18(printed):
    assert (np.abs(printed.exact_ratio - PRINTED_18.value) <= PRINTED_18.half_digit + 1e-9).all()


def test_the_printed_draw_is_one_that_this_noise_gives(printed):
    """26 ratios of zero entries in (17), and the departures of (25) from (15): neither too large nor too small."""
    zeros = PRINTED_17.value[~NONZERO]
    assert zeros.size == 26
    assert 26 - 2 * math.sqrt(52) < float(zeros @ zeros) < 26 + 2 * math.sqrt(52)
    departure = np.abs(PRINTED_25.value - printed.truth) - PRINTED_25.half_digit
    assert (departure <= 3 * printed.fits[2].sigma + 1e-15).all()


def test_the_rebuilt_entries_are_those_of_a_beam_though_nobody_put_that_in(printed):
    k = printed.truth
    for shear, cross, bend in ((k[1, 1], k[1, 5], k[5, 5]), (k[2, 2], k[2, 4], k[4, 4])):
        assert shear * bend / cross**2 == pytest.approx(4 / 3, rel=0.03)
        assert 2 * abs(cross) / bend == pytest.approx(0.3, rel=0.05)


# -- closed forms -------------------------------------------------------------------------------------------------------


def test_the_observation_matrix_gives_the_deflections_of_any_matrix():
    rng = np.random.default_rng(1)
    k, wrench = rng.normal(size=(6, 6)), rng.normal(size=(6, 4))
    assert observation_matrix(wrench) @ k.ravel() == pytest.approx((k @ wrench).T.ravel())


def test_rank_is_36_and_condition_one_without_weights_ten_with_them(printed, stated):
    for link in (printed, stated):
        assert (link.rank, link.condition) == (36, pytest.approx(1.0))
        assert link.condition_weighted == pytest.approx(10.0)


def test_five_loads_do_not_determine_36_entries():
    A = observation_matrix(unit_loads()[:, :5])
    assert np.linalg.matrix_rank(A) == 30


def test_standard_deviations_are_noise_over_load_and_m1_combines_twins(printed):
    full, M1, both = (fit.sigma for fit in printed.fits)
    assert full == pytest.approx(np.repeat([2.5e-7, 2.5e-6], 3)[:, None] * np.ones(6))
    twins = 1 / math.sqrt(1 / 2.5e-7**2 + 1 / 2.5e-6**2)
    assert M1[2, 4] == pytest.approx(twins)
    assert M1[4, 2] == pytest.approx(twins)
    assert np.diag(M1) == pytest.approx(np.diag(full))
    assert both[NONZERO] == pytest.approx(M1[NONZERO])
    assert (both[~NONZERO] == 0).all()


def test_m1_helps_k53_and_k62_tenfold_and_no_other_entry(printed):
    gain = dict(zip(names_of(NONZERO), printed.relative_sigma()[0] / printed.relative_sigma()[1], strict=True))
    for name, factor in gain.items():
        if name in ("k53", "k62"):
            assert factor == pytest.approx(10, rel=0.01)
        else:
            assert 1 <= factor < 1.01
    percent = 100 * printed.relative_sigma()[:2, names_of(NONZERO).index("k53")]
    assert percent == pytest.approx([1.462, 0.1455], rel=1e-3)


def test_estimates_of_exact_readings_are_exact(printed):
    readings = printed.A @ printed.truth.ravel()
    for fit in printed.fits:
        assert fit.matrices(readings) == pytest.approx(printed.truth, rel=1e-10, abs=1e-16)


def test_the_reduced_fit_is_the_minimum_of_the_weighted_squares(printed):
    rng = np.random.default_rng(4)
    A, sigma = observation_matrix(rng.normal(size=(6, 9))), rng.uniform(0.5, 2, 54)
    dt, M = rng.normal(size=54), reduction("M1 + M2")
    fit = linear_fit(A, sigma, M)
    expected, *_ = np.linalg.lstsq(A @ M / sigma[:, None], dt / sigma, rcond=None)
    assert fit.gain @ dt == pytest.approx(expected)
    assert fit.covariance == pytest.approx(np.linalg.inv((A @ M).T @ np.diag(sigma**-2) @ (A @ M)))


def test_nine_entries_pass_ratio_5_at_both_noises_but_50_at_the_printed_one_only(printed, stated):
    for link, least in ((printed, 68.4), (stated, 6.84)):
        assert names_of(link.identifiable) == NINE
        assert link.exact_ratio[link.identifiable].min() == pytest.approx(least)


def test_definite_means_the_symmetric_part():
    turned = np.eye(6) + 5 * (np.eye(6, k=1) - np.eye(6, k=-1))  # x^T k x = x^T x
    assert is_definite(turned)
    assert not is_definite(np.diag([1, 1, 1, 1, 1, -1e-9]))
    assert is_definite(np.stack([np.eye(6), -np.eye(6)])).tolist() == [True, False]


# -- a thousand draws ---------------------------------------------------------------------------------------------------


def test_the_scatter_of_a_thousand_draws_is_that_of_the_covariance(study):
    sigma = study.link.relative_sigma()
    assert study.rms_relative_error[:3] == pytest.approx(sigma, rel=4 / math.sqrt(2 * study.seeds))


def test_two_of_five_estimates_are_not_positive_definite_and_m1_and_m2_hardly_help(study):
    three = 3 * math.sqrt(0.25 / study.seeds)
    below = 0.5 * math.erfc(0.18 / math.sqrt(2))
    assert study.not_definite[2] == pytest.approx(below, abs=three)
    assert study.k11_negative[:3] == pytest.approx(below, abs=three)
    # more unknowns, more ways to fail; from 200,000 draws .449 and .436
    assert study.not_definite[:2] == pytest.approx([0.449, 0.436], abs=three)
    assert study.not_definite[0] >= study.not_definite[1] >= study.not_definite[2]


def test_zeros_pass_a_ratio_of_2_as_often_as_chance_has_it(study):
    p = math.erfc(2 / math.sqrt(2))
    three = 3 * math.sqrt(26 * p * (1 - p) / study.seeds)
    assert study.zeros_above.mean() == pytest.approx(26 * p, abs=three)
    assert study.split_holds == 1.0
    assert study.paper_claim_holds == 1.0


def test_the_cone_repairs_the_sign_of_k11_not_its_value(study):
    for method in (3, 4):
        assert study.k11_negative[method] == 0
        assert study.k11_mean[method] > 2
        assert study.rms_relative_error[method, 0] > 3
        assert study.not_definite[method] == pytest.approx(study.not_definite[method - 2], abs=0.002)
        assert study.rms_relative_error[method, 1:] == pytest.approx(study.rms_relative_error[1, 1:], rel=0.01)


def test_with_the_beam_template_the_cone_cuts_k11_off_at_zero(study):
    free, held = study.matrices[2], study.matrices[4]
    cut = np.maximum(free[:, 0, 0], 0)
    assert held[:, 0, 0] == pytest.approx(cut, abs=1e-12)
    rest = NONZERO & (np.arange(36).reshape(6, 6) > 0)
    assert held[:, rest] == pytest.approx(free[:, rest], rel=1e-6)


def test_the_constrained_fit_is_that_of_cvxpy(stated):
    """Ten times the noise: cones bind in many places."""
    import cvxpy as cp

    readings = np.array([stated.readings(seed) for seed in range(6)])
    bound = 0
    for row, found in zip(readings, semidefinite_fits(stated, "symmetric", readings), strict=True):
        unit = np.sqrt(np.diag(stated.fits[0].sigma))
        K = cp.Variable((6, 6), PSD=True)
        measured = row.reshape(6, 6).T / LOAD  # column j is load j
        weight = np.outer(unit, unit) / stated.fits[0].sigma
        offset = measured / stated.fits[0].sigma
        cost = cp.sum_squares(cp.multiply(weight, K) - offset)
        cp.Problem(cp.Minimize(cost)).solve(solver=cp.CLARABEL)
        assert found / np.outer(unit, unit) == pytest.approx(K.value, rel=1e-4, abs=2e-3)
        mine = float((((found - measured) / stated.fits[0].sigma) ** 2).sum())
        assert mine == pytest.approx(float(cost.value), rel=1e-5)
        bound += not is_definite(stated.fits[1].matrices(row))
    assert bound >= 2


def test_a_seed_gives_the_same_draw_whatever_the_others(printed):
    assert study_single_link(printed, seeds=1, seed=7).matrices[0, 0] == pytest.approx(
        study_single_link(printed, seeds=3, seed=5).matrices[0, 2], rel=1e-12
    )


# -- command and report -------------------------------------------------------------------------------------------------


def test_the_command_prints_ours_beside_theirs_and_writes_json(tmp_path):
    target = tmp_path / "s.json"
    words = ["single-link", "--noise", "stated", "--seeds", "20", "--seed", "3", "--json", str(target)]
    done = CliRunner().invoke(app, words, env={"COLUMNS": "200"})
    assert done.exit_code == 0, done.output
    for word in ("1592", "159.2", "more than 50", "consistency check"):
        assert word in done.output
    found = json.loads(target.read_text())
    assert found["noise"] == {"setting": "stated", "position_sigma_mm": 0.025, "orientation_sigma_mrad": 0.25}
    assert (found["rank"], found["seeds"], found["seed"]) == (36, 20, 3)
    assert tuple(found["identifiable"]) == NINE
    assert [m["method"] for m in found["methods"]] == list(METHODS)


def test_a_noise_that_the_paper_does_not_have_is_refused():
    done = CliRunner().invoke(app, ["single-link", "--noise", "small"])
    assert isinstance(done.exception, InputError)
    assert "printed or stated" in str(done.exception)


def test_the_report_holds_every_table_and_asks_for_nothing(study, stated):
    page = single_link_report(study, all_tables(study, study, study_single_link(stated, seeds=5)))
    assert page.count("<table>") == 7
    assert "http" not in page.replace("http://www.w3.org", "")
    assert "43 % of" in page
