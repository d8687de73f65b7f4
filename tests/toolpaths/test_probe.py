"""Closed loop: what a probe found on the cut part is taken apart, corrected, or handed on."""

from __future__ import annotations

import json
from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest

from drake_stiffness.errors import InputError
from toolpaths import job
from toolpaths.probing.handover import campaign_files
from toolpaths.probing.path_places import places_on_path
from toolpaths.probing.probe import read_probe

SHIFT = np.array([0.12, -0.07, 0.04])
NOISE = 0.004


def write_table(path, rows, header):
    path.write_text("\n".join([",".join(header), *(",".join(f"{v:.9g}" for v in row) for row in rows)]) + "\n")
    return read_probe(path)


@pytest.fixture(scope="module")
def square(tools):
    """A square path whose force turns with the feed, so that its size and a shift of the part can be told apart."""
    corners = [(0, 0), (200, 0), (200, 200), (0, 200), (0, 0)]
    points = []
    for a, b in pairwise(corners):
        points += [np.add(a, np.multiply(t, np.subtract(b, a))) for t in np.arange(0.1, 1.01, 0.1)]
    return tools.program(*(f"LIN {{X {x:.4f},Y {y:.4f},Z 0.0000,A 0.0000,B 0.0000,C 180.0000}}" for x, y in points))


@pytest.fixture(scope="module")
def process(tools):
    return tools.process(force=tools.constant("path", fx_N=-250, fy_N=400, fz_N=-100))


@pytest.fixture(scope="module")
def plain(square, model, process):
    return job.compensate(square, model, process)


def actual_mm(model, process, program_result, factor, q):
    """Where the tool of the same model really is less where the program wants it, with another force; base frame."""
    path = program_result.path
    p = path.bench.actual(q, factor * path.wrench)[1]
    return (p.T - path.p) @ process.base[0] * 1e3


def probed(plain, model, process, q, tmp_path, factor=1.0, shift=SHIFT, rest=None, seed=0, normal=False):
    """A probe table of every second point, cut with joints q."""
    rng = np.random.default_rng(seed)
    some = np.arange(0, plain.rows.size, 2)
    deviation = actual_mm(model, process, plain, factor, q)[some] + shift
    if rest is not None:
        deviation = deviation + rest(plain.target_mm[some])
    deviation = deviation + rng.normal(0, NOISE, deviation.shape)
    if normal:
        n = np.tile([0.6, 0.0, 0.8], (some.size, 1))
        n[::2] = [0.0, 1.0, 0.0]
        n[1::4] = [0.8, 0.0, -0.6]
        rows = np.hstack(
            [plain.target_mm[some], (deviation * n).sum(axis=1)[:, None], n, np.full((some.size, 1), NOISE)]
        )
        header = ["x_mm", "y_mm", "z_mm", "deviation_mm", "nx", "ny", "nz", "sigma_mm"]
    else:
        rows = np.hstack([plain.target_mm[some], deviation, np.full((some.size, 1), NOISE)])
        header = ["x_mm", "y_mm", "z_mm", "dx_mm", "dy_mm", "dz_mm", "sigma_mm"]
    return write_table(tmp_path / "probe.csv", rows, header)


def test_a_model_that_is_right_leaves_nothing_to_learn(plain, square, model, process, tmp_path):
    probe = probed(plain, model, process, plain.path.postures.q, tmp_path, shift=0)
    result = job.compensate(square, model, process, probe=probe)
    learnt = result.learnt
    assert not learnt.systematic
    assert np.abs(learnt.shift_mm).max() < 5 * NOISE
    assert abs(learnt.force_error) < 4 * learnt.force_error_sigma
    assert np.linalg.norm(result.correction_mm - plain.correction_mm, axis=1).max() < 4 * NOISE


