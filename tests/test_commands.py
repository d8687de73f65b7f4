"""Every command as a user runs it: exit codes, the files written, what `--json` holds, the same again from the same inputs.

Predictions and simulations are held against computations that share no code with the package: Drake's rigid Jacobian, and the
segmented arm of `examples/plants`.
"""

from __future__ import annotations

import contextlib
import csv
import hashlib
import io
import json
import logging
import os
import subprocess
import sys
from pathlib import Path
from unittest import mock

import numpy as np
import pytest
import yaml

from drake_stiffness import cli

EXAMPLES = Path(__file__).parents[1] / "examples"
KR270 = EXAMPLES / "kr270"
JOINTS = tuple(f"joint_{k}" for k in range(1, 7))
LINKS = ("base_link", *(f"link_{k}" for k in range(1, 7)))


def run(*arguments, env=None):
    """(exit code, stdout, stderr) of a command in this process."""
    out, err = io.StringIO(), io.StringIO()
    logger = logging.getLogger("drake_stiffness")
    before = logger.handlers, logger.propagate
    try:
        with (
            mock.patch.object(sys, "argv", ["drake-stiffness", *map(str, arguments)]),
            mock.patch.dict(os.environ, {"COLUMNS": "200", **(env or {})}),
            contextlib.redirect_stdout(out),
            contextlib.redirect_stderr(err),
            pytest.raises(SystemExit) as end,
        ):
            cli.main()
    finally:
        logger.handlers, logger.propagate = before
    return int(end.value.code or 0), out.getvalue(), err.getvalue()


def done(*arguments, **options):
    """(stdout, stderr) of a command that must succeed."""
    code, out, err = run(*arguments, **options)
    assert code == 0, err
    return out, err


def strict_json(path: Path):
    """JSON as the standard has it: no NaN, no Infinity."""

    def refuse(word):
        raise AssertionError(f"{path.name} holds {word}")

    return json.loads(path.read_text(encoding="utf-8"), parse_constant=refuse)


def table(path: Path) -> list[dict[str, str]]:
    with path.open(encoding="utf-8", newline="") as file:
        return list(csv.DictReader(file))


def numbers(rows, *names) -> np.ndarray:
    return np.array([[float(row[name]) for name in names] for row in rows])


@pytest.fixture(scope="module")
def identified(tmp_path_factory):
    """`identify` on the example: (folder, stdout, stderr)."""
    folder = tmp_path_factory.mktemp("identified")
    out, err = done(
        "identify", KR270 / "campaign.yaml", "-o", folder / "model.json", "--json", folder / "result.json",
        env={"FORCE_COLOR": "1"},
    )  # fmt: skip
    return folder, out, err


@pytest.fixture(scope="module")
def model(identified):
    return strict_json(identified[0] / "model.json")


# -- inspect ------------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(("cell", "links"), [("cell.yaml", 7), ("cell_joints_only.yaml", 0)])
def test_inspect_counts_the_complete_arm_whatever_the_cell_keeps(tmp_path, cell, links):
    out, _ = done("inspect", KR270 / cell, "--json", tmp_path / "i.json")
    found = strict_json(tmp_path / "i.json")
    assert found["counts"] == {"complete": 258, "symmetric": 153, "beam": 62}
    assert [s["name"] for s in found["springs"]] == [*JOINTS, *LINKS[:links]]
    assert [s["kind"] for s in found["springs"]] == ["joint"] * 6 + ["link"] * links
    assert sum(s["unknowns"] for s in found["springs"]) == 6 + 8 * links
    assert found["links"] == list(LINKS)
    assert "identifiable" not in found
    assert "weight included" in " ".join(found["conventions"])
    for name in (*JOINTS, "258", "153", "62"):
        assert name in out


def test_inspect_says_where_every_spring_acts(tmp_path):
    done("inspect", KR270 / "cell.yaml", "--json", tmp_path / "i.json")
    frames = {s["name"]: s["frame"] for s in strict_json(tmp_path / "i.json")["springs"]}
    assert "joint_1" in frames["base_link"]
    assert "joint_3" in frames["link_2"]
    assert frames["link_6"] == "flange"
    assert "axis" in frames["joint_4"]
    axes = {s["name"]: s.get("beam_axis") for s in strict_json(tmp_path / "i.json")["springs"]}
    # the base stands up, the arm lies along x of its frames, the flange's z is the last axis
    assert [axes[name] for name in LINKS] == ["z", "x", "x", "x", "x", "x", "z"]


