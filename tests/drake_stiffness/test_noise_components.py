"""The tracker's noise and the arm's own: told apart where readings repeat, and what fits make of them."""

import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.linalg import block_diag
from synthetic import points_of, table, table_text
from three_arms import KR270

from drake_stiffness.assembly import make_model
from drake_stiffness.campaign import Noise
from drake_stiffness.cell import read_cell
from drake_stiffness.effects import Cases
from drake_stiffness.effects.compliance import JointCompliance
from drake_stiffness.identification import identify
from drake_stiffness.noise_components import noise_components, noise_line, seen_noise
from drake_stiffness.observation import columns, measured, observe, residual_m
from drake_stiffness.plant import build_arm
from drake_stiffness.posture_noise import lever, posture_noise
from drake_stiffness.simulation import simulate_readings
from drake_stiffness.statistics import goodness

sys.path.insert(0, str(Path(__file__).parents[2] / "examples"))
from plants.chain import read_chain
from plants.repeatability import joint_errors

TRACKER, REPEATABILITY = 12e-6, 60e-6
K = np.array([0.33, 0.302, 0.406, 3.002, 3.303, 2.365]) * 1e-6
LOADS = ((0, 0, 0), (0, 0, -2500.0), (0, 0, 0), (0, 3500.0, 0), (3000.0, 0, 0), (0, 0, 0))


@pytest.fixture(scope="module")
def robot():
    cell = read_cell(KR270 / "cell.yaml")
    return cell, build_arm(cell), read_chain(KR270 / "kr270.urdf")


def cases_of(cell, q, loads=LOADS):
    """Experiments at postures q (E, n), one step a load."""
    steps = len(loads)
    wrench = np.tile(np.pad(np.array(loads, dtype=float), ((0, 0), (0, 3))).T, len(q))
    numbers = np.repeat(np.arange(len(q)), steps), np.tile(np.arange(steps), len(q))
    return Cases(
        np.repeat(q.T, steps, axis=1), wrench, np.array(cell.load_point_m), *numbers, np.arange(float(len(q) * steps))
    )


def postures(number, seed=0):
    low, high = [-50, -110, 30, -150, -90, -150], [50, -40, 130, 150, 90, 150]
    return np.deg2rad(np.random.default_rng(seed).uniform(low, high, (number, 6)))


class World:
    """Readings of a plan without noise, what joint errors do to them (from the plants' own kinematics), and noise drawn anew."""

    def __init__(self, folder, robot, cases, points=3):
        cell, arm, self.chain = robot
        self.cell, self.arm, self.cases, self.places = cell, arm, cases, points_of(cell)[:points]
        self.model = make_model(cell, arm, [JointCompliance(name) for name in arm.joint_names])
        shape = np.zeros((points, 3, cases.number))
        self.m = table(folder, cell, arm, cases, shape)
        self.exact = simulate_readings(self.model.with_x(K), self.m.cases, self.m.case, self.m.point).p.T
        self.J = np.array([self.chain.jacobian(cases.q.T, place)[:, :3] for place in self.places])  # (P, N, 3, n)

    def read(self, rng, approach, tracker=TRACKER, rms=REPEATABILITY):
        """Measurements with the noise of one campaign."""
        unit = self.cases.experiment if approach == "per_experiment" else np.arange(self.cases.number)
        first = np.unique(unit, return_index=True)[1]
        error = joint_errors(self.chain, self.cases.q.T[first], rms, rng)[unit]
        moved = np.einsum("pnij,nj->npi", self.J, error).reshape(-1, 3)
        return replace(self.m, position=self.exact + moved + rng.normal(scale=tracker, size=moved.shape))

    def sigma_of_a_coordinate(self, rms=REPEATABILITY):
        """What the plants' repeatability, a 3-D length at the flange, is of one coordinate of a reflector."""
        at_flange = self.chain.jacobian(self.cases.q.T, np.zeros(3))[:, :3]
        joint = rms / np.sqrt((at_flange**2).sum(axis=(1, 2)).mean())
        return joint * np.sqrt((self.J**2).sum(axis=(2, 3)).mean() / 3)

    def motion(self, approach, m):
        return posture_noise(self.sigma_of_a_coordinate(), approach, self.arm, self.cell.reference_points_m, m)

    def components(self, m, approach=None):
        return noise_components(m, self.arm, self.cell.reference_points_m, approach)


