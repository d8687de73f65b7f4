"""`diagnose --fixed`: five postures tell whether a stored model is still true, and which effect changed."""

import json
import re
from dataclasses import replace

import numpy as np
import pytest
from hidden_campaigns import SIGMA_M, draw, run, softer, table, with_physics, write
from plants.gear_mesh import Backlash
from scipy.spatial.transform import Rotation
from typer.testing import CliRunner

from drake_stiffness.cli import app
from drake_stiffness.diagnosis import recheck as recheck_module
from drake_stiffness.diagnosis.prior import prior_root, with_prior
from drake_stiffness.diagnosis.recheck import recheck
from drake_stiffness.diagnosis.recheck_job import recheck_campaign, recheck_document
from drake_stiffness.diagnosis.recheck_words import change_words, strongest, then_and_now
from drake_stiffness.errors import InputError
from drake_stiffness.jobs import identify_campaign
from drake_stiffness.model import load_model
from drake_stiffness.observation import measured, observe, predicted
from drake_stiffness.report.diagnosis_shape import shapes_between
from drake_stiffness.report.recheck import recheck_report
from drake_stiffness.report.recheck_next import next_steps
from drake_stiffness.report.recheck_plots import then_and_now_figure
from drake_stiffness.task import read_task


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    return tmp_path_factory.mktemp("recheck")


@pytest.fixture(scope="module")
def stored(folder):
    """Last month's model, of twelve postures."""
    path = write(folder / "then", table(run(draw(12, 1)), 1))
    identify_campaign(path).model.save(folder / "old.json")
    return folder / "old.json"


@pytest.fixture(scope="module")
def five():
    return draw(5, 2)


@pytest.fixture(scope="module")
def same(folder, five):
    return write(folder / "same", table(run(five), 2))


def named(result):
    return [(e["kind"], e["where"], e["change"]) for e in result.document["effects"]]


def test_a_model_that_is_still_true_is_called_so(stored, same):
    """Eight draws of the noise; one in a hundred may be called false."""
    task, model = read_task(same), load_model(stored)
    exact, false = run(draw(5, 2)).exact.reshape(-1, 3), 0
    for seed in range(8):
        noise = np.random.default_rng([seed, 9]).normal(scale=SIGMA_M, size=exact.shape)
        m = replace(task.measurements, position=exact + noise)
        o = observe(m, True, task.campaign.noise)
        false += recheck(model, [], m, o, 0, lambda text: None).verdict != "consistent"
    assert false <= 1


@pytest.fixture(scope="module")
def softened(folder, stored, five):
    """A third joint that gives a tenth more than it did."""
    return recheck_campaign(write(folder / "softer", table(run(five, softer(2, 1.1)), 3)), stored)


def text_of(page):
    return re.sub(r"\s+", " ", re.sub(r"<[^>]+>", " ", re.sub(r"<style>.*?</style>", "", page, flags=re.DOTALL)))


def test_a_softer_joint_is_named_with_its_value_then_and_now(softened):
    result = softened
    assert result.document["verdict"] == "explained"
    assert named(result) == [("joint_compliance", "joint_3", "changed")]
    k = result.document["effects"][0]["parameters"]["k"]
    assert k["value"] / k["value_then"] == pytest.approx(1.1, abs=0.01)
    assert abs(k["value"] - 1.1 * 0.406e-6) < 4 * k["sigma"]
    assert result.document["gap"]["held_out_p_value_after"] > 0.01 > result.document["gap"]["held_out_p_value_before"]
    # The model of now predicts as the diagnosis says: it is a model like any other.
    assert result.model.x[result.model.names.index("joint_3")] == k["value"]


def test_a_backlash_that_appeared_is_named(folder, stored, five):
    worn = run(five, with_physics(Backlash(0, 1e-4, 50.0, 0.05, 4000.0)))
    result = recheck_campaign(write(folder / "worn", table(worn, 4)), stored)
    assert result.document["verdict"] == "explained"
    assert named(result)[0] == ("joint_backlash", "joint_1", "appeared")
    width = result.document["effects"][0]["parameters"]["width"]
    assert width["value"] == pytest.approx(1e-4, rel=0.15)
    assert "value_then" not in width