def test_inspect_finds_the_ranks_that_geometry_allows(tmp_path):
    done("inspect", KR270 / "cell.yaml", "--identifiability", "--json", tmp_path / "i.json")
    entries = strict_json(tmp_path / "i.json")["identifiable"]
    found = {(e["template"], e["load"]): e for e in entries}
    assert len(found) == len(entries) == 6
    parameters = {"full": 258, "symmetric": 153, "beam": 62}
    for (template, load), entry in found.items():
        assert set(entry) == {
            "template", "load", "parameters", "rank", "singular_gap", "algebraic_rank", "special_points",
        }  # fmt: skip
        assert entry["special_points"] is None
        by_algebra = load == "wrench" and template != "beam"
        assert entry["algebraic_rank"] == (entry["rank"] if by_algebra else None)
        assert entry["parameters"] == parameters[template]
        assert entry["singular_gap"] > 1e6
    # 7 * 36 - 6 * 12 and 7 * 21 - 6 * 7: what turning about an axis leaves unchanged is shared across every joint
    assert found["full", "wrench"]["rank"] == 180
    assert found["symmetric", "wrench"]["rank"] == 105
    assert found["full", "force"]["rank"] == 162
    assert found["symmetric", "force"]["rank"] == 99
    assert 25 <= found["beam", "force"]["rank"] <= found["beam", "wrench"]["rank"] <= 55


# -- identify -----------------------------------------------------------------------------------------------------------


def test_a_model_has_the_keys_of_the_contract(model):
    contract = {"format", "cell", "arm", "springs", "parameters", "covariance", "effects", "fit", "provenance"}
    assert contract <= set(model)
    assert model["format"] == "drake-stiffness-model/1"
    assert model["cell"]["reference_points_m"]["P2"] == [-0.12, 0.2, 0.05]
    assert {"residual_rms_mm", "chi2_per_dof", "dof", "held_out_rms_mm", "method", "solver", "min_eigenvalue"} <= set(
        model["fit"]
    )
    assert model["fit"]["method"] == "sdp"
    assert "CLARABEL" in model["fit"]["solver"].upper()


def test_springs_are_symmetric_positive_semidefinite_matrices(model):
    assert [s["name"] for s in model["springs"]] == [*JOINTS, *LINKS]
    for spring in model["springs"]:
        k = np.array(spring["compliance"])
        assert k.shape == ((1, 1) if spring["kind"] == "joint" else (6, 6))
        np.testing.assert_array_equal(k, k.T)
        scale = np.sqrt(np.maximum(np.diag(k), 1e-30))
        assert np.linalg.eigvalsh(k / np.outer(scale, scale))[0] > -1e-6
    assert model["fit"]["min_eigenvalue"] >= -1e-9


def test_parameters_say_how_well_they_are_known(model):
    entries = model["parameters"]
    assert len(entries) == 62
    names = [p["name"] for p in entries]
    assert names[:6] == list(JOINTS)
    assert {"link_2.k26", "base_link.k44", "link_6.k11"} <= set(names)
    for p in entries:
        assert set(p) == {"name", "value", "unit", "sigma", "ratio", "group", "merged_with"}
        assert p["group"] in ("G1+", "G1~", "G1-", "G2", "G3")
        assert set(p["merged_with"]) <= set(names)
        if p["group"] == "G3":
            assert p["merged_with"]
        if p["group"].startswith("G1"):
            assert p["ratio"] == pytest.approx(abs(p["value"]) / p["sigma"])
            assert p["group"] == ("G1+" if p["ratio"] > 5 else "G1-" if p["ratio"] < 2 else "G1~")
        else:
            assert p["sigma"] is None
            assert p["ratio"] is None
    units = {p["name"].split(".")[-1]: p["unit"] for p in entries}
    assert (units["k11"], units["k26"], units["k44"], units["joint_1"]) == ("m/N", "rad/N", "rad/(N m)", "rad/(N m)")


def test_springs_parameters_and_effects_tell_the_same_values(model):
    by_name = {p["name"]: p["value"] for p in model["parameters"]}
    for spring in model["springs"]:
        k = np.array(spring["compliance"])
        own = {n: v for n, v in by_name.items() if n.split(".")[0] == spring["name"]}
        for name, value in own.items():
            i, j = (0, 0) if spring["kind"] == "joint" else (int(name[-2]) - 1, int(name[-1]) - 1)
            assert k[i, j] == value
    flat = [p["value"] for e in model["effects"] for p in e["parameters"].values()]
    assert flat == [p["value"] for p in model["parameters"]]
    for effect in model["effects"]:
        assert {"kind", "where", "parameters", "evidence", "confounded_with"} <= set(effect)
        for parameter in effect["parameters"].values():
            assert {"value", "unit", "sigma"} <= set(parameter)
    kinds = [e["kind"] for e in model["effects"]]
    assert kinds == ["joint_compliance"] * 6 + ["base_compliance"] + ["link_compliance"] * 6
    assert model["effects"][6]["where"] == "base"


def test_the_covariance_belongs_to_named_parameters(model):
    names, matrix = model["covariance"]["parameters"], np.array(model["covariance"]["matrix"])
    assert matrix.shape == (len(names),) * 2
    assert set(names) <= {p["name"] for p in model["parameters"]}
    np.testing.assert_allclose(matrix, matrix.T, atol=1e-12 * np.abs(matrix).max())
    for p in model["parameters"]:
        if p["sigma"] is not None:
            place = names.index(p["name"])
            assert matrix[place, place] == pytest.approx(p["sigma"] ** 2)


