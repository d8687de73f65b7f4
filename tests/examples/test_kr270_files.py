"""The committed files of the example: independent of the packages, reproducible, and what the formats ask for."""

from __future__ import annotations

import ast
import csv
import io
from pathlib import Path

import make_campaign
import make_program
import numpy as np
import pytest
import yaml
from plants import oracle
from plants.chain import read_chain
from plants.krl_reader import from_frames, parse_program, read_program, to_frames, with_poses
from plants.mirror import compensate
from plants.process import Process
from plants.readings import read_measurements
from plants.replay import replay, replay_files
from plants.rigid_ik import tool_poses
from plants.segmented_arm import SegmentedArm

EXAMPLES = Path(__file__).parents[2] / "examples"
KR270 = EXAMPLES / "kr270"


@pytest.fixture(scope="module")
def arm() -> SegmentedArm:
    return SegmentedArm.from_files(KR270 / "kr270.urdf", KR270 / "true_arm.yaml")


@pytest.mark.parametrize("path", sorted((EXAMPLES / "plants").glob("*.py")), ids=lambda path: path.name)
def test_plants_stand_alone(path: Path) -> None:
    tree = ast.parse(path.read_text(encoding="utf-8"))
    names: list[str] = []
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            names += [alias.name for alias in node.names]
        elif isinstance(node, ast.ImportFrom) and node.level == 0:
            names.append(node.module or "")
        elif isinstance(node, ast.Call) and isinstance(node.func, ast.Name):
            assert node.func.id not in ("print", "__import__")
    tops = {name.split(".")[0] for name in names}
    assert not tops & {"drake_stiffness", "toolpaths", "importlib"}
    assert "pydrake.all" not in names


def test_arm_has_the_public_measures() -> None:
    chain = read_chain(KR270 / "kr270.urdf")
    assert chain.joint_names == tuple(f"joint_{k}" for k in range(1, 7))
    assert chain.link_names == ("base_link", *(f"link_{k}" for k in range(1, 7)))
    np.testing.assert_allclose(chain.masses, [226.0, 367.4, 232.1, 191.5, 47.9, 23.7, 12.2])
    limits = np.array([[-185, 185], [-140, -5], [-120, 155], [-350, 350], [-125, 125], [-350, 350]])
    np.testing.assert_allclose(np.rad2deg(np.column_stack([chain.lower, chain.upper])), limits)
    R, p = chain.flange(np.zeros((1, 6)))
    np.testing.assert_allclose(p[0], [0.35 + 1.15 + 1.2 + 0.24, 0.0, 0.675 - 0.041], atol=1e-12)
    np.testing.assert_allclose(R[0, :, 2], [1.0, 0.0, 0.0], atol=1e-12)
    jacobian = chain.jacobian(np.zeros((1, 6)), np.zeros(3))[0]
    np.testing.assert_allclose(
        jacobian[3:].T, [[0, 0, -1], [0, 1, 0], [0, 1, 0], [-1, 0, 0], [0, 1, 0], [-1, 0, 0]], atol=1e-12
    )
    assert np.all(np.linalg.norm(chain.end_p, axis=1) > 0.05)


def test_cells_differ_in_links_alone() -> None:
    full, joints = (
        yaml.safe_load((KR270 / name).read_text(encoding="utf-8")) for name in ("cell.yaml", "cell_joints_only.yaml")
    )
    assert joints["springs"].pop("links") == "none"
    assert full["springs"].pop("links") == "all"
    assert full == joints
    truth = yaml.safe_load((KR270 / "true_arm.yaml").read_text(encoding="utf-8"))
    assert {name: full["tool"][name] for name in truth["tool"]} == truth["tool"]
    points = np.array(list(full["reference_points_m"].values()))
    assert np.linalg.matrix_rank(points[1:] - points[0], tol=0.05) == 2
    assert np.linalg.norm(points[:, :2], axis=1).min() > 0.1
    force = yaml.safe_load((KR270 / "process.yaml").read_text(encoding="utf-8"))["force"]["constant"]
    assert np.linalg.norm([force["fx_N"], force["fy_N"], force["fz_N"]]) == pytest.approx(500.0)


def test_measurements_are_what_the_script_makes(arm: SegmentedArm) -> None:
    """Text equal but for the last printed digit, which another machine's arithmetic may round the other way."""
    made = list(csv.DictReader(io.StringIO(make_campaign.make_table(arm, make_campaign.instruments()))))
    with (KR270 / "measurements.csv").open(encoding="utf-8", newline="") as file:
        committed = list(csv.DictReader(file))
    assert len(made) == len(committed) == 30 * 7 * 3
    positions = ("x_mm", "y_mm", "z_mm")
    for new, old in zip(made, committed, strict=True):
        assert {k: v for k, v in new.items() if k not in positions} == {
            k: v for k, v in old.items() if k not in positions
        }
        assert [float(new[k]) for k in positions] == pytest.approx([float(old[k]) for k in positions], abs=1.1e-5)
    assert {row["note"] for row in committed} == {"simulated"}
    starts = [float(row["time_s"]) for row in committed if row["step"] == "0" and row["point"] == "P1"]
    assert len(set(starts)) == 30
    assert starts != sorted(starts)


