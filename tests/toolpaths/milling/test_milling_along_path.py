"""Milling along a program: axes, feed, engagement tables, what carries no force; and what process.yaml may say."""

from __future__ import annotations

import numpy as np
import pytest
from slots import AL, DOWN, MEAN, SLOT, STRAIGHT, along, load, process

from drake_stiffness.errors import InputError


def test_a_slot_along_x_with_an_upright_tool(model, tools, tmp_path):
    """World axes are those of the closed forms here; the axial force is towards the tip, which is down."""
    got = load(along(tools, *STRAIGHT), process(tmp_path), model)
    np.testing.assert_allclose(got.wrench[:3].T, np.tile(MEAN * [1, 1, -1], (3, 1)), atol=0.06)
    # torque of the cut on the tool about the spindle's axis, and the force half a depth up
    np.testing.assert_allclose(got.wrench[5], 4.59, atol=0.01)
    np.testing.assert_allclose(got.relative_sigma, 0.3)


def test_in_path_axes_the_tool_s_z_decides_the_sign_of_y(model, tools, tmp_path):
    """z into the work: y is to the right of the feed, so a clockwise spindle pushes to -y; z is along the axial force."""
    milled = load(along(tools, *STRAIGHT), process(tmp_path, SLOT + ", moments: false"), model).wrench
    stated = tools.process(
        workpiece={"position_m": [1.8, 0, 0.8]}, force=tools.constant("path", fx_N=-152.2, fy_N=-335.9, fz_N=89.0)
    )
    np.testing.assert_allclose(milled, load(along(tools, *STRAIGHT), stated, model).wrench, atol=0.06)
    other = load(
        along(tools, *STRAIGHT), process(tmp_path, SLOT + ", moments: false, rotation: counterclockwise"), model
    )
    stated = tools.process(
        workpiece={"position_m": [1.8, 0, 0.8]}, force=tools.constant("path", fx_N=-152.2, fy_N=335.9, fz_N=89.0)
    )
    np.testing.assert_allclose(other.wrench, load(along(tools, *STRAIGHT), stated, model).wrench, atol=0.06)


def test_where_nobody_says_how_the_spindle_turns_the_averages_stand_in_path_axes_and_the_result_asks(
    model, tools, tmp_path
):
    """F_x, F_y, F_z of the literature along x, y, z of the path, z the tool's: the plainest reading, and a loud question."""
    silent = process(tmp_path, SLOT + ", moments: false", rotation="")
    found = load(along(tools, *STRAIGHT), silent, model)
    stated = tools.process(
        workpiece={"position_m": [1.8, 0, 0.8]}, force=tools.constant("path", fx_N=-152.2, fy_N=335.9, fz_N=89.0)
    )
    np.testing.assert_allclose(found.wrench, load(along(tools, *STRAIGHT), stated, model).wrench, atol=0.06)
    (asked,) = [note for note in found.notes if note.startswith("CHECK THE SPINDLE")]
    assert "to the right of its feed" in asked
    assert "write rotation: clockwise" in asked
    towards = process(tmp_path, SLOT + ", moments: false", rotation="", more="tool_axis: z")
    up = load(along(tools, *STRAIGHT, pose="A 0,B 0,C 0"), towards, model)
    np.testing.assert_allclose(up.wrench[:3, 0], MEAN * [1, 1, -1], atol=0.06)


def test_a_tcp_that_points_to_the_spindle_names_it(model, tools, tmp_path):
    """The same tool in the world, its TCP frame drawn the other way round."""
    down = load(along(tools, *STRAIGHT), process(tmp_path), model).wrench
    up = load(along(tools, *STRAIGHT, pose="A 0,B 0,C 0"), process(tmp_path, more="tool_axis: z"), model).wrench
    np.testing.assert_allclose(up, down, atol=1e-9)