def test_the_fit_is_as_good_as_the_stated_noise(model):
    """Noise is 12 um a coordinate; three readings of 22 experiments took part, 8 experiments did not."""
    fit = model["fit"]
    assert fit["chi2_per_dof"] == pytest.approx(1.0, abs=0.1)
    assert fit["residual_rms_mm"] == pytest.approx(np.sqrt(3) * 0.012, rel=0.15)
    assert fit["held_out_rms_mm"] == pytest.approx(np.sqrt(3) * 0.012, rel=0.35)
    # 22 experiments of 7 steps and 3 points; three free references each; 32 combinations
    assert fit["dof"] == 22 * 7 * 3 * 3 - 22 * 3 * 3 - 32


def test_provenance_names_the_files_by_content(model):
    provenance = model["provenance"]
    assert provenance["seed"] == 0
    assert "drake-stiffness" in provenance["program"]
    named = {entry["file"]: entry["sha256"] for entry in provenance["inputs"].values()}
    expected = ("campaign.yaml", "cell.yaml", "kr270.urdf", "measurements.csv")
    assert named == {n: hashlib.sha256((KR270 / n).read_bytes()).hexdigest() for n in expected}


def test_the_same_inputs_give_the_same_model_but_for_the_time(identified, tmp_path, monkeypatch):
    monkeypatch.chdir(KR270)
    done("identify", "campaign.yaml", "-o", tmp_path / "again.json")
    first, again = (p.read_text().splitlines() for p in (identified[0] / "model.json", tmp_path / "again.json"))
    assert len(first) == len(again)
    assert {a.split('"')[1] for a, b in zip(first, again, strict=True) if a != b} <= {"time"}


def test_the_result_for_programs_and_the_terminal_say_what_the_model_says(identified, model):
    result = strict_json(identified[0] / "result.json")
    for key in ("parameters", "fit", "provenance"):
        assert result[key] == model[key]
    assert any(line.startswith("MERGED: 60 of 62") for line in result["warnings"])
    out = identified[1]
    assert "rank 32" in out
    assert "MERGED" in out
    assert "joint_2" in out


def test_progress_goes_to_stderr(identified):
    _, out, err = identified
    assert "iteration" in err
    assert "sigma" in err
    assert "iteration" not in out


def test_identify_by_least_squares_flags_what_no_structure_has(tmp_path):
    out, _ = done(
        "identify", KR270 / "campaign.yaml", "-o", tmp_path / "m.json", "--method", "least-squares"
    )  # fmt: skip
    fit = strict_json(tmp_path / "m.json")["fit"]
    assert fit["method"] == "least-squares"
    assert fit["solver"] == "QR"
    assert fit["min_eigenvalue"] < 0
    assert "NOT PHYSICAL" in out


def test_joints_alone_fit_far_worse(model, tmp_path):
    """The comparison the example is about: no link springs, and the noise is rejected."""
    out, _ = done("identify", KR270 / "campaign_joints_only.yaml", "-o", tmp_path / "m.json")
    joints = strict_json(tmp_path / "m.json")
    assert [s["kind"] for s in joints["springs"]] == ["joint"] * 6
    assert joints["fit"]["held_out_rms_mm"] > 10 * model["fit"]["held_out_rms_mm"]
    assert joints["fit"]["noise_rejected"] is True
    assert "NOISE REJECTED" in out


# -- predict ------------------------------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def predicted(identified, tmp_path_factory):
    folder = tmp_path_factory.mktemp("predicted")
    out, err = done(
        "predict", identified[0] / "model.json", KR270 / "measurements.csv", "-o", folder / "p.csv", "--json", folder / "p.json"
    )  # fmt: skip
    return folder, out, err


def test_predict_adds_columns_and_changes_no_cell(predicted):
    given, got = table(KR270 / "measurements.csv"), table(predicted[0] / "p.csv")
    assert len(given) == len(got)
    for before, after in zip(given, got, strict=True):
        assert {k: after[k] for k in before} == before
    added = set(got[0]) - set(given[0])
    assert {f"predicted_d{a}_mm" for a in "xyz"} | {f"predicted_sigma_{a}_mm" for a in "xyz"} <= added
    assert all(name.startswith("predicted_") for name in added)