def test_what_comes_to_nothing_once_all_is_fitted_has_not_appeared(folder, stored, five, monkeypatch):
    """A cone or a bound may leave nothing of what passed its test to first order; here backlash, by decree."""
    whole = recheck_module._settle

    def settled(model, o, root, free, changes):
        out, x = whole(model, o, root, free, changes), None
        for change in changes:
            if change.named.effect.kind == "joint_backlash":
                x = out.model.x.copy()
                x[out.model.slices[change.number]] = 0.0
        return out if x is None else replace(out, model=out.model.with_x(x))

    monkeypatch.setattr(recheck_module, "_settle", settled)
    worn = run(five, with_physics(Backlash(0, 1e-4, 50.0, 0.05, 4000.0)))
    result = recheck_campaign(write(folder / "nothing", table(worn, 4)), stored)
    assert "joint_backlash" not in [kind for kind, *_ in named(result)]
    assert any(
        "all its values are zero" in r["why"] for r in result.document["rejected"] if r["kind"] == "joint_backlash"
    )


def test_a_tracker_that_was_turned_is_named(folder, stored, five):
    done = run(five)
    turned = Rotation.from_rotvec([0.0, 0.004, 0.008]).apply(done.exact.reshape(-1, 3)).reshape(done.exact.shape)
    result = recheck_campaign(write(folder / "turned", table(replace(done, exact=turned), 5)), stored)
    assert named(result) == [("tracker_frame", "tracker", "appeared")]
    found = result.document["effects"][0]["parameters"]
    for axis, angle in (("ry", 0.004), ("rz", 0.008)):
        assert abs(abs(found[axis]["value"]) - angle) < 4 * found[axis]["sigma"]


def test_a_tracker_set_up_anew_is_no_change_if_the_campaign_says_so(folder, stored, five):
    done = run(five)
    turned = Rotation.from_rotvec([0.0, 0.004, 0.008]).apply(done.exact.reshape(-1, 3)).reshape(done.exact.shape)
    path = write(folder / "anew", table(replace(done, exact=turned), 5), tracker_frame="unknown")
    result = recheck_campaign(path, stored)
    assert result.document["verdict"] == "consistent"
    assert result.document["recheck"]["set_up_anew"] == ["tracker_frame at tracker"]


def test_chi_square_is_that_of_readings_with_the_models_own_uncertainty(stored, same):
    """Two ways to one number: rows of the prior below the readings, and the inverse of their covariance."""
    task, model = read_task(same), load_model(stored)
    o = task.observations()
    left = with_prior(model, o, prior_root(model, []), [])
    r = measured(o) - predicted(o, model)
    C = model.statistics.covariance / np.outer(model.scales, model.scales)
    direct = r @ np.linalg.solve(np.eye(r.size) + left.A @ C @ left.A.T, r)
    assert left.r @ left.r == pytest.approx(direct, rel=1e-9)
    assert left.dof == o.rows - o.references


def test_three_postures_hold_none_out_and_say_so(folder, stored):
    result = recheck_campaign(write(folder / "three", table(run(draw(3, 7)), 7)), stored)
    assert result.document["verdict"] == "consistent"
    assert result.document["gap"]["held_out_after_rms_mm"] is None
    assert "3 postures are fewer than 4" in result.document["recheck"]["held_out"]


def test_the_command_writes_what_it_says(folder, stored, same):
    out, page = folder / "recheck.json", folder / "recheck.html"
    command = ["diagnose", str(same), "--fixed", "--model", str(stored), "--json", str(out), "--report", str(page)]
    ran = CliRunner().invoke(app, command)
    assert ran.exit_code == 0, ran.output
    assert "still true" in " ".join(ran.output.split())
    document = json.loads(out.read_text())
    assert document["verdict"] == "consistent"
    text = text_of(page.read_text(encoding="utf-8"))
    assert "Is old.json still true? " in text
    assert "Still true. At 5 postures the stored model is" in text
    assert "Go on with the stored model" in text
    for words in ("No longer true", "Changed:", "Appeared:", "The arm"):
        assert words not in text
    for entry in document["untestable"]:
        assert entry["kind"] in text
        assert entry["lacks"] in text


def test_the_page_says_what_changed_from_what_to_what_and_what_to_do(softened):
    page = recheck_report(softened)
    text = text_of(page)
    (entry,) = softened.document["effects"]
    (k,) = then_and_now(entry)
    assert k.unit == "µrad/(kN m)"
    assert (k.then, k.now) == pytest.approx([entry["parameters"]["k"][w] * 1e9 for w in ("value_then", "value")])
    assert f"No longer true. Joint compliance at joint_3 changed (k {k.then:.1f} -&gt; {k.now:.1f}" in text
    assert f"{k.then:.1f} {k.then - 1.96 * k.sigma_then:.1f} .. {k.then + 1.96 * k.sigma_then:.1f}" in text
    assert f"{k.now:.1f} {k.now - 1.96 * k.sigma:.1f} .. {k.now + 1.96 * k.sigma:.1f}" in text
    assert f"({100 * k.share:+.1f} %)" in text
    for other in entry["confounded_with"]:
        assert f"{other['kind']} at {other['where']}" in text
    for part in ("The gap", "What to do next", "Where the gap is", "The arm", "Suspects", "Ruled out", "Provenance"):
        assert part in text
    assert "http" not in text
    assert all(src.startswith("data:image/") for src in re.findall(r'src="([^"]{0,40})', page))


