"""Every predicted displacement comes with its interval, without any solver, near an active constraint too."""

from __future__ import annotations

import csv
import io
import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from drake_stiffness import jobs
from drake_stiffness import statistics as st
from drake_stiffness.errors import InputError
from drake_stiffness.identification import identify
from drake_stiffness.model import load_model
from drake_stiffness.simulation import simulate_displacement, simulate_readings
from drake_stiffness.support import displacement_support
from drake_stiffness.task import read_task

KR270 = Path(__file__).parents[2] / "examples" / "kr270"
TABLE_1 = np.array([0.33, 0.302, 0.406, 3.002, 3.303, 2.365]) * 1e-6  # rad/(N m)


@pytest.fixture(scope="module")
def stiff_wrist():
    """Campaigns of an arm of joint springs whose joint 6 does not give way at all."""
    task = read_task(KR270 / "campaign_joints_only.yaml")
    o = task.observations()
    truth = task.model.with_x(TABLE_1 * (np.arange(6) < 5))
    m = o.measurements
    exact = simulate_readings(truth, m.cases, m.case, m.point).p.T

    def campaign(seed, sigma_m=12e-6):
        noise = np.random.default_rng(seed).normal(scale=sigma_m, size=exact.shape)
        return replace(o, measurements=replace(m, position=exact + noise))

    return task, truth, campaign


def identified(model, o, method="sdp"):
    solution = identify(model, o, method)
    fit = st.goodness(solution, o)
    numbers, how = st.statistics(solution, o, fit)
    entry = st.fit_entry(solution, fit, float("nan"), method, 0.0, how) | {"quantity": "displacement"}
    return st.attach(solution, numbers, entry, {})


def with_a_negative_estimate(stiff_wrist):
    task, _, campaign = stiff_wrist
    for seed in range(20):
        free = identified(task.model, campaign(seed), "least-squares")
        if free.x[5] < -0.5 * free.statistics.sigma[5]:
            return identified(task.model, campaign(seed)), free
    raise AssertionError("no seed in twenty puts the sixth compliance below zero")


def loaded(m):
    return np.flatnonzero(~m.unloaded[m.case])


def test_without_an_active_constraint_the_interval_is_prediction_and_two_sigma(stiff_wrist):
    task, _, campaign = stiff_wrist
    soft = task.model.with_x(TABLE_1)
    o = campaign(0)
    m = o.measurements
    o = replace(o, measurements=replace(m, position=simulate_readings(soft, m.cases, m.case, m.point).p.T))
    model = identified(task.model, o)
    support = displacement_support(model, m.cases, m.case, m.point)
    assert support.high == pytest.approx(1.959964 * support.sigma, rel=1e-4, abs=1e-12)
    assert support.low == pytest.approx(-1.959964 * support.sigma, rel=1e-4, abs=1e-12)


def test_at_an_active_constraint_the_interval_is_centred_at_least_squares_and_holds_the_prediction(stiff_wrist):
    model, free = with_a_negative_estimate(stiff_wrist)
    assert model.x[5] == pytest.approx(0.0, abs=1e-6 * model.scales[5])
    # The stored shift is that of the linear theory; loaded equilibria differ from it in the second order.
    shift = free.x - model.x
    assert model.statistics.shift == pytest.approx(shift, abs=0.02 * np.abs(shift).max())
    m = stiff_wrist[2](0).measurements
    own = loaded(m)
    support = displacement_support(model, m.cases, m.case[own], m.point[own])
    here, there = (simulate_displacement(one, m.cases, m.case[own], m.point[own]).dp.T for one in (model, free))
    assert (support.low <= 0.0).all()
    assert (support.high >= 0.0).all()
    half = 1.959964 * support.sigma
    # The springs' gradient is that of the undeflected arm: a percent of the shift is left to the loaded equilibrium.
    slack = 0.02 * np.abs(there - here).max()
    assert support.low == pytest.approx(np.minimum(there - here - half, 0.0), abs=slack)
    assert support.high == pytest.approx(np.maximum(there - here + half, 0.0), abs=slack)
    assert (np.abs(there - here) > 0.1 * half).any()


def test_intervals_of_predictions_cover_at_the_rim(stiff_wrist):
    """Sixty campaigns, the true compliance of joint 6 at its bound: 95 % within three binomial deviations."""
    task, truth, campaign = stiff_wrist
    m = campaign(0).measurements
    own = loaded(m)[::41]
    wanted = simulate_displacement(truth, m.cases, m.case[own], m.point[own]).dp.T
    hits = []
    for seed in range(60):
        model = identified(task.model, campaign(seed))
        support = displacement_support(model, m.cases, m.case[own], m.point[own])
        found = simulate_displacement(model, m.cases, m.case[own], m.point[own]).dp.T
        hits.append((found + support.low <= wanted) & (wanted <= found + support.high))
    share = np.mean(hits, axis=0)
    assert (share > 0.95 - 3 * np.sqrt(0.95 * 0.05 / 60) - 1e-9).all()
    assert share.mean() > 0.93


def test_predict_writes_the_interval_beside_every_prediction(stiff_wrist, tmp_path):
    model, _ = with_a_negative_estimate(stiff_wrist)
    model.save(tmp_path / "model.json")
    stored = load_model(tmp_path / "model.json")
    assert stored.statistics.shift == pytest.approx(model.statistics.shift)
    rows = list(csv.DictReader(io.StringIO(jobs.predict(stored, KR270 / "measurements.csv").text)))
    for axis in "xyz":
        low, value, high, sigma = (
            np.array([float(row[name]) for row in rows])
            for name in (
                f"predicted_low_{axis}_mm",
                f"predicted_d{axis}_mm",
                f"predicted_high_{axis}_mm",
                f"predicted_sigma_{axis}_mm",
            )
        )
        printed = 4e-6  # the table holds nanometres
        assert (low <= value).all()
        assert (value <= high).all()
        assert (high - low >= 2 * 1.9599 * sigma - printed).all()
        assert (sigma > 0).any()


def test_a_model_of_an_earlier_version_still_predicts_and_a_broken_shift_is_refused(stiff_wrist, tmp_path):
    model, _ = with_a_negative_estimate(stiff_wrist)
    content = json.loads(json.dumps(model.to_dict(), default=np.ndarray.tolist))
    shift = content.pop("least_squares_shift")
    (tmp_path / "old.json").write_text(json.dumps(content))
    old = load_model(tmp_path / "old.json")
    assert old.statistics.shift is None
    m = stiff_wrist[2](0).measurements
    support = displacement_support(old, m.cases, m.case[:9], m.point[:9])
    assert support.high == pytest.approx(-support.low)
    (tmp_path / "broken.json").write_text(json.dumps(content | {"least_squares_shift": shift[:-1]}))
    with pytest.raises(InputError, match="least_squares_shift"):
        load_model(tmp_path / "broken.json")