def test_predictions_meet_what_was_measured(predicted):
    rows = table(predicted[0] / "p.csv")
    d = numbers(rows, "predicted_dx_mm", "predicted_dy_mm", "predicted_dz_mm")
    p = numbers(rows, "x_mm", "y_mm", "z_mm")
    sigma = numbers(rows, "predicted_sigma_x_mm", "predicted_sigma_y_mm", "predicted_sigma_z_mm")
    start = {(r["experiment"], r["point"]): i for i, r in reversed(list(enumerate(rows)))}
    reference = np.array([start[r["experiment"], r["point"]] for r in rows])
    loaded = np.array([r["step"] in "1245" for r in rows])
    assert not d[~loaded].any()
    assert not sigma[~loaded].any()
    error = ((p - p[reference]) - d)[loaded]
    # measured differences carry the noise of two readings
    assert np.sqrt((error**2).mean()) == pytest.approx(0.012 * np.sqrt(2), rel=0.1)
    assert np.linalg.norm(d, axis=1).max() > 5
    assert (sigma[loaded] > 0).all()
    assert sigma.max() < 0.02


def test_the_stated_sigma_is_what_the_covariance_makes_of_the_prediction(tmp_path):
    """Gradients by predicting with each compliance a little larger: sigma^2 = g^T C g, to the curvature of the loads."""
    done("identify", KR270 / "campaign_joints_only.yaml", "-o", tmp_path / "m.json")
    rows = (KR270 / "measurements.csv").read_text().splitlines()
    (tmp_path / "t.csv").write_text("\n".join([rows[0], *(r for r in rows if r.startswith(("E05,5", "E11,2")))]) + "\n")
    content = strict_json(tmp_path / "m.json")
    assert content["covariance"]["parameters"] == list(JOINTS)

    def predicted_with(changed, *columns):
        (tmp_path / "n.json").write_text(json.dumps(changed))
        done("predict", tmp_path / "n.json", tmp_path / "t.csv", "-o", tmp_path / "p.csv")
        return numbers(table(tmp_path / "p.csv"), *columns)

    shift = [f"predicted_d{a}_mm" for a in "xyz"]
    plain, sigma = (predicted_with(content, *c) for c in (shift, [f"predicted_sigma_{a}_mm" for a in "xyz"]))
    gradient = np.empty((6, *plain.shape))
    for i in range(6):
        changed = json.loads(json.dumps(content))
        changed["effects"][i]["parameters"]["k"]["value"] += 2e-8
        changed["parameters"][i]["value"] += 2e-8
        changed["springs"][i]["compliance"][0][0] += 2e-8
        gradient[i] = (predicted_with(changed, *shift) - plain) / 2e-8
    expected = np.sqrt(np.einsum("irc,ij,jrc->rc", gradient, np.array(content["covariance"]["matrix"]), gradient))
    assert expected.min() > 0
    np.testing.assert_allclose(sigma, expected, rtol=0.03, atol=0.01 * expected.max())


def test_predict_sums_up(predicted):
    folder, out, err = predicted
    summary = strict_json(folder / "p.json")
    d = numbers(table(folder / "p.csv"), "predicted_dx_mm", "predicted_dy_mm", "predicted_dz_mm")
    assert summary["rows"] == 630
    assert summary["predicted_rms_mm"] == pytest.approx(np.sqrt((d**2).sum(axis=1).mean()), rel=1e-5)
    assert summary["error_rms_mm"] == pytest.approx(0.024, abs=0.004)
    assert summary["unsupported_share_max"] < 1e-6
    assert "630 predictions" in err
    assert out == ""


def test_predicting_a_plan_needs_no_readings(identified, tmp_path):
    rows = [r.split(",")[:13] for r in (KR270 / "measurements.csv").read_text().splitlines()[:8]]
    place = rows[0].index("point")
    for row in rows:
        del row[place]
    lines = [",".join(rows[0]), *(",".join(r) for r in rows[1::3])]
    (tmp_path / "plan.csv").write_text("\n".join(lines) + "\n")
    done(
        "predict",
        identified[0] / "model.json",
        tmp_path / "plan.csv",
        "-o",
        tmp_path / "p.csv",
        "--json",
        tmp_path / "p.json",
    )
    got = table(tmp_path / "p.csv")
    assert [r["point"] for r in got] == ["P1", "P2", "P3"] * 3
    assert strict_json(tmp_path / "p.json")["error_rms_mm"] is None


# -- compensate ---------------------------------------------------------------------------------------------------------


def test_compensate_writes_the_program_and_an_account(identified, tmp_path):
    out, _ = done(
        "compensate", KR270 / "pocket.src", "--model", identified[0] / "model.json", "--process", KR270 / "process.yaml",
        "-o", tmp_path / "pocket.src", "--json", tmp_path / "c.json",
    )  # fmt: skip
    before, after = (KR270 / "pocket.src").read_bytes(), (tmp_path / "pocket.src").read_bytes()
    changed = [
        (a, b) for a, b in zip(before.splitlines(keepends=True), after.splitlines(keepends=True), strict=True) if a != b
    ]
    account = strict_json(tmp_path / "c.json")
    assert account["corrected_points"] == 599
    assert len(changed) == 597  # 595 lines, and two arcs of two points on one line each
    assert all(a.startswith((b"LIN", b"CIRC")) and a.endswith(b"\r\n") and b.endswith(b"\r\n") for a, b in changed)
    assert account["percent_compensated"] > 99.9
    assert account["residual_mm"]["max"] < 0.001  # printed to a micrometre
    assert account["one_shot_residual_mm"]["mean"] > account["residual_mm"]["mean"]
    assert account["uncompensated_mm"]["mean"] == pytest.approx(account["correction_mm"]["mean"], rel=1e-3)
    for name in ("correction_mm", "uncompensated_mm", "one_shot_residual_mm", "residual_mm", "model_sigma_mm"):
        assert account[name]["mean"] <= account[name]["rms"] <= account[name]["max"]
    assert account["refused"] == account["inserted"] == []
    assert "99.9" in out


