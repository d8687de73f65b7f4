"""The whole job from files, and that it repeats itself."""

import json

import numpy as np
import pytest
from synthetic import SIDEWAYS, VERTICAL, plan, points_of, table_text
from three_arms import KR270

from drake_stiffness.errors import InputError
from drake_stiffness.jobs import identify_campaign

K6 = np.array([0.33e-6, 0.30e-6, 0.42e-6, 2.8e-6, 2.9e-6, 3.4e-6])


@pytest.fixture
def campaign(tmp_path, arms, cells, judges):
    arm, cell, rng = arms["kr270"], cells["kr270"], np.random.default_rng(0)
    cases = plan(arm, cell, 12, rng, [VERTICAL, SIDEWAYS])
    p = judges["kr270"].positions(cases, points_of(cell), K6)
    text = table_text(arm, cases, tuple(cell.reference_points_m), p + 12e-6 * rng.normal(size=p.shape))
    (tmp_path / "m.csv").write_text(text)
    (tmp_path / "kr270.urdf").write_bytes((KR270 / "kr270.urdf").read_bytes())
    (tmp_path / "cell.yaml").write_bytes((KR270 / "cell_joints_only.yaml").read_bytes())
    path = tmp_path / "campaign.yaml"
    path.write_text(
        "cell: cell.yaml\nmeasurements: m.csv\nnoise: {position_sigma_mm: 0.012}\nhold_out: {fraction: 0.25, seed: 3}\n"
    )
    return path


def test_a_campaign_is_identified_from_its_files(campaign):
    found = identify_campaign(campaign)
    model, fit = found.model, found.model.fit
    z = (model.x - K6) / model.statistics.sigma
    assert np.abs(z).max() < 5
    assert fit["experiments"] == {"fitted": 9, "held_out": 3}
    assert fit["held_out_rms_mm"] == pytest.approx(np.sqrt(3) * 0.012 * np.sqrt(2), rel=0.35)
    assert fit["min_eigenvalue"] >= -1e-9
    assert fit["method"] == "sdp"
    # joints are all well revealed: only what noise of this size may do can be warned of
    assert not any(w.startswith(("NOT SEEN", "MERGED", "NOT PHYSICAL", "NO CHECK")) for w in found.warnings)
    assert found.residual_mm.shape == (3, 9 * 3 * 3)
    assert np.sqrt((found.residual_mm**2).sum(axis=0).mean()) == pytest.approx(fit["residual_rms_mm"], rel=1e-9)


def test_the_held_out_error_is_that_of_the_held_out_experiments_and_they_take_no_part(campaign):
    """Loaded readings of what is held out move by a millimetre: the model stays, the held-out error tells."""
    before = identify_campaign(campaign)
    held = {name for name, h in zip(before.measurements.experiments, before.held, strict=True) if h}
    table = campaign.parent / "m.csv"
    head, *lines = table.read_text().splitlines()
    x = head.split(",").index("x_m")
    for number, line in enumerate(lines):
        cells = line.split(",")
        if cells[0] in held and cells[1] != "0":
            cells[x] = repr(float(cells[x]) + 1e-3)
            lines[number] = ",".join(cells)
    table.write_text("\n".join([head, *lines]) + "\n")
    after = identify_campaign(campaign)
    assert np.array_equal(after.model.x, before.model.x)
    assert after.model.fit["residual_rms_mm"] == before.model.fit["residual_rms_mm"]
    assert after.model.fit["held_out_rms_mm"] == pytest.approx(1.0, rel=0.02)


def test_same_files_give_the_same_model_but_for_the_time(campaign, tmp_path):
    contents = []
    for name in ("a.json", "b.json"):
        identify_campaign(campaign).model.save(tmp_path / name)
        content = json.loads((tmp_path / name).read_text())
        assert content["provenance"].pop("time")
        contents.append(content)
    assert contents[0] == contents[1]
    inputs = contents[0]["provenance"]["inputs"]
    assert {entry["file"] for entry in inputs.values()} == {"campaign.yaml", "cell.yaml", "kr270.urdf", "m.csv"}
    assert all(len(entry["sha256"]) == 64 for entry in inputs.values())
    assert contents[0]["provenance"]["seed"] == 3


def test_a_campaign_with_nothing_to_identify_is_refused(campaign):
    cell = campaign.parent / "cell.yaml"
    cell.write_text(cell.read_text().replace("joints: all", "joints: none"))
    with pytest.raises(InputError, match="nothing to identify"):
        identify_campaign(campaign)


def test_a_fault_in_held_out_experiments_is_said_too(campaign):
    """The last experiment loses its unloaded step; whether held out or fitted, it has no reference."""
    table = campaign.parent / "m.csv"
    lines = [line for line in table.read_text().splitlines() if not line.startswith("E011,0,")]
    table.write_text("\n".join(lines) + "\n")
    campaign.write_text(campaign.read_text().replace("{fraction: 0.25, seed: 3}", "{experiments: [E011]}"))
    with pytest.raises(InputError, match="'E011' has no unloaded step"):
        identify_campaign(campaign)
