"""process.yaml against program, model and campaign: frames that must agree, postures, external axes, and what was never seen."""

from __future__ import annotations

import contextlib
import io
import json
import logging
import re
import sys
from dataclasses import replace
from pathlib import Path
from unittest import mock

import numpy as np
import pytest

from drake_stiffness import cli
from drake_stiffness.errors import InputError, UntrustworthyError
from drake_stiffness.support import REFUSE_ABOVE, WARN_ABOVE
from toolpaths import job
from toolpaths.process import check_frames, check_model, external_positions, posture, read_process

KR270 = Path(__file__).parents[2] / "examples" / "kr270"
POSE = "A 0.0000,B 0.0000,C 180.0000"


def write(folder, text):
    (folder / "process.yaml").write_text(text)
    return read_process(folder / "process.yaml")


def test_what_is_not_written_has_the_defaults_of_the_contract(tmp_path):
    process = write(tmp_path, "posture_deg: [0, 0, 0, 0, 0, 0]\nforce: {constant: {fz_N: -200, frame: tool}}\n")
    assert process.reference == "unloaded"
    assert process.geometry is False
    assert process.cell is None
    R, p = process.base
    np.testing.assert_array_equal(R, np.eye(3))
    np.testing.assert_array_equal(p, 0)
    np.testing.assert_array_equal(process.force.constant.wrench, [0, 0, -200, 0, 0, 0])


def test_the_workpiece_turns_by_roll_pitch_yaw(tools):
    """R = Rz(yaw) Ry(pitch) Rx(roll)."""
    R, p = tools.process(workpiece={"position_m": [1, 2, 3], "rpy_deg": [10, 20, 30]}).base
    x, y, z = np.radians([10, 20, 30])
    about_x = [[1, 0, 0], [0, np.cos(x), -np.sin(x)], [0, np.sin(x), np.cos(x)]]
    about_y = [[np.cos(y), 0, np.sin(y)], [0, 1, 0], [-np.sin(y), 0, np.cos(y)]]
    about_z = [[np.cos(z), -np.sin(z), 0], [np.sin(z), np.cos(z), 0], [0, 0, 1]]
    np.testing.assert_allclose(R, np.array(about_z) @ about_y @ about_x, atol=1e-15)
    np.testing.assert_array_equal(p, [1, 2, 3])


def test_a_program_in_a_turned_base_is_corrected_as_in_the_plain_one(model, tools):
    """The same points of the world written in two bases: corrections are the same vectors of the world."""
    plain = tools.program(*(f"LIN {{X {x}.0000,Y {y}.0000,Z 0.0000,{POSE}}}" for x, y in ((0, 0), (30, 10), (60, 0))))
    # the second base is turned by 90 degrees about z and shifted
    lines = [
        f"LIN {{X {y}.0000,Y {100 - x}.0000,Z 50.0000,A -90.0000,B 0.0000,C 180.0000}}"
        for x, y in ((0, 0), (30, 10), (60, 0))
    ]
    turned = tools.program(*lines)
    force = tools.constant("tool", fx_N=200, fz_N=-300)
    first = job.compensate(plain, model, tools.process(workpiece={"position_m": [1.7, 0, 0.8]}, force=force))
    other = {"position_m": [1.8, 0.0, 0.75], "rpy_deg": [0, 0, 90]}
    second = job.compensate(turned, model, tools.process(workpiece=other, force=force))
    world = np.column_stack([-second.correction_mm[:, 1], second.correction_mm[:, 0], second.correction_mm[:, 2]])
    np.testing.assert_allclose(first.correction_mm, world, atol=2.1e-4)
    np.testing.assert_allclose(first.force_N, second.force_N, atol=1e-9)


# -- posture and external axes --------------------------------------------------------------------------------------------------


