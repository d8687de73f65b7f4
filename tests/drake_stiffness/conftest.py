"""The three arms, their cells and judges, made once."""

from __future__ import annotations

import pytest
from drake_judge import Judge
from three_arms import write_arms

from drake_stiffness.cell import read_cell
from drake_stiffness.plant import build_arm

ARMS = ("kr270", "track", "free")


@pytest.fixture(scope="session")
def cells(tmp_path_factory):
    paths = write_arms(tmp_path_factory.mktemp("arms"))
    return {name: read_cell(path) for name, path in paths.items()}


@pytest.fixture(scope="session")
def arms(cells):
    return {name: build_arm(cell) for name, cell in cells.items()}


@pytest.fixture(scope="session")
def judges(cells):
    return {name: Judge(cell) for name, cell in cells.items()}


@pytest.fixture(scope="session", params=ARMS)
def arm_name(request):
    return request.param
