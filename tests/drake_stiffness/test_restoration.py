"""Restored models: positive definite, true to what was identified, honest about what is not."""

from __future__ import annotations

import dataclasses
import json
import shutil

import numpy as np
import pytest
from scipy.optimize import linprog
from synthetic import hand_made_arm, plan, points_of, watched
from three_arms import KR270, random_springs
from typer.testing import CliRunner

from drake_stiffness.assembly import make_model, spring_effects
from drake_stiffness.cell import read_cell
from drake_stiffness.cli import app
from drake_stiffness.effects.compliance import BaseCompliance, JointCompliance, LinkCompliance
from drake_stiffness.errors import InputError, UntrustworthyError
from drake_stiffness.identification import identify
from drake_stiffness.jobs import identify_campaign
from drake_stiffness.model import Model, Statistics, load_model
from drake_stiffness.plant import build_arm
from drake_stiffness.restoration.beam_mechanics import BEAM, beam_frame, beam_inequalities
from drake_stiffness.restoration.completion import complete
from drake_stiffness.restoration.restoration import LABEL, restore
from drake_stiffness.restoration.sections import Section, Sections
from drake_stiffness.simulation import simulate_readings
from drake_stiffness.statistics import goodness, held_out_errors, rms_mm, statistics
from drake_stiffness.task import read_task

# Matrix (15) of the source paper, as reconstructed from its (17), (18), (25): k11 k22 k26 k33 k35 k44 k55 k66.
PAPER = np.array([4.5e-8, 8.0e-5, 3.98e-4, 3.65e-5, -1.71e-4, 3.76e-3, 1.09e-3, 2.65e-3])
# Standard deviations behind (17): one row of readings each, off-diagonal entries read twice.
SIGMA = np.array([2.5e-7, 2.5e-7, 2.5e-7, 2.5e-7, 2.5e-7, 2.5e-6, 2.5e-6, 2.5e-6])


def one_link(x, sigma, length=0.3, groups=None):
    """A link that was measured entry by entry."""
    arm = hand_made_arm([(length, 0, 0), (0.2, 0, 0)], [(0, 0, 1)])
    effects = (BaseCompliance("base", "beam", "x", length, "ground"),)
    groups = groups or tuple("G1+" if abs(a) > 5 * s else "G1-" for a, s in zip(x, sigma, strict=True))
    s = Statistics(sigma, groups, ((),) * 8, np.diag(sigma**2), np.zeros((8, 0)))
    cell = {
        "robot": {"model": "-", "flange": "-"},
        "reference_points_m": {"P": [0, 0, 0]},
        "springs": {"links": ["ground"]},
    }
    cell["springs"]["joints"] = "none"
    return Model(cell, arm, {"P": np.zeros(3)}, np.zeros(3), effects, np.array(x), s, fit={"warnings": []})


def test_the_papers_own_negative_k11_becomes_an_interval_that_holds_the_truth():
    estimate = PAPER.copy()
    estimate[0] = -3.05e-8  # (25)
    r = restore(one_link(estimate, SIGMA), Sections(default=Section(half_width_y_m=0.008, half_width_z_m=0.012)))
    assert [r.model.names[i] for i in r.number] == ["ground.k11"]
    k55, k66 = PAPER[6:]
    # By hand: r >= c / 5, so k11 >= (c_y/5)^2 k66 and (c_z/5)^2 k55; k11 <= c_y^2 k66 and c_z^2 k55.
    assert r.low[0] == pytest.approx(max(0.0016**2 * k66, 0.0024**2 * k55), rel=0.02)
    assert r.high[0] == pytest.approx(min(0.008**2 * k66, 0.012**2 * k55), rel=0.02)
    assert r.low[0] < PAPER[0] < r.high[0]
    assert "k11 >= r_y^2 k66" in r.rules[0][0]
    assert r.departure < 1.0
    np.linalg.cholesky(r.model.effects[0].matrix(r.model.x))
    assert r.model.x[1:] == pytest.approx(PAPER[1:], abs=1e-6 * np.abs(PAPER[1:]).max(), rel=0.01)