def test_a_posture_lists_revolute_joints_or_all(model, track_model, tools):
    six = [10.0, -70.0, 120.0, 0.0, -50.0, 5.0]
    np.testing.assert_allclose(posture(tools.process(posture_deg=six), model), np.radians(six))
    np.testing.assert_allclose(posture(tools.process(posture_deg=six), track_model), [0, *np.radians(six)])
    seven = tools.process(posture_deg=[700.0, *six])
    np.testing.assert_allclose(posture(seven, track_model), [0.7, *np.radians(six)])
    with pytest.raises(InputError, match=r"posture_deg has 7 numbers.*6 revolute joints of 6"):
        posture(seven, model)
    with pytest.raises(InputError, match="posture_deg has 5 numbers"):
        posture(tools.process(posture_deg=six[:5]), track_model)


def test_external_words_drive_joints_in_mm_and_degrees(track_model, tools):
    program = tools.program(
        f"LIN {{X 0,Y 0,Z 0,{POSE},E1 250.5,E3 -30}}", "LIN {X 5}", f"LIN {{X 0,Y 0,Z 0,{POSE},E1 0}}"
    )
    rows = np.arange(3)
    found = external_positions(
        tools.process(external_axes={"E1": "track", "e3": "joint_1"}), program, track_model, rows
    )
    np.testing.assert_allclose(found[0], [0.2505, 0.2505, 0.0])
    np.testing.assert_allclose(found[1], np.radians([-30, -30, -30]))


@pytest.mark.parametrize(
    ("axes", "says"),
    [
        ({"E1": "slide"}, "'slide'.*track, joint_1"),
        ({"E7": "track"}, "'E7'.*E1 .. E6"),
        ({"X": "track"}, "'X'.*E1 .. E6"),
        ({"E2": "track"}, "line 1: E2 is not known here"),
    ],
)
def test_external_axes_that_do_not_fit(track_model, tools, axes, says):
    program = tools.program(f"LIN {{X 0,Y 0,Z 0,{POSE},E1 0}}")
    with pytest.raises(InputError, match=says):
        external_positions(tools.process(external_axes=axes), program, track_model, np.arange(1))


# -- frames and cells -------------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("setting", "fits"),
    [
        ("$BASE = BASE_DATA[3]", True),
        ("$TOOL = TOOL_DATA[1]", True),
        ("$BASE = {X 1650,Y -100,Z 750,A 0,B 0,C 0}", True),
        ("$BASE = {X 1650.005,Y -100,Z 750,A 0,B 0.0005,C 360}", True),
        ("$BASE = {X 1650.02,Y -100,Z 750,A 0,B 0,C 0}", False),
        ("$BASE = {X 1650,Y -100,Z 750,A 0,B 0.002,C 0}", False),
        ("$BASE = $NULLFRAME", False),
        ("$TOOL = {X 180,Y 0,Z 220,A 0,B -90,C 180}", True),
        ("$TOOL = {X 180,Y 0,Z 220,A 180,B -90,C 0}", True),
        ("$TOOL = {X 180,Y 0,Z 221,A 0,B -90,C 180}", False),
        ("$TOOL = {X 180,Y 0,Z 220,A 0,B 90,C 180}", False),
        ("$BASE = {X 1650,Y -100,Z 750}", False),
        ("$BASE = WORKTABLE", False),
    ],
)
def test_frames_that_the_program_sets_must_agree(model, tools, setting, fits):
    program = tools.program(setting, f"LIN {{X 0,Y 0,Z 0,{POSE}}}")
    if fits:
        check_frames(tools.process(), program, model)
    else:
        with pytest.raises(InputError, match=r"line 1.*\$(BASE|TOOL)"):
            check_frames(tools.process(), program, model)


def test_a_process_that_names_no_cell_takes_any_model(model, tools):
    check_model(tools.process(), model)


def test_the_cell_is_compared_by_what_it_is(model, tmp_path):
    text = (KR270 / "cell.yaml").read_text()
    process = write(
        tmp_path, "cell: c.yaml\nposture_deg: [0, 0, 0, 0, 0, 0]\nforce: {constant: {fz_N: -2, frame: tool}}\n"
    )
    for same in (text, text.replace("links: all", "links: none"), text.replace("[0, 0, -9.81]", "[0.0, 0.0, -9.81]")):
        (tmp_path / "c.yaml").write_text(same)
        check_model(process, model)
    (tmp_path / "c.yaml").write_text(text.replace("mass_kg: 90.0", "mass_kg: 90.5"))
    with pytest.raises(InputError, match=r"tool.mass_kg is 90.0 in the model, 90.5 in"):
        check_model(process, model)


