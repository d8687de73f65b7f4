"""A spring across a joint: its torque, its stiffness, what it does to an arm, and what a campaign shows of it.

Truth comes from distances between points, from Drake's LinearSpringDamper, and from stiffnesses put in by hand.
"""

import numpy as np
import pytest
from drake_judge import Judge
from pydrake.multibody.plant import MultibodyPlant
from pydrake.multibody.tree import MultibodyForces
from scipy.spatial.transform import Rotation
from synthetic import hand_made_arm, plan, points_of, watched
from three_arms import random_postures, random_springs, random_wrench

from drake_stiffness.assembly import joint_spring, link_spring, make_model
from drake_stiffness.effects.effect import Cases
from drake_stiffness.effects.gravity_compensator import GravityCompensator, free_length
from drake_stiffness.equilibrium import solve_equilibrium
from drake_stiffness.errors import UntrustworthyError
from drake_stiffness.identification import identify
from drake_stiffness.plant import build_elastic_plant
from drake_stiffness.sensitivity import sensitivity
from drake_stiffness.simulation import simulate_readings
from drake_stiffness.statistics import goodness, statistics
from drake_stiffness.structure import build_structure

ANCHOR, LEVER = (0.68593, 0.12030), 0.18472
SEED = np.array([1 / 0.144e-6, 0.458 / 0.144e-6])  # K_c and K_c s0 of Table 1
BALANCING = np.array([1.5e5, 1.5e5 * 0.458])
K = np.array([0.33e-6, 0.302e-6, 0.406e-6, 3.002e-6, 3.303e-6, 2.365e-6])
JOINT = {"kr270": "joint_2", "track": "elbow", "free": "s3"}


def compensator(where="joint_2", variant="spring", lever_deg=-90.0):
    return GravityCompensator(where, ANCHOR, LEVER, lever_deg, variant)


class SpringJudge(Judge):
    """The elastic Drake plant with a LinearSpringDamper across a joint."""

    def __init__(self, cell, spring):
        super().__init__(cell)
        self.e = build_elastic_plant(cell, [spring])
        self.plant: MultibodyPlant = self.e.plant
        self.context, self.world = self.plant.CreateDefaultContext(), self.plant.world_frame()

    def of_the_spring(self):
        """Generalised forces of force elements less those of weight, at the posture now set."""
        forces = MultibodyForces(self.plant)
        self.plant.CalcForceElementsContribution(self.context, forces)
        return self.plant.CalcGeneralizedForces(self.context, forces) - self.plant.CalcGravityGeneralizedForces(
            self.context
        )

    def torques(self, wrench, p_EL, theta_link):
        joint, links = super().torques(wrench, p_EL, theta_link)
        extra = self.of_the_spring()
        assert all(np.abs(extra[s.velocity_start() : s.velocity_start() + 6]).max() < 1e-9 for s in self.e.link_springs)
        return joint + np.array([extra[j.velocity_start()] for j in self.e.joint_springs]), links


# -- one joint ---------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("axis", [(0, 1, 0), (0, 0, -1), (0.3, 0.8, 0.1)])
def test_the_torque_is_what_the_energy_of_a_spring_between_two_pins_loses_over_a_turn(axis):
    axis = np.array(axis) / np.linalg.norm(axis)
    effect, x = GravityCompensator("j", (0.5, -0.2), 0.3, 35.0), np.array([2e5, 0.9e5])
    pins = effect.point_spring(axis, x)

    def energy(q):
        s = np.linalg.norm(Rotation.from_rotvec(q * axis).apply(pins.p_MB) - pins.p_FA)
        return 0.5 * x[0] * (s - x[1] / x[0]) ** 2

    for q in np.linspace(-3, 3, 13):
        slope = (energy(q + 1e-5) - energy(q - 1e-5)) / 2e-5
        assert effect.moment(np.array([q]), x)[0] == pytest.approx(-slope, rel=1e-8, abs=1e-4)


def test_the_pins_lie_where_the_sketch_says_behind_below_and_upright_over_the_shoulder_of_a_kuka_arm():
    spring = compensator(lever_deg=-90.0).point_spring(np.array([0.0, 1.0, 0.0]), SEED)
    assert spring.p_FA == pytest.approx([-0.68593, 0, -0.12030])
    assert spring.p_MB == pytest.approx([0, 0, 0.18472], abs=1e-12)
    upright = Rotation.from_rotvec([0, -np.pi / 2, 0]).apply(spring.p_MB)
    assert upright == pytest.approx([-0.18472, 0, 0], abs=1e-12)
    assert (spring.stiffness, spring.free_length) == pytest.approx((1 / 0.144e-6, 0.458))