@pytest.mark.parametrize("cut_with", ["uncorrected", "corrected"])
@pytest.mark.parametrize("normal", [False, True])
def test_a_shifted_workpiece_and_a_larger_force_are_named_and_taken_away(
    plain, square, model, process, tmp_path, cut_with, normal
):
    q = plain.path.postures.q if cut_with == "uncorrected" else _printed_joints(plain)
    probe = probed(plain, model, process, q, tmp_path, factor=1.15, normal=normal)
    result = job.compensate(square, model, process, probe=probe, cut_with=cut_with)
    learnt = result.learnt
    assert learnt.force_told_apart
    assert learnt.force_error == pytest.approx(0.15, abs=4 * learnt.force_error_sigma + 0.003)
    np.testing.assert_allclose(learnt.shift_mm, SHIFT, atol=4 * learnt.shift_sigma_mm.max() + 0.002)
    assert not learnt.systematic
    left = actual_mm(model, process, plain, 1.15, _printed_joints(result)) + SHIFT
    before = actual_mm(model, process, plain, 1.15, _printed_joints(plain)) + SHIFT
    assert np.linalg.norm(left, axis=1).max() < 0.05 * np.linalg.norm(before, axis=1).max() + 3 * NOISE


def test_a_turned_workpiece_is_named_by_its_axis_and_taken_away(plain, square, model, process, tmp_path):
    turn = np.array([0.4, -0.3, 0.8])  # mrad
    some = plain.target_mm[::2]
    turned = np.cross(turn * 1e-3, plain.target_mm - some.mean(axis=0))
    probe = probed(plain, model, process, plain.path.postures.q, tmp_path, shift=turned[::2])
    result = job.compensate(square, model, process, probe=probe)
    np.testing.assert_allclose(result.learnt.turn_mrad, turn, atol=4 * result.learnt.turn_sigma_mrad.max())
    left = actual_mm(model, process, plain, 1.0, _printed_joints(result)) + turned
    assert np.linalg.norm(left, axis=1).max() < 0.2 * np.linalg.norm(turned, axis=1).max()


def _printed_joints(result):
    """Joints that the corrected numbers command: the model's own mirror, to a printed digit."""
    from toolpaths.compensation import mirror

    path = result.path
    aim = None if result.learnt is None else result.learnt.aim
    return mirror(path.bench, path.postures.q, path.wrench, path.only, path.postures.free, aim=aim).q


def bump(p):
    """0.08 mm across a hundred millimetres of one side: nothing that a shift, a turn or a force could be."""
    out = np.zeros_like(p)
    out[:, 2] = 0.08 * np.exp(-0.5 * ((p[:, 0] - 100) / 30) ** 2 - 0.5 * (p[:, 1] / 20) ** 2)
    return out


def test_a_rest_that_neighbours_share_is_corrected_where_it_was_seen_and_handed_to_diagnose(
    plain, square, model, process, tmp_path
):
    probe = probed(plain, model, process, plain.path.postures.q, tmp_path, rest=bump)
    result = job.compensate(square, model, process, probe=probe)
    learnt = result.learnt
    assert learnt.systematic
    assert learnt.corrected_rest
    assert any("diagnose" in note for note in result.notes)
    left = actual_mm(model, process, plain, 1.0, _printed_joints(result)) + SHIFT + bump(plain.target_mm)
    at = int(bump(plain.target_mm)[:, 2].argmax())
    assert np.linalg.norm(left[at]) < 0.025
    assert np.sqrt((left**2).sum(axis=1).mean()) < 0.4 * np.sqrt((bump(plain.target_mm) ** 2).sum(axis=1).mean())


def test_one_outlier_is_said_but_not_chased(plain, square, model, process, tmp_path):
    def spike(p):
        out = np.zeros_like(p)
        out[7, 2] = 0.3
        return out

    probe = probed(plain, model, process, plain.path.postures.q, tmp_path, rest=spike)
    result = job.compensate(square, model, process, probe=probe)
    assert result.learnt.systematic
    assert not result.learnt.corrected_rest
    assert any("left alone" in note for note in result.notes)


