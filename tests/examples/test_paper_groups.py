"""docs/paper_groups.md says what the example gives."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

from drake_stiffness.jobs import identify_campaign

ROOT = Path(__file__).parents[2]
PAGE = (ROOT / "docs" / "paper_groups.md").read_text()


@pytest.fixture(scope="module")
def made(tmp_path_factory):
    folder = tmp_path_factory.mktemp("groups")
    words = [sys.executable, str(ROOT / "examples" / "paper" / "groups.py"), str(folder)]
    done = subprocess.run(words, cwd=ROOT, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    return folder


def test_every_row_that_the_example_makes_stands_on_the_page(made):
    ours = [line for line in (made / "groups.md").read_text().splitlines() if line.startswith("|")]
    assert len(ours) >= 22
    for row in ours:
        assert row in PAGE.splitlines()


def test_the_figure_is_there(made):
    for file in (made / "groups.svg", ROOT / "docs" / "groups.svg"):
        assert file.read_text().startswith("<svg")
    assert "](groups.svg)" in PAGE


def test_the_pair_of_the_page_is_the_one_that_is_flagged():
    found = identify_campaign(ROOT / "examples" / "kr270" / "campaign.yaml").groups
    pairs = {(found.base_names[p.first], found.base_names[p.second]): p for p in found.pairs if p.says == "sum known"}
    pair = pairs["link_4.k66", "link_6.k44"]
    assert [f"{r:.1f}" for r in pair.ratios] == ["4.4", "1.5"]
    assert "ratios of 4.4 and 1.5" in PAGE
    assert round(pair.known_ratio) == 29
    best = found.directions.ratio / found.ratio.max()
    assert (int((best > 1).sum()), round(best.max())) == (7, 65)
    assert "Seven\nof them are known better than any single parameter, the best 65 times better" in PAGE
    # 2.857 and 0.8696 are lengths of this arm
    assert [f"{1 / length:.4g}" for length in (0.35, 1.15)] == ["2.857", "0.8696"]
