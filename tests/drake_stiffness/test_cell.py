"""cell.yaml: defaults, and what is refused."""

import pytest

from drake_stiffness.cell import read_cell
from drake_stiffness.errors import InputError

SMALL = "robot: {model: r.urdf, flange: f}\nreference_points_m: {P1: [0.1, 0, 0]}\n"


def read(tmp_path, text):
    (tmp_path / "cell.yaml").write_text(text)
    return read_cell(tmp_path / "cell.yaml")


def test_what_is_not_written_has_the_documented_default(tmp_path):
    cell = read(tmp_path, SMALL)
    assert cell.robot.joints is None
    assert cell.gravity_m_per_s2 == (0.0, 0.0, -9.81)
    assert (cell.tool.mass_kg, cell.load_point_m) == (0.0, (0.0, 0.0, 0.0))
    assert (cell.springs.joints, cell.springs.links, cell.springs.template) == ("all", "none", "beam")
    assert cell.robot_path == tmp_path / "r.urdf"


BAD = {
    "unknown key": (SMALL + "tools: {}\n", ["tools", "Did you mean 'tool'"]),
    "unknown key inside": (SMALL + "springs: {tempalte: beam}\n", ["springs.tempalte", "Did you mean 'template'"]),
    "wrong unit": (SMALL + "load_point_mm: [0, 0, 300]\n", ["load_point_mm", "Did you mean 'load_point_m'"]),
    "gravity in mm": (SMALL + "gravity_m_per_s2: [0, 0, -9810]\n", ["gravity_m_per_s2", "9810", "m/s^2"]),
    "negative mass": (SMALL + "tool: {mass_kg: -1}\n", ["tool.mass_kg", "found -1", "greater than or equal to 0"]),
    "two numbers": (SMALL + "load_point_m: [0, 0]\n", ["load_point_m"]),
    "template": (SMALL + "springs: {template: plank}\n", ["springs.template", "'plank'", "'beam'"]),
    "beam axis": (SMALL + "springs: {beam_axes: {l: w}}\n", ["springs.beam_axes.l", "'w'"]),
    "points in two cases": ("robot: {model: r.urdf, flange: f}\nreference_points_m: {P1: [0, 0, 0], p1: [0, 0, 0]}\n", ["'P1'", "'p1'", "upper and lower case"]),
    "no points": ("robot: {model: r.urdf, flange: f}\nreference_points_m: {}\n", ["reference_points_m", "at least 1"]),
    "no flange": ("robot: {model: r.urdf}\nreference_points_m: {P: [0, 0, 0]}\n", ["robot.flange", "missing"]),
}  # fmt: skip


@pytest.mark.parametrize("name", list(BAD))
def test_a_cell_with_a_fault_is_refused_naming_key_and_value(tmp_path, name):
    text, words = BAD[name]
    with pytest.raises(InputError) as error:
        read(tmp_path, text)
    for word in ["cell.yaml", *words]:
        assert word in str(error.value)
