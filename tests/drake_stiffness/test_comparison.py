"""Reductions held against each other: what the held-out error is made of, who is recommended, the beam prior."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from synthetic import FORWARD, SIDEWAYS, VERTICAL, noise, plan, points_of, table
from test_identification import beam_links

from drake_stiffness.assembly import make_model
from drake_stiffness.campaign import CampaignFile
from drake_stiffness.effects.compliance import JointCompliance
from drake_stiffness.errors import InputError
from drake_stiffness.identification import identify
from drake_stiffness.observation import columns
from drake_stiffness.reduction.beam_prior import fit_with_prior, prior_rows, typical_compliance
from drake_stiffness.reduction.comparison import compare_reductions, recommend
from drake_stiffness.reduction.scoring import Row, scored_readings
from drake_stiffness.statistics import held_out_errors
from drake_stiffness.task import Task

K6 = np.array([0.33e-6, 0.30e-6, 0.42e-6, 2.8e-6, 2.9e-6, 3.4e-6])
SIGMA = 12e-6


@pytest.fixture(scope="module")
def task(arms, cells, judges, tmp_path_factory):
    """40 postures of a KR 270 of prismatic beams, judged by Drake, 20 of them held out."""
    folder, arm, cell, rng = tmp_path_factory.mktemp("task"), arms["kr270"], cells["kr270"], np.random.default_rng(11)
    springs, k_link = beam_links(arm, rng)
    cases = plan(arm, cell, 40, rng, [VERTICAL, SIDEWAYS, FORWARD], rest=2)
    p = judges["kr270"].positions(cases, points_of(cell), K6, k_link)
    m = table(folder, cell, arm, cases, p + SIGMA * rng.normal(size=p.shape))
    campaign = CampaignFile(cell="cell.yaml", measurements="measurements.csv", noise=noise(SIGMA))
    effects = (*(JointCompliance(n) for n in arm.joint_names), *springs)
    return Task(folder / "campaign.yaml", campaign, cell, arm, m, np.arange(40) % 2 == 0, effects)


def row(method, error, combinations, *, physical=True, note=""):
    """A row of 5 held-out experiments with 4 readings each."""
    model = type("Fitted", (), {"fit": {"min_eigenvalue": 0.0 if physical else -1.0}})()
    error = np.asarray(error, dtype=float)
    return Row(method, method, model, combinations, combinations, error, np.ones(20), np.repeat(range(5), 4), note=note)


def test_the_smallest_held_out_error_wins_unless_a_smaller_model_is_within_noise_of_it():
    rng = np.random.default_rng(0)
    best = 0.02 + 0.001 * rng.normal(size=20)
    near, far = best + 0.002 * rng.normal(size=20), best + 0.01
    assert recommend([row("none", best, 32), row("sequential", far, 20)]) == ("none", ("none",))
    chosen, tied = recommend([row("none", best, 32), row("sequential", near, 20), row("joints", far, 6)])
    assert chosen == "sequential"
    assert set(tied) == {"none", "sequential"}
    # as many combinations, but no compliance matrix
    assert recommend([row("base", best, 32, physical=False), row("none", best, 32)])[0] == "none"
    assert recommend([row("base", best, 32, note="joint_2 is negative"), row("joints", far, 6)])[0] == "joints"
    assert recommend([]) == ("", ())


def test_differences_are_paired_over_experiments_not_over_readings():
    """One experiment in which a model errs badly is one piece of evidence, however many readings it has."""
    best = np.full(20, 0.02)
    once = best.copy()
    once[:4] += 0.05
    assert recommend([row("none", best, 32), row("sequential", once, 20)])[0] == "sequential"


def test_noise_and_variance_make_up_the_error_of_a_model_that_fits(task):
    """With the right model there is no bias: the held-out mean square is what noise and covariance say."""
    result = compare_reductions(task, ["none", "joints"])
    found, alone = result.row("none"), result.row("joints")
    whole = float((found.error_mm**2).mean())
    assert whole == pytest.approx(found.noise_mm**2 + found.deviation_mm**2, rel=0.12)
    # two unloaded readings are the reference: 3 sigma^2 (1 + 1/2)
    assert found.noise_mm == pytest.approx(1e3 * SIGMA * np.sqrt(4.5))
    assert 0.1 * found.noise_mm < found.deviation_mm < found.noise_mm
    assert alone.bias_mm > 5 * found.noise_mm
    assert found.percent > 99.0 > alone.percent
    assert result.recommended == "none"


def test_a_row_scores_the_loaded_readings_in_their_order(task):
    held = task.held_out()
    which, share = scored_readings(held, True)
    assert not held.unloaded[held.case[which]].any()
    assert share == pytest.approx(0.5)
    assert which.size == held_out_errors(task.model, held, True).shape[1] == 20 * 3 * 3


def test_reductions_of_one_campaign_in_one_table(task):
    result = compare_reductions(task, ["m3", "sequential", "base", "none"], upper=8.0, lower=3.0)
    free = {r.method: r.parameters for r in result.rows}
    assert free["m3"] <= free["sequential"] < free["base"] < free["none"] == 62
    assert result.row("base").mean_mm == pytest.approx(result.row("none").mean_mm, rel=0.1)
    content = result.to_dict()
    assert [entry["method"] for entry in content["methods"]] == ["m3", "sequential", "base", "none"]
    m3 = content["methods"][0]
    assert len(m3["kept"]) + len(m3["dropped"]) + len(m3["merged"]) == 62
    assert all(d["ratio"] < 8.0 for d in m3["dropped"])
    groups = {d["group"]: d["ratio"] for d in m3["dropped"]}
    assert groups["G1~"] >= 3.0 > groups["G1-"]


def test_a_template_that_is_the_cells_own_is_not_shown_twice(task):
    beams = compare_reductions(task, ["m2", "joints"])
    assert [r.method for r in beams.rows] == ["joints"]
    wider = replace(task, effects=(*task.effects[:6], task.effects[8].__class__("link_2", "symmetric", "x", 1.0)))
    assert [r.method for r in compare_reductions(wider, ["m1", "m2"]).rows] == ["m2"]


def test_what_cannot_be_asked_is_told(task):
    with pytest.raises(InputError, match="m9"):
        compare_reductions(task, ["m9"])
    for upper, lower in ((2.0, 5.0), (5.0, 0.0), (np.inf, 2.0)):
        with pytest.raises(InputError, match="lower <= upper"):
            compare_reductions(task, ["joints"], upper, lower)


# -- the beam prior --------------------------------------------------------------------------------------------------------


def test_a_prismatic_beam_satisfies_the_prior_and_a_reversed_one_does_not(arms, cells):
    """Compliances by the tip's virtual work (quadrature), along whichever axis the link has, forwards or backwards."""
    arm, cell = arms["kr270"], cells["kr270"]
    s, w = np.polynomial.legendre.leggauss(6)
    for link, axis in (("link_2", None), ("base_link", "z"), ("link_3", None)):
        from drake_stiffness.assembly import default_beam_axis, link_spring

        axis = axis or default_beam_axis(arm, link)
        model = make_model(cell, arm, [link_spring(arm, link, "beam", axis)])
        along = arm.R_PF[arm.link_names.index(link)].T @ arm.p_PF[arm.link_names.index(link)]
        e = np.zeros(3)
        e["xyz".index(axis)] = along["xyz".index(axis)]
        K = np.zeros((6, 6))
        bend, twist = 3e-7, 1.3 * 3e-7
        for node, weight in zip(s, w, strict=True):
            arm_to_tip = (1 - node) / 2 * e  # from the section to the tip
            cross = np.array(
                [
                    [0, -arm_to_tip[2], arm_to_tip[1]],
                    [arm_to_tip[2], 0, -arm_to_tip[0]],
                    [-arm_to_tip[1], arm_to_tip[0], 0],
                ]
            )
            carried = np.hstack([cross, np.eye(3)])  # moment at the section from the tip's wrench
            give = np.diag([twist if i == "xyz".index(axis) else bend for i in range(3)])
            K += weight / 2 * carried.T @ give @ carried
        x = model.effects[0].template.values(K)
        assert (
            np.abs(np.delete(K.ravel(), np.flatnonzero(np.abs(model.effects[0].template.basis).sum(0)))).max() < 1e-20
        )
        P = prior_rows(model, 0.5, bend)
        assert len(P) == 6
        assert np.abs(P @ (x / model.scales)).max() < 1e-9
        wrong = x.copy()
        off = [i for i, name in enumerate(model.effects[0].template.names) if name[1] != name[2]]
        wrong[off] *= -1
        assert np.abs(P @ (wrong / model.scales)).max() > 1.0


def test_the_prior_decides_what_the_data_leave_open_and_nothing_else(task):
    o = task.observations()
    plain = identify(task.model, o)
    found = fit_with_prior(plain, o)
    A = columns(o, task.model)
    seen = A @ ((found.model.x - plain.model.x) / plain.model.scales)
    assert np.linalg.norm(seen) < 4.0  # sigma of all 540 readings together
    P = prior_rows(plain.model, 0.5, typical_compliance(plain.model))
    departure = [np.linalg.norm(P @ (m.x / m.scales)) for m in (plain.model, found.model)]
    assert departure[1] < 0.7 * departure[0]  # the links of this arm twist more and less than the prior says
    misfit = [np.linalg.norm(solution.residual) for solution in (plain, found)]
    assert misfit[1] ** 2 + departure[1] ** 2 < misfit[0] ** 2 + departure[0] ** 2
    assert misfit[1] >= misfit[0]
    assert found.model.fit == plain.model.fit
    with pytest.raises(InputError, match="spread"):
        fit_with_prior(plain, o, 0.0)
