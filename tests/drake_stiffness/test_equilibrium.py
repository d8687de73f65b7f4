"""The loaded equilibrium: against Drake, against beams and pendulums that have formulas, and where there is none."""

import numpy as np
import pytest
from scipy.integrate import quad
from scipy.optimize import brentq
from synthetic import hand_made_arm
from three_arms import random_postures, random_springs, random_wrench

from drake_stiffness import equilibrium
from drake_stiffness.effects.effect import Cases
from drake_stiffness.equilibrium import solve_equilibrium
from drake_stiffness.errors import UntrustworthyError
from drake_stiffness.simulation import linear_displacement
from drake_stiffness.structure import Structure


def test_loaded_postures_of_three_arms_are_drakes_to_a_nanometre(arms, cells, judges, arm_name):
    arm, judge, rng = arms[arm_name], judges[arm_name], np.random.default_rng(5)
    q, wrench, load = random_postures(arm, 8, rng), random_wrench(8, rng), np.array(cells[arm_name].load_point_m)
    k_joint, k_link = random_springs(arm, rng)
    found = solve_equilibrium(Structure(arm, k_joint, k_link), Cases(q, wrench, load))
    for i in range(8):
        joint, link = found.theta_joint[:, i], [theta[:, i] for theta in found.theta_link]
        X = judge.pose(q[:, i], joint, link)
        assert np.abs(X[:3, 3] - found.p_E[:, i]).max() < 1e-9
        assert np.abs(X[:3, :3] - found.R_E[:, :, i]).max() < 1e-9
        tau_joint, tau_link = judge.torques(wrench[:, i], load, link)
        assert np.abs(joint - k_joint * tau_joint).max() < 1e-10
        for theta, k, tau in zip(link, k_link, tau_link, strict=True):
            assert np.abs(theta - k @ tau).max() < 1e-10
        X, _, _ = judge.equilibrium(q[:, i], wrench[:, i], load, k_joint, k_link)
        assert np.abs(X[:3, 3] - found.p_E[:, i]).max() < 1e-9
    assert np.abs(found.theta_link[0][3:]).max() > 1e-4  # the deflections are large enough to mean something


def test_each_case_has_a_load_point_of_its_own_if_asked(arms, judges):
    arm, judge, rng = arms["free"], judges["free"], np.random.default_rng(6)
    q, wrench, load = random_postures(arm, 3, rng), random_wrench(3, rng), rng.normal(0, 0.2, (3, 3))
    k_joint, k_link = random_springs(arm, rng)
    found = solve_equilibrium(Structure(arm, k_joint, k_link), Cases(q, wrench, load))
    for i in range(3):
        X, _, _ = judge.equilibrium(q[:, i], wrench[:, i], load[:, i], k_joint, k_link)
        assert np.abs(X[:3, 3] - found.p_E[:, i]).max() < 1e-9


def test_many_postures_in_chunks_are_the_same_as_one_by_one(arms, monkeypatch):
    monkeypatch.setattr(equilibrium, "CHUNK", 300)
    arm, rng = arms["kr270"], np.random.default_rng(7)
    q, wrench = random_postures(arm, 700, rng), random_wrench(700, rng)
    k_joint, _ = random_springs(arm, rng)
    structure = Structure(arm, k_joint, (None,) * 7)
    together = solve_equilibrium(structure, Cases(q, wrench, np.zeros(3)))
    for i in (0, 299, 300, 699):
        alone = solve_equilibrium(structure, Cases(q[:, [i]], wrench[:, [i]], np.zeros(3)))
        assert np.abs(together.p_E[:, i] - alone.p_E[:, 0]).max() < 1e-12


@pytest.mark.parametrize("tolerance", [1e-6, 1e-8, 1e-10])
def test_no_more_than_the_tolerance_is_left_to_find(arms, tolerance):
    """Also where the iteration starts from a neighbour's deflections, whose contraction it goes by."""
    arm, rng = arms["kr270"], np.random.default_rng(8)
    q, wrench = random_postures(arm, 300, rng), random_wrench(300, rng)
    structure = Structure(arm, *random_springs(arm, rng))
    exact = solve_equilibrium(structure, Cases(q, wrench, np.zeros(3)))
    rough = solve_equilibrium(structure, Cases(q, wrench, np.zeros(3)), tolerance=tolerance)
    near = solve_equilibrium(structure, Cases(q + 1e-3, wrench, np.zeros(3)))
    again = solve_equilibrium(structure, Cases(q, wrench, np.zeros(3)), near, tolerance)
    assert rough.iterations < exact.iterations
    for found in (rough, again):
        assert np.abs(found.theta_joint - exact.theta_joint).max() < tolerance
        for own, other in zip(found.theta_link, exact.theta_link, strict=True):
            assert np.abs(own - other).max() < tolerance


# -- a cantilever -------------------------------------------------------------------------------------------------------

L, EI, GJ, EA = 1.3, 2.1e5, 1.4e5, 8e8