def test_the_wrench_turns_with_the_feed_and_not_with_the_tool(model, tools, tmp_path):
    one = load(along(tools, *STRAIGHT), process(tmp_path), model).wrench[:3, 1]
    turned = along(tools, *((-y, x, z) for x, y, z in STRAIGHT), pose="A 75,B 0,C 180")
    x, y, z = load(turned, process(tmp_path), model).wrench[:3, 1]
    np.testing.assert_allclose([y, -x, z], one, atol=1e-9)


def test_the_mirrored_cut_of_a_mirrored_path_is_mirrored(model, tools, tmp_path):
    """Climbing around a pocket one way with M3 is climbing the other way with M4."""
    path = [(0, 0, 0), (10, 5, 0), (20, 15, 0)]
    sides = SLOT.replace("radial_depth_mm: 20, mode: slot", "radial_depth_mm: 5, mode: down")
    one = load(along(tools, *path), process(tmp_path, sides), model).wrench
    other = load(
        along(tools, *((x, -y, z) for x, y, z in path)),
        process(tmp_path, sides + ", rotation: counterclockwise"),
        model,
    ).wrench
    np.testing.assert_allclose(other, one * np.array([1, -1, 1, -1, 1, -1.0])[:, None], atol=1e-9)


def test_the_feed_comes_from_the_program_before_process_yaml(model, tools, tmp_path):
    """Twice the feed: the cutting part of the force doubles, that of the edges stays."""
    program = along(tools, *STRAIGHT)
    program.feed_mm_per_min[1] = 4800.0
    got = load(program, process(tmp_path), model).wrench
    edges = 4 * 3 / np.pi * np.array([-26.6, 27.7, -0.7 * np.pi / 2])
    np.testing.assert_allclose(got[:3, 1] - edges, 2 * (got[:3, 2] - edges), atol=1e-6)
    program.feed_mm_per_min[:] = np.nan
    with pytest.raises(InputError, match=r"line 1: the program does not say the feed.*feed_mm_per_min"):
        load(program, process(tmp_path, feed=""), model)


def test_plunges_and_retracts_carry_no_force_and_points_written_twice_keep_theirs(model, tools, tmp_path):
    program = along(tools, (0, 0, 9), (0, 0, 0), (10, 0, 0), (10, 0, 0), (10, 0, 9))
    got = load(program, process(tmp_path), model)
    size = np.linalg.norm(got.wrench[:3], axis=0)
    np.testing.assert_allclose(size, [0, 0, 379.4, 379.4, 0], atol=0.1)
    assert any("3 points reached along the tool's axis" in note for note in got.notes)


def test_a_ramp_cuts_with_the_feed_across_the_axis(model, tools, tmp_path):
    ramp = load(along(tools, (0, 0, 0), (10, 0, -5)), process(tmp_path), model).wrench[:3, 1]
    flat = load(along(tools, (0, 0, 0), (10, 0, 0)), process(tmp_path), model).wrench[:3, 1]
    edges = 4 * 3 / np.pi * np.array([-26.6, 27.7, -0.7 * np.pi / 2])
    np.testing.assert_allclose((ramp - edges), (flat - edges) * 10 / np.hypot(10, 5), atol=1e-6)


def test_where_nothing_tells_the_feed_s_direction_the_line_is_named(model, tools, tmp_path):
    program = tools.program("PTP {A1 0,A2 0,A3 0,A4 0,A5 0,A6 0}", f"LIN {{X 0,Y 0,Z 0,{DOWN}}}")
    with pytest.raises(InputError, match="line 2: the direction of feed is not known"):
        load(program, process(tmp_path), model)


BY_TABLE = SLOT.replace("axial_depth_mm: 3, radial_depth_mm: 20, mode: slot", "engagement: cuts.csv")


