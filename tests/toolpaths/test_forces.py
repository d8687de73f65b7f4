"""The wrench on the tool: frames that coincide give one wrench, frames that turn turn it, tables go row by row."""

from __future__ import annotations

import numpy as np
import pytest

from drake_stiffness.errors import InputError
from toolpaths import job, loaded_path
from toolpaths.compensation import bench_of
from toolpaths.forces import wrenches
from toolpaths.orientation import rotation_from_abc
from toolpaths.process import read_process

ALL_SIX = {"fx_N": 10.0, "fy_N": 20.0, "fz_N": -30.0, "mx_Nm": 1.0, "my_Nm": -2.0, "mz_Nm": 3.0}
SIX = np.array(list(ALL_SIX.values()))


def loads(program, process, model) -> np.ndarray:
    """(6, N) for all corrected rows, with targets as the job computes them."""
    bench = bench_of(model, "unloaded", False)
    R, p = loaded_path.targets(program, process, bench, np.radians([0, -70, 120, 0, -50, 0.0]))
    rows = np.flatnonzero(program.corrected)
    return wrenches(process, program, rows, p, R[rows])


def straight(tools, pose="A 0,B 0,C 0"):
    """Feed along x."""
    return tools.program(*(f"LIN {{X {x},Y 0,Z 0,{pose}}}" for x in (0, 10, 20)))


@pytest.mark.parametrize("frame", ["tool", "path", "workpiece", "world"])
def test_frames_that_coincide_give_the_same_wrench(model, tools, frame):
    process = tools.process(workpiece={"position_m": [1.8, 0.1, 0.8]}, force=tools.constant(frame, **ALL_SIX))
    np.testing.assert_allclose(loads(straight(tools), process, model), np.repeat(SIX[:, None], 3, axis=1), atol=1e-12)


def rotated(R, v=SIX):
    return np.concatenate([R @ v[:3], R @ v[3:]])


def rz(angle):
    c, s = np.cos(np.radians(angle)), np.sin(np.radians(angle))
    return np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]])


def rx(angle):
    c, s = np.cos(np.radians(angle)), np.sin(np.radians(angle))
    return np.array([[1, 0, 0], [0, c, -s], [0, s, c]])


def test_frames_turn_the_wrench_each_in_its_own_way(model, tools):
    """Base turned by yaw 30, tool by A 40 and C 170 in the base, feed along the base's y."""
    program = tools.program(*(f"LIN {{X 0,Y {y},Z 0,A 40,B 0,C 170}}" for y in (0, 10, 20)))
    expected = {
        "world": np.eye(3),
        "workpiece": rz(30),
        "tool": rz(30) @ rz(40) @ rx(170),
    }
    tool_z = expected["tool"][:, 2]
    x = rz(30) @ [0, 1, 0]
    y = np.cross(tool_z, x) / np.linalg.norm(np.cross(tool_z, x))
    expected["path"] = np.column_stack([x, y, np.cross(x, y)])
    for frame, R in expected.items():
        process = tools.process(
            workpiece={"position_m": [1.8, 0, 0.8], "rpy_deg": [0, 0, 30]}, force=tools.constant(frame, **ALL_SIX)
        )
        got = loads(program, process, model)
        np.testing.assert_allclose(got, np.repeat(rotated(R)[:, None], 3, axis=1), atol=1e-9, err_msg=frame)


def test_path_axes_are_square_and_follow_the_feed(model, tools):
    """A tool that leans: z of the path is the tool's z made perpendicular to the feed."""
    program = tools.program("LIN {X 0,Y 0,Z 0,A 0,B 20,C 0}", "LIN {X 10,Y 0,Z 0,A 0,B 20,C 0}")
    along = loads(program, tools.process(force=tools.constant("path", fx_N=1)), model)[:3, 1]
    across = loads(program, tools.process(force=tools.constant("path", fy_N=1)), model)[:3, 1]
    up = loads(program, tools.process(force=tools.constant("path", fz_N=1)), model)[:3, 1]
    np.testing.assert_allclose(np.column_stack([along, across, up]), np.eye(3), atol=1e-12)


def circle(angle, radius=50.0, centre=(100.0, 20.0)):
    return centre[0] + radius * np.cos(angle), centre[1] + radius * np.sin(angle)


