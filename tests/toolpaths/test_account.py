"""The account of a correction: intervals that hold, causes that add up, kinks, limits, and checks before anything is written."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from drake_stiffness.errors import InputError, UntrustworthyError
from drake_stiffness.model import Statistics
from toolpaths import job
from toolpaths.account.blending import Blending
from toolpaths.account.evenness import evenness
from toolpaths.account.points_table import COLUMNS, points_csv
from toolpaths.account.residual import length_interval
from toolpaths.compensation import bench_of, deviation, mirror
from toolpaths.process import Process

POSE = "A 0.0000,B 0.0000,C 180.0000"


@pytest.fixture(scope="module")
def short(tools):
    return tools.program(*(f"LIN {{X {x}.0000,Y {20 * (x // 40)}.0000,Z 0.0000,{POSE}}}" for x in range(0, 200, 20)))


@pytest.fixture(scope="module")
def process(tools):
    return tools.process()


@pytest.fixture(scope="module")
def known(model):
    """The model with springs known to 2 % each, independently, and a form that errs by 1 %."""
    n = model.x.size
    sigma = 0.02 * np.abs(model.x)
    statistics = Statistics(sigma, ("G1+",) * n, ((),) * n, np.diag(sigma**2), np.zeros((n, 0)))
    return replace(model, statistics=statistics, fit={"model_form": {"relative": 0.01}})


@pytest.fixture(scope="module")
def result(short, known, process):
    return job.compensate(short, known, process)


# -- intervals ----------------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("off", [0.0, 1.0, 8.0])
def test_an_interval_of_a_length_holds_what_a_gaussian_gives(off):
    rng = np.random.default_rng(int(off))
    A = rng.normal(size=(3, 3)) * [1.0, 0.3, 0.05]
    m = off * np.array([0.6, 0.0, 0.8])
    drawn = np.linalg.norm(m + rng.normal(size=(100_000, 3)) @ A.T, axis=1)
    low, high = length_interval(m[None], (A @ A.T)[None])
    below = 0.025 if low[0] > 0 else 0.0  # nothing is shorter than nothing, so the upper end may have all five percent
    assert (drawn > high).mean() == pytest.approx(0.05 - below, abs=0.004)
    assert (drawn < low).mean() <= below * 1.05


def test_without_any_doubt_an_interval_is_the_residual_itself():
    low, high = length_interval(np.array([[0.3, 0.0, 0.4]]), np.zeros((1, 3, 3)))
    np.testing.assert_allclose([low[0], high[0]], 0.5)


def test_arms_drawn_from_the_covariance_stay_in_the_interval(short, known, process):
    """Arms whose springs differ as the covariance says, pushed by forces that differ as stated, run the corrected joints."""
    force = process.force.model_copy(update={"relative_sigma": 0.1})
    stated = process.model_copy(update={"force": force})
    model = replace(known, fit={"model_form": {"relative": 0.0}})
    result = job.compensate(short, model, stated)
    path, rng, inside = result.path, np.random.default_rng(3), []
    q = mirror(path.bench, path.postures.q, path.wrench, path.only, path.postures.free).q
    for _ in range(100):
        x = model.x + 0.02 * np.abs(model.x) * rng.normal(size=model.x.size)
        other = bench_of(model.with_x(x), "unloaded", False)
        p = other.actual(q, path.wrench * (1 + 0.1 * rng.normal()))[1]
        length = np.linalg.norm(p.T - path.p, axis=1) * 1e3
        inside.append(((length >= result.account.interval.low_mm) & (length <= result.account.interval.high_mm)).mean())
    assert 0.9 < np.mean(inside) < 0.975
    parts = result.to_dict()["residual_interval_mm"]["sigma_parts_mm"]
    assert parts["force"]["mean"] == pytest.approx(0.1 * result.before_mm.mean(), rel=0.01)


def test_each_doubt_widens_the_interval_and_is_listed(short, model, known, process):
    bare = job.compensate(short, model, process).account.interval
    assert bare.carries == ("printed digits",)
    assert {"covariance of the parameters", "uncertainty of the process force"} <= set(bare.lacks)
    more = job.compensate(short, known, process).account.interval
    assert (more.high_mm > bare.high_mm).all()
    np.testing.assert_allclose(more.form_mm, 0.01 * job.compensate(short, known, process).before_mm, rtol=1e-6)
    np.testing.assert_allclose(bare.high_mm, np.linalg.norm(bare.residual_mm, axis=1))


def test_where_sag_is_corrected_its_error_counts(short, known, process):
    """Springs known to 2 %: without any force, the sigma of the sag is that of springs that differ by so much."""
    from drake_stiffness.effects.effect import Cases
    from drake_stiffness.equilibrium import solve_equilibrium

    idle = process.model_validate(
        {**process.model_dump(), "reference": "rigid", "force": {"constant": {"fz_N": 0.0, "frame": "tool"}}}
    )
    result = job.compensate(short, known, idle)
    q, p_ET = result.path.postures.q[:, :1], known.tcp[1]
    cases, moved = Cases(q, np.zeros((6, 1)), p_ET), 0.0
    for i in np.flatnonzero(known.x):
        ends = []
        for sign in (1, -1):
            x = known.x.copy()
            x[i] *= 1 + sign * 0.01
            at = solve_equilibrium(known.with_x(x).structure, cases)
            ends.append(at.p_E + np.einsum("ijn,j->in", at.R_E, p_ET))
        moved += ((ends[0] - ends[1]) ** 2).sum()
    assert result.account.interval.parameters_mm[0] == pytest.approx(1e3 * np.sqrt(moved), rel=0.02)
    assert result.account.interval.parameters_mm[0] > 0.02


def test_what_is_not_stated_is_asked_for(result):
    asked = [note for note in result.notes if "not stated" in note]
    assert any("force.relative_sigma" in note for note in asked)
    (controller,) = [note for note in asked if "controller" in note]
    for key in ("loads_set", "tool_data_set", "absolute_accuracy", "blend_radius_mm"):
        assert key in controller


def test_what_is_stated_of_the_controller_is_repeated_and_judged(short, known, process):
    stated = Process.model_validate(
        {
            **process.model_dump(),
            "controller": {"loads_set": False, "tool_data_set": True, "absolute_accuracy": True, "blend_radius_mm": 20},
        }
    )
    result = job.compensate(short, known, stated)
    assert result.to_dict()["controller"]["blend_radius_mm"] == 20
    assert any("sag model" in note for note in result.notes)
    assert any("shorter than twice the blend radius of 20 mm" in note for note in result.notes)
    assert not any("not stated under" in note for note in result.notes)


# -- causes -------------------------------------------------------------------------------------------------------------------


def test_shares_add_up_and_are_what_each_spring_alone_bends(short, known, process, result):
    causes = result.to_dict()["causes"]
    assert sum(c["share"] for c in causes) == pytest.approx(1.0)
    assert causes[-1]["kind"] == "second order"
    assert abs(causes[-1]["share"]) < 0.01
    path = result.path
    for name in ("joint_2", "link_2"):
        keep = [getattr(e, "where", "") == name for e in known.effects]
        alone = bench_of(known.subset(keep), "unloaded", False).actual(path.postures.q, path.wrench)[1]
        moved = (alone.T - path.p) * 1e3
        (cause,) = [c for c in causes if c["where"] == name]
        u = result.deflection_mm / result.before_mm[:, None]
        assert cause["share"] == pytest.approx((u * moved).sum() / result.before_mm.sum(), rel=0.02)
        assert cause["mean_mm"] == pytest.approx(np.linalg.norm(moved, axis=1).mean(), rel=0.02)


def test_joints_only_is_what_a_correction_by_the_joint_springs_would_leave(short, known, result):
    """Their own mirror iteration, judged by the full model."""
    path = result.path
    joints = bench_of(known.without_links, "unloaded", False)
    q = mirror(joints, path.postures.q, path.wrench, path.only, path.postures.free).q
    R0, p0 = path.bench.commanded(path.postures.q)
    left = deviation(path.bench, q, path.wrench, R0, p0, path.only)[0][:3]
    np.testing.assert_allclose(
        result.account.causes.joints_only_mm, np.linalg.norm(left, axis=0) * 1e3, rtol=0.02, atol=2e-4
    )
    best = result.account.causes.best_joints_only_mm
    assert 0 < best < np.sqrt((result.account.causes.joints_only_mm**2).mean())


def test_a_model_of_joints_alone_leaves_nothing_to_a_joints_only_correction(short, known, process):
    joints = known.without_links
    causes = job.compensate(short, replace(joints, fit={}), process).account.causes
    assert causes.joints_only_mm.max() < 1e-9
    assert causes.best_joints_only_mm < 1e-6


# -- evenness and reserves ----------------------------------------------------------------------------------------------------


def test_a_step_of_the_correction_is_a_kink_and_printing_is_none():
    target = np.array([[0.0, 0, 0], [1, 0, 0], [2, 0, 0], [3, 0, 0], [3, 0, 0]])
    correction = np.array([[0.1, 0, 0], [0.101, 0, 0], [0.25, 0, 0], [0.25, 0, 0], [0.25, 0, 0]])
    begin = np.array([True, False, False, False, False])
    found = evenness(target, correction, begin, np.full(5, 0.0005))
    assert found.kinks.tolist() == [2]
    assert np.isnan(found.change_per_mm[0])
    assert found.change_per_mm[1] == 0.0
    assert any("line 12" in note for note in found.notes(np.arange(10, 15)))


def test_blends_of_the_program_are_held_against_its_steps():
    spacing, change = np.array([np.nan, 1.0, 10.0, 10.0, 1.0]), np.array([np.nan, 0.01, 0.02, 0.0, 0.0])
    said = np.array([0.0, 0.6, 0.6, np.inf, np.nan])
    own = Blending(said, float("nan"), spacing, change)
    # Steps whose two blends are known: 0 + 0.6 of 1 mm, 0.6 + 0.6 of 10 mm.
    assert own.overlapping == 0.0
    assert own.within_mm == pytest.approx(0.012)
    assert own.limits_mm == (0.0, 0.6)
    (note,) = own.notes()
    assert "20 % of the points the blend depends on speed" in note
    # From a rounded point to one that is gone to: the blend takes its part of the step at the beginning.
    assert (
        Blending(np.array([0.6, 0.0]), float("nan"), np.array([np.nan, 2.0]), np.array([np.nan, 0.1])).within_mm == 0.06
    )
    stated = Blending(said, 4.0, spacing, change)
    np.testing.assert_array_equal(stated.radius_mm, np.full(5, 4.0))
    assert stated.overlapping == 0.5
    told = " ".join(stated.notes())
    assert "50 % of the steps are shorter than twice the blend radius of 4 mm" in told
    assert "the program itself says blend radii of 0 to 0.6 mm" in told


def test_a_blend_that_the_program_says_is_repeated_and_used(known, process, tools):
    program = tools.program(
        "$APO.CDIS = 0.5",
        *(f"LIN {{X {x}.000,Y 50.000,Z 0.000,A 0.000,B 0.000,C 180.000}} C_DIS" for x in range(60, 66)),
    )
    result = job.compensate(program, known, process)
    even = result.to_dict()["evenness"]
    assert even["smallest_blend_radius_mm"] == even["largest_blend_radius_mm"] == 0.5
    assert even["share_of_points_whose_blend_the_program_says"] == 1.0
    assert even["share_of_steps_shorter_than_two_blend_radii"] == 0.0
    (controller,) = [note for note in result.notes if "`controller`" in note]
    assert "does it blend as the program says, 0.5 mm (blend_radius_mm)" in controller


def test_a_force_that_jumps_along_the_path_is_flagged_as_a_kink(short, known, process, tmp_path):
    rows = ["0,0,-400"] * 5 + ["900,0,-400"] * 5
    (tmp_path / "f.csv").write_text("\n".join(["fx_N,fy_N,fz_N", *rows]) + "\n")
    table = Process.model_validate({**process.model_dump(exclude={"force"}), "force": {"table": "f.csv"}})
    table._path = tmp_path / "process.yaml"
    d = job.compensate(short, known, table).to_dict()["evenness"]
    assert d["kink_lines"] == [6]


def test_the_nearest_limit_is_named(result, known):
    reserve = result.to_dict()["reserve"]
    joint = known.arm.joint_names.index(reserve["nearest_joint"])
    q = np.degrees(result.path.postures.q[joint])
    gap = min((q - np.degrees(known.arm.lower[joint])).min(), (np.degrees(known.arm.upper[joint]) - q).min())
    assert reserve["limit_margin"] == pytest.approx(gap, abs=0.1)


# -- before anything is written -----------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("changes", "says"),
    [
        ({"workpiece": {"position_m": [1650, -100, 750]}}, "workpiece.position_m in metres?"),
        ({"force": {"constant": {"fz_N": -60e3, "frame": "tool"}}}, "in newtons?"),
    ],
)
def test_units_that_can_only_be_wrong_are_asked_for_by_name(short, known, process, changes, says):
    with pytest.raises(InputError) as caught:
        job.compensate(short, known, Process.model_validate({**process.model_dump(exclude=changes.keys()), **changes}))
    assert says in str(caught.value)


def test_a_tool_of_kilometres_is_asked_for_by_name(short, known, process):
    cell = {
        **known.cell,
        "tool": {**known.cell["tool"], "tcp": {"position_m": [180, 0, 220], "rpy_deg": [180, -90, 0]}},
    }
    with pytest.raises(InputError, match=r"Is tool\.tcp\.position_m in metres"):
        job.compensate(short, replace(known, cell=cell), process)


def test_a_program_in_another_unit_is_asked_for(tools, known, process):
    far = tools.program(*(f"LIN {{X {x}000.0,Y 0.0,Z 0.0,{POSE}}}" for x in (100, 120, 140)))
    with pytest.raises(InputError, match="lengths in millimetres"):
        job.compensate(far, known, process)
    tiny = tools.program(*(f"LIN {{X {x},Y 0.0000,Z 0.0000,{POSE}}}" for x in ("0.1000", "0.1200", "0.1400")))
    assert any("really millimetres" in note for note in job.compensate(tiny, known, process).notes)


def test_centimetres_of_deflection_are_no_milling(short, known, process):
    with pytest.raises(UntrustworthyError, match=r"no milling.*units of the campaign"):
        job.compensate(short, known.with_x(25 * known.x), process)


def test_a_large_force_is_doubted_and_a_spindle_under_the_part_too(short, known, process, tools):
    force = tools.constant("tool", fz_N=-6000)
    assert any(
        "more than milling or this arm" in n for n in job.compensate(short, known, tools.process(force=force)).notes
    )
    flipped = process.model_copy(update={"tool_axis": "z"})
    notes = job.compensate(short, known, flipped).notes
    assert any("mill from below" in note for note in notes)
    assert any("points back at the flange" in note for note in notes)


# -- what comes out -----------------------------------------------------------------------------------------------------------


def test_the_points_table_says_the_same_as_the_result(result):
    rows = points_csv(result).splitlines()
    assert rows[0] == ",".join(COLUMNS)
    assert len(rows) == 1 + result.rows.size
    values = dict(zip(COLUMNS, rows[3].split(","), strict=True))
    assert int(values["line"]) == result.line[2]
    assert float(values["interval_high_mm"]) == pytest.approx(result.account.interval.high_mm[2], rel=1e-5)
    assert float(values["correction_z_mm"]) == pytest.approx(result.correction_mm[2, 2], rel=1e-5)
    assert rows[1].endswith(",")  # a cut's first point has no step before it


def test_the_json_of_a_result_holds_no_nan(result):
    from drake_stiffness.files import json_text

    document = json.loads(json_text(result.to_dict()))
    assert document["residual_interval_mm"]["level"] == 0.95
    assert document["probe"] is None


def test_a_dry_run_writes_no_program_and_says_what_it_would(arm_folder, known, tmp_path):
    from typer.testing import CliRunner

    from drake_stiffness.cli import app

    known.save(tmp_path / "model.json")
    (tmp_path / "p.src").write_text(f"LIN {{X 100.0000,Y 0.0000,Z 0.0000,{POSE}}}\n")
    (tmp_path / "process.yaml").write_text(
        "workpiece: {position_m: [1.65, -0.10, 0.75]}\nposture_deg: [0, -70, 120, 0, -50, 0]\n"
        "force: {constant: {fz_N: -400, frame: tool}}\n"
    )
    names = ["compensate", "p.src", "--model", "model.json", "--process", "process.yaml"]
    arguments = [str(tmp_path / a) if "." in a else a for a in names]
    done = CliRunner().invoke(
        app, [*arguments, "-o", str(tmp_path / "out.src"), "--dry-run", "--points", str(tmp_path / "p.csv")]
    )
    assert done.exit_code == 0, done.output
    assert "dry run" in done.stdout
    assert not Path(tmp_path / "out.src").exists()
    assert (tmp_path / "p.csv").read_text().startswith("line,")
    far = (tmp_path / "process.yaml").read_text().replace("1.65", "9.65")
    (tmp_path / "process.yaml").write_text(far)
    assert isinstance(CliRunner().invoke(app, [*arguments, "--dry-run"]).exception, UntrustworthyError)
    assert isinstance(CliRunner().invoke(app, arguments).exception, InputError)  # no -o
