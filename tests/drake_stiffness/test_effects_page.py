"""The page of effects says what the classes say: every kind, its unknowns with their units, what it needs; and its example is the file."""

import re
from pathlib import Path

import pytest

from drake_stiffness.effects.catalogue import _BUILT_IN

ROOT = Path(__file__).parents[2]
PAGE = (ROOT / "docs" / "effects.md").read_text(encoding="utf-8")
KINDS = {cls.kind: cls for cls in _BUILT_IN}
HEADER = ("kind", "where", "equation", "unknowns", "needs", "how it shows")


def rows():
    lines = [line for line in PAGE.splitlines() if line.startswith("| ")]
    table = [tuple(cell.strip() for cell in line.strip("|").split("|")) for line in lines]
    assert table[0] == HEADER
    return {row[0].strip("`"): row for row in table[1:]}


def test_every_kind_has_one_row_and_there_are_no_others():
    assert set(rows()) == set(KINDS)
    assert sum(line.startswith("| `") for line in PAGE.splitlines()) == len(KINDS)


@pytest.mark.parametrize("kind", KINDS)
def test_a_row_states_the_unknowns_and_units_of_its_class(arms, cells, kind):
    cell = rows()[kind][3]
    points = cells["kr270"].reference_points_m
    effects = list(KINDS[kind].candidates(arms["kr270"], points))
    assert effects, "a kind of the catalogue can be somewhere"
    parameters = [p for effect in effects for p in effect.parameters]
    if ".." in cell:
        names = re.findall(r"`(\w+)`", cell)
        assert min(p.name for p in parameters) == names[0]
        assert max(p.name for p in parameters) == names[1]
    else:
        assert set(re.findall(r"`(\w+)`", cell)) == {p.name for p in parameters}
    stated = {unit.strip() for unit in re.sub(r".*`", "", cell).split(",")} | {
        unit.strip() for unit in re.split(r"`[^`]*`,?", cell) if unit.strip() and ".." not in unit
    }
    stated = {unit for some in stated for unit in (u.strip() for u in some.split(",")) if unit}
    assert stated == {p.unit for p in parameters}


@pytest.mark.parametrize("kind", KINDS)
def test_a_row_states_what_a_campaign_needs(kind):
    needs = ", ".join(KINDS[kind].needs) or "-"
    assert rows()[kind][4] == needs
    legend = re.findall(r"\*\*(\w+)\*\*:", PAGE)
    assert set(KINDS[kind].needs) <= set(legend)


def test_the_example_on_the_page_is_the_file():
    (block,) = re.findall(r"```python\n(.*?)```", PAGE, re.DOTALL)
    assert block == (ROOT / "examples" / "own_effect" / "joint_creep.py").read_text(encoding="utf-8")
    code = [line for line in block.splitlines() if line.strip()]
    assert len(code) <= 45
