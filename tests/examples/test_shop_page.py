"""docs/shop.md: its commands run as written in examples/shop, in its order, and it shows what they give."""

import json
import re
import shlex
import shutil
import subprocess
import sys
from pathlib import Path

import pytest
from command_line import call

ROOT = Path(__file__).parents[2]
PAGE = (ROOT / "docs" / "shop.md").read_text()


def blocks(kind):
    """The fenced blocks of the page of one kind, '' for those without a language."""
    found = re.findall(r"^```(\w*)\n(.*?)^```$", PAGE, re.DOTALL | re.MULTILINE)
    return [text for language, text in found if language == kind]


@pytest.fixture(scope="module")
def shop(tmp_path_factory):
    """The examples as a user has them, after all commands of the page; and what the commands printed."""
    folder = tmp_path_factory.mktemp("user") / "examples"
    shutil.copytree(ROOT / "examples", folder, ignore=shutil.ignore_patterns("__pycache__"))
    printed = []
    lines = [line for block in blocks("sh") for line in block.splitlines() if line.strip()]
    assert len(lines) == 3
    for line in lines:
        done = call(*shlex.split(line)[1:], folder=folder / "shop")
        assert done.code == 0, f"{line}\n{done.err}"
        printed.append(done)
    return folder / "shop", printed


def test_the_page_shows_the_map_of_the_example():
    block = next(b for b in blocks("yaml") if "readings:" in b)
    stated = [line.split("#")[0].rstrip() for line in (ROOT / "examples/shop/MAP.yaml").read_text().splitlines()]
    assert block.splitlines() == [line for line in stated if line]


def test_the_page_shows_lines_of_the_program(shop):
    block = next(b for b in blocks("") if "PTP" in b)
    program = (shop[0] / "measure.src").read_text().splitlines()
    for line in block.splitlines():
        assert line in program


def test_what_the_tracker_and_the_sensor_wrote_comes_back_without_a_complaint(shop):
    folder, printed = shop
    imported = json.loads((folder / "imported.json").read_text())
    assert (imported["rows"], imported["experiments"], imported["steps"]) == (210, 14, 70)
    assert imported["warnings"] == imported["unmatched"] == imported["dropped"] == imported["missing"] == []
    assert printed[1].err == ""


def test_the_model_fits_and_the_noise_is_told_apart_as_the_page_says(shop):
    folder, printed = shop
    fit = json.loads((folder / "model.json").read_text())["fit"]
    assert fit["chi2_per_dof"] == pytest.approx(1.0, abs=0.12)
    found = fit["noise_components"]
    assert found["tracker_low_mm"] < 0.012 < found["tracker_high_mm"]
    assert found["posture_low_mm"] < 0.0365 < found["posture_high_mm"]
    assert found["posture_noise"] == "per_experiment"
    (block,) = [b for b in blocks("") if "Noise seen" in b]
    assert "".join(block.split()) in "".join(printed[2].out.split())


def test_the_exports_are_those_their_maker_writes(shop):
    folder, _ = shop
    before = {name: (folder / name).read_bytes() for name in ("PLAN.csv", "tracker.txt", "force.log")}
    subprocess.run([sys.executable, "make_exports.py"], cwd=folder, check=True)
    assert {name: (folder / name).read_bytes() for name in before} == before
