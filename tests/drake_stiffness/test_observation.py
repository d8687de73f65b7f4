"""Readings as rows: references taken off, displacement columns, repeats, excluded rows, orientations."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from synthetic import SIDEWAYS, VERTICAL, noise, plan, points_of, table, table_text, watched

from drake_stiffness.assembly import make_model
from drake_stiffness.campaign import read_measurements
from drake_stiffness.effects.compliance import JointCompliance
from drake_stiffness.errors import InputError
from drake_stiffness.identification import identify
from drake_stiffness.observation import columns, measured, observe, predicted, restrict

K6 = np.array([0.33e-6, 0.30e-6, 0.42e-6, 2.8e-6, 2.9e-6, 3.4e-6])
SIGMA = 12e-6


@pytest.fixture
def world(arms, cells, judges):
    arm, cell, rng = arms["kr270"], cells["kr270"], np.random.default_rng(0)
    cases = plan(arm, cell, 5, rng, [VERTICAL, SIDEWAYS], rest=2)
    p = judges["kr270"].positions(cases, points_of(cell), K6)
    return arm, cell, cases, p, p + SIGMA * rng.normal(size=p.shape)


def start(cell, arm):
    return make_model(cell, arm, [JointCompliance(name) for name in arm.joint_names])


def relative_to_first(cases, p):
    first = np.flatnonzero(cases.step == 0)[cases.experiment]
    return p - p[:, :, first]


def test_free_references_are_the_same_as_unknown_positions_fitted_along(tmp_path, world):
    """Elimination against the textbook: three columns more for every point of every experiment."""
    arm, cell, cases, _, noisy = world
    o = watched(tmp_path, cell, arm, cases, noisy, SIGMA)
    free = watched(tmp_path, cell, arm, cases, noisy, SIGMA, displacement=False)
    model = start(cell, arm)
    A, B = columns(o, model), columns(free, model)
    r = measured(o) - predicted(o, model)
    R = measured(free) - predicted(free, model)
    m = free.measurements
    key = m.cases.experiment[m.case] * 3 + np.unique(m.point, return_inverse=True)[1]
    D = np.zeros((3 * key.size, 3 * 15))
    for row, k in enumerate(key):
        D[3 * row : 3 * row + 3, 3 * k : 3 * k + 3] = np.eye(3)
    expected = np.linalg.lstsq(np.hstack([B, D]), R, rcond=None)[0][:6]
    assert np.linalg.lstsq(A, r, rcond=None)[0] == pytest.approx(expected, rel=1e-7)
    information = np.linalg.inv(np.hstack([B, D]).T @ np.hstack([B, D]))[:6, :6]
    assert np.linalg.inv(A.T @ A) == pytest.approx(information, rel=1e-7)
    assert o.references == 3 * 15
    assert free.references == 0


def test_displacement_columns_give_the_same_estimate_and_sigmas_as_the_positions_they_came_from(tmp_path, world):
    arm, cell, cases, _, noisy = world
    absolute = watched(tmp_path, cell, arm, cases, noisy, SIGMA)
    relative = watched(tmp_path, cell, arm, cases, relative_to_first(cases, noisy), SIGMA, relative=True)
    a, b = (identify(start(cell, arm), o, "least-squares") for o in (absolute, relative))
    assert relative.measurements.relative
    assert a.model.x == pytest.approx(b.model.x, rel=1e-8)
    assert a.identifiability.covariance() == pytest.approx(b.identifiability.covariance(), rel=1e-10)


def test_displacements_are_no_evidence_of_absolute_position(tmp_path, world):
    arm, cell, cases, _, noisy = world
    with pytest.raises(InputError, match=r"quantity is 'position'.*quantity: displacement"):
        watched(tmp_path, cell, arm, cases, relative_to_first(cases, noisy), SIGMA, relative=True, displacement=False)


def test_rows_of_weight_0_are_as_if_not_written(tmp_path, world):
    arm, cell, cases, _, noisy = world
    lines = table_text(arm, cases, tuple(cell.reference_points_m), noisy).splitlines()
    bad = [5, 17, 40]
    with_weight = [lines[0] + ",weight"]
    without = [lines[0]]
    for number, line in enumerate(lines[1:]):
        if number in bad:
            cut = line.split(",")
            cut[-1] = "999.0"
            with_weight.append(",".join(cut) + ",0")
        else:
            with_weight.append(line + (",1" if number % 2 else ","))
            without.append(line)
    solved = []
    for text in (with_weight, without):
        path = tmp_path / "m.csv"
        path.write_text("\n".join(text) + "\n")
        m = read_measurements(path, arm, tuple(cell.reference_points_m), np.array(cell.load_point_m), readings=True)
        assert m.case.size == len(lines) - 1 - len(bad)
        solved.append(identify(start(cell, arm), observe(m, True, noise(SIGMA))).model.x)
    assert np.array_equal(*solved)


def test_the_order_of_rows_does_not_matter(tmp_path, world):
    arm, cell, cases, _, noisy = world
    lines = table_text(arm, cases, tuple(cell.reference_points_m), noisy).splitlines()
    found = []
    for order in (np.arange(len(lines) - 1), np.random.default_rng(1).permutation(len(lines) - 1)):
        path = tmp_path / "m.csv"
        path.write_text("\n".join([lines[0], *(lines[1 + i] for i in order)]) + "\n")
        m = read_measurements(path, arm, tuple(cell.reference_points_m), np.array(cell.load_point_m), readings=True)
        o = observe(m, True, noise(SIGMA))
        assert (m.cases.step[o.first_unloaded] == 0).all()
        found.append(identify(start(cell, arm), o).model.x)
    assert found[0] == pytest.approx(found[1], rel=1e-9)


def test_restricting_to_some_experiments_is_reading_only_those(tmp_path, world):
    arm, cell, cases, _, noisy = world
    whole = table(tmp_path, cell, arm, cases, noisy)
    keep = np.array([True, False, True, True, False])
    few = np.flatnonzero(keep[cases.experiment])
    alone = table(tmp_path, cell, arm, cases.take(few), noisy[:, :, few])
    part = restrict(whole, keep)
    assert part.experiments == alone.experiments
    for name in ("case", "point", "position"):
        assert np.array_equal(getattr(part, name), getattr(alone, name)), name
    for name in ("q", "wrench", "experiment", "step", "time_s"):
        assert np.array_equal(getattr(part.cases, name), getattr(alone.cases, name)), name
    assert part.line(0) == whole.line(0)


def turned(judge, cell, cases):
    """Rotation vectors of the flange since the first unloaded step of each experiment, from Drake."""
    poses = [
        judge.equilibrium(cases.q[:, i], cases.wrench[:, i], cases.p_ELoad, K6, [None] * 7)[0]
        for i in range(cases.number)
    ]
    R = np.array(poses)[:, :3, :3]
    first = np.flatnonzero(cases.step == 0)[cases.experiment]
    return Rotation.from_matrix(R @ R[first].transpose(0, 2, 1)).as_rotvec().T


def test_orientations_alone_of_weak_positions_tell_the_joints(tmp_path, world, judges):
    arm, cell, cases, p, _ = world
    turn = turned(judges["kr270"], cell, cases)
    o = watched(
        tmp_path,
        cell,
        arm,
        cases,
        p + 0.05 * np.random.default_rng(2).normal(size=p.shape),
        0.05,
        turn=turn,
        sigma_rad=1e-6,
    )
    assert o.turned.size == cases.number  # the same orientation beside three points counts once
    assert o.rows == 3 * (3 * cases.number + cases.number)
    # the last joints turn the flange even where no force bends them far: all six are found from rotations
    assert identify(start(cell, arm), o).model.x == pytest.approx(K6, rel=2e-2)
    exact = watched(tmp_path, cell, arm, cases, p, 1e-5, turn=turn, sigma_rad=1e-6)
    assert identify(start(cell, arm), exact).model.x == pytest.approx(K6, rel=1e-7)


def test_orientations_count_with_their_own_noise_and_their_own_free_reference(tmp_path, world, judges):
    arm, cell, cases, p, _ = world
    turn, rng = turned(judges["kr270"], cell, cases), np.random.default_rng(3)
    error = 5e-5 * rng.normal(size=turn.shape)
    first = np.flatnonzero(cases.step == 0)[cases.experiment]
    once = (
        turn + error - error[:, first]
    )  # read as rotation since the first step: that reading's noise is in all of them
    assert np.array_equal(once[:, first], np.zeros_like(once))
    o = watched(tmp_path, cell, arm, cases, p + SIGMA * rng.normal(size=p.shape), SIGMA, turn=once, sigma_rad=5e-5)
    solution = identify(start(cell, arm), o)
    dof = o.rows - o.references - 6
    assert o.references == 3 * 15 + 3 * 5
    assert float(solution.residual @ solution.residual) / dof == pytest.approx(1.0, abs=5 * np.sqrt(2 / dof))
    rotations = solution.residual[3 * o.measurements.case.size :]
    free = rotations.size - 3 * 5
    assert float(rotations @ rotations) / free == pytest.approx(1.0, abs=4 * np.sqrt(2 / free))


def test_orientations_without_their_noise_or_without_unloaded_step_are_refused(tmp_path, world):
    arm, cell, cases, p, _ = world
    turn = np.zeros((3, cases.number))
    with pytest.raises(InputError, match="orientation_sigma_mrad"):
        watched(tmp_path, cell, arm, cases, p, SIGMA, turn=turn)
    loaded = cases.take(np.flatnonzero((cases.step > 1) | (cases.experiment != 2)))
    few = np.flatnonzero((cases.step > 1) | (cases.experiment != 2))
    for displacement, options in ((True, {}), (False, {"turn": turn[:, few], "sigma_rad": 1e-5})):
        with pytest.raises(InputError, match="experiment 'E002' has no unloaded step"):
            watched(tmp_path, cell, arm, loaded, p[:, :, few], SIGMA, displacement=displacement, **options)
    watched(tmp_path, cell, arm, loaded, p[:, :, few], SIGMA, displacement=False)


def test_residuals_are_measured_minus_predicted_in_units_of_sigma(tmp_path, world):
    arm, cell, cases, p, noisy = world
    o = watched(tmp_path, cell, arm, cases, noisy, SIGMA, displacement=False)
    model = start(cell, arm).with_x(K6)
    r = (measured(o) - predicted(o, model)).reshape(-1, 3)
    expected = ((noisy - p) / SIGMA).transpose(2, 0, 1).reshape(-1, 3)
    assert np.abs(r - expected).max() < 1e-4
    m = replace(o.measurements, position=o.measurements.position + 1.0)
    assert measured(replace(o, measurements=m)) == pytest.approx(measured(o) + 1.0 / SIGMA)