def beam_compliance() -> np.ndarray:
    """Tip compliance of a slender prismatic beam along x (no shear)."""
    k = np.diag([L / EA, L**3 / (3 * EI), L**3 / (3 * EI), L / GJ, L / EI, L / EI])
    k[1, 5] = k[5, 1] = L**2 / (2 * EI)
    k[2, 4] = k[4, 2] = -(L**2) / (2 * EI)
    return k


def cantilever() -> Structure:
    arm = hand_made_arm([(0, 0, 0), (L, 0, 0)], [(0, 0, 1)])
    return Structure(arm, np.zeros(1), (None, beam_compliance()))


@pytest.mark.parametrize("axis", [1, 2])
def test_a_cantilever_under_a_tip_force_bends_by_F_L3_over_3EI(axis):
    force = np.zeros((6, 1))
    force[axis] = 1e-3
    found = solve_equilibrium(cantilever(), Cases(np.zeros((1, 1)), force, np.zeros(3)))
    tip = found.p_E[:, 0] - [L, 0, 0]
    expected = np.zeros(3)
    expected[axis] = 1e-3 * L**3 / (3 * EI)
    assert np.abs(tip - expected).max() < 1e-10 * expected[axis]


def test_a_force_beyond_the_tip_bends_as_the_integral_of_the_moment_says():
    reach, point, F = 0.4, 0.7, 1.0
    # virtual work: deflection where a unit load would act, rigid extension beyond the tip
    expected, _ = quad(lambda x: F * (L + reach - x) * (L + point - x) / EI, 0, L, epsabs=1e-18)
    moved = linear_displacement(
        cantilever(), np.zeros((1, 1)), [[0, F, 0, 0, 0, 0]], np.array([point, 0, 0]), np.array([reach, 0, 0])
    )
    slope, _ = quad(lambda x: F * (L + reach - x) / EI, 0, L, epsabs=1e-18)
    assert moved[0] == pytest.approx([0, expected, 0, 0, 0, slope], rel=1e-10, abs=1e-20)


def test_pull_and_twist_of_a_cantilever():
    moved = linear_displacement(cantilever(), np.zeros((1, 1)), [[1e3, 0, 0, 50, 0, 0]], np.zeros(3), np.zeros(3))
    assert moved[0] == pytest.approx([1e3 * L / EA, 0, 0, 50 * L / GJ, 0, 0], rel=1e-10, abs=1e-20)


def test_linear_and_loaded_displacements_differ_by_a_share_proportional_to_the_load(arms):
    arm, rng = arms["kr270"], np.random.default_rng(8)
    from dataclasses import replace

    weightless = replace(arm, gravity=np.zeros(3))
    q, wrench = random_postures(arm, 20, rng), random_wrench(20, rng)
    k_joint, k_link = random_springs(arm, rng)
    structure, load = Structure(weightless, k_joint, k_link), np.array([0.1, 0.05, 0.2])
    rest = solve_equilibrium(structure, Cases(q, np.zeros((6, 20)), load)).p_E
    factors, share = np.array([0.05, 0.1, 0.2, 0.4, 0.8]), []
    for f in factors:
        loaded = solve_equilibrium(structure, Cases(q, f * wrench, load)).p_E - rest
        linear = linear_displacement(structure, q.T, f * wrench.T, np.zeros(3), load)[:, :3].T
        share.append(np.median(np.linalg.norm(loaded - linear, axis=0) / np.linalg.norm(linear, axis=0)))
    slope = np.polyfit(np.log(factors), np.log(share), 1)[0]
    assert slope == pytest.approx(1.0, abs=0.1)
    assert share[-1] > 1e-4


def test_a_loaded_arm_obeys_maxwell_reciprocity(arms, arm_name):
    """Around any equilibrium of dead loads: motion of A by force at B is motion of B by force at A, finite deflections included."""
    arm, rng = arms[arm_name], np.random.default_rng(9)
    q, held = random_postures(arm, 1, rng), random_wrench(1, rng, 1000, 0)
    k_joint, k_link = random_springs(arm, rng)
    structure = Structure(arm, k_joint, tuple(8 * k for k in k_link))
    A, B, h = np.array([0.3, 0.1, 0.1]), np.array([-0.2, 0.25, 0.4]), 2.0

    def place(point, at, force):
        """Position of `point` with the held wrench on the flange and `force` at `at`, as one wrench on the flange."""
        f = np.array(held)
        for _ in range(60):
            found = solve_equilibrium(structure, Cases(q, f, np.zeros(3)))
            arm_of_force = found.R_E[:, :, 0] @ at
            new = held + np.concatenate([force, np.cross(arm_of_force, force)])[:, None]
            if np.abs(new - f).max() < 1e-12:
                break
            f = new
        return found.p_E[:, 0] + found.R_E[:, :, 0] @ point

    by_B = np.array([(place(A, B, h * e) - place(A, B, -h * e)) / (2 * h) for e in np.eye(3)]).T
    by_A = np.array([(place(B, A, h * e) - place(B, A, -h * e)) / (2 * h) for e in np.eye(3)]).T
    assert np.abs(by_B - by_A.T).max() < 1e-6 * np.abs(by_B).max()
    assert np.abs(by_B - by_B.T).max() > 1e-3 * np.abs(by_B).max()  # not symmetric by itself: the law says something


