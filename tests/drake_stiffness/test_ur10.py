"""Real laser-tracker readings of a UR10 under its own weight (series B), where the data lie beside the project."""

import shutil
from pathlib import Path

import numpy as np
import pytest

from drake_stiffness.jobs import identify_campaign

DATA = Path(__file__).parents[2].parent / "shared" / "data" / "ur10_series_b"
pytestmark = pytest.mark.skipif(not DATA.is_dir(), reason=f"the measured data are not in this checkout ({DATA})")


def identified(tmp_path, joints):
    for file in DATA.iterdir():
        shutil.copy(file, tmp_path)
    cell = tmp_path / "cell.yaml"
    cell.write_text(cell.read_text().replace("joints: none", f"joints: {joints}"))
    return identify_campaign(tmp_path / "campaign.yaml")


def test_geometry_alone_leaves_what_others_found(tmp_path):
    found = identified(tmp_path, "none")
    assert 0.43 < found.model.fit["held_out_rms_mm"] < 0.46


def test_joint_compliance_lowers_it_and_only_joints_that_weight_loads_are_revealed(tmp_path):
    found = identified(tmp_path, "all")
    model = found.model
    assert 0.40 < model.fit["held_out_rms_mm"] < 0.43
    springs = {s["name"]: s["compliance"][0][0] for s in model.to_dict()["springs"]}
    assert 10e-6 < springs["shoulder_lift_joint"] < 16e-6
    assert min(springs.values()) >= 0.0
    names = list(springs)
    group = dict(zip(model.names, model.statistics.group, strict=True))
    for joint in (names[0], names[3], names[4], names[5]):
        assert group[joint] in ("G1-", "G2", "G3"), joint
        assert any(joint in w and w.startswith(("NOT SEEN", "NOT REVEALED")) for w in found.warnings), joint
    assert group[names[1]] == "G1+"
    assert np.isfinite(model.statistics.sigma[model.names.index(names[1])])
