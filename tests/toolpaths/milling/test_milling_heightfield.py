"""Engagement from a height field: cuts whose engagement is known give the forces of that engagement."""

from __future__ import annotations

import numpy as np
import pytest
from slots import DOWN, along, load, process, stated, swept

from drake_stiffness.errors import InputError


def both(model, tools, tmp_path, path, *millings):
    program = along(tools, *path)
    return [load(program, process(tmp_path, text), model).wrench for text in millings]


@pytest.mark.parametrize("shape", ["", ", cutter: ball", ", cutter: bull-nose, corner_radius_mm: 4"])
def test_a_slot_through_a_block(model, tools, tmp_path, shape):
    got, expected = both(
        model,
        tools,
        tmp_path,
        [(-20, 0, 0), (20, 0, 0), (40, 0, 0)],
        swept(-30, 30) + shape,
        stated(3, 20, "slot") + shape,
    )
    size = np.linalg.norm(expected[:3, 1])
    np.testing.assert_allclose(got[:3, 1:], expected[:3, 1:], atol=0.02 * size)
    np.testing.assert_allclose(got[3:, 1:], expected[3:, 1:], atol=0.02 * np.abs(expected[3:, 1:]).max())


@pytest.mark.parametrize(
    ("low", "high", "mode", "turn"),
    [
        (-30, -6, "down", ""),
        (6, 30, "up", ""),
        (-30, -6, "up", ", rotation: counterclockwise"),
    ],
)
def test_the_side_of_a_wall_and_the_spindle_decide_between_up_and_down(model, tools, tmp_path, low, high, mode, turn):
    path = [(-20, 0, 0), (20, 0, 0), (40, 0, 0)]
    got, expected = both(model, tools, tmp_path, path, swept(low, high) + turn, stated(3, 4, mode) + turn)
    np.testing.assert_allclose(got[:3, 1:], expected[:3, 1:], atol=0.06 * np.linalg.norm(expected[:3, 1]))


def test_what_was_cut_is_gone(model, tools, tmp_path):
    """Out and back in one slot, then half a diameter beside it; moves above the stock cut air."""
    path = [(-20, 0, 0), (40, 0, 0), (-20, 0, 0), (-20, 10, 0), (20, 10, 0), (20, 10, 20), (0, 0, 20)]
    got, up = both(model, tools, tmp_path, path, swept(-30, 30), stated(3, 10, "up"))
    size = np.linalg.norm(got[:3], axis=0)
    assert size[1] > 370
    assert size[[2, 3, 5, 6]].max() < 1e-9
    np.testing.assert_allclose(got[:3, 4], up[:3, 4], atol=0.05 * size[4])


def test_an_arc_is_swept_along_its_circle(model, tools, tmp_path):
    lines = ["LIN {X 0,Y -25,Z 0,%s}", "CIRC {X 25,Y 0,Z 0,%s},{X 0,Y 25,Z 0,%s}"]
    program = tools.program(*(line.replace("%s", DOWN) for line in lines))
    found = load(program, process(tmp_path, swept(-60, 60)), model).wrench[:3]
    slot = load(program, process(tmp_path, stated(3, 20, "slot")), model).wrench[:3]
    np.testing.assert_allclose(found[:, 1], slot[:, 1], atol=0.04 * np.linalg.norm(slot[:, 1]))


def test_a_tool_that_leans_is_refused_and_a_rapid_through_the_stock_is_told(model, tools, tmp_path):
    text = swept(-30, 30)
    with pytest.raises(InputError, match=r"line 1: the tool's axis .* needs \(0, 0, 1\)"):
        load(along(tools, (0, 0, 0), (9, 0, 0), pose="A 0,B 5,C 180"), process(tmp_path, text), model)
    program = tools.program(f"PTP {{X 30,Y 0,Z 1,{DOWN}}}", f"LIN {{X 40,Y 0,Z 1,{DOWN}}}")
    notes = load(program, process(tmp_path, text), model).notes
    assert any("run through the stock of the height field: line 1" in note for note in notes)