# -- a virtual campaign ---------------------------------------------------------------------------------------------------


def track_urdf() -> str:
    """The KR 270 on a rail along y, seven joints: what a second robot looks like."""
    rail = """
  <link name="rail">
    <inertial><origin xyz="0 0 0.1"/><mass value="900"/>
      <inertia ixx="90" iyy="90" izz="90" ixy="0" ixz="0" iyz="0"/></inertial>
  </link>
  <joint name="track" type="prismatic">
    <parent link="rail"/><child link="base_link"/><origin xyz="0.1 -0.2 0.3"/><axis xyz="0 1 0"/>
    <limit lower="-2" upper="3" effort="9000" velocity="2"/>
  </joint>
"""
    text = (KR270 / "kr270.urdf").read_text()
    mark = '  <link name="base_link">'
    assert mark in text
    return text.replace(mark, rail + mark).replace('name="kr270_r2700"', 'name="on_a_track"')


TRACK_CELL = """
robot: {model: track.urdf, flange: flange}
gravity_m_per_s2: [0, 0, -9.81]
tool: {mass_kg: 60.0, center_of_mass_m: [0.05, 0, 0.2]}
load_point_m: [0.15, 0.05, 0.25]
reference_points_m: {A: [0.25, 0, 0.1], B: [-0.12, 0.2, 0.05], C: [-0.1, -0.22, 0.15]}
springs: {joints: all, links: [rail, link_2], template: symmetric}
"""
TRACK_TRUTH = {
    ("joint_compliance", "track"): {"k": 4e-9},
    ("joint_compliance", "joint_1"): {"k": 3.3e-7},
    ("joint_compliance", "joint_2"): {"joint_2": 3.0e-7},
    ("joint_compliance", "joint_4"): {"value": 3.0e-6},
    ("link_compliance", "link_2"): {"k22": 2e-9, "k62": 1.5e-9, "link_2.k66": 3e-9, "k55": 5e-8, "k44": 2e-8},
    ("base_compliance", "base"): {"k33": 1e-9, "k44": 4e-9, "k55": 3e-9, "k45": 1e-9, "k66": 2e-9},
}


def truth_file(path: Path, entries) -> Path:
    effects = [{"kind": kind, "where": where, "parameters": values} for (kind, where), values in entries.items()]
    path.write_text(yaml.safe_dump({"effects": effects}))
    return path


def write_plan(path: Path, joints: dict[str, tuple[float, float]], postures: int, loads, seed: int = 1) -> Path:
    """Random postures between bounds (units in the names), step 0 unloaded, then one step a load (N, N m), all points."""
    rng = np.random.default_rng(seed)
    header = ["experiment", "step", *joints, "fx_N", "fy_N", "fz_N", "mx_Nm", "my_Nm", "mz_Nm"]
    lines = [",".join(header)]
    for e in range(postures):
        q = [f"{rng.uniform(*bounds):.4f}" for bounds in joints.values()]
        for step, load in enumerate([(0,) * 6, *loads]):
            lines.append(",".join([f"E{e}", str(step), *q, *map(str, load)]))
    path.write_text("\n".join(lines) + "\n")
    return path


SPACE = {
    "joint_1_deg": (-55, 55), "joint_2_deg": (-120, -25), "joint_3_deg": (10, 140),
    "joint_4_deg": (-170, 170), "joint_5_deg": (-110, 110), "joint_6_deg": (-170, 170),
}  # fmt: skip
TRACK_SPACE = {"track_mm": (-1500, 2500), **SPACE}
LOADS = [(3000, 0, 0, 0, 0, 0), (0, 3000, 0, 0, 0, 0), (0, 0, -2500, 0, 0, 0), (0, 0, 0, 300, -400, 500)]


def folder_with(tmp_path, cell=TRACK_CELL, truth=TRACK_TRUTH, **changes):
    (tmp_path / "track.urdf").write_text(track_urdf())
    (tmp_path / "kr270.urdf").write_text((KR270 / "kr270.urdf").read_text())
    (tmp_path / "cell.yaml").write_text(cell)
    truth_file(tmp_path / "truth.yaml", truth)
    return tmp_path


def simulate(folder: Path, name: str = "virtual", *more) -> list[dict[str, str]]:
    done(
        "simulate", folder / "cell.yaml", "--truth", folder / "truth.yaml", "--plan", folder / "plan.csv", "-o", folder / name, *more
    )  # fmt: skip
    return table(folder / name / "measurements.csv")


