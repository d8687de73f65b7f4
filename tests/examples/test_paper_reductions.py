"""docs/paper_reductions.md says what the example gives, and M3 as printed loses on postures that took no part."""

from __future__ import annotations

import re
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
PAGE = (ROOT / "docs" / "paper_reductions.md").read_text()
sys.path.insert(0, str(ROOT / "examples" / "paper"))

METHODS = ("joints", "m3", "sequential", "none")


def rows_of_page(setting):
    """Figures of one setting's table by the method's label."""
    block = PAGE[PAGE.index(f"### {setting.name}") :]
    lines = re.findall(r"^\|.*$", block[: block.index("Recommended")], re.MULTILINE)[2:]
    cells = [[cell.strip() for cell in line.strip("|").split("|")] for line in lines]
    return {row[0]: [float(value) for value in row[1:]] for row in cells}


@pytest.fixture(scope="module")
def few():
    """The setting of 15 postures, by the example."""
    import reductions

    return reductions, reductions.SETTINGS[1], *reductions.compare(reductions.SETTINGS[1], METHODS)


def test_the_page_has_the_figures_that_the_example_gives(few):
    _, setting, result, errors = few
    page = rows_of_page(setting)
    for row in result.rows:
        e, printed = errors[row.method], page[row.label]
        assert printed[0] == row.parameters, row.method
        assert printed[1] == pytest.approx(e.mean(), rel=0.02), row.method
        assert printed[3] == pytest.approx(e.max(), rel=0.02), row.method
        share = 100 * (1 - 1e-3 * e.mean() / row.displacement_mm.mean())
        assert printed[4] == pytest.approx(share, abs=0.02), row.method
        assert printed[5] == pytest.approx(1e3 * row.mean_mm, rel=0.02), row.method


def test_what_the_page_concludes_holds_in_every_table():
    import reductions

    for setting in reductions.SETTINGS:
        page = rows_of_page(setting)
        mean = {method: page[reductions.METHODS[method]][1] for method in reductions.METHODS if method != "m2"}
        assert mean["m3"] > 1.3 * mean["sequential"] > 1.3 * mean["none"]
        assert mean["joints"] > 40 * mean["sequential"]
        assert 91.0 < page[reductions.METHODS["joints"]][4] < 93.0
        assert 16 <= page[reductions.METHODS["sequential"]][0] <= 25
        assert page[reductions.METHODS["m1"]][0] == 153


def test_the_example_draws_its_figure(few):
    reductions, *one = few
    assert reductions.figure([tuple(one)]).startswith("data:image/svg+xml;base64,")
    assert "M3 in turn" in reductions.table(*one)
    assert (ROOT / "docs" / "reductions.svg").read_text().startswith("<svg")
