"""model.json: round trip, and what is not a model."""

import json

import numpy as np
import pytest
from synthetic import SIDEWAYS, VERTICAL, plan, points_of, watched

from drake_stiffness.assembly import make_model, spring_effects
from drake_stiffness.effects import make_effect
from drake_stiffness.errors import InputError
from drake_stiffness.identification import identify
from drake_stiffness.model import load_model
from drake_stiffness.simulation import simulate_readings
from drake_stiffness.statistics import attach, goodness, statistics
from drake_stiffness.support import position_support


@pytest.fixture(scope="module")
def identified(tmp_path_factory, arms, cells, judges):
    arm, cell, rng = arms["kr270"], cells["kr270"], np.random.default_rng(0)
    cases = plan(arm, cell, 8, rng, [VERTICAL, SIDEWAYS])
    k = np.array([0.33e-6, 0.30e-6, 0.42e-6, 2.8e-6, 2.9e-6, 3.4e-6])
    p = judges["kr270"].positions(cases, points_of(cell), k)
    effects = [
        *spring_effects(cell, arm),
        make_effect("tracker_frame", "tracker"),
        make_effect("reflector_offset", "P2"),
    ]
    folder = tmp_path_factory.mktemp("model")
    o = watched(folder, cell, arm, cases, p + 1e-5 * rng.normal(size=p.shape), 1e-5, displacement=False)
    solution = identify(make_model(cell, arm, effects), o, "least-squares")
    stats, _ = statistics(solution, o, goodness(solution, o))
    return attach(solution, stats, {"dof": 3, "held_out_rms_mm": float("nan")}, {"seed": 0}), cases


def test_a_stored_model_is_the_same_model(tmp_path, identified):
    model, cases = identified
    model.save(tmp_path / "model.json")
    again = load_model(tmp_path / "model.json")
    assert again.names == model.names
    assert np.array_equal(again.x, model.x)
    assert again.parameters == model.parameters
    for name in ("R_PF", "p_PF", "axis_F", "mass_kg", "p_MCom", "p_ETool", "gravity", "lower", "upper"):
        assert np.array_equal(getattr(again.arm, name), getattr(model.arm, name)), name
    s, t = model.statistics, again.statistics
    assert (t.group, t.merged_with) == (s.group, s.merged_with)
    assert np.array_equal(t.sigma, s.sigma, equal_nan=True)
    assert np.array_equal(t.null_space, s.null_space)
    seen = np.array([g != "G2" for g in s.group])
    assert np.array_equal(t.covariance[np.ix_(seen, seen)], s.covariance[np.ix_(seen, seen)])
    case, point = np.arange(cases.number), np.array(["P2"] * cases.number)
    assert np.array_equal(
        simulate_readings(again, cases, case, point).p, simulate_readings(model, cases, case, point).p
    )
    assert position_support(again, cases, case, point).sigma == pytest.approx(
        position_support(model, cases, case, point).sigma, rel=1e-9
    )
    again.save(tmp_path / "again.json")
    assert (tmp_path / "again.json").read_bytes() == (tmp_path / "model.json").read_bytes()


def test_the_file_holds_what_the_formats_promise(tmp_path, identified):
    model, _ = identified
    model.save(tmp_path / "model.json")
    content = json.loads((tmp_path / "model.json").read_text())
    assert content["format"] == "drake-stiffness-model/1"
    assert {"cell", "arm", "springs", "parameters", "covariance", "effects", "fit", "provenance"} <= set(content)
    assert content["fit"]["held_out_rms_mm"] is None
    springs = {s["name"]: s for s in content["springs"]}
    assert springs["joint_2"]["kind"] == "joint"
    assert springs["joint_2"]["compliance"] == [[model.x[1]]]
    assert springs["base_link"]["kind"] == "link"
    for spring in content["springs"]:
        K = np.array(spring["compliance"])
        assert K.shape in ((1, 1), (6, 6))
        assert np.array_equal(K, K.T)
    row = next(p for p in content["parameters"] if p["name"] == "joint_2")
    assert row["unit"] == "rad/(N m)"
    assert row["group"] in ("G1+", "G1~", "G1-", "G2", "G3")
    if row["sigma"] is not None:
        assert row["ratio"] == pytest.approx(abs(row["value"]) / row["sigma"])
    number = len(content["covariance"]["parameters"])
    assert np.array(content["covariance"]["matrix"]).shape == (number, number)


def spoil_values(content):
    next(iter(content["effects"][1]["parameters"].values()))["value"] = None


BROKEN = {
    "cut short": (lambda text: text[: len(text) // 2], "truncated"),
    "nothing": (lambda text: "", "empty"),
    "zeros": (lambda text: "\0" * 100, "empty"),
    "another format": (lambda text: text.replace("drake-stiffness-model/1", "drake-stiffness-model/9"), "drake-stiffness-model/9"),
    "another file": (lambda text: '{"rows": [1, 2]}', "format is None"),
    "a list": (lambda text: "[1, 2]", "format is None"),
    "not json": (lambda text: "cell: cell.yaml\n", "not a whole JSON file"),
    "a part missing": (lambda text: text.replace('"R_PF"', '"R_XX"'), "R_PF"),
    "an unknown effect": (lambda text: text.replace('"joint_compliance"', '"joint_magic"'), "joint_magic"),
}  # fmt: skip


@pytest.mark.parametrize("name", list(BROKEN))
def test_a_file_that_is_no_whole_model_is_refused(tmp_path, identified, name):
    identified[0].save(tmp_path / "model.json")
    change, says = BROKEN[name]
    path = tmp_path / "broken.json"
    path.write_text(change((tmp_path / "model.json").read_text()))
    with pytest.raises(InputError) as error:
        load_model(path)
    assert "broken.json" in str(error.value)
    assert says in str(error.value)


def test_a_value_that_is_null_is_no_value(tmp_path, identified):
    content = json.loads(json.dumps(identified[0].to_dict(), default=lambda a: a.tolist()).replace("NaN", "null"))
    spoil_values(content)
    (tmp_path / "m.json").write_text(json.dumps(content))
    with pytest.raises(InputError, match=r"m\.json"):
        load_model(tmp_path / "m.json")


def test_a_model_without_links_keeps_joints_and_instruments(identified):
    model, _ = identified
    bare = model.without_links
    assert {e.kind for e in bare.effects} == {"joint_compliance", "tracker_frame", "reflector_offset"}
    assert np.array_equal(bare.x[:6], model.x[:6])
    assert np.array_equal(bare.x[6:], model.x[-9:])
    assert bare.statistics is None


def test_the_tool_centre_point_turns_as_the_cell_says(identified):
    from scipy.spatial.transform import Rotation

    R, p = identified[0].tcp
    assert p == pytest.approx([0.18, 0, 0.22])
    assert np.allclose(R, Rotation.from_euler("ZYX", [0, -90, 180], degrees=True).as_matrix(), atol=1e-12)
