"""Exports of trackers, force sensors and robots come back as the measurements they were."""

import csv

import numpy as np
import pytest
from tracker_exports import (
    JOINTS,
    NAMES,
    START,
    force_log,
    make_folder,
    measurements_text,
    rows_of,
    tracker_a,
    tracker_b,
    tracker_c,
    write_lines,
    write_map,
)

from drake_stiffness.campaign import read_measurements
from drake_stiffness.importing.readings import import_readings


@pytest.fixture
def folder(tmp_path):
    return make_folder(tmp_path)


def read(path, arms, cells):
    points = tuple(cells["kr270"].reference_points_m)
    return read_measurements(path, arms["kr270"], points, np.zeros(3), readings=True)


def by_key(m):
    """Readings by experiment, step and point: joints, wrench, position, time."""
    e, step = m.cases.experiment[m.case], m.cases.step[m.case]
    return {
        (m.experiments[e[i]], int(step[i]), str(m.point[i])): (
            m.cases.q[:, m.case[i]], m.cases.wrench[:, m.case[i]], m.position[i]
        )
        for i in range(m.case.size)
    }  # fmt: skip


def same(folder, result, arms, cells, *, force_N=5e-4, metres=1e-9):
    """The imported table holds the readings of the original to the printed digit."""
    (folder / "measurements.csv").write_text(result.text)
    got, want = (by_key(read(folder / n, arms, cells)) for n in ("measurements.csv", "original.csv"))
    assert got.keys() == want.keys()
    for key, (q, wrench, p) in want.items():
        np.testing.assert_allclose(got[key][0], q, atol=1e-12)
        np.testing.assert_allclose(got[key][1], wrench, atol=force_N)
        np.testing.assert_allclose(got[key][2], p, atol=metres)


@pytest.mark.parametrize("tracker", [tracker_a, tracker_b, tracker_c])
def test_three_trackers_give_back_the_same_measurements(folder, arms, cells, tracker):
    start = START.isoformat() if tracker is tracker_c else None
    result = import_readings(write_map(folder, readings=tracker(folder), start=start))
    same(folder, result, arms, cells)
    assert (result.rows, result.experiments, result.steps, result.points) == (84, 4, 28, ("P1", "P2", "P3"))
    assert result.unmatched == result.missing == result.warnings == []
    assert result.dropped == (["a.txt, line 4"] if tracker is tracker_a else [])
    # steps 0, 3 and 6 of every experiment are unloaded: their scatter is the tracker's, 12 um
    assert result.repeat_sigma_mm == pytest.approx(0.012, rel=0.25)


def test_a_force_log_is_matched_by_time_turned_and_taken_as_reaction(folder, arms, cells):
    forces = force_log(folder)
    result = import_readings(write_map(folder, readings=tracker_c(folder), forces=forces, start=START.isoformat()))
    same(folder, result, arms, cells)
    assert result.warnings == []


def test_a_column_of_temperatures_comes_along(folder, arms, cells):
    """Any column of numbers will do for a thermometer: here the clock."""
    result = import_readings(write_map(folder, readings=tracker_a(folder) | {"temperature_degC": "Zeit"}))
    same(folder, result, arms, cells)
    for row in csv.DictReader((folder / "measurements.csv").open()):
        assert float(row["temperature_degC"]) == pytest.approx(float(row["time_s"]), abs=0.006)


def test_without_a_plan_the_logs_say_postures_and_loads(folder, arms, cells):
    lines = ["id,nr," + ",".join(f"A{k}" for k in range(1, 7)) + ",F"]
    rng = np.random.default_rng(1)
    rows = [row for row in rows_of(folder) if int(row["step"]) < 4]
    for row in rows:
        if row["point"] == "P1":
            angles = [float(row[f"{j}_deg"]) + rng.uniform(-1, 1) * 1e-7 for j in JOINTS]
            lines.append(
                ",".join(
                    [row["experiment"], row["step"], *(f"{a:.8f}" for a in angles), f"{-float(row['fz_N']) / 9.81:.9f}"]
                )
            )
    write_lines(folder / "robot.csv", lines)
    match = {"by": "columns", "experiment": "id", "step": "nr"}
    joints = {"file": "robot.csv", "columns": {j: f"A{k}" for k, j in enumerate(JOINTS, 1)}, "match": match}
    forces = {"file": "robot.csv", "column": "F", "along": "-z", "unit": "kg", "match": match}
    result = import_readings(
        write_map(folder, plan=None, readings=tracker_a(folder, rows), joints=joints, forces=forces)
    )
    (folder / "original.csv").write_text(measurements_text(rows))
    (folder / "measurements.csv").write_text(result.text)
    got, want = (by_key(read(folder / n, arms, cells)) for n in ("measurements.csv", "original.csv"))
    assert got.keys() == want.keys()
    for key, (q, wrench, p) in want.items():
        np.testing.assert_allclose(got[key][0], q, atol=1e-7)
        np.testing.assert_allclose(got[key][1], wrench, atol=1e-3)
        np.testing.assert_allclose(got[key][2], p, atol=1e-9)