def test_a_balancing_spring_lifts_an_arm_that_leans_forward():
    q = np.radians([-60.0, -40.0, -20.0, -5.0])  # weight turns joint 2 of the KR 270 to the positive side there
    assert (compensator().moment(q, BALANCING) < -1e3).all()


def test_the_stiffening_is_eta_of_the_paper_and_minus_the_slope_of_the_torque():
    effect, q = compensator(lever_deg=0.0), np.linspace(-np.pi, np.pi, 41)
    a, L, s0 = np.hypot(*ANCHOR), LEVER, 0.458
    phi = q + np.arctan2(ANCHOR[1], ANCHOR[0])
    s = np.sqrt(a**2 + L**2 + 2 * a * L * np.cos(phi))
    eta = s0 / s * (a * L * np.sin(phi) ** 2 / s**2 + np.cos(phi)) - np.cos(phi)
    assert effect.stiffening(q, SEED) == pytest.approx(SEED[0] * a * L * eta, rel=1e-12)
    slope = (effect.moment(q + 1e-6, SEED) - effect.moment(q - 1e-6, SEED)) / 2e-6
    assert effect.stiffening(q, SEED) == pytest.approx(-slope, abs=1e-8 * np.abs(slope).max())


def test_the_printed_values_cannot_be_a_real_spring_and_vary_the_stiffness_of_joint_2_by_a_tenth():
    effect, q = compensator(lever_deg=0.0), np.linspace(-np.pi, np.pi, 10001)
    pull = SEED[0] * effect.length(q)[1] - SEED[1]
    assert (pull.min(), pull.max()) == pytest.approx((0.37e6, 2.94e6), rel=0.01)
    limits = np.radians(np.linspace(-140.0, -5.0, 1001))
    share = effect.stiffening(limits, SEED) * 0.302e-6
    assert (share.min(), share.max()) == pytest.approx((-0.130, 0.0856), abs=1e-3)
    assert np.abs(compensator().stiffening(limits, BALANCING) * 0.302e-6).max() < 0.005


def test_the_free_length_and_its_sigma_come_from_the_two_unknowns():
    value, sigma = free_length(SEED, np.diag([0.0, (0.05 * SEED[1]) ** 2]))
    assert (value, sigma) == pytest.approx((0.458, 0.05 * 0.458))
    drawn = np.random.default_rng(0).multivariate_normal(
        SEED, C := 1e-4 * np.array([[4e13, 1e13], [1e13, 1e13]]), 20000
    )
    assert free_length(SEED, C)[1] == pytest.approx((drawn[:, 1] / drawn[:, 0]).std(), rel=0.03)


# -- on an arm ---------------------------------------------------------------------------------------------------------


def test_drake_turns_the_joint_by_the_same_torque_at_any_posture(arms, cells, arm_name):
    arm, rng = arms[arm_name], np.random.default_rng(1)
    effect, i = compensator(JOINT[arm_name], lever_deg=-70.0), arm.joint_names.index(JOINT[arm_name])
    judge = SpringJudge(cells[arm_name], effect.point_spring(arm.axis_F[i], BALANCING))
    q, theta = random_postures(arm, 5, rng), rng.normal(0, 0.02, (arm.num_joints, 5))
    ours = effect.torque(arm, q, theta, BALANCING)[i]
    for n in range(5):
        judge.pose(q[:, n], theta[:, n], rng.normal(0, 0.01, (arm.num_joints + 1, 6)))
        found = judge.of_the_spring()
        spring = judge.e.joint_springs[i].velocity_start()
        assert found[spring] == pytest.approx(ours[n], rel=1e-9)
        others = np.delete(found, [spring, judge.e.joints[i].velocity_start()])
        assert np.abs(others).max() < 1e-9 * np.abs(ours).max()


def test_the_loaded_arm_stands_where_drake_with_a_spring_puts_it(arms, cells, arm_name):
    arm, rng = arms[arm_name], np.random.default_rng(2)
    effect, i = compensator(JOINT[arm_name]), arm.joint_names.index(JOINT[arm_name])
    judge = SpringJudge(cells[arm_name], effect.point_spring(arm.axis_F[i], BALANCING))
    q, wrench, load = random_postures(arm, 3, rng), random_wrench(3, rng), np.array([0.1, 0.05, 0.2])
    k_joint, k_link = random_springs(arm, rng)
    model = [joint_spring(arm, n) for n in arm.joint_names] + [
        link_spring(arm, n, "symmetric", "x") for n in arm.link_names
    ]
    entries = [k[np.triu_indices(6)] for k in k_link]
    structure = build_structure(arm, [*model, effect], [*k_joint[:, None], *entries, BALANCING])
    found = solve_equilibrium(structure, Cases(q, wrench, load))
    bare = solve_equilibrium(build_structure(arm, model, [*k_joint[:, None], *entries]), Cases(q, wrench, load))
    assert np.abs(found.p_E - bare.p_E).max() > 1e-5
    for n in range(3):
        X, theta, _ = judge.equilibrium(q[:, n], wrench[:, n], load, k_joint, k_link)
        assert np.abs(X[:3, 3] - found.p_E[:, n]).max() < 1e-9
        assert np.abs(theta - found.theta_joint[:, n]).max() < 1e-10