def test_limits_that_contradict_what_was_identified_are_refused_and_the_rule_is_named():
    stretched = PAPER.copy()
    stretched[0] = 2e-6
    with pytest.raises(UntrustworthyError, match=r"ground: k11 <= c_y\^2 k66") as error:
        restore(one_link(stretched, SIGMA), Sections(default=Section(half_width_y_m=0.008, half_width_z_m=0.1)))
    assert "sigma" in str(error.value)


def test_a_link_that_is_no_beam_at_all_is_named():
    wrong = PAPER.copy()
    wrong[[0, 2]] = 1e-4, -3.98e-4
    with pytest.raises(UntrustworthyError, match="Without the limits of ground they agree: that link is no such beam"):
        restore(one_link(wrong, SIGMA), Sections())


def test_what_nothing_bounds_is_said_to_have_no_bound():
    """A link whose every reading is missing (G2): its compliance may be anything above zero."""
    model = one_link(PAPER, SIGMA)
    s = model.statistics
    blind = dataclasses.replace(
        s, sigma=np.full(8, np.nan), group=("G2",) * 8, covariance=np.zeros((8, 8)), null_space=np.eye(8)
    )
    r = restore(dataclasses.replace(model, statistics=blind), Sections())
    assert np.isinf(r.high[r.model.names.index("ground.k66")])
    assert r.low[0] == 0.0
    np.linalg.cholesky(r.model.effects[0].matrix(r.model.x))
    stated = Section(youngs_modulus_GPa=(60, 220), area_m2=(1e-4, 1e-2))
    r = restore(dataclasses.replace(model, statistics=blind), Sections(default=stated))
    assert np.isfinite(r.high).all()
    assert r.low[0] == pytest.approx(0.3 / (220e9 * 1e-2), rel=1e-3)


# -- the KR 270 campaign ----------------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def kr270():
    model = identify_campaign(KR270 / "campaign.yaml").model
    return model, restore(model, Sections())


def test_every_link_of_the_restored_kr_270_is_positive_definite_as_a_whole(kr270):
    before, r = kr270
    assert min(np.linalg.eigvalsh(e.matrix(x))[0] for e, x in links(before)) < 1e-14
    for effect, x in links(r.model):
        d = np.sqrt(np.diag(effect.matrix(x)))
        assert np.linalg.eigvalsh(effect.matrix(x) / np.outer(d, d))[0] > 1e-3, effect.where
    assert min(r.smallest.values()) > 1e-4


def links(model):
    return [(e, x) for e, x in zip(model.effects, model.values, strict=True) if isinstance(e, LinkCompliance)]


def test_restoring_leaves_what_was_identified_untouched(kr270):
    before, r = kr270
    change = (r.model.x - before.x) / before.scales
    null = before.statistics.null_space
    assert np.linalg.norm(change) > 0.1
    assert np.linalg.norm(change - null @ (null.T @ change)) < 1e-12
    assert r.departure == 0.0


def test_the_restored_model_predicts_held_out_postures_no_worse(kr270):
    before, r = kr270
    task = read_task(KR270 / "campaign.yaml")
    m = task.held_out()
    errors = [rms_mm(held_out_errors(model, m, True)) for model in (before, r.model)]
    # What differs is of second order in the deflection; 0.1 um beside 24 um of noise.
    assert errors[1] < errors[0] + 1e-4
    shift = (
        simulate_readings(before, m.cases, m.case, m.point).p - simulate_readings(r.model, m.cases, m.case, m.point).p
    )
    assert rms_mm(shift - shift.mean(axis=1, keepdims=True)) < 0.02 * 24


def test_only_the_campaign_that_a_model_was_identified_from_speaks_for_it(tmp_path):
    """Whatever it is called and wherever it stands: what counts is its readings. Joints alone are quick to identify, and that
    they have no links to restore is said after the campaign was taken for the model's own."""
    identify_campaign(KR270 / "campaign_joints_only.yaml").model.save(tmp_path / "model.json")
    for name in ("cell_joints_only.yaml", "campaign_joints_only.yaml", "measurements.csv", "kr270.urdf"):
        shutil.copy(KR270 / name, tmp_path)
    campaign = (tmp_path / "campaign_joints_only.yaml").rename(tmp_path / "same.yaml")
    words = ["restore", str(tmp_path / "model.json"), "-o", str(tmp_path / "r.json"), "--campaign", str(campaign)]
    assert "no link springs" in str(CliRunner().invoke(app, words).exception)
    rows = (tmp_path / "measurements.csv").read_text().splitlines()
    (tmp_path / "measurements.csv").write_text("\n".join(rows[:-1]) + "\n")
    other = CliRunner().invoke(app, words)
    assert isinstance(other.exception, InputError)
    assert "are not those that" in str(other.exception)
    assert "(measurements.csv, another SHA-256)" in str(other.exception)
    assert not (tmp_path / "r.json").exists()