def test_under_one_constant_force_a_shift_and_the_force_s_size_look_alike(square, model, plain, tools, tmp_path):
    process = tools.process()
    result = job.compensate(square, model, process)
    probe = probed(result, model, process, result.path.postures.q, tmp_path, factor=1.1)
    again = job.compensate(square, model, process, probe=probe)
    assert not again.learnt.force_told_apart
    assert any("look alike" in note for note in again.notes)
    left = actual_mm(model, process, result, 1.1, _printed_joints(again)) + SHIFT
    assert np.linalg.norm(left, axis=1).max() < 0.03  # their sum is what is corrected


def test_what_is_handed_over_is_a_campaign_that_our_reader_takes(plain, square, model, process, tmp_path, arm_folder):
    """Its displacements are predicted by the model that it was cut with, to the noise: the shift of the part is taken off."""
    from drake_stiffness.simulation import simulate_displacement
    from drake_stiffness.task import read_task

    probe = probed(plain, model, process, plain.path.postures.q, tmp_path)
    result = job.compensate(square, model, process, probe=probe)
    of_cell = process.model_copy(update={"cell": str(arm_folder / "cell.yaml")})
    for name, content in campaign_files(model, of_cell, result.path, result.learnt).items():
        (tmp_path / name).write_text(content)
    task = read_task(tmp_path / "campaign.yaml")
    assert task.campaign.noise.position_sigma_mm == pytest.approx(NOISE, rel=0.01)
    m = task.measurements
    loaded = np.flatnonzero(~m.unloaded[m.case])
    assert loaded.size == probe.size
    same = replace(model, points=dict(task.cell.reference_points_m))
    same = replace(same, points={name: np.array(p) for name, p in same.points.items()})
    predicted = simulate_displacement(same, m.cases, m.case[loaded], m.point[loaded]).dp
    first = np.array(
        [
            np.flatnonzero((m.cases.experiment[m.case] == e) & m.unloaded[m.case])[0]
            for e in m.cases.experiment[m.case[loaded]]
        ]
    )
    seen = (m.position[loaded] - m.position[first]).T
    np.testing.assert_allclose((seen - predicted) * 1e3, 0.0, atol=6 * NOISE)


def test_with_the_corrected_program_displacements_are_counted_from_what_was_commanded(
    plain, square, model, process, tmp_path
):
    """The tool stands where it was wanted, so from the commanded pose it is displaced by minus the correction."""
    q = _printed_joints(plain)
    probe = probed(plain, model, process, q, tmp_path, shift=0)
    result = job.compensate(square, model, process, probe=probe, cut_with="corrected")
    rows = campaign_files(model, process, result.path, result.learnt)["measurements.csv"].splitlines()
    names = rows[0].split(",")
    moved = [float(rows[2].split(",")[names.index(name)]) for name in ("dx_mm", "dy_mm", "dz_mm")]
    np.testing.assert_allclose(moved, -plain.correction_mm[0], atol=5 * NOISE)  # base frame parallel to the world


@pytest.mark.parametrize(
    ("header", "row", "says"),
    [
        ("x_mm,y_mm,z_mm", "0,0,0", "either dx_mm"),
        ("x_mm,y_mm,z_mm,deviation_mm", "0,0,0,0.1", "column 'nx' is missing"),
        ("x_mm,y_mm,z_mm,deviation_mm,nx,ny,nz", "0,0,0,0.1,0,0,0.5", "length 0.5"),
        ("x_mm,y_mm,z_mm,dx_mm,dy_mm,dz_mm", "0,0,0,100,0,0", "100 mm"),
        ("x_mm,y_mm,z_mm,dx_mm,dy_mm,dz_mm,sigma_mm", "0,0,0,0.1,0,0,0", "sigma is 0"),
        ("x_mm,y_mm,z_mm,dx,dy_mm,dz_mm", "0,0,0,0.1,0,0", "unknown column 'dx'"),
    ],
)
def test_tables_that_say_nothing_are_refused_with_what_is_missing(tmp_path, header, row, says):
    (tmp_path / "p.csv").write_text(f"{header}\n{row}\n")
    with pytest.raises(InputError, match=says.replace("(", r"\(")):
        read_probe(tmp_path / "p.csv")


