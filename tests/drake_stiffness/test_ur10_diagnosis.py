"""Real laser-tracker readings of a UR10 (series B), from geometry alone: what is missing, and what cannot be said."""

import csv
import shutil
from pathlib import Path

import pytest

from drake_stiffness.diagnosis import confirmation, search
from drake_stiffness.diagnosis.diagnosis import diagnose
from drake_stiffness.diagnosis.document import diagnosis_document
from drake_stiffness.effects import harmonics
from drake_stiffness.task import read_task

DATA = Path(__file__).parents[2].parent / "shared" / "data" / "ur10_series_b"
pytestmark = pytest.mark.skipif(not DATA.is_dir(), reason=f"the measured data are not in this checkout ({DATA})")
EVERY = 4


@pytest.fixture(scope="module")
def document(tmp_path_factory):
    """Every fourth posture, a few harmonics, one effect, few placebos: seconds, not minutes."""
    folder = tmp_path_factory.mktemp("ur10")
    for file in DATA.iterdir():
        shutil.copy(file, folder)
    with (DATA / "measurements.csv").open(newline="") as table:
        rows = list(csv.reader(table))
    path = folder / "measurements.csv"
    path.chmod(0o644)
    path.write_text("\n".join(",".join(row) for row in [rows[0], *rows[1::EVERY]]) + "\n")
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(harmonics, "HARMONICS", (1, 2, 9))
        patch.setattr(search, "MOST_EFFECTS", 1)
        patch.setattr(confirmation, "PLACEBOS", 20)
        d = diagnose(read_task(folder / "campaign.yaml"), lambda text: None)
    return diagnosis_document(d, {}, None)


def test_compliance_of_joint_2_under_weight_is_named_or_in_the_class(document):
    """A quarter of the postures need not tell the joint's compliance from that of the link before it."""
    first = document["effects"][0]
    members = {(first["kind"], first["where"])} | {(c["kind"], c["where"]) for c in first["confounded_with"]}
    assert ("joint_compliance", "shoulder_lift_joint") in members


def test_joints_that_weight_does_not_load_are_not_named(document):
    stiff = {"shoulder_pan_joint", "wrist_1_joint", "wrist_2_joint", "wrist_3_joint"}
    assert not [e for e in document["effects"] if e["kind"] == "joint_compliance" and e["where"] in stiff]


def test_the_gap_shrinks_on_postures_that_took_no_part(document):
    gap = document["gap"]
    assert gap["held_out_after_rms_mm"] < gap["held_out_before_rms_mm"] - 0.01


def test_the_stated_noise_is_noticed_to_be_too_small(document):
    """No repeats and one point: nothing shows the noise but that no smooth function comes near to the stated one."""
    assert document["verdict"] == "partly_explained"  # never `explained` by a noise that nothing shows
    assert "stated noise" in document["where_in_words"]["after"]
    assert "too small" in document["where_in_words"]["after"]


def test_what_needs_loads_and_times_is_untestable(document):
    untestable = {(u["kind"], u["where"]) for u in document["untestable"]}
    assert ("tracker_drift", "tracker") in untestable
    assert ("joint_hysteresis", "shoulder_lift_joint") in untestable
    assert ("joint_hardening", "shoulder_lift_joint") in untestable
