"""The 3-D scene of a corrected program: one page, opened in a browser, shows arm, path and corrections."""

from __future__ import annotations

import base64
import re
import shutil
import subprocess

import numpy as np
import pytest

from drake_stiffness.report.compensation_scene import scene_html
from toolpaths import job


@pytest.fixture(scope="module")
def page(pocket, model, tools):
    return scene_html(job.compensate(pocket, model, tools.process()), model)


def test_the_scene_is_one_page_that_holds_arm_paths_and_corrections(page):
    assert 1e6 < len(page) < 1e7
    blobs = [base64.b64decode(blob) for blob in re.findall(r"base64,([A-Za-z0-9+/=]{40,})", page)]
    for part in (b"/arm/links", b"/path/wanted", b"/path/uncorrected", b"/path/corrected", b"/correction"):
        assert any(part in blob for blob in blobs), part
    assert not re.search(r'<script[^>]+src="http', page)
    assert "test.src" in page
    assert "times as large as they are" in page
    assert "look('path')" in page


@pytest.mark.parametrize("look_at", ["", "#path"])
def test_a_browser_draws_the_path_in_both_colours(page, tmp_path, look_at):
    browser = next(
        (found for name in ("chromium", "chromium-browser", "google-chrome") if (found := shutil.which(name))), None
    )
    if browser is None:
        pytest.skip("no chromium here: the scene was not opened in a browser")
    (tmp_path / "scene.html").write_text(page)
    arguments = [
        "--headless=new",
        "--no-sandbox",
        "--use-gl=angle",
        "--use-angle=swiftshader",
        "--enable-unsafe-swiftshader",
    ]
    arguments += ["--virtual-time-budget=4000", "--window-size=640,420", f"--user-data-dir={tmp_path / 'profile'}"]
    picture = tmp_path / "scene.png"
    subprocess.run(
        [browser, *arguments, f"--screenshot={picture}", (tmp_path / "scene.html").as_uri() + look_at],
        capture_output=True,
        check=True,
        timeout=120,
    )
    from matplotlib.image import imread

    seen = imread(picture)[60:, :, :3].reshape(-1, 3)  # below the legend's edge and the controls
    blue = (seen[:, 2] > seen[:, 0] + 0.25).sum()
    warm = (seen[:, 0] > seen[:, 2] + 0.25).sum()
    steel = (np.ptp(seen, axis=1) < 0.15) & (seen.mean(axis=1) < 0.7)
    assert blue > (1000 if look_at else 30)
    assert warm > (1000 if look_at else 30)
    assert steel.sum() > 300 or look_at  # the arm, out of the way where the path is looked at