def stiffness_law(q2):
    """Deflection of joint 2 beyond k tau when its stiffness is K2 + K_c a L eta(q2), with the seed's numbers."""
    a, L, s0 = np.hypot(*ANCHOR), LEVER, 0.458
    phi = q2 + np.arctan2(ANCHOR[1], ANCHOR[0])
    s = np.sqrt(a**2 + L**2 + 2 * a * L * np.cos(phi))
    eta = s0 / s * (a * L * np.sin(phi) ** 2 / s**2 + np.cos(phi)) - np.cos(phi)
    stiffness = 1 / K[1] + a * L * eta / 0.144e-6
    return lambda tau: np.array([0, tau[1] / stiffness - K[1] * tau[1], 0, 0, 0, 0])


def test_the_variant_stiffness_makes_joint_2_give_way_by_its_torque_over_the_varied_stiffness(arms, judges):
    arm, rng = arms["kr270"], np.random.default_rng(3)
    q, wrench, load = random_postures(arm, 3, rng), random_wrench(3, rng), np.zeros(3)
    effects = [*(joint_spring(arm, n) for n in arm.joint_names), compensator(variant="stiffness", lever_deg=0.0)]
    found = solve_equilibrium(build_structure(arm, effects, [*K[:, None], SEED]), Cases(q, wrench, load))
    for n in range(3):
        X, _, _ = judges["kr270"].equilibrium(q[:, n], wrench[:, n], load, K, [None] * 7, stiffness_law(q[1, n]))
        assert np.abs(X[:3, 3] - found.p_E[:, n]).max() < 1e-9


@pytest.mark.parametrize("variant", ["spring", "stiffness"])
def test_zero_is_no_compensator(arms, variant):
    arm, rng = arms["kr270"], np.random.default_rng(4)
    cases = Cases(random_postures(arm, 3, rng), random_wrench(3, rng), np.zeros(3))
    joints = [joint_spring(arm, n) for n in arm.joint_names]
    with_it = build_structure(arm, [*joints, compensator(variant=variant)], [*K[:, None], np.zeros(2)])
    bare = build_structure(arm, joints, list(K[:, None]))
    assert np.array_equal(solve_equilibrium(with_it, cases).p_E, solve_equilibrium(bare, cases).p_E)


@pytest.mark.parametrize("variant", ["spring", "stiffness"])
def test_columns_of_the_joints_springs_are_what_readings_do_when_a_compliance_changes(arms, cells, variant):
    """Soft loads: the columns are those of the undeflected arm, the readings those of the loaded one."""
    arm, rng, x = arms["kr270"], np.random.default_rng(5), SEED if variant == "stiffness" else BALANCING
    effects = [*(joint_spring(arm, n) for n in arm.joint_names), compensator(variant=variant, lever_deg=0.0)]
    model = make_model(
        cells["kr270"], arm, effects, np.concatenate([K / 100, 100 * x if variant == "stiffness" else x])
    )
    cases = Cases(random_postures(arm, 4, rng), random_wrench(4, rng), model.load_point)
    case, point = np.arange(4), np.array(["P1"] * 4)
    columns = sensitivity(model, cases, case, point)[:, :3, :6]
    for j in range(6):
        h = np.zeros(8)
        h[j] = 1e-3 * K[j]
        ends = [simulate_readings(model.with_x(model.x + s * h), cases, case, point).p for s in (1, -1)]
        slope = (ends[0] - ends[1]).T / (2 * h[j]) * model.scales[j]
        assert np.abs(columns[:, :, j] - slope).max() < 2e-3 * np.abs(slope).max()


# -- a pendulum held up by a spring ------------------------------------------------------------------------------------

MASS, HEIGHT, G = 80.0, 1.5, 9.81


