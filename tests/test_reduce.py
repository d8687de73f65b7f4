"""`reduce` as a user runs it: the table, the files, and what a reduced model is good for afterwards."""

from __future__ import annotations

import csv
import json

import numpy as np
import pytest
import yaml
from test_commands import KR270, done, run, strict_json


@pytest.fixture(scope="module")
def written(tmp_path_factory):
    """`reduce --method sequential` of the example: (folder, stdout, stderr)."""
    folder = tmp_path_factory.mktemp("reduce")
    files = ("-o", folder / "model.json", "--json", folder / "r.json", "--report", folder / "r.html")
    out, err = done("reduce", KR270 / "campaign.yaml", "--method", "m3,sequential,none", *files)
    return folder, out, err


def test_one_table_with_joints_alone_beside_and_a_recommendation_that_follows_it(written):
    folder, out, _ = written
    content = strict_json(folder / "r.json")
    rows = {entry["method"]: entry for entry in content["methods"]}
    assert list(rows) == ["joints", "m3", "sequential", "none"]
    error = {name: entry["held_out_error_mm"]["mean"] for name, entry in rows.items()}
    assert error["joints"] > 5 * error["m3"] > 5 * error["sequential"]
    assert content["recommended"] in content["within_noise_of_the_best"]
    assert min(error, key=error.get) in content["within_noise_of_the_best"]
    assert rows["none"]["parameters"] == 62
    assert rows["m3"]["parameters"] < rows["sequential"]["parameters"] < rows["none"]["combinations_fitted"]
    assert "Recommended" in out
    assert "G1~" in out
    page = (folder / "r.html").read_text()
    assert "M3 as printed" in page
    assert "data:image/svg+xml" in page


def test_the_recommended_model_is_written_and_its_held_out_error_is_that_of_the_table(written):
    folder, _, _ = written
    model, content = strict_json(folder / "model.json"), strict_json(folder / "r.json")
    method = model["fit"]["reduction"]["method"]
    assert method == content["recommended"]
    assert model["fit"]["experiments"] == content["experiments"] == {"fitted": 22, "held_out": 8}
    parts = next(e for e in content["methods"] if e["method"] == method)
    assert model["fit"]["held_out_rms_mm"] < 1.5 * parts["held_out_rms_mm"]["noise"]
    assert set(model["provenance"]["inputs"]) == {"campaign", "cell", "robot", "measurements"}


def test_a_model_reduced_in_turn_predicts_and_compensates(tmp_path):
    done("reduce", KR270 / "campaign.yaml", "--method", "sequential", "-o", tmp_path / "m.json", "--upper", "10")
    model = strict_json(tmp_path / "m.json")
    kept = model["fit"]["reduction"]["kept"]
    assert [p["name"] for p in model["parameters"]] == kept
    assert len(kept) < 25
    done("predict", tmp_path / "m.json", KR270 / "measurements.csv", "-o", tmp_path / "p.csv")
    with (tmp_path / "p.csv").open() as file:
        rows = [row for row in csv.DictReader(file) if row["fz_N"] == "-2500.000"]
    unloaded = {}
    with (KR270 / "measurements.csv").open() as file:
        for row in csv.DictReader(file):
            if row["step"] == "0":
                unloaded[row["experiment"], row["point"]] = float(row["z_mm"])
    read = np.array([float(r["z_mm"]) - unloaded[r["experiment"], r["point"]] for r in rows])
    found = np.array([float(r["predicted_dz_mm"]) for r in rows])
    assert np.sqrt(((read - found) ** 2).mean()) < 0.05
    assert np.sqrt((read**2).mean()) > 2.0
    process = KR270 / "process.yaml"
    program = ("compensate", KR270 / "pocket.src", "--model", tmp_path / "m.json", "--process", process)
    done(*program, "-o", tmp_path / "out.src")
    assert (tmp_path / "out.src").read_bytes() != (KR270 / "pocket.src").read_bytes()


def test_without_held_out_postures_a_named_method_is_fitted_on_all_and_nothing_is_recommended(tmp_path):
    campaign, out = KR270 / "campaign.yaml", tmp_path / "m.json"
    done("reduce", campaign, "--method", "joints", "--hold-out", "0", "-o", out, "--json", tmp_path / "r.json")
    assert json.loads(out.read_text())["fit"]["experiments"] == {"fitted": 30, "held_out": 0}
    assert strict_json(tmp_path / "r.json")["recommended"] is None
    code, _, err = run("reduce", campaign, "--method", "joints,m3", "--hold-out", "0", "-o", tmp_path / "n.json")
    assert code == 2
    assert "--method" in err
    assert not (tmp_path / "n.json").exists()


@pytest.mark.parametrize(
    ("options", "said"),
    [
        (("--method", "m4"), ["m4", "sequential"]),
        (("--upper", "1"), ["lower 2.0", "upper 1.0"]),
        (("--fit", "qr"), ["qr", "least-squares"]),
        (("--hold-out", "1.5"), ["1.5", "fraction"]),
        (("--spread", "-1", "--method", "prior"), ["-1", "prior"]),
    ],
)
def test_wrong_options_are_told_and_nothing_is_written(options, said, tmp_path):
    code, _, err = run("reduce", KR270 / "campaign.yaml", *options, "-o", tmp_path / "m.json")
    assert code == 2
    assert all(part in err for part in said), err
    assert not list(tmp_path.iterdir())


def test_a_threshold_that_nothing_passes_is_not_trustworthy(tmp_path):
    options = ("--method", "m3", "--upper", "1e9", "-o", tmp_path / "m.json")
    code, _, err = run("reduce", KR270 / "campaign.yaml", *options)
    assert code == 3
    assert "leaves nothing" in err
    assert not (tmp_path / "m.json").exists()


def with_masks(folder, masks):
    cell = yaml.safe_load((KR270 / "cell.yaml").read_text())
    cell["robot"]["model"] = str(KR270 / "kr270.urdf")
    cell["springs"] |= {"links": ["link_2", "link_3"], "masks": masks}
    (folder / "cell.yaml").write_text(yaml.safe_dump(cell))
    return folder / "cell.yaml"


def test_a_users_mask_is_what_the_cell_keeps(tmp_path):
    cell = with_masks(tmp_path, {"link_2": ["k22", "k62", "k66"]})
    done("inspect", cell, "--json", tmp_path / "i.json")
    springs = {s["name"]: s for s in strict_json(tmp_path / "i.json")["springs"]}
    assert springs["link_2"]["parameters"] == ["link_2.k22", "link_2.k26", "link_2.k66"]
    assert springs["link_3"]["unknowns"] == 8


@pytest.mark.parametrize(
    ("masks", "said"),
    [
        ({"link_2": ["k22", "k27"]}, ["springs.masks", "k27", "k11 .. k66"]),
        ({"link_2": ["k26", "k22"]}, ["link_2", "without k66", "Add k66"]),
        ({"link_2": []}, ["link_2", "at least one"]),
        ({"link_2": ["k26", "k62", "k22", "k66"]}, ["twice"]),
        ({"link_5": ["k44"]}, ["springs.masks", "link_5", "link_2, link_3"]),
    ],
)
def test_a_mask_that_cannot_be_is_told(masks, said, tmp_path):
    code, _, err = run("inspect", with_masks(tmp_path, masks))
    assert code == 2
    assert all(part in err for part in said), err