# -- what repeats show --------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("number", "visits", "approach", "points"),
    [(6, 3, "per_experiment", 3), (20, 1, "per_step", 3), (8, 3, "per_experiment", 1)],
)
def test_both_components_are_recovered_and_their_intervals_cover_them(
    tmp_path, robot, number, visits, approach, points
):
    q = np.repeat(postures(number), visits, axis=0)
    world = World(tmp_path, robot, cases_of(robot[0], q, LOADS[:3]), points)
    found = [world.components(world.read(np.random.default_rng([7, seed]), approach)) for seed in range(40)]
    assert {f.approach for f in found} == {approach}
    true = world.sigma_of_a_coordinate() * 1e3
    assert np.mean([f.tracker.sigma_mm**2 for f in found]) ** 0.5 == pytest.approx(TRACKER * 1e3, rel=0.05)
    assert np.mean([f.posture.sigma_mm**2 for f in found]) ** 0.5 == pytest.approx(true, rel=0.08)
    # 95 % of 40 are 38; fewer than 34 would be 3 sigma off
    assert sum(f.tracker.low_mm < TRACKER * 1e3 < f.tracker.high_mm for f in found) >= 34
    assert sum(f.posture.low_mm < true < f.posture.high_mm for f in found) >= 34


def test_the_users_sigma_of_a_coordinate_is_the_one_the_plant_has(tmp_path, robot):
    world = World(tmp_path, robot, cases_of(robot[0], postures(8)))
    joint = REPEATABILITY / np.sqrt(
        (world.chain.jacobian(world.cases.q.T, np.zeros(3))[:, :3] ** 2).sum(axis=(1, 2)).mean()
    )
    assert joint * lever(world.arm, world.cell.reference_points_m, world.m) == pytest.approx(
        world.sigma_of_a_coordinate(), rel=1e-9
    )


def test_an_arm_that_comes_back_exactly_is_seen_to_do_so(tmp_path, robot):
    world = World(tmp_path, robot, cases_of(robot[0], np.repeat(postures(5), 2, axis=0), LOADS[:4]))
    found = [world.components(world.read(np.random.default_rng(seed), "per_experiment", rms=0.0)) for seed in range(20)]
    assert sum(f.posture.low_mm == 0.0 for f in found) >= 17
    assert np.median([f.posture.sigma_mm for f in found]) < 0.003
    assert all(f.posture.high_mm < 0.015 for f in found)


def test_where_nothing_repeats_nothing_is_said(tmp_path, robot):
    world = World(tmp_path, robot, cases_of(robot[0], postures(4), LOADS[2:5]))
    assert world.components(world.read(np.random.default_rng(0), "per_experiment")) is None


def test_repeats_without_any_noise_were_computed_and_say_nothing(tmp_path, robot):
    world = World(tmp_path, robot, cases_of(robot[0], np.repeat(postures(2), 2, axis=0)))
    assert world.components(world.read(np.random.default_rng(0), "per_experiment", tracker=0.0, rms=0.0)) is None


def test_one_point_read_once_per_approach_tells_the_parts_not_apart(tmp_path, robot):
    """Every repeat is an approach of its own, and all three coordinates move with it: only the sum is known."""
    world = World(tmp_path, robot, cases_of(robot[0], postures(8)), points=1)
    found = world.components(world.read(np.random.default_rng(0), "per_step"))
    assert found.posture is None
    assert found.tracker.sigma_mm == pytest.approx(np.hypot(TRACKER, world.sigma_of_a_coordinate()) * 1e3, rel=0.4)
    entry = found.to_dict()
    assert entry["posture_sigma_mm"] is None
    assert "do not show" in noise_line(entry, Noise(position_sigma_mm=0.012), True)


def test_one_posture_stays_one_group_and_what_repeats_is_counted(tmp_path, robot):
    """Two experiments of one posture, six steps of which three are unloaded, three points; the other posture stands alone."""
    q = postures(2)[[0, 0, 1]]
    world = World(tmp_path, robot, cases_of(robot[0], q))
    found = world.components(world.read(np.random.default_rng(1), "per_experiment"))
    unloaded, loaded = (6 - 1) * 3 + (3 - 1) * 3, 3 * (2 - 1) * 3
    assert found.repeats == unloaded + loaded
    assert found.posture.dof == 6


def test_a_campaign_that_leaves_the_posture_noise_out_is_told_what_to_state(tmp_path, robot):
    cell, arm, _ = robot
    world = World(tmp_path, robot, cases_of(cell, postures(8)))
    m = world.read(np.random.default_rng(2), "per_step")
    bare, stated = (
        Noise(position_sigma_mm=0.012),
        Noise(position_sigma_mm=0.012, posture_sigma_mm=0.04, posture_noise="per_step"),
    )
    entry = seen_noise(m, arm, cell.reference_points_m, bare)
    assert entry == seen_noise(m, arm, cell.reference_points_m, stated)
    assert f"noise: {{posture_sigma_mm: {entry['posture_sigma_mm']:.2g}, posture_noise: per_step}}" in noise_line(
        entry, bare, True
    )
    assert noise_line(entry, stated, True).endswith("; stated 0.04).")
    still = entry | {"posture_noise": "per_experiment"}  # displacements lose it, positions do not
    assert "Not stated" not in noise_line(still, bare, True)
    assert "Not stated" in noise_line(still, bare, False)