def at(angle, pose="A 0,B 0,C 180"):
    x, y = circle(angle)
    return f"{{X {x:.9f},Y {y:.9f},Z 0,{pose}}}"


@pytest.mark.parametrize("sense", [1, -1])
@pytest.mark.parametrize("share", [0.5, 0.2])
def test_on_an_arc_the_feed_is_its_tangent(model, tools, sense, share):
    """At the auxiliary point and at the end, wherever on the arc the auxiliary point lies."""
    begin, end = 0.3, 0.3 + sense * 1.9
    via = begin + share * (end - begin)
    program = tools.program(f"LIN {at(begin)}", f"CIRC {at(via)},{at(end)}")
    got = loads(program, tools.process(force=tools.constant("path", fx_N=100)), model)[:3].T
    for row, angle in ((1, via), (2, end)):
        tangent = sense * np.array([-np.sin(angle), np.cos(angle), 0])
        np.testing.assert_allclose(got[row], 100 * tangent, atol=1e-5)


def test_a_line_after_an_arc_and_an_arc_after_a_line(model, tools):
    program = tools.program(
        f"LIN {at(0.0)}", f"CIRC {at(0.5)},{at(1.0)}", "LIN {X 0,Y 0,Z 0,A 0,B 0,C 180}", f"CIRC {at(2.0)},{at(2.5)}"
    )
    got = loads(program, tools.process(force=tools.constant("path", fx_N=1)), model)[:3].T
    towards = -np.array([*circle(1.0), 0.0])
    np.testing.assert_allclose(got[3], towards / np.linalg.norm(towards), atol=1e-9)
    # the second arc runs through the origin, 2.0 and 2.5: its tangents are not those of the first circle
    a, b, c = np.zeros(2), np.array(circle(2.0)), np.array(circle(2.5))
    # perpendicular to the radius of the circle through the three points
    system = 2 * np.array([b - a, c - a])
    centre = np.linalg.solve(system, [b @ b - a @ a, c @ c - a @ a])
    for row, point in ((4, b), (5, c)):
        assert got[row, :2] @ (point - centre) == pytest.approx(0, abs=1e-6)
        assert got[row, :2] @ (c - b) > 0


def test_three_points_on_a_line_make_an_arc_that_is_a_line(model, tools):
    pose = "A 0,B 0,C 0"
    program = tools.program(f"LIN {{X 0,Y 0,Z 0,{pose}}}", f"CIRC {{X 5,Y 0,Z 0,{pose}}},{{X 10,Y 0,Z 0,{pose}}}")
    got = loads(program, tools.process(force=tools.constant("path", fx_N=1)), model)
    np.testing.assert_allclose(got[:3], np.repeat([[1.0], [0.0], [0.0]], 3, axis=1), atol=1e-9)


def test_the_feed_of_the_first_cut_comes_from_the_approach(model, tools):
    """A rapid carries no force but tells where the cut comes from."""
    program = tools.program(
        "PTP {X 0,Y -10,Z 0,A 0,B 0,C 0}", "LIN {X 0,Y 0,Z 0,A 0,B 0,C 0}", "LIN {X 10,Y 0,Z 0,A 0,B 0,C 0}"
    )
    got = loads(program, tools.process(force=tools.constant("path", fx_N=1)), model)[:3].T
    np.testing.assert_allclose(got, [[0, 1, 0], [1, 0, 0]], atol=1e-12)


def test_without_an_approach_the_first_cut_feeds_as_the_second(model, tools):
    got = loads(straight(tools), tools.process(force=tools.constant("path", fx_N=1)), model)[:3].T
    np.testing.assert_allclose(got[0], [1, 0, 0], atol=1e-12)