def test_a_table_of_engagements_goes_motion_by_motion_and_air_carries_nothing(model, tools, tmp_path):
    (tmp_path / "cuts.csv").write_text("axial_depth_mm,radial_depth_mm,mode\n3,,slot\n0,,\n1.5,20,slot\n")
    got = load(along(tools, *STRAIGHT), process(tmp_path, BY_TABLE), model).wrench[:3].T
    np.testing.assert_allclose(got[0], 2 * got[2], rtol=1e-12)
    assert not got[1].any()


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("axial_depth_mm,radial_depth_mm,mode\n3,,slot\n", "1 rows, but .* has 3 corrected motions"),
        ("axial_depth_mm,radial_depth_mm,mode\n3,30,up\n1,1,up\n1,1,up\n", "line 2: radial_depth_mm is 30; expected"),
        ("axial_depth_mm,radial_depth_mm,mode\n3,2,slot\n1,1,up\n1,1,up\n", "line 2: .*mode slot"),
        (
            "axial_depth_mm,radial_depth_mm,mode\n3,2,sideways\n1,1,up\n1,1,up\n",
            "line 2, column 'mode': found 'sideways'",
        ),
        ("axial_depth_mm,mode\n3,slot\n3,slot\n3,slot\n", "column radial_depth_mm is missing"),
        ("axial_depth_mm,radial_depth_mm,mode\n-3,2,up\n1,1,up\n1,1,up\n", "line 2: axial_depth_mm is -3"),
    ],
)
def test_a_table_that_does_not_fit_is_refused(model, tools, tmp_path, text, message):
    (tmp_path / "cuts.csv").write_text(text)
    with pytest.raises(InputError, match=message):
        load(along(tools, *STRAIGHT), process(tmp_path, BY_TABLE), model)


@pytest.mark.parametrize(
    ("before", "after", "message"),
    [
        ("radial_depth_mm: 20", "radial_depth_mm: 5", "with mode slot"),
        ("mode: slot", "mode: up, cutter: bull-nose", "corner_radius_mm belongs to"),
        ("mode: slot", "mode: up, cutter: bull-nose, corner_radius_mm: 11", "at most half of diameter_mm"),
        ("axial_depth_mm: 3, radial_depth_mm: 20, mode: slot, ", "", "give the engagement once"),
        ("mode: slot", "mode: slot, engagement: a.csv", "give the engagement once"),
        (", Kae: 0.7", "", "Kae is missing"),
        (", Kae: 0.7", ", Kae: 0.7, mc: 0.2", "does not belong to them"),
        (AL, "Unobtainium", "no published set 'Unobtainium'.*Al7075-T6"),
        ("teeth: 4", "teeth: 0", "greater than or equal to 1"),
        ("spindle_rpm: 6000, ", "", "spindle_rpm: missing"),
        ("mode: slot", "mode: sideways", "'slot', 'up' or 'down'"),
    ],
)
def test_a_process_that_cannot_be_is_refused_with_the_remedy(tmp_path, before, after, message):
    assert before in SLOT
    with pytest.raises(InputError, match=message):
        process(tmp_path, SLOT.replace(before, after))


def test_coefficients_by_name_and_kienzle(model, tools, tmp_path):
    program = along(tools, *STRAIGHT)
    own = load(program, process(tmp_path), model)
    named = load(program, process(tmp_path, SLOT.replace(AL, "Al7075-T6")), model)
    np.testing.assert_allclose(named.wrench, own.wrench, rtol=1e-12)
    kienzle = "{kc1_1: 700, mc: 0.25, radial_ratio: 0.3, axial_ratio: 0.2, relative_sigma: 0.1}"
    got = load(program, process(tmp_path, SLOT.replace(AL, kienzle)), model)
    assert got.relative_sigma[0] == 0.1
    # in a slot F_x is the radial share, F_y the tangential: both see the same chip
    assert got.wrench[0, 0] == pytest.approx(-0.3 * got.wrench[1, 0])


def test_the_velocity_of_a_krl_program_is_its_feed(model, tools, tmp_path):
    """0.04 m/s over 4 teeth at 6000 rpm is a chip of 0.1 mm; process.yaml says nothing of feed."""
    program = tools.program("$VEL.CP = 0.04", *(f"LIN {{X {x:.3f},Y 0.000,Z 0.000,{DOWN}}}" for x in (0, 10)))
    got = load(program, process(tmp_path, feed=""), model).wrench[:3, 1]
    np.testing.assert_allclose(got, MEAN * [1, 1, -1], atol=0.06)