def held_pendulum(share, spring, lever_deg):
    """Standing on a joint spring of `share` of the stiffness it needs, with a compensator of `spring` N/m and free length 0."""
    arm = hand_made_arm([(0, 0, 0), (0, 0, HEIGHT)], [(0, 1, 0)], [0.0, MASS], gravity=(0, 0, -G))
    effects = [joint_spring(arm, "j1"), GravityCompensator("j1", (0.6, 0.0), 0.2, lever_deg)]
    k = 1 / (share * MASS * G * HEIGHT)
    return build_structure(arm, effects, [np.array([k]), np.array([spring, 0.0])])


UPRIGHT = Cases(np.zeros((1, 1)), np.zeros((6, 1)), np.zeros(3))
NEEDED = MASS * G * HEIGHT / (0.6 * 0.2)  # N/m that replace the whole joint spring


def test_a_pendulum_too_soft_to_stand_stands_with_a_spring_that_carries_it():
    """The lever points back at rest, so the spring is shortest there: phi = 180 deg."""
    with pytest.raises(UntrustworthyError, match="K - H is not positive definite"):
        solve_equilibrium(held_pendulum(0.9, 0.05 * NEEDED, 180.0), UPRIGHT)
    found = solve_equilibrium(held_pendulum(0.9, 0.15 * NEEDED, 180.0), UPRIGHT)
    assert found.theta_joint[0, 0] == pytest.approx(0.0, abs=1e-12)


def test_a_pendulum_that_stands_by_itself_is_pulled_over_by_a_spring_mounted_the_wrong_way():
    assert solve_equilibrium(held_pendulum(1.1, 0.05 * NEEDED, 0.0), UPRIGHT).theta_joint[0, 0] == pytest.approx(0.0)
    with pytest.raises(UntrustworthyError, match="K - H is not positive definite"):
        solve_equilibrium(held_pendulum(1.1, 0.15 * NEEDED, 0.0), UPRIGHT)


# -- found again from readings -----------------------------------------------------------------------------------------


def positions(judge, cell, cases, law=None):
    points, out = points_of(cell), []
    for n in range(cases.number):
        bend = None if law is None else law(cases.q[1, n])
        X, _, _ = judge.equilibrium(cases.q[:, n], cases.wrench[:, n], cases.p_ELoad, K, [None] * 7, bend)
        out.append(points @ X[:3, :3].T + X[:3, 3])
    return np.array(out).transpose(1, 2, 0)


def fitted(tmp_path, arm, cell, cases, p, effect, displacement):
    model = make_model(cell, arm, [*(joint_spring(arm, n) for n in arm.joint_names), effect])
    return identify(model, o := watched(tmp_path, cell, arm, cases, p, 1e-5, displacement=displacement)), o


def test_a_real_spring_is_found_from_positions(tmp_path, arms, cells):
    arm, cell = arms["kr270"], cells["kr270"]
    effect, cases = compensator(), plan(arm, cell, 8, np.random.default_rng(6))
    judge = SpringJudge(cell, effect.point_spring(arm.axis_F[1], BALANCING))
    solution, _ = fitted(tmp_path, arm, cell, cases, positions(judge, cell, cases), effect, displacement=False)
    assert solution.model.x == pytest.approx(np.concatenate([K, BALANCING]), rel=1e-5)


def test_the_varied_stiffness_of_the_paper_is_found_from_displacements(tmp_path, arms, cells, judges):
    arm, cell = arms["kr270"], cells["kr270"]
    cases, effect = plan(arm, cell, 8, np.random.default_rng(7)), compensator(variant="stiffness", lever_deg=0.0)
    p = positions(judges["kr270"], cell, cases, stiffness_law)
    solution, _ = fitted(tmp_path, arm, cell, cases, p, effect, displacement=True)
    assert solution.model.x == pytest.approx(np.concatenate([K, SEED]), rel=1e-4)


def test_a_campaign_in_which_joint_2_never_moves_cannot_tell_a_compensator_from_the_joints_spring(
    tmp_path, arms, cells, judges
):
    arm, cell = arms["kr270"], cells["kr270"]
    cases = plan(arm, cell, 8, np.random.default_rng(8))
    cases.q[1] = -1.2
    p = positions(judges["kr270"], cell, cases, stiffness_law)
    effect = compensator(variant="stiffness", lever_deg=0.0)
    solution, o = fitted(tmp_path, arm, cell, cases, p, effect, displacement=True)
    groups = dict(zip(solution.model.names, statistics(solution, o, goodness(solution, o))[0].group, strict=True))
    assert {groups[f"joint_2.gravity_compensator.{n}"] for n in ("spring", "preload")} == {"G3"}
    assert groups["joint_3"] == "G1+"
