"""The tool turned about its axis: less deflection, the same cut, a smooth and sound path."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from drake_stiffness.errors import InputError
from drake_stiffness.report.compensation import body
from toolpaths.account.points_table import points_csv
from toolpaths.formats.apt import Apt
from toolpaths.formats.krl import Krl
from toolpaths.formats.waypoints_csv import WaypointsCsv
from toolpaths.job import compensate
from toolpaths.loaded_path import about, loaded_path, targets
from toolpaths.postures import outside_limits, singularity_margin
from toolpaths.process import Process, posture
from toolpaths.spin import Ride, Spin


def silent(*_) -> None:
    pass


def process(**force) -> Process:
    return Process.model_validate(
        {
            "workpiece": {"position_m": [1.65, -0.10, 0.75]},
            "posture_deg": [0, -70, 120, 0, -50, 0],
            "force": {"constant": {"frame": "workpiece", **force}},
        }
    )


def line(number: int = 40) -> bytes:
    """A straight cut of 400 mm, tool down."""
    x = np.linspace(0.0, 400.0, number)
    rows = "".join(f"LIN {{X {v:.3f}, Y {0.1 * v:.3f}, Z 0.000, A 0.0000, B -6.0000, C 164.0000}}\n" for v in x)
    return b"DEF CUT( )\n" + rows.encode() + b"END\n"


@pytest.fixture(scope="module")
def cut():
    return process(fx_N=200, fy_N=300, fz_N=-100)


@pytest.fixture(scope="module")
def ridden(model, cut):
    program = Krl().parse(line(), "cut.src")
    return program, loaded_path(program, model, cut, silent), loaded_path(program, model, cut, silent, "stiffest")


def test_the_arm_bends_less_and_the_cut_is_the_same(ridden, cut):
    _, kept, turned = ridden
    assert turned.spin.chosen_mm.mean() < 0.95 * turned.spin.kept_mm.mean()
    np.testing.assert_allclose(turned.p, kept.p)
    axis = cut.spindle_axis
    np.testing.assert_allclose(turned.R @ axis, kept.R @ axis, atol=1e-12)
    np.testing.assert_allclose(turned.wrench, kept.wrench, atol=1e-9)


def test_no_constant_turn_does_much_better(ridden, model, cut):
    """Another way to the same choice: every constant turn tried on the whole path."""
    _, kept, turned = ridden
    start = posture(cut, model)
    best = np.inf
    for degrees in range(-180, 180, 10):
        R = kept.R @ about(cut.spindle_axis, np.full(len(kept.p), np.radians(degrees)))
        none = np.zeros((3, len(kept.p)), dtype=bool)
        ride = Ride(kept.bench, R, kept.p, cut.spindle_axis, kept.wrench, kept.wrench, start, {}, none)
        q, sound = ride.postures(np.zeros(len(kept.p)))
        if sound.all():
            best = min(best, ride.deflection_mm(q, kept.wrench).mean())
    assert turned.spin.chosen_mm.mean() < 1.03 * best


def test_the_turned_path_is_smooth_and_sound(ridden, model):
    _, _, turned = ridden
    q = turned.postures.q
    assert not outside_limits(model.arm, q)
    assert singularity_margin(model.arm, q).min() > 0.01
    assert np.abs(np.diff(q, axis=1)).max() < 0.3
    assert np.degrees(np.abs(np.diff(turned.spin.angle_rad))).max() < 25


def test_the_turn_keeps_off_limits_because_the_correction_moves_joints_too(ridden, model, cut):
    """A limit a fifth of a degree beyond where the turned path would go."""
    program, kept, turned = ridden
    room = turned.postures.q.max(axis=1) - kept.postures.q.max(axis=1)
    joint = int(np.argmax(room))
    upper = model.arm.upper.copy()
    upper[joint] = turned.postures.q[joint].max() + np.radians(0.2)
    narrow = replace(model, arm=replace(model.arm, upper=upper))
    found = loaded_path(program, narrow, cut, silent, "stiffest")
    assert np.abs(found.spin.angle_rad).max() > 0.1
    assert np.degrees(upper[joint] - found.postures.q[joint].max()) > 0.99


def test_the_printed_program_has_the_turn_and_only_the_turn(model, cut, ridden):
    program, _, turned = ridden
    result = compensate(program, model, cut, spin="stiffest")
    again = Krl().parse(result.raw, "cut.src")
    R, _ = targets(again, cut, turned.bench, posture(cut, model))
    apart = np.abs(R - turned.R).max()
    assert apart < 5e-3  # the correction itself turns the tool by its small deflection
    assert result.after_mm.max() < 2 * result.quantum_mm + 1e-3
    assert result.to_dict()["spin"]["largest_turn_deg"] > 10
    # What it buys is said, shown, and listed point by point.
    assert any(note.startswith("--spin stiffest: the tool was turned by") for note in result.notes)
    assert "Turning the tool about its axis" in str(body(result, model, level=2))
    header, first = points_csv(result).splitlines()[:2]
    turn = float(first.split(",")[header.split(",").index("tool_turn_deg")])
    assert turn == pytest.approx(np.degrees(turned.spin.angle_rad[0]), rel=1e-5)


def test_a_program_of_the_tool_s_axis_alone_is_told_where_its_turns_are():
    program = Apt().parse(b"GOTO/1,2,3,0,0,1\n", "cut.apt")
    spin = Spin(np.array([0.3]), np.ones(1), np.full(1, 0.5), "the tool was turned")
    assert "tool_turn_deg" in spin.notes(program)[0]
    assert "tool_turn_deg" not in Spin(np.zeros(1), np.ones(1), np.ones(1), "not turned").notes(program)[0]


def test_a_program_without_orientations_cannot_be_turned(model, cut):
    table = b"x_mm,y_mm,z_mm\n0,0,0\n10,0,0\n20,0,0\n"
    program = WaypointsCsv().parse(table, "cut.csv")
    with pytest.raises(InputError, match="write no orientation"):
        loaded_path(program, model, cut, silent, "stiffest")


def test_where_turning_gains_nothing_the_tool_stays(model, cut, ridden):
    program, _, _ = ridden
    turned = loaded_path(program, model, process(), silent, "stiffest")
    assert not turned.spin.angle_rad.any()
    assert "it would gain less than one percent" in turned.spin.why


def test_a_force_that_turns_with_the_tool_is_doubted(model, cut, ridden):
    program, _, turned = ridden
    assert "tool's axes" not in turned.spin.why
    tied = process(fx_N=240.0, fy_N=180.0, fz_N=-400.0, frame="tool")
    assert "the force is stated in the tool's axes" in loaded_path(program, model, tied, silent, "stiffest").spin.why