def test_half_a_description_of_milling_is_refused_with_what_is_missing(tmp_path):
    with pytest.raises(InputError, match=r"force\.milling\.teeth: missing"):
        write(tmp_path, "posture_deg: [0, 0, 0, 0, 0, 0]\nforce: {milling: {diameter_mm: 20}}\n")


# -- what the campaign never saw ----------------------------------------------------------------------------------------------------


def run(*arguments):
    out, err = io.StringIO(), io.StringIO()
    logger = logging.getLogger("drake_stiffness")
    before = logger.handlers, logger.propagate
    try:
        with (
            mock.patch.object(sys, "argv", ["drake-stiffness", *map(str, arguments)]),
            contextlib.redirect_stdout(out),
            contextlib.redirect_stderr(err),
            pytest.raises(SystemExit) as end,
        ):
            cli.main()
    finally:
        logger.handlers, logger.propagate = before
    return int(end.value.code or 0), err.getvalue(), out.getvalue()


@pytest.fixture(scope="module")
def vertical(arm_folder, tmp_path_factory):
    """A campaign with vertical loads only, joint springs only: joint 1, about the vertical, is never loaded."""
    folder = tmp_path_factory.mktemp("vertical")
    (folder / "kr270.urdf").write_text((KR270 / "kr270.urdf").read_text())
    (folder / "cell.yaml").write_text((KR270 / "cell_joints_only.yaml").read_text())
    truth = "".join(
        f"  - {{kind: joint_compliance, where: joint_{k}, parameters: {{k: {v}e-6}}}}\n"
        for k, v in enumerate((0.33, 0.302, 0.406, 3.002, 3.303, 2.365), start=1)
    )
    (folder / "truth.yaml").write_text("effects:\n" + truth)
    rng = np.random.default_rng(0)
    rows = ["experiment,step," + ",".join(f"joint_{k}_deg" for k in range(1, 7)) + ",fz_N"]
    for e in range(12):
        q = rng.uniform([-55, -120, 10, -170, -110, -170], [55, -25, 140, 170, 110, 170]).round(3)
        rows += [f"E{e},{step},{','.join(map(str, q))},{fz}" for step, fz in enumerate((0, -1200, -2500))]
    (folder / "plan.csv").write_text("\n".join(rows) + "\n")
    arguments = (
        "simulate",
        folder / "cell.yaml",
        "--truth",
        folder / "truth.yaml",
        "--plan",
        folder / "plan.csv",
        "-o",
        folder / "v",
    )
    assert run(*arguments, "--noise-mm", "0.01")[0] == 0
    code, err, out = run("identify", folder / "v" / "campaign.yaml", "-o", folder / "model.json")
    assert code == 0, err
    # said loudly when it is identified, too
    assert "NOT SEEN" in out
    assert "joint_1" in out
    lines = [line for line in (KR270 / "pocket.src").read_text().splitlines() if line.startswith("LIN")][:6]
    (folder / "program.src").write_text("\n".join(lines) + "\n")
    return folder


def milled(folder, force):
    (folder / "process.yaml").write_text(
        "cell: cell.yaml\nworkpiece: {position_m: [1.65, -0.10, 0.75]}\nposture_deg: [0, -70, 120, 0, -50, 0]\n"
        f"force: {{constant: {{{force}, frame: world}}}}\n"
    )
    outputs = [folder / "out.src", folder / "out.json"]
    for path in outputs:
        path.unlink(missing_ok=True)
    result = run(
        *("compensate", folder / "program.src", "--model", folder / "model.json", "--process", folder / "process.yaml"),
        *("-o", outputs[0], "--json", outputs[1]),
    )
    return result, outputs


def test_the_unseen_joint_is_named_in_the_model(vertical):
    model = json.loads((vertical / "model.json").read_text())
    groups = {p["name"]: p["group"] for p in model["parameters"]}
    assert groups["joint_1"] == "G2"
    assert all(groups[f"joint_{k}"] == "G1+" for k in (2, 3, 4, 5, 6))
    assert model["parameters"][0]["sigma"] is None