def test_places_that_no_motion_cut_are_refused_or_left_out(plain, square, model, process, tmp_path):
    far = write_table(
        tmp_path / "far.csv", [[5000, 0, 0, 0.1, 0, 0]], ["x_mm", "y_mm", "z_mm", "dx_mm", "dy_mm", "dz_mm"]
    )
    with pytest.raises(InputError, match="program's base frame"):
        job.compensate(square, model, process, probe=far)
    probe = probed(plain, model, process, plain.path.postures.q, tmp_path)
    nominal = probe.nominal_mm.copy()
    nominal[3] += 500
    result = job.compensate(square, model, process, probe=replace(probe, nominal_mm=nominal))
    assert result.learnt.probe.size == probe.size - 1
    assert any("were not used" in note for note in result.notes)


def test_a_place_is_found_on_the_nearest_step_or_on_the_line_it_names():
    target = np.array([[0.0, 0, 0], [100, 0, 0], [100, 100, 0], [0, 5, 0], [100, 5, 0]])
    begin = np.array([True, False, False, True, False])
    line = np.array([1, 2, 3, 4, 5])
    wanted = np.array([[30.0, 1, 0], [30, 1, 0], [30, 4, 7]])
    found = places_on_path(target, begin, line, wanted, np.array([-1, 5, -1]))
    assert found.after.tolist() == [1, 4, 4]
    np.testing.assert_allclose(found.t, 0.3)
    np.testing.assert_allclose(found.distance_mm, [1, 4, np.hypot(1, 7)])
    assert found.at(target[:, 0]).tolist() == pytest.approx([30, 30, 30])


def test_the_json_of_a_probe_holds_no_nan(plain, square, model, process, tmp_path):
    from drake_stiffness.files import json_text

    probe = probed(plain, model, process, plain.path.postures.q, tmp_path)
    document = json.loads(json_text(job.compensate(square, model, process, probe=probe).to_dict()))["probe"]
    assert document["force"]["told_apart_from_a_shift"]
    assert document["hand_to"] is None


def test_the_command_corrects_a_probed_part_and_hands_the_rest_on(plain, square, model, process, tmp_path):
    from typer.testing import CliRunner

    from drake_stiffness.cli import app

    probed(plain, model, process, plain.path.postures.q, tmp_path, rest=bump)
    model.save(tmp_path / "model.json")
    (tmp_path / "p.src").write_bytes(square.raw)
    (tmp_path / "process.yaml").write_text(
        "workpiece: {position_m: [1.65, -0.10, 0.75]}\nposture_deg: [0, -70, 120, 0, -50, 0]\n"
        "force: {constant: {fx_N: -250, fy_N: 400, fz_N: -100, frame: path}}\n"
    )
    (tmp_path / "rest").mkdir()
    words = "compensate p.src --model model.json --process process.yaml -o second.src --measured probe.csv --handover rest --json c.json"
    names = ("p.src", "model.json", "process.yaml", "second.src", "probe.csv", "rest", "c.json")
    done = CliRunner().invoke(app, [str(tmp_path / w) if w in names else w for w in words.split()])
    assert done.exit_code == 0, done.output
    assert json.loads((tmp_path / "c.json").read_text())["probe"]["hand_to"] == "diagnose"
    assert {f.name for f in (tmp_path / "rest").iterdir()} == {"campaign.yaml", "cell.yaml", "measurements.csv"}
    assert (tmp_path / "second.src").read_bytes() != plain.raw
