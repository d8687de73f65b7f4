"""docs/paper_single_link.md says what the example gives."""

from __future__ import annotations

import re
import subprocess
import sys
from pathlib import Path

import pytest

from drake_stiffness.report.single_link_tables import all_tables
from drake_stiffness.single_link.example import noise_setting, single_link
from drake_stiffness.single_link.study import study_single_link

ROOT = Path(__file__).parents[2]
PAGE = (ROOT / "docs" / "paper_single_link.md").read_text()
NUMBER = r"[-+]?\d+(?:\.\d+)?(?:e[-+]?\d+)?"


@pytest.fixture(scope="module")
def studies():
    return [study_single_link(single_link(noise_setting(name))) for name in ("printed", "stated")]


@pytest.fixture(scope="module")
def tables(studies):
    return all_tables(studies[0], *studies)


def tables_of(page):
    """Tables of a Markdown page as rows of cells, by header."""
    found = {}
    for block in re.findall(r"(?:^\|.*\n)+", page, re.MULTILINE):
        rows = [[cell.strip() for cell in line.strip("|\n ").split(" | ")] for line in block.splitlines()]
        found[tuple(rows[0])] = rows[2:]
    return found


def test_every_number_of_every_table_is_that_of_the_library(tables):
    on_page = tables_of(PAGE)
    assert len(on_page) == len(tables) == 7
    for table in tables:
        rows = on_page[table.header]
        assert len(rows) == len(table.rows), table.title
        for row, expected in zip(rows, table.rows, strict=True):
            for cell, wanted in zip(row, expected, strict=True):
                assert re.sub(NUMBER, "#", cell) == re.sub(NUMBER, "#", wanted), (table.title, row)
                ours = [float(n) for n in re.findall(NUMBER, wanted)]
                assert [float(n) for n in re.findall(NUMBER, cell)] == pytest.approx(ours, rel=5e-3, abs=1e-12), row


def test_numbers_in_the_text_are_those_of_the_tables(studies, tables):
    notes = " ".join(table.note for table in tables)
    text = " ".join(PAGE.split())
    for number in ("2.495e-07 to 2.502e-07", "2.496e-06 to 2.504e-06"):
        assert number in notes
        assert number in text
    for number, sentence in (
        ("6.3", "their squares sum to 6.3; expected 10 ± 4.5"),
        ("4.3 of 3", "their squares sum to 4.3 (of 3)"),
        ("23.6", "Their squares sum to 23.6; noise alone gives 26 ± 7.2"),
        ("0.016", "The standard error of a share is 0.016"),
        ("0.429", "because only k11 matters: 0.429"),
    ):
        assert number in notes
        assert sentence in text
    printed, stated = (study.link for study in studies)
    k53, k62 = 6, 8  # among the nonzero entries, row by row
    percent = [f"{100 * printed.relative_sigma()[m, i]:.3g} %" for i in (k53, k62) for m in (0, 1)]
    assert "from {} to {} and from {} to {}".format(*percent) in text
    assert f"the least ratio is {stated.exact_ratio[stated.identifiable].min():.2f}" in text
    k = printed.truth
    for shear, cross, bend in ((k[1, 1], k[1, 5], k[5, 5]), (k[2, 2], k[2, 4], k[4, 4])):
        assert f"{shear * bend / cross**2:.3f}" in text
        assert f"{2 * abs(cross) / bend:.3f} m" in text


def test_the_example_writes_figure_and_tables(tmp_path):
    words = [sys.executable, str(ROOT / "examples" / "paper" / "single_link.py"), str(tmp_path / "new")]
    done = subprocess.run(words, cwd=ROOT, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    assert (tmp_path / "new" / "single_link.svg").read_text().startswith("<svg")
    assert "| k53 |" in (tmp_path / "new" / "single_link.md").read_text()
    assert "positive definite: False" in done.stdout


def test_the_figure_of_the_page_is_there():
    assert "](single_link.svg)" in PAGE
    assert (ROOT / "docs" / "single_link.svg").read_text().startswith("<svg")