# -- what fits make of them ---------------------------------------------------------------------------------------------


def z_scores(world, approach, displacement, motion, seeds):
    """(seeds, 6) errors of the joint compliances in units of what seed eq. (14) says, and chi-square per dof."""
    z, chi2 = [], []
    for seed in range(seeds):
        m = world.read(np.random.default_rng([3, seed]), approach)
        o = observe(
            m, displacement, Noise(position_sigma_mm=TRACKER * 1e3), world.motion(approach, m) if motion else None
        )
        solution = identify(world.model, o, "least-squares")
        sigma = np.sqrt(np.diag(solution.identifiability.covariance())) * solution.model.scales
        z.append((solution.model.x - K) / sigma)
        chi2.append(goodness(solution, o).chi2_per_dof)
    return np.array(z), np.mean(chi2)


@pytest.mark.parametrize(
    ("approach", "displacement"), [("per_step", True), ("per_experiment", False), ("per_step", False)]
)
def test_stated_sigmas_are_right_with_posture_noise_and_too_small_without(tmp_path, robot, approach, displacement):
    # joint 1 is not seen under vertical loads alone; the plan pulls sideways too
    world = World(tmp_path, robot, cases_of(robot[0], postures(10)))
    z, chi2 = z_scores(world, approach, displacement, motion=True, seeds=25)
    assert 0.85 < z.std() < 1.15
    assert abs(z.mean()) < 0.3
    assert chi2 == pytest.approx(1.0, abs=0.05)
    bare, chi2 = z_scores(world, approach, displacement, motion=False, seeds=10)
    assert bare.std() > 1.6
    assert chi2 > 2


def test_a_posture_error_that_stands_still_is_no_matter_to_displacements(tmp_path, robot):
    """It moves all steps of an experiment alike, so the free reference takes it."""
    world = World(tmp_path, robot, cases_of(robot[0], postures(4)))
    m = world.read(np.random.default_rng(0), "per_experiment")
    plain = observe(m, True, Noise(position_sigma_mm=0.012))
    stated = observe(m, True, Noise(position_sigma_mm=0.012), world.motion("per_experiment", m))
    A, B = columns(plain, world.model), columns(stated, world.model)
    np.testing.assert_allclose(B.T @ B, A.T @ A, rtol=1e-8, atol=1e-8 * np.abs(A.T @ A).max())
    y, w = measured(plain), measured(stated)
    np.testing.assert_allclose(B.T @ w, A.T @ y, rtol=1e-6, atol=1e-8 * np.abs(A.T @ y).max())
    assert w @ w == pytest.approx(y @ y, rel=1e-8)