def test_the_picture_of_a_change_shows_the_change_and_not_the_whole_effect(softened):
    """A tenth of the compliance, times the torque: what the readings show beyond the stored model."""
    found = softened.recheck
    (change,) = found.changes
    stored, now, o = found.left.scene.model, found.settled.model, found.left.scene.o
    then = stored.values[change.number]
    (shape,) = shapes_between(o, stored, now, now.effects[change.number], then)
    assert np.nanstd(shape.after) < 0.2 * np.nanstd(shape.before)
    assert np.nanstd(shape.before - shape.itself - shape.after) < 0.05 * np.nanstd(shape.before)
    (whole,) = shapes_between(o, stored, now, now.effects[change.number])
    assert np.nanstd(whole.itself) == pytest.approx(11 * np.nanstd(shape.itself), rel=0.05)


def test_of_many_values_the_surest_changes_are_said_and_the_others_counted():
    def value(then, now):
        return {"value": now, "unit": "rad", "sigma": 1e-5, "value_then": then, "sigma_then": 1e-5}

    parameters = {f"sin_{n}": value(1e-4, 1e-4 + n * 1e-5) for n in range(1, 12)} | {"cos_9": value(2e-4, -3e-4)}
    entry = {"kind": "joint_periodic_error", "where": "joint_2", "change": "changed", "parameters": parameters}
    words = change_words(entry)
    assert words.startswith(
        "joint periodic error at joint_2 changed (cos_9 0.2 -> -0.3 +- 0.01 mrad; sin_11 0.1 -> 0.21"
    )
    assert "+- 0.01 mrad (+110.0 %), and 10 more)" in words
    values = then_and_now(entry)
    assert [v.name for v in strongest(values, 3)] == ["cos_9", "sin_11", "sin_10"]
    assert strongest(values, 12) == values
    assert then_and_now_figure(values).startswith("data:image/svg+xml")
    # A negative value has no share, and one that nothing is known of has no share, and no certainty.
    entry["parameters"] = {"k": value(1e-4, 2e-4) | {"sigma_then": None, "sigma": None}}
    (loose,) = then_and_now(entry)
    assert (loose.share, loose.sure) == (None, 0.0)


def test_what_leaves_nearly_all_of_the_gap_is_no_answer(stored, same):
    """The flange moved by 0.1 mm at random at every step: something passes its test, and none of it is true."""
    task, model = read_task(same), load_model(stored)
    exact = run(draw(5, 2)).exact
    shaken = exact + np.random.default_rng(3).normal(scale=6e-5, size=(exact.shape[0], 1, 3))
    m = replace(task.measurements, position=shaken.reshape(-1, 3))
    found = recheck(model, [], m, observe(m, True, task.campaign.noise), 0, lambda text: None)
    assert (found.verdict, found.changes) == ("unexplained", ())
    assert found.first.passed
    document = recheck_document(found, model)
    assert any("nearly all of the gap would be left" in entry["why"] for entry in document["rejected"])
    steps = " ".join(next_steps({**document, "recheck": {"postures": 3}}))
    for words in ("Measure a whole campaign", "Measure at least 4 postures", "Not answered here"):
        assert words in steps


def test_an_arm_that_carries_nothing_shows_no_change_of_a_spring(stored, same):
    """Readings move as if joint 1 had softened, but the loads are a millionth: whatever moved them, it was no spring."""
    task, model = read_task(same), load_model(stored)
    done = run(draw(5, 2), softer(0, 1.5)).exact.reshape(-1, 3)
    m = task.measurements
    m = replace(m, position=done, cases=replace(m.cases, wrench=1e-6 * m.cases.wrench))
    found = recheck(model, [], m, observe(m, True, task.campaign.noise), 0, lambda text: None)
    assert found.verdict != "consistent"
    assert not [c for c in found.changes if c.named.effect.kind.startswith("joint_")]
    assert ("joint_compliance", "joint_1") in {(u.kind, u.where) for u in found.untestable}


def test_without_a_covariance_nothing_can_be_said(folder, stored, same):
    content = json.loads(stored.read_text())
    del content["covariance"]
    (folder / "bare.json").write_text(json.dumps(content))
    with pytest.raises(InputError, match="holds no covariance"):
        recheck_campaign(same, folder / "bare.json")
