"""Where the cell is stiff: each place as if asked alone, the loaded equilibrium as second opinion, and what cannot be machined."""

from __future__ import annotations

import csv
import io

import numpy as np
import pytest
from command_line import call

from drake_stiffness.effects.effect import Cases
from drake_stiffness.equilibrium import solve_equilibrium
from toolpaths.compensation import bench_of
from toolpaths.loaded_path import loaded_path
from toolpaths.postures import along_path
from toolpaths.process import posture
from toolpaths.stiffness_map import OUT_OF_REACH, SOUND, grid, stiffness_map

PLACES = grid([1.3, -0.4, 0.7], [2.1, 0.4, 0.7], 0.2)


@pytest.fixture(scope="module")
def process(model):
    from toolpaths.process import Process

    return Process.model_validate(
        {
            "workpiece": {"position_m": [1.65, -0.10, 0.75]},
            "posture_deg": [0, -70, 120, 0, -50, 0],
            "force": {"constant": {"fx_N": 240, "fy_N": 180, "fz_N": -400, "frame": "tool"}},
        }
    )


@pytest.fixture(scope="module")
def mapped(model, process):
    return stiffness_map(model, process, PLACES)


def test_the_grid_has_both_ends_and_neighbours_follow_each_other():
    assert PLACES.shape == (25, 3)
    np.testing.assert_allclose(PLACES.min(axis=0), [1.3, -0.4, 0.7])
    np.testing.assert_allclose(PLACES.max(axis=0), [2.1, 0.4, 0.7])
    assert np.linalg.norm(np.diff(PLACES, axis=0), axis=1).max() < 0.21


def test_a_hundred_newtons_bend_the_arm_by_what_the_loaded_equilibrium_says(mapped, model, process):
    """Second way: joints by the path solver, three loads, loaded minus unloaded."""
    place = 7
    start = posture(process, model)
    bench = bench_of(model, "unloaded", False)
    R, _ = bench.commanded(start[:, None])
    R_WE = R.transpose(2, 0, 1) @ bench.R_ET.T
    p_WE = PLACES[place] - R_WE[0] @ bench.p_ET
    q = along_path(model.arm, R_WE, p_WE[None], start, {}).q
    for axis in range(3):
        wrench = np.zeros((6, 1))
        wrench[axis] = 100.0
        cases = Cases(q, wrench, bench.p_ET)
        loaded, unloaded = solve_equilibrium(bench.loaded, cases), solve_equilibrium(bench.loaded, cases.unloaded())
        tool = [(e.p_E + np.einsum("ijn,j->in", e.R_E, bench.p_ET))[:, 0] for e in (loaded, unloaded)]
        bent = 1e6 * np.linalg.norm(tool[0] - tool[1])
        assert mapped.along_um[place, axis] == pytest.approx(bent, rel=0.02)


def test_the_worst_direction_is_no_better_than_any_axis_and_no_worse_than_all_together(mapped):
    sound = mapped.state == SOUND
    assert sound.sum() > 15
    along = mapped.along_um[sound]
    assert (mapped.worst_um[sound] >= along.max(axis=1) - 1e-9).all()
    assert (mapped.worst_um[sound] <= np.linalg.norm(along, axis=1) + 1e-9).all()


def test_places_out_of_reach_have_no_number_and_are_named(model, process):
    found = stiffness_map(model, process, np.array([[1.7, 0.0, 0.7], [4.0, 0.0, 0.7]]))
    assert found.state.tolist()[:2] == [SOUND, OUT_OF_REACH]
    assert np.isnan(found.measure[1])
    assert found.best == 0 or found.best == found.here


def test_a_program_is_judged_where_it_lies_as_by_its_own_path(model, process, pocket):
    found = stiffness_map(model, process, np.array([[1.65, -0.10, 0.75], [1.5, 0.3, 0.7]]), pocket)
    path = loaded_path(pocket, model, process, lambda *_: None)
    from drake_stiffness.simulation import linear_displacement

    bench = path.bench
    move = linear_displacement(bench.loaded, path.postures.q.T, path.wrench.T, bench.p_ET, bench.p_ET)
    assert found.mean_mm[0] == pytest.approx(1e3 * np.linalg.norm(move[:, :3], axis=1).mean(), rel=0.02)
    assert found.mean_mm[0] == pytest.approx(found.mean_mm[found.here])
    assert found.mean_mm[1] < found.mean_mm[0]


def test_the_command_writes_table_report_and_json(tmp_path, model):
    model.save(tmp_path / "model.json")
    (tmp_path / "process.yaml").write_text(
        "workpiece: {position_m: [1.65, -0.1, 0.75]}\nposture_deg: [0, -70, 120, 0, -50, 0]\n"
        "force: {constant: {fz_N: -400, frame: tool}}\n"
    )
    words = (
        "map",
        "--model",
        "model.json",
        "--process",
        "process.yaml",
        "--area",
        "1.4:1.8,-0.2:0.2",
        "--step-mm",
        "200",
    )
    done = call(*words, "-o", "map.csv", "--report", "map.html", "--json", "map.json", folder=tmp_path)
    assert done.code == 0, done.err
    rows = list(csv.DictReader(io.StringIO((tmp_path / "map.csv").read_text())))
    assert len(rows) == 9
    assert {row["z_m"] for row in rows} == {"0.75"}
    assert "Best place" in (tmp_path / "map.html").read_text()
    assert "10 of 10 places can be machined" in done.out


@pytest.mark.parametrize(
    ("area", "said"),
    [("1:2", "expected x0:x1"), ("2:1,0:1", "the smaller end first"), ("1200:2000,-500:500", "not millimetres"), ("a:b,0:1", "found 'a:b,0:1'")],
)  # fmt: skip
def test_an_area_that_cannot_be_meant_is_refused(tmp_path, model, area, said):
    model.save(tmp_path / "model.json")
    (tmp_path / "process.yaml").write_text(
        "posture_deg: [0, -70, 120, 0, -50, 0]\nforce: {constant: {fz_N: -400, frame: tool}}\n"
    )
    done = call("map", "--model", "model.json", "--process", "process.yaml", "--area", area, folder=tmp_path)
    assert done.code == 2
    assert said in done.err


def test_an_area_beyond_reach_is_refused_and_nothing_is_written(tmp_path, model):
    model.save(tmp_path / "model.json")
    (tmp_path / "cut.csv").write_text("x_mm,y_mm,z_mm\n0,0,0\n10,0,0\n")
    (tmp_path / "process.yaml").write_text(
        "workpiece: {position_m: [9, 0, 0]}\nposture_deg: [0, -70, 120, 0, -50, 0]\n"
        "force: {constant: {fz_N: -400, frame: tool}}\n"
    )
    words = ("map", "--model", "model.json", "--process", "process.yaml", "--program", "cut.csv", "-o", "m.csv")
    done = call(*words, folder=tmp_path)
    assert done.code == 2
    assert "no place of the area can be machined (out of reach)" in done.err
    assert not (tmp_path / "m.csv").exists()