def test_milling_sideways_after_a_vertical_campaign_is_refused(vertical):
    (code, err, _), outputs = milled(vertical, "fy_N: 400")
    assert code == 3
    assert "does not support" in err
    share = float(err.split("up to ")[1].split(" %")[0])
    assert 50 < share <= 100
    assert "line 1, 2, 3, 4, 5, 6" in err
    assert not any(path.exists() for path in outputs)


def test_the_same_force_vertically_is_accepted(vertical):
    (code, err, _), outputs = milled(vertical, "fz_N: 400")
    assert code == 0, err
    assert outputs[0].exists()
    account = json.loads(outputs[1].read_text())
    assert account["unsupported_share"] < 1e-6
    assert account["percent_compensated"] > 99


def test_a_force_partly_sideways_is_told_its_share(vertical):
    (code, err, out), outputs = milled(vertical, "fz_N: 400, fy_N: 25")
    assert code == 0, err
    account = json.loads(outputs[1].read_text())
    assert WARN_ABOVE < account["unsupported_share"] < REFUSE_ABOVE
    assert any("not supported by the model's campaign" in note for note in account["notes"])
    assert "not supported" in out


@pytest.mark.parametrize(("column", "code"), [("fy_N", 3), ("fz_N", 0)])
def test_a_prediction_says_so_too(vertical, tmp_path, column, code):
    header, *rows = (vertical / "plan.csv").read_text().splitlines()
    rows = [row for row in rows if row.startswith("E1,")]  # reaches 2.5 m forwards
    (tmp_path / "p.csv").write_text("\n".join([header.replace("fz_N", column), *rows]) + "\n")
    result, err, _ = run(
        "predict", vertical / "model.json", tmp_path / "p.csv", "-o", tmp_path / "o.csv", "--json", tmp_path / "o.json"
    )
    assert result == code, err
    if code:
        assert re.search(r"6 of 9 predictions .* up to \d+ % .* never showed", err)
        assert not list(tmp_path.glob(".*"))
    else:
        summary = json.loads((tmp_path / "o.json").read_text())
        assert summary["unsupported_rows"] == 0
        assert summary["unsupported_share_max"] < 1e-6


def test_a_model_without_statistics_says_that_it_knows_no_uncertainty(pocket, model, tools):
    assert any("no statistics" in note for note in job.compensate(pocket, model, tools.process()).notes)


# -- whole jobs that cannot be done ---------------------------------------------------------------------------------------------------


def test_a_workpiece_out_of_reach_names_all_lines(pocket, model, tools):
    with pytest.raises(UntrustworthyError, match=r"out of reach.*line 2, 3, 4.*more"):
        job.compensate(pocket, model, tools.process(workpiece={"position_m": [4.0, 0, 0.8]}))


def test_limits_on_the_way_are_named_by_line_and_joint(pocket, model, tools):
    upper = model.arm.upper.copy()
    upper[5] = np.radians(5.0)  # joint 6 goes to 30 degrees and back
    tight = replace(model, arm=replace(model.arm, upper=upper))
    with pytest.raises(UntrustworthyError, match=r"outside the joint limits .first: joint 'joint_6'.: line"):
        job.compensate(pocket, tight, tools.process())


def test_a_load_that_the_arm_cannot_bear(pocket, model, tools):
    """Springs that give way faster than weight pushes the arm back (a force that no arm bears is refused before)."""
    with pytest.raises(UntrustworthyError, match=r"posture .*load .*(stable|converge)"):
        job.compensate(pocket, model.with_x(3e4 * model.x), tools.process())


def test_an_external_word_that_nothing_maps_is_refused_where_the_arm_has_joints_to_spare(track_model, tools):
    program = tools.program("LIN {X 0.000,Y 200.000,Z 0.000,A 0.000,B 0.000,C 180.000,E1 400.0}")
    process = tools.process(workpiece={"position_m": [1.75, 0.0, 1.05]}, posture_deg=[200, 0, -70, 120, 0, -50, 0])
    with pytest.raises(InputError, match="E1 is driven"):
        job.compensate(program, track_model, process)
