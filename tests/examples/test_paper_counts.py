"""docs/paper_counts.md says what the example gives."""

from __future__ import annotations

import re
import subprocess
import sys
from pathlib import Path

import pytest

from drake_stiffness.springs import parameter_counts

ROOT = Path(__file__).parents[2]
PAGE = (ROOT / "docs" / "paper_counts.md").read_text()


@pytest.fixture(scope="module")
def made(tmp_path_factory):
    folder = tmp_path_factory.mktemp("counts")
    words = [sys.executable, str(ROOT / "examples" / "paper" / "counts.py"), str(folder)]
    done = subprocess.run(words, cwd=ROOT, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    return folder


def rows(text):
    """Rows of all tables; gaps (1e11 and the like) to their order of magnitude, because they are rounding."""
    gaps = re.sub(r"\b\de\+(\d\d)\b", lambda found: "gap" if int(found[1]) >= 6 else found[0], text)
    return [line for line in gaps.splitlines() if line.startswith("|")]


def test_every_row_that_the_example_makes_stands_on_the_page(made):
    ours, theirs = rows((made / "counts.md").read_text()), rows(PAGE)
    assert len(ours) >= 15
    for row in ours:
        assert row in theirs
    assert sum("gap |" in row for row in ours) >= 11


def test_the_counts_of_the_page_are_those_of_the_library():
    for name, count in zip(("complete", "after M1", "after M2"), parameter_counts(6).values(), strict=True):
        assert re.search(rf"^\| {name}.*\| {count} \|$", PAGE, re.MULTILINE)


def test_the_figure_is_there(made):
    for file in (made / "counts.svg", ROOT / "docs" / "counts.svg"):
        assert file.read_text().startswith("<svg")
    assert "](counts.svg)" in PAGE