def test_readings_are_the_true_arm_plus_stated_noise(arm: SegmentedArm) -> None:
    tools = make_campaign.instruments()
    data = read_measurements(KR270 / "measurements.csv", arm.chain.joint_names, tools.points)
    R, p = arm.poses(data.q, data.wrench, tools.load_point)
    exact = p[data.state] + np.einsum("mij,mj->mi", R[data.state], data.target)
    assert (data.position - exact).std() == pytest.approx(12e-6, rel=0.05)
    levels = np.unique(np.round(np.linalg.norm(data.wrench[:, :3], axis=1)))
    np.testing.assert_allclose(levels, [0, 1250, 1750, 2500, 3500])
    margin = np.rad2deg(np.minimum(data.q - arm.chain.lower, arm.chain.upper - data.q).min())
    assert margin > 5.0


def test_program_is_what_the_script_makes() -> None:
    data = (KR270 / "pocket.src").read_bytes()
    assert data == make_program.program_text().encode("ascii")
    assert data.count(b"\n") == data.count(b"\r\n")
    program = parse_program(data.decode("ascii"))
    assert sum(kind == "LIN" for kind in program.kinds) >= 500
    assert program.kinds.count("CIRC") == 4
    assert program.kinds.count("PTP") == 1
    assert not np.any(np.all(program.poses[:, :3] == [0.0, 0.0, 80.0], axis=1)), "a comment was read as a motion"
    assert np.ptp(program.poses[:, 3:], axis=0).min() > 5.0
    assert with_poses(program, program.poses) == program.text


def test_program_is_reached_away_from_limits_and_singularities(arm: SegmentedArm) -> None:
    chain, job, program = arm.chain, Process.from_file(KR270 / "process.yaml"), read_program(KR270 / "pocket.src")
    q = job.joints(chain, program)
    R, p = tool_poses(chain, q, job.tool)
    wanted_R, wanted_p = to_frames(program.poses[program.cutting])
    np.testing.assert_allclose(R, job.workpiece_R @ wanted_R, atol=1e-9)
    np.testing.assert_allclose(p, job.workpiece_p + wanted_p @ job.workpiece_R.T, atol=1e-9)
    assert np.rad2deg(np.minimum(q - chain.lower, chain.upper - q)).min() > 10.0
    assert np.rad2deg(np.abs(q[:, 4])).min() > 10.0
    # The longest step, 0.6 rad, is the finishing pass along a whole wall.
    assert np.abs(np.diff(q, axis=0)).max() < 0.7
    printed = job.poses(chain, q, program.poses[program.cutting])
    np.testing.assert_allclose(printed, program.poses[program.cutting], atol=1e-6)


def test_angles_stay_on_the_branch_of_the_program() -> None:
    poses = np.array([[1.0, 2.0, 3.0, 179.9, 10.0, -179.9], [0.0, 0.0, 0.0, -350.0, 100.0, 30.0]])
    near = poses + [0.0, 0.0, 0.0, 0.3, -0.2, 0.3]
    np.testing.assert_allclose(from_frames(*to_frames(poses), near), poses, atol=1e-9)


def test_oracle_fits_and_compensates(arm: SegmentedArm, tmp_path: Path) -> None:
    """From a start that is off by a factor of two, on the committed readings, to a corrected program."""
    tools = make_campaign.instruments()
    kept = [f"E{k:02d}" for k in range(1, 31) if k % 4]
    data = read_measurements(KR270 / "measurements.csv", arm.chain.joint_names, tools.points, experiments=kept)
    fitted = oracle.fit(oracle.wrong_start(arm), data, tools.load_point, tools.sigma_m)
    assert fitted.chi2_per_dof == pytest.approx(1.0, abs=0.12)
    original, corrected = KR270 / "pocket.src", tmp_path / "corrected.src"
    job = Process.from_file(KR270 / "process.yaml")
    corrected.write_bytes(compensate(fitted.arm, read_program(original), job).encode("latin-1"))
    before = replay_files(arm, original, original, KR270 / "process.yaml")
    after = replay_files(arm, original, corrected, KR270 / "process.yaml")
    assert before.mean_mm > 0.5
    assert after.percent_compensated(before) > 99.7
    assert after.max_mm < 0.01


def test_perfect_knowledge_leaves_only_the_rounding_of_the_program(arm: SegmentedArm, tmp_path: Path) -> None:
    original, corrected = KR270 / "pocket.src", tmp_path / "corrected.src"
    job, program = Process.from_file(KR270 / "process.yaml"), read_program(original)
    corrected.write_bytes(compensate(arm, program, job).encode("latin-1"))
    after = replay_files(arm, original, corrected, KR270 / "process.yaml")
    assert after.max_mm < 0.0015
    other = parse_program(program.text.replace("LIN", "PTP", 1))
    (tmp_path / "other.src").write_bytes(other.text.encode("latin-1"))
    with pytest.raises(ValueError, match="motions"):
        replay_files(arm, original, tmp_path / "other.src", KR270 / "process.yaml")


def test_replay_of_no_load_is_no_error_and_errors_of_the_robot_show(arm: SegmentedArm) -> None:
    q = np.deg2rad([[0.0, -80.0, 110.0, 10.0, -40.0, 5.0]])
    tcp, wrench = np.array([0.18, 0.0, 0.22]), np.array([[300.0, 0.0, -400.0, 0.0, 0.0, 0.0]])
    assert replay(arm, q, q, wrench, tcp, force_scale=0.0).max_mm < 1e-9  # rounding of equal equilibria
    loaded = replay(arm, q, q, wrench, tcp)
    assert replay(arm, q, q, wrench, tcp, force_scale=1.2).mean_mm == pytest.approx(1.2 * loaded.mean_mm, rel=1e-2)
    shaken = replay(arm, q, q, 0 * wrench, tcp, joint_error=np.full((1, 6), 1e-5))
    assert 0.001 < shaken.mean_mm < 0.1