def test_restored_entries_are_labelled_and_never_called_identified(kr270, tmp_path):
    before, r = kr270
    groups = dict(zip(r.model.names, r.model.statistics.group, strict=True))
    assert len(r.model.restored) == sum(g not in ("G1+", "G1~") for g in groups.values()) == 60
    for entry, low, high in zip(r.model.restored, r.low, r.high, strict=True):
        assert entry["label"] == LABEL == "restored, not identified"
        assert groups[entry["name"]] not in ("G1+", "G1~")
        assert low <= entry["low"] <= entry["value"] <= entry["high"] <= high
    r.model.save(tmp_path / "r.json")
    again = load_model(tmp_path / "r.json")
    assert again.restored == r.model.restored
    assert set(again.restored[0]) == {"name", "low", "high", "value", "unit", "label", "from"}
    assert again.with_x(again.x).restored == ()
    assert before.restored == ()


def test_intervals_lie_inside_those_of_the_linear_rules_alone(kr270):
    """A second way, scipy's simplex: linear rules and signs, identified combinations exact; the cones can only take from that."""
    before, r = kr270
    G, h = beam_inequalities(before, Sections())
    size = np.abs(G * before.scales).sum(axis=1)
    scaled = G * before.scales / size[:, None]
    null = before.statistics.null_space
    seen = np.linalg.svd(null, full_matrices=True)[0][:, null.shape[1] :]
    cov = before.statistics.covariance / np.outer(before.scales, before.scales)
    slack = r.radius * np.sqrt(np.diag(seen.T @ cov @ seen))  # the box around the region
    z = seen.T @ (before.x / before.scales)
    A = np.vstack([scaled, seen.T, -seen.T])
    b = np.concatenate([h / size, z + slack, -z + slack])
    bounds = [(0 if p.lower == 0 else None, None) for p in before.parameters]
    tried = 0
    for name in ("joint_3", "base_link.k11", "link_2.k44", "link_2.k55", "link_5.k66"):
        i, k = before.names.index(name), [before.names[j] for j in r.number].index(name)
        for sign, end in ((1, r.low[k]), (-1, r.high[k])):
            found = linprog(sign * np.eye(before.x.size)[i], A_ub=A, b_ub=b, bounds=bounds)
            if found.status == 0:
                assert sign * end >= found.fun * before.scales[i] - 1e-3 * abs(end)
                tried += 1
    assert tried >= 6


# -- another arm ------------------------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def track(cells, arms, tmp_path_factory):
    """The arm on a track with a leaning elastic link: the truth, its readings, the identified model."""
    folder = tmp_path_factory.mktemp("track")
    cell, arm = cells["track"], arms["track"]
    stated = cell.model_copy(update={"springs": cell.springs.model_copy(update={"links": ("upper",)})})
    stated._path = cell._path
    effects = spring_effects(stated, arm)
    rng = np.random.default_rng(5)
    number = arm.link_names.index("upper")
    line = arm.R_PF[number].T @ arm.p_PF[number]
    L, k66, k55 = float(np.linalg.norm(line)), 3e-7, 2e-7
    beam = np.array([4e-10, k66 * L**2 / 3 + 3e-9, k66 * L / 2, k55 * L**2 / 3 + 3e-9, -k55 * L / 2, 5e-7, k55, k66])
    Q = np.kron(np.eye(2), beam_frame(line))
    truth = np.concatenate([random_springs(arm, rng)[0], effects[-1].template.values(Q @ BEAM.matrix(beam) @ Q.T)])
    model = make_model(stated, arm, effects, truth)
    cases = plan(arm, stated, 10, rng)
    count = len(stated.reference_points_m)
    case = np.tile(np.arange(cases.number), count)
    names = np.repeat(list(stated.reference_points_m), cases.number)
    p = simulate_readings(model, cases, case, names).p.reshape(3, count, -1).transpose(1, 0, 2)
    assert points_of(stated).shape == (count, 3)
    o = watched(folder, stated, arm, cases, p + rng.normal(0, 1e-5, p.shape), 1e-5)
    return model, o, with_statistics(make_model(stated, arm, effects), o), folder