def displacements(rows) -> np.ndarray:
    """(M, 3) mm from the unloaded step of the same experiment and point; rows ordered as simulated."""
    p = numbers(rows, "x_mm", "y_mm", "z_mm")
    start = {(r["experiment"], r["point"]): i for i, r in enumerate(rows) if r["step"] == "0"}
    return p - p[[start[r["experiment"], r["point"]] for r in rows]]


def test_simulate_identify_predict_on_an_arm_with_a_track(tmp_path):
    folder = folder_with(tmp_path)
    write_plan(folder / "plan.csv", TRACK_SPACE, 16, LOADS)
    rows = simulate(folder, "virtual", "--json", folder / "s.json")
    summary = strict_json(folder / "s.json")
    d = displacements(rows)
    size = np.linalg.norm(d, axis=1)[[r["step"] != "0" for r in rows]]
    assert summary["displacement_rms_mm"] == pytest.approx(np.sqrt((size**2).mean()), rel=1e-4)
    assert summary["displacement_max_mm"] == pytest.approx(size.max(), rel=1e-4)
    assert sorted(p.name for p in (folder / "virtual").iterdir()) == ["campaign.yaml", "measurements.csv"]
    campaign = yaml.safe_load((folder / "virtual" / "campaign.yaml").read_text())
    assert (folder / "virtual" / campaign["cell"]).samefile(folder / "cell.yaml")

    done("identify", folder / "virtual" / "campaign.yaml", "-o", folder / "model.json")
    found = strict_json(folder / "model.json")
    assert [s["name"] for s in found["springs"]] == ["track", *JOINTS, "rail", "link_2"]
    assert found["parameters"][0]["unit"] == "m/N"
    known = {p["name"]: p["value"] for p in found["parameters"] if p["group"].startswith("G1")}
    # table and model round to a nanometre; joint 6 is rigid in truth
    for name, value in {"joint_4": 3.0e-6, "joint_6": 0.0}.items():
        assert known[name] == pytest.approx(value, abs=1e-10)

    write_plan(folder / "other.csv", TRACK_SPACE, 6, LOADS, seed=2)
    done("predict", folder / "model.json", folder / "other.csv", "-o", folder / "p.csv")
    (folder / "plan.csv").write_text((folder / "other.csv").read_text())
    truth = displacements(simulate(folder, "elsewhere"))
    got = numbers(table(folder / "p.csv"), "predicted_dx_mm", "predicted_dy_mm", "predicted_dz_mm")
    assert np.linalg.norm(truth, axis=1).max() > 3
    np.testing.assert_allclose(got, truth, atol=1e-4)


def _drake_arm(path: Path):
    """Drake's rigid plant: poses and Jacobians for the judges below."""
    from pydrake.multibody.parsing import Parser
    from pydrake.multibody.plant import MultibodyPlant

    plant = MultibodyPlant(0.0)
    Parser(plant).AddModels(str(path))
    root = "rail" if plant.HasBodyNamed("rail") else "base_link"
    plant.WeldFrames(plant.world_frame(), plant.GetFrameByName(root))
    plant.Finalize()
    return plant, plant.CreateDefaultContext()


def _skew(v):
    return np.array([[0, -v[2], v[1]], [v[2], 0, -v[0]], [-v[1], v[0], 0]])


def _link_matrix(values) -> np.ndarray:
    k = np.zeros((6, 6))
    for name, value in values.items():
        i, j = int(name[-2]) - 1, int(name[-1]) - 1
        k[i, j] = k[j, i] = value
    return k


def linear_judge(plant, context, q, joints, truth, wrench, p_load, p_point) -> np.ndarray:
    """Displacement (3,) of a point, m: sum over springs of J k J^T W, all geometry asked of Drake."""
    for name, value in zip(joints, q, strict=True):
        joint = plant.GetJointByName(name)
        if joint.type_name() == "revolute":
            joint.set_angle(context, value)
        else:
            joint.set_translation(context, value)
    flange = plant.GetFrameByName("flange").CalcPoseInWorld(context)
    load, point = flange @ np.array(p_load), flange @ np.array(p_point)
    total = np.zeros(3)
    ends = {"base": joints[0], "link_2": "joint_3"}
    for (kind, where), values in truth.items():
        if kind == "joint_compliance":
            joint = plant.GetJointByName(where)
            frame = joint.frame_on_parent().CalcPoseInWorld(context)
            (k,) = values.values()
            if joint.type_name() == "revolute":
                axis = frame.rotation().matrix() @ joint.revolute_axis()
                torque = axis @ (wrench[3:] + np.cross(load - frame.translation(), wrench[:3]))
                total += k * torque * np.cross(axis, point - frame.translation())
            else:
                axis = frame.rotation().matrix() @ joint.translation_axis()
                total += k * (axis @ wrench[:3]) * axis
        else:
            frame = plant.GetJointByName(ends[where]).frame_on_parent().CalcPoseInWorld(context)
            R, p = frame.rotation().matrix(), frame.translation()
            turn = np.block([[R, np.zeros((3, 3))], [np.zeros((3, 3)), R]])
            carried = turn.T @ np.concatenate([wrench[:3], wrench[3:] + np.cross(load - p, wrench[:3])])
            moved = turn @ _link_matrix(values) @ carried
            total += moved[:3] + np.cross(moved[3:], point - p)
    return total