# -- a pendulum standing on its joint spring ---------------------------------------------------------------------------------

MASS, HEIGHT, G = 80.0, 1.5, 9.81
CRITICAL = MASS * G * HEIGHT  # the stiffness below which the weight wins, N m / rad


def pendulum(stiffness: float) -> Structure:
    arm = hand_made_arm([(0, 0, 0), (0, 0, HEIGHT)], [(0, 1, 0)], [0.0, MASS], gravity=(0, 0, -G))
    return Structure(arm, np.array([1 / stiffness]), (None, None))


def at(tilt: float) -> Cases:
    return Cases(np.array([[tilt]]), np.zeros((6, 1)), np.zeros(3))


@pytest.mark.parametrize("share", [1.5, 2.0, 10.0])
def test_an_inverted_pendulum_stiffer_than_critical_leans_by_the_solution_of_k_theta_is_mgh_sin(share):
    tilt = 0.02
    theta = solve_equilibrium(pendulum(share * CRITICAL), at(tilt)).theta_joint[0, 0]
    expected = brentq(lambda x: share * x - np.sin(tilt + x), 0, 1, xtol=1e-15)
    assert theta == pytest.approx(expected, rel=1e-9)


@pytest.mark.parametrize("share", [0.999, 0.9, 0.3])
@pytest.mark.parametrize("tilt", [1e-3, 1e-6])
def test_an_inverted_pendulum_softer_than_critical_is_refused_naming_posture_and_load(share, tilt):
    with pytest.raises(UntrustworthyError) as error:
        solve_equilibrium(pendulum(share * CRITICAL), at(tilt))
    assert "K - H is not positive definite" in str(error.value)
    assert "posture (j1 " in str(error.value)
    assert "load (N, N m)" in str(error.value)


def test_an_inverted_pendulum_just_above_critical_is_found_stable():
    """The refusal must come from instability, not from an iteration that is too slow (1 % above critical)."""
    theta = solve_equilibrium(pendulum(1.01 * CRITICAL), at(1e-4)).theta_joint[0, 0]
    assert theta == pytest.approx(brentq(lambda x: 1.01 * x - np.sin(1e-4 + x), 0, 0.5, xtol=1e-15), rel=1e-6)


def test_an_upright_pendulum_softer_than_critical_is_refused_though_nothing_pulls_it_aside():
    """Torque is exactly zero, so an iteration alone would call it solved; it would fall at a breath."""
    with pytest.raises(UntrustworthyError, match="positive definite"):
        solve_equilibrium(pendulum(0.5 * CRITICAL), at(0.0))


def test_compliances_far_too_large_are_refused_naming_the_case_the_posture_and_the_load(arms):
    arm, rng = arms["kr270"], np.random.default_rng(10)
    q, wrench = random_postures(arm, 3, rng), np.zeros((6, 3))
    wrench[2, 1] = -3e6
    with pytest.raises(UntrustworthyError) as error:
        solve_equilibrium(Structure(arm, np.full(6, 2e-6), (None,) * 7), Cases(q, wrench, np.zeros(3)))
    assert f"joint_3 {np.degrees(q[2, 1]):.6g} deg" in str(error.value)
    assert "-3000000" in str(error.value)
    assert "case 2" in str(error.value)


def test_the_refusal_counts_cases_over_the_whole_array(arms):
    arm, rng = arms["kr270"], np.random.default_rng(10)
    q, wrench = random_postures(arm, 2100, rng), np.zeros((6, 2100))
    wrench[2, 2070] = -3e6
    with pytest.raises(UntrustworthyError, match="case 2071,"):
        solve_equilibrium(Structure(arm, np.full(6, 2e-6), (None,) * 7), Cases(q, wrench, np.zeros(3)))


def test_a_hopeless_case_does_not_put_the_blame_on_a_sound_one(arms):
    """The load is so large that the iteration is given up at once, before the sound cases beside it stand."""
    arm, rng = arms["kr270"], np.random.default_rng(10)
    q, wrench = random_postures(arm, 3, rng), np.zeros((6, 3))
    wrench[2, 1] = -3e9
    with pytest.raises(UntrustworthyError, match="case 2"):
        solve_equilibrium(Structure(arm, np.full(6, 2e-6), (None,) * 7), Cases(q, wrench, np.zeros(3)))


def test_a_rigid_arm_stays_where_it_is_commanded(arms):
    q = random_postures(arms["track"], 4, np.random.default_rng(11))
    rigid = Structure(arms["track"], np.zeros(7), (None,) * 8)
    from drake_stiffness.arm import forward

    found = solve_equilibrium(rigid, Cases(q, np.full((6, 4), 500.0), np.zeros(3)))
    assert np.array_equal(found.p_E, forward(arms["track"], q).p_E)
    assert found.iterations == 0
