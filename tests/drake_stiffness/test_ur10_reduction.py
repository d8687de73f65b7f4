"""Reductions on real laser-tracker readings of a UR10 under its own weight, where the data lie beside the project."""

from __future__ import annotations

import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import yaml

from drake_stiffness.observation import restrict
from drake_stiffness.reduction.comparison import compare_reductions
from drake_stiffness.task import read_task

DATA = Path(__file__).parents[2].parent / "shared" / "data" / "ur10_series_b"
pytestmark = pytest.mark.skipif(not DATA.is_dir(), reason=f"the measured data are not in this checkout ({DATA})")


@pytest.fixture(scope="module")
def result(tmp_path_factory):
    """Joints and the two long links, fitted on a fifth of the postures and scored on another."""
    folder = tmp_path_factory.mktemp("ur10")
    for file in DATA.iterdir():
        shutil.copy(file, folder / file.name)
        (folder / file.name).chmod(0o644)
    cell = yaml.safe_load((folder / "cell.yaml").read_text())
    cell["springs"] = {"joints": "all", "links": ["upper_arm_link", "forearm_link"], "template": "beam"}
    (folder / "cell.yaml").write_text(yaml.safe_dump(cell))
    task = read_task(folder / "campaign.yaml")
    part = np.random.default_rng(0).permutation(task.held.size) % 5
    few = part < 2
    rename = np.cumsum(few) - 1
    held = np.zeros(int(few.sum()), dtype=bool)
    held[rename[np.flatnonzero(part == 1)]] = True
    task = replace(task, measurements=restrict(task.measurements, few), held=held)
    return compare_reductions(task, ["joints", "m3", "sequential", "none"])


def test_weight_alone_says_little_of_links(result):
    joints, links = result.row("joints").mean_mm, result.row("none").mean_mm
    assert 0.30 < links < 0.45
    assert links == pytest.approx(joints, rel=0.05)


def test_what_is_recommended_has_no_compliance_that_is_negative_beyond_doubt(result):
    assert result.recommended in ("joints", "none")
    assert result.row(result.recommended).model.impossible() is None


@pytest.mark.parametrize("method", ["m3", "sequential"])
def test_ratios_count_the_noise_that_the_residuals_show_and_then_nothing_passes(result, method):
    """Chi-square rejects the stated 0.1 mm, so sigmas are more than doubled; geometry explains what is left of the springs."""
    assert result.row("none").chi2_per_dof > 4.0
    assert result.row(method).model is None
    assert "leaves nothing" in result.row(method).note