def with_statistics(model, o):
    solution = identify(model, o, "sdp")
    return dataclasses.replace(
        solution.model, statistics=statistics(solution, o, goodness(solution, o))[0], fit={"warnings": []}
    )


def test_the_truth_of_another_arm_lies_in_its_intervals_although_its_link_leans(track):
    truth, _, found, _ = track
    r = restore(found, Sections(default=Section(half_width_y_m=0.1, half_width_z_m=0.1)))
    assert r.number.size > 3
    assert not r.notes
    slack = 1e-9 * np.abs(truth.x[r.number])
    assert ((r.low - slack <= truth.x[r.number]) & (truth.x[r.number] <= r.high + slack)).all()
    ((effect, x),) = links(r.model)
    np.linalg.cholesky(effect.matrix(x) / np.outer(effect.component_scales, effect.component_scales))


def test_a_reduced_model_is_completed_from_the_readings_and_refused_without_them(track):
    truth, o, found, _ = track
    effects = tuple(
        e.masked(["k11", "k22", "k44", "k55", "k66", "k12"]) if isinstance(e, LinkCompliance) else e
        for e in found.effects
    )
    kept = dataclasses.replace(found, effects=effects[1:], x=np.zeros(6 + 6), statistics=None)
    reduced = with_statistics(kept, o)
    with pytest.raises(InputError, match="16 compliances were taken away"):
        restore(reduced, Sections())
    r = restore(reduced, Sections(default=Section(half_width_y_m=0.1, half_width_z_m=0.1)), o)
    assert r.model.names == truth.names
    slack = 1e-9 * np.abs(truth.x[r.number])
    assert ((r.low - slack <= truth.x[r.number]) & (truth.x[r.number] <= r.high + slack)).all()
    errors = [np.linalg.norm(held_out_errors(m, o.measurements, True)) for m in (reduced, r.model)]
    assert errors[1] < errors[0]


def test_completing_gives_back_joints_links_and_whole_matrices():
    cell = read_cell(KR270 / "cell.yaml")
    arm = build_arm(cell)
    whole = make_model(cell, arm, spring_effects(cell, arm))
    part = make_model(cell, arm, [JointCompliance("joint_2"), LinkCompliance("link_2", "beam").masked(["k22", "k66"])])
    again, new = complete(part.with_x(np.array([1e-6, 2e-9, 3e-7])))
    assert again.names == whole.names
    assert new.sum() == 59
    assert again.x[again.names.index("link_2.k66")] == 3e-7
    assert complete(whole)[0] is whole


def test_models_that_cannot_be_restored_are_refused_with_the_reason():
    model = one_link(PAPER, SIGMA)
    with pytest.raises(InputError, match="no statistics"):
        restore(dataclasses.replace(model, statistics=None), Sections())
    joints = dataclasses.replace(
        model, effects=(JointCompliance("j1"),), x=np.ones(1), cell={**model.cell, "springs": {"links": "none"}}
    )
    with pytest.raises(InputError, match="no link springs"):
        restore(joints, Sections())


def test_the_command_writes_model_summary_and_report(track, monkeypatch):
    _, _, found, folder = track
    monkeypatch.chdir(folder)
    found.save(folder / "model.json")
    (folder / "sections.yaml").write_text("default: {half_width_y_m: 0.1, half_width_z_m: 0.1}\n")
    names = [
        "restore",
        "model.json",
        "--sections",
        "sections.yaml",
        "-o",
        "r.json",
        "--json",
        "s.json",
        "--report",
        "r.html",
    ]
    result = CliRunner().invoke(app, names)
    assert result.exit_code == 0, result.output
    assert LABEL in result.output
    written = load_model(folder / "r.json")
    assert written.provenance["restoration"]["inputs"]["sections"]["file"] == "sections.yaml"
    restored = written.restored
    assert json.loads((folder / "s.json").read_text())["restored"] == list(restored)
    assert "upper.k12" in (folder / "r.html").read_text()
    same = CliRunner().invoke(app, ["restore", "model.json", "-o", "model.json"])
    assert isinstance(same.exception, InputError)