@pytest.mark.parametrize("displacement", [True, False])
def test_whitening_is_generalised_least_squares(tmp_path, robot, displacement):
    """Against the textbook: the covariance of all rows written out, the references as explicit unknowns; orientations too."""
    cell, arm, _ = robot
    cases = cases_of(cell, postures(3), LOADS[:4])
    world = World(tmp_path, robot, cases)
    rng = np.random.default_rng(5)
    turn = np.where(np.arange(cases.number) % 4 == 0, 0.0, 1e-4) * rng.normal(size=(3, cases.number))
    m = table(tmp_path, cell, arm, cases, rng.normal(size=(3, 3, cases.number)), turn=turn)
    m = replace(m, position=world.exact + rng.normal(scale=1e-4, size=world.exact.shape))
    noise, motion = Noise(position_sigma_mm=0.012, orientation_sigma_mrad=0.02), world.motion("per_step", m)
    plain, o = observe(m, displacement, noise), observe(m, displacement, noise, motion)
    A = columns(o, world.model)
    N, P = cases.number, 3
    # covariance in units of noise, rows of a step: 3 points, then its orientation
    spread = motion.spread(m)
    position = [3 * r + c for r in range(m.case.size) for c in range(3)]
    own = {s: np.flatnonzero(m.case == s) for s in range(N)}
    B = np.zeros((3 * m.case.size + 3 * N, 6 * N))
    for s in range(N):
        rows = np.concatenate([np.arange(3 * r, 3 * r + 3) for r in own[s]])
        B[rows, 6 * s : 6 * s + 6] = spread[own[s], :3].reshape(-1, 6) / 12e-6
    for k, reading in enumerate(plain.turned):
        s = m.case[reading]
        B[3 * m.case.size + 3 * k + np.arange(3), 6 * s : 6 * s + 6] = spread[reading, 3:] / 20e-6
    V = np.eye(len(B)) + B @ B.T
    # the matrix before references are taken off: without displacement mode and with groups of one
    bare = replace(plain, displacement=False, turned=np.zeros(0, dtype=int), group_r=np.zeros(0, dtype=int))
    from drake_stiffness.sensitivity import sensitivity

    turned_columns = sensitivity(world.model, m.cases, m.case, m.point)[plain.turned, 3:] / 20e-6
    F = np.concatenate([columns(bare, world.model), turned_columns.reshape(-1, 6)])
    experiment = m.cases.experiment[m.case]
    names = {pair: i for i, pair in enumerate(sorted({(e, p) for e, p in zip(experiment, m.point, strict=True)}))}
    points = np.array(
        [[names[e, p] == i for i in range(len(names))] for e, p in zip(experiment, m.point, strict=True)], dtype=float
    )
    turns = np.array([[experiment[r] == e for e in range(3)] for r in plain.turned], dtype=float)
    first = np.kron(points, np.eye(3)) if displacement else np.zeros((3 * m.case.size, 0))
    refs = block_diag(first, np.kron(turns, np.eye(3)))
    inverse = np.linalg.inv(V)
    whole = np.concatenate([F, refs], axis=1)
    information = whole.T @ inverse @ whole
    n = 6
    schur = information[:n, :n] - information[:n, n:] @ np.linalg.solve(information[n:, n:], information[n:, :n])
    np.testing.assert_allclose(A.T @ A, schur, rtol=1e-6, atol=1e-8 * np.abs(schur).max())
    assert len(position) == 3 * P * N
    # and a residual in metres is that of the readings, whatever the whitening
    np.testing.assert_allclose(residual_m(o, world.model), residual_m(plain, world.model))


def test_rows_of_one_step_share_what_eliminating_references_takes_off(tmp_path, robot):
    world = World(tmp_path, robot, cases_of(robot[0], postures(2), LOADS[:3]))
    m = world.read(np.random.default_rng(0), "per_step")
    o = observe(m, True, Noise(position_sigma_mm=0.012), world.motion("per_step", m))
    eye = np.eye(o.rows)
    taken = o.whitening.white(eye) @ np.linalg.inv(o.whitening.white(eye)) - o.whitening.apply(
        np.linalg.inv(o.whitening.white(eye))
    )
    own = np.arange(4, 13)
    np.testing.assert_allclose(o.whitening.reference_share(own), taken[np.ix_(own, own)], atol=1e-10)


def test_a_campaign_states_it_in_its_noise(tmp_path, robot):
    """The same through campaign.yaml: an arm driven there anew for every step; residuals stay those of the readings."""
    from drake_stiffness.jobs import identify_campaign

    world = World(tmp_path, robot, cases_of(robot[0], postures(10)))
    m = world.read(np.random.default_rng(4), "per_step")
    p = m.position.reshape(world.cases.number, 3, 3).transpose(1, 2, 0)
    (tmp_path / "measurements.csv").write_text(table_text(world.arm, world.cases, ("P1", "P2", "P3"), p))
    cell = (KR270 / "cell_joints_only.yaml").read_text().replace("model: kr270.urdf", f"model: {KR270 / 'kr270.urdf'}")
    (tmp_path / "cell.yaml").write_text(cell)
    found = {}
    for name, more in (("bare", ""), ("stated", ", posture_sigma_mm: 0.0367, posture_noise: per_step")):
        path = tmp_path / f"{name}.yaml"
        noise = f"noise: {{position_sigma_mm: 0.012{more}}}"
        path.write_text(f"cell: cell.yaml\nmeasurements: measurements.csv\n{noise}\n")
        found[name] = identify_campaign(path)
    bare, stated = (found[name].model.fit for name in ("bare", "stated"))
    assert bare["noise_rejected"] is True
    assert stated["noise_rejected"] is False
    assert stated["chi2_per_dof"] == pytest.approx(1.0, abs=0.25)
    # what is left is 12 um of the tracker and 37 um of the arm, three coordinates, in both
    assert stated["residual_rms_mm"] == pytest.approx(np.sqrt(3) * np.hypot(0.012, 0.0367), rel=0.2)
    assert stated["residual_rms_mm"] == pytest.approx(bare["residual_rms_mm"], rel=0.05)
    assert np.sqrt((found["stated"].residual_mm ** 2).sum(axis=0).mean()) == pytest.approx(stated["residual_rms_mm"])
    assert stated["noise_components"] == bare["noise_components"]
    assert stated["noise_components"]["posture_noise"] == "per_step"