def test_a_simulated_displacement_is_that_of_drake_s_jacobian_at_small_loads(tmp_path):
    """Weightless, so that the linear formula is exact but for the load's own second order."""
    folder = folder_with(tmp_path, TRACK_CELL.replace("-9.81", "0"))
    write_plan(folder / "plan.csv", TRACK_SPACE, 5, [tuple(0.02 * v for v in load) for load in LOADS])
    rows = simulate(folder)
    plant, context = _drake_arm(folder / "track.urdf")
    joints = ("track", *JOINTS)
    points = yaml.safe_load(TRACK_CELL)["reference_points_m"]
    expected = []
    for row in rows:
        q = [float(row["track_mm"]) * 1e-3, *np.radians([float(row[f"{j}_deg"]) for j in JOINTS])]
        wrench = numbers([row], "fx_N", "fy_N", "fz_N", "mx_Nm", "my_Nm", "mz_Nm")[0]
        expected.append(
            1e3 * linear_judge(plant, context, q, joints, TRACK_TRUTH, wrench, [0.15, 0.05, 0.25], points[row["point"]])
        )
    got = displacements(rows)
    assert np.abs(expected).max() > 0.03
    np.testing.assert_allclose(got, expected, atol=3e-4 * np.abs(expected).max())


@pytest.fixture(scope="module")
def segmented():
    """The independent arm of the examples with rigid links: joint springs, weight, finite rotations."""
    sys.path.insert(0, str(EXAMPLES))
    try:
        from plants.oracle import RIGID
        from plants.segmented_arm import SegmentedArm
    finally:
        sys.path.remove(str(EXAMPLES))
    arm = SegmentedArm.from_files(KR270 / "kr270.urdf", KR270 / "true_arm.yaml")
    return arm.with_values(link_factors=RIGID * arm.link_factors)


PAYLOAD = {"mass": 40.0, "moment_x": 2.0, "moment_y": -3.0, "moment_z": 5.0}


@pytest.mark.parametrize("payload", [None, PAYLOAD])
def test_simulated_positions_under_full_load_are_those_of_the_independent_arm(tmp_path, segmented, payload):
    from dataclasses import replace

    compliance = dict(zip(JOINTS, segmented.joint_compliance.tolist(), strict=True))
    truth = {("joint_compliance", j): {"k": k} for j, k in compliance.items()}
    if payload is not None:
        truth["payload", "tool"] = payload
        tool = segmented.tool
        mass = tool.mass + payload["mass"]
        moment = mass * tool.center_of_mass + [payload[f"moment_{c}"] for c in "xyz"]
        segmented = replace(segmented, tool=replace(tool, mass=mass, center_of_mass=moment / mass))
    folder = folder_with(tmp_path, (KR270 / "cell.yaml").read_text(), truth)
    write_plan(folder / "plan.csv", SPACE, 4, LOADS)
    rows = simulate(folder)
    points = {
        n: np.array(p) for n, p in yaml.safe_load((KR270 / "cell.yaml").read_text())["reference_points_m"].items()
    }
    q = np.radians(numbers(rows, *(f"{j}_deg" for j in JOINTS)))
    wrench = numbers(rows, "fx_N", "fy_N", "fz_N", "mx_Nm", "my_Nm", "mz_Nm")
    R, p = segmented.poses(q, wrench, np.array([0.15, 0.05, 0.25]))
    expected = 1e3 * (p + np.einsum("nij,nj->ni", R, np.array([points[r["point"]] for r in rows])))
    np.testing.assert_allclose(numbers(rows, "x_mm", "y_mm", "z_mm"), expected, atol=1e-4)
    assert np.linalg.norm(displacements(rows), axis=1).max() > 3


def test_a_zero_truth_bends_nothing(tmp_path):
    folder = folder_with(tmp_path, truth={("payload", "tool"): {"mass": 50.0}})
    write_plan(folder / "plan.csv", TRACK_SPACE, 2, LOADS)
    assert np.abs(displacements(simulate(folder))).max() == 0.0


