"""`diagnose --fixed`: five postures tell whether a stored model is still true, and which effect changed."""

import json
from dataclasses import replace

import numpy as np
import pytest
from hidden_campaigns import SIGMA_M, draw, run, softer, table, with_physics, write
from plants.gear_mesh import Backlash
from scipy.spatial.transform import Rotation
from typer.testing import CliRunner

from drake_stiffness.cli import app
from drake_stiffness.diagnosis.prior import prior_root, with_prior
from drake_stiffness.diagnosis.recheck import recheck
from drake_stiffness.diagnosis.recheck_job import recheck_campaign
from drake_stiffness.errors import InputError
from drake_stiffness.jobs import identify_campaign
from drake_stiffness.model import load_model
from drake_stiffness.observation import measured, observe, predicted
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


def test_a_softer_joint_is_named_with_its_value_then_and_now(folder, stored, five):
    result = recheck_campaign(write(folder / "softer", table(run(five, softer(2, 1.1)), 3)), stored)
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
    out = folder / "recheck.json"
    ran = CliRunner().invoke(app, ["diagnose", str(same), "--fixed", "--model", str(stored), "--json", str(out)])
    assert ran.exit_code == 0, ran.output
    assert "still true" in " ".join(ran.output.split())
    assert json.loads(out.read_text())["verdict"] == "consistent"


def test_without_a_covariance_nothing_can_be_said(folder, stored, same):
    content = json.loads(stored.read_text())
    del content["covariance"]
    (folder / "bare.json").write_text(json.dumps(content))
    with pytest.raises(InputError, match="holds no covariance"):
        recheck_campaign(same, folder / "bare.json")