@pytest.mark.parametrize(
    "lines",
    [
        ["LIN {X 0,Y 0,Z 0,A 0,B 0,C 0}", "LIN {X 0,Y 0,Z 5,A 0,B 0,C 0}"],
        ["LIN {X 0,Y 0,Z 0,A 0,B 0,C 0}", "LIN {X 5,Y 0,Z 0,A 0,B 0,C 0}", "LIN {X 5,Y 0,Z 0,A 0,B 0,C 0}"],
        ["PTP {A1 0,A2 0,A3 0,A4 0,A5 0,A6 0}", "PTP P1", "LIN {X 0,Y 0,Z 0,A 0,B 0,C 0}"],
    ],
    ids=["along the tool", "no way made", "a single point"],
)
def test_a_feed_that_is_no_direction_matters_only_where_the_force_asks_for_it(model, tools, lines):
    program = tools.program(*lines)
    with pytest.raises(InputError, match=f"line {len(lines) if len(lines) == 3 else '[12]'}.*path axes"):
        loads(program, tools.process(force=tools.constant("path", fx_N=1)), model)
    if lines[-1] != "LIN {X 0,Y 0,Z 0,A 0,B 0,C 0}" or len(lines) == 3:
        # a push along the tool is the same whichever way the feed goes
        got = loads(program, tools.process(force=tools.constant("path", fz_N=-5)), model)
        np.testing.assert_allclose(got[:3, -1], [0, 0, -5], atol=1e-12)


# -- tables -----------------------------------------------------------------------------------------------------------------


def with_table(tmp_path, text, frame="workpiece", rpy="[0, 0, 0]"):
    (tmp_path / "forces.csv").write_text(text)
    (tmp_path / "process.yaml").write_text(
        f"workpiece: {{position_m: [1.8, 0, 0.8], rpy_deg: {rpy}}}\nposture_deg: [0, -70, 120, 0, -50, 0]\n"
        f"force: {{table: forces.csv, frame: {frame}}}\n"
    )
    return read_process(tmp_path / "process.yaml")


def test_a_table_has_a_row_per_motion_and_an_arc_is_one_motion(model, tools, tmp_path):
    program = tools.program(
        f"LIN {at(0.0)}", f"CIRC {at(0.5)},{at(1.0)}", f"PTP {at(0.0)}", f"LIN {at(1.2)}", f"CIRC {at(1.3)},{at(1.4)}"
    )
    process = with_table(tmp_path, "fx_N,mz_Nm\n1,10\n2,20\n3,30\n4,40\n")
    got = loads(program, process, model)
    np.testing.assert_array_equal(got[0], [1, 2, 2, 3, 4, 4])
    np.testing.assert_array_equal(got[5], [10, 20, 20, 30, 40, 40])
    np.testing.assert_array_equal(got[[1, 2, 3, 4]], 0)


@pytest.mark.parametrize("rows", [1, 2, 4, 6])
def test_a_table_of_another_length_is_refused(model, tools, tmp_path, rows):
    process = with_table(tmp_path, "fx_N\n" + "1\n" * rows)
    with pytest.raises(InputError, match=rf"forces.csv: {rows} rows.*3 corrected motions"):
        loads(straight(tools), process, model)


def test_units_and_frames_of_a_table(model, tools, tmp_path):
    process = with_table(tmp_path, "fx_kN,my_kNm,fy_N,note\n1,2,3,a\n1,2,3,b\n1,2,3,c\n", rpy="[0, 0, 90]")
    got = loads(straight(tools), process, model)
    np.testing.assert_allclose(got[:, 0], [-3, 1000, 0, -2000, 0, 0], atol=1e-9)


@pytest.mark.parametrize("frame", ["tool", "path", "workpiece", "world"])
def test_a_table_and_a_constant_in_one_frame_are_the_same_wrench(model, tools, tmp_path, frame):
    program = tools.program(*(f"LIN {{X {x},Y {y},Z 0,A 10,B 5,C 170}}" for x, y in ((0, 0), (10, 5), (20, 0))))
    process = with_table(tmp_path, ",".join(ALL_SIX) + "\n" + (",".join(map(str, SIX)) + "\n") * 3, frame, "[5, 0, 30]")
    one = tools.process(
        workpiece={"position_m": [1.8, 0, 0.8], "rpy_deg": [5, 0, 30]}, force=tools.constant(frame, **ALL_SIX)
    )
    np.testing.assert_allclose(loads(program, process, model), loads(program, one, model), atol=1e-12)


def test_the_force_of_a_program_reaches_the_account(pocket, model, tools):
    """Tool axes: the direction turns with the tool from point to point, the size does not."""
    process = tools.process()
    result = job.compensate(pocket, model, process)
    R = rotation_from_abc(pocket.orientation)[result.rows]
    np.testing.assert_allclose(result.force_N, R @ [240.0, 180.0, -400.0], atol=1e-9)
    assert np.ptp(result.force_N, axis=0).min() > 10