def test_noise_has_the_stated_size_and_follows_its_seed(tmp_path):
    folder = folder_with(tmp_path)
    write_plan(folder / "plan.csv", TRACK_SPACE, 20, LOADS)
    quiet = numbers(simulate(folder, "quiet"), "x_mm", "y_mm", "z_mm")
    noisy = {n: simulate(folder, n, "--noise-mm", "0.02", "--seed", s) for n, s in (("a", "5"), ("b", "5"), ("c", "6"))}
    assert noisy["a"] == noisy["b"]
    assert noisy["a"] != noisy["c"]
    error = numbers(noisy["a"], "x_mm", "y_mm", "z_mm") - quiet
    assert error.std() == pytest.approx(0.02, rel=0.1)
    assert abs(error.mean()) < 0.004
    assert yaml.safe_load((folder / "a" / "campaign.yaml").read_text())["noise"] == {"position_sigma_mm": 0.02}


def test_the_track_counts_its_own_joint_and_link(tmp_path):
    folder = folder_with(tmp_path)
    done("inspect", folder / "cell.yaml", "--json", tmp_path / "i.json")
    found = strict_json(tmp_path / "i.json")
    assert found["counts"] == {"complete": 8 * 36 + 7, "symmetric": 8 * 21 + 7, "beam": 8 * 8 + 7}
    assert found["joints"][0]["type"] == "prismatic"
    assert (found["joints"][0]["lower"], found["joints"][0]["upper"], found["joints"][0]["unit"]) == (-2000, 3000, "mm")


# -- processes and help ---------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("command", ["inspect", "simulate", "identify", "predict", "compensate"])
def test_help_names_the_options(command):
    out, _ = done(command, "--help", env={"COLUMNS": "120"})
    assert "--json" in out
    code, out, _ = run("--help")
    assert code == 0
    assert command in out


def test_each_command_once_in_a_process_of_its_own(tmp_path):
    """What an installed program does: exit codes reach the shell, results stdout, messages stderr."""
    folder = folder_with(tmp_path, TRACK_CELL.replace("links: [rail, link_2]", "links: none"), {
        ("joint_compliance", "joint_2"): {"k": 3e-7}
    })  # fmt: skip
    write_plan(folder / "plan.csv", TRACK_SPACE, 4, LOADS)
    (folder / "p.csv").write_text(
        "x_mm,y_mm,z_mm,a_deg,b_deg,c_deg,e1_mm\n100.000,20.000,-16.000,0,0,180,200\n120,20,-16,0,0,180,210\n"
    )
    (folder / "process.yaml").write_text(
        "workpiece: {position_m: [1.75, 0.0, 1.05]}\nposture_deg: [0, -70, 120, 0, -50, 0]\nexternal_axes: {E1: track}\n"
        "force: {constant: {fz_N: 400, frame: world}}\n"
    )
    steps = [
        ["inspect", "cell.yaml"],
        ["simulate", "cell.yaml", "--truth", "truth.yaml", "--plan", "plan.csv", "-o", "v"],
        ["identify", "v/campaign.yaml", "-o", "model.json"],
        ["predict", "model.json", "plan.csv", "-o", "predicted.csv"],
        ["compensate", "p.csv", "--model", "model.json", "--process", "process.yaml", "-o", "out.csv"],
    ]  # fmt: skip
    for arguments in steps:
        result = subprocess.run(
            [sys.executable, "-m", "drake_stiffness.cli", *arguments], cwd=folder, capture_output=True, text=True
        )
        assert result.returncode == 0, result.stderr
        assert result.stdout or arguments[0] in ("simulate", "predict")
        assert "Traceback" not in result.stderr
    wrong = subprocess.run(
        [sys.executable, "-m", "drake_stiffness.cli", "inspect", "nothing.yaml"],
        cwd=folder,
        capture_output=True,
        text=True,
    )
    assert wrong.returncode == 2
    assert wrong.stdout == ""
    assert "nothing.yaml" in wrong.stderr


@pytest.mark.parametrize("command", ["inspect", "identify", "compensate"])
def test_reports_are_one_self_contained_file(identified, tmp_path, command):
    pytest.importorskip("drake_stiffness.report")
    model = identified[0] / "model.json"
    arguments = {
        "inspect": [KR270 / "cell.yaml"],
        "identify": [KR270 / "campaign_joints_only.yaml", "-o", tmp_path / "m.json"],
        "compensate": [
            *(KR270 / "pocket.src", "--model", model, "--process", KR270 / "process.yaml", "-o", tmp_path / "p.src")
        ],
    }[command]
    done(command, *arguments, "--report", tmp_path / "r.html")
    page = (tmp_path / "r.html").read_text(encoding="utf-8")
    assert page.lstrip().lower().startswith("<!doctype html")
    assert "data:image" in page or "<svg" in page
    for outside in ("http://", "https://", 'src="/', "file://"):
        assert f'src="{outside}' not in page
        assert f'href="{outside}' not in page


def test_one_path_for_two_outputs_is_refused(tmp_path):
    """One would replace the other without a word."""
    twice = tmp_path / "out.json"
    code, _, err = run("identify", KR270 / "campaign.yaml", "-o", twice, "--json", twice)
    assert code == 2
    assert "two outputs" in err
    assert not twice.exists()