def test_several_samples_are_averaged_and_their_scatter_is_said(folder, arms, cells):
    rng = np.random.default_rng(2)
    rows = []
    for row in rows_of(folder):
        noise = rng.normal(scale=0.02, size=(2, 3))
        for off in (*noise, -noise.sum(axis=0)):  # three samples whose mean is the reading
            rows.append(row | {f"{a}_mm": f"{float(row[f'{a}_mm']) + off[c]:.7f}" for c, a in enumerate("xyz")})
    readings = tracker_a(folder, rows)
    result = import_readings(write_map(folder, readings=readings, samples="mean"))
    same(folder, result, arms, cells, metres=2e-9)
    assert result.rows == 84
    off = [float(row["x_mm"]) for row in rows]
    assert result.sample_sigma_mm == pytest.approx(
        np.sqrt(np.mean(np.var(np.reshape(off, (-1, 3)), axis=1, ddof=1))), rel=0.2
    )
    kept = import_readings(write_map(folder, readings=readings, samples="keep"))
    (folder / "kept.csv").write_text(kept.text)
    assert read(folder / "kept.csv", arms, cells).case.size == 3 * 84


def test_every_point_may_have_a_file_of_its_own(folder, arms, cells):
    entries = []
    for name in NAMES:
        own = [row for row in rows_of(folder) if row["point"] == name]
        lines = [
            "X,Y,Z,exp,n",
            *(",".join([row["x_mm"], row["y_mm"], row["z_mm"], row["experiment"], row["step"]]) for row in own),
        ]
        write_lines(folder / f"{name}.csv", lines)
        entries.append(
            {
                "file": f"{name}.csv",
                "unit": "mm",
                "point": name,
                "columns": {"x": "X", "y": "Y", "z": "Z"},
                "match": {"experiment": "exp", "step": "n"},
            }
        )
    same(folder, import_readings(write_map(folder, readings=entries)), arms, cells)


def test_displacements_in_inches_stay_displacements(folder, arms, cells):
    rows = rows_of(folder)
    zero = {(r["experiment"], r["point"]): r for r in rows if r["step"] == "0"}
    lines = ["e,s,p,dX,dY,dZ"]
    for row in rows:
        start = zero[row["experiment"], row["point"]]
        d = [(float(row[f"{a}_mm"]) - float(start[f"{a}_mm"])) / 25.4 for a in "xyz"]
        lines.append(",".join([row["experiment"], row["step"], row["point"], *(f"{v:.10f}" for v in d)]))
    write_lines(folder / "d.csv", lines)
    readings = {
        "file": "d.csv", "quantity": "displacement", "unit": "inch", "columns": {"x": "dX", "y": "dY", "z": "dZ"},
        "point_column": "p", "match": {"experiment": "e", "step": "s"},
    }  # fmt: skip
    (folder / "measurements.csv").write_text(import_readings(write_map(folder, readings=readings)).text)
    m = read(folder / "measurements.csv", arms, cells)
    assert m.relative
    want = by_key(read(folder / "original.csv", arms, cells))
    for (name, step, point), (_, _, p) in by_key(m).items():
        np.testing.assert_allclose(p, want[name, step, point][2] - want[name, 0, point][2], atol=2e-9)


def test_a_sensor_on_the_flange_turns_with_it_and_its_moment_moves_to_the_load_point(folder, arms, cells):
    """A pure force at the load point, read at the flange in the flange's axes, is that force and no moment."""
    from drake_stiffness.arm import forward

    rows = [row for row in rows_of(folder) if row["point"] == "P1"]
    q = np.deg2rad([[float(row[f"{j}_deg"]) for j in JOINTS] for row in rows]).T
    R = forward(arms["kr270"], q).R_E
    lines = ["e,s,fx,fy,fz,mx,my,mz"]
    lever = np.array([0.15, 0.05, 0.25])  # the load point of the cell, flange frame
    for i, row in enumerate(rows):
        f = R[:, :, i].T @ np.array([float(row[f"f{a}_N"]) for a in "xyz"]) + [3.0, -2.0, 1.0]
        moment = np.cross(lever, f - [3.0, -2.0, 1.0])
        lines.append(",".join([row["experiment"], row["step"], *(f"{v:.9f}" for v in [*f, *moment])]))
    write_lines(folder / "f.csv", lines)
    forces = {
        "file": "f.csv", "unit": "N", "frame": "flange", "moments_at_m": [0, 0, 0], "tare": True,
        "columns": {n: n for n in ("fx", "fy", "fz", "mx", "my", "mz")}, "match": {"experiment": "e", "step": "s"},
    }  # fmt: skip
    result = import_readings(write_map(folder, readings=tracker_a(folder), forces=forces))
    same(folder, result, arms, cells)
