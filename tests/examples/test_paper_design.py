"""The figures of docs/design.md: the plans of the table, and the example in small."""

from __future__ import annotations

import importlib.util
import re
import sys
from pathlib import Path

import numpy as np
import pytest

from drake_stiffness.cell import read_cell
from drake_stiffness.design.assumptions import assumed_model
from drake_stiffness.design.design import choose, choose_fewest
from drake_stiffness.design.settings import Design, payload_force
from drake_stiffness.design.space import make_criterion, prepare
from drake_stiffness.design.summary import gain
from drake_stiffness.plant import build_arm

ROOT = Path(__file__).parents[2]
KR270 = ROOT / "examples" / "kr270"
PAGE = (ROOT / "docs" / "design.md").read_text(encoding="utf-8")


@pytest.fixture(scope="module")
def example():
    spec = importlib.util.spec_from_file_location("paper_design", ROOT / "examples" / "paper" / "design.py")
    module = importlib.util.module_from_spec(spec)
    sys.modules[spec.name] = module
    spec.loader.exec_module(module)
    return module


@pytest.fixture(scope="module")
def model():
    cell = read_cell(KR270 / "cell.yaml")
    return assumed_model(cell, build_arm(cell), Design())


def row(name):
    (cells,) = re.findall(rf"^\| {re.escape(name)} \|(.*)\|$", PAGE, re.MULTILINE)
    return [float(cell) for cell in cells.split("|")]


def test_the_table_of_efficiencies_is_that_of_the_program(model):
    space = prepare(model, 30, Design(candidates=5000))
    assert f"({space.basis.shape[1]} combinations of {model.x.size} unknowns" in PAGE
    assert f"({payload_force(model.arm):.0f} N for the KR 270" in PAGE
    for name, words in (("a", "a"), ("ratio", "ratio (joints)")):
        d = choose(space, make_criterion(space, name), 30)
        efficiency, random, times = row(words)
        assert d.efficiency == pytest.approx(efficiency, abs=0.004)
        assert np.median(d.random) / d.relaxation.bound == pytest.approx(random, abs=0.01)
        assert gain(d) == pytest.approx(times, abs=0.02)
    assert min(row(words)[0] for words in ("a", "d", "e", "ratio (joints)", "toolpath (pocket.src)")) > 0.95


def test_the_fewest_postures_are_those_of_the_page(model):
    d = choose_fewest(prepare(model, 30, Design(random_plans=0)), 30)
    assert f"plan of {len(d.chosen)} postures and proves that fewer than {d.fewest} cannot do it" in PAGE


def test_the_example_in_small(example):
    found = example.trial(n=8, randoms=1, number=300, draws=1)
    assert list(found) == [*example.CHOSEN, "random 1"]
    sigma, error = np.array(list(found.values())).reshape(4, 2, 2).transpose(1, 0, 2)
    assert sigma[1, 0] == sigma[:, 0].min()
    # Exchange ends where no single swap helps, so another plan may be a trace better than the one made for this.
    assert sigma[2, 1] <= 1.01 * sigma[:, 1].min()
    assert sigma[0, 1] < sigma[3, 1]
    assert 0.1 < (error / sigma).min() <= (error / sigma).max() < 4  # of the size that was promised
    assert example.figure(found).startswith("data:image/svg")
