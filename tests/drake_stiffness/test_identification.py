"""Identification: what noise-free and noisy data give back, and the semidefinite program against formulas and rivals."""

from dataclasses import replace

import cvxpy as cp
import numpy as np
import pytest
from scipy.optimize import lsq_linear
from synthetic import FORWARD, SIDEWAYS, VERTICAL, hand_made_arm, noise, plan, points_of, table, watched
from three_arms import random_springs

from drake_stiffness.assembly import link_spring, make_model, spring_effects
from drake_stiffness.cell import Springs
from drake_stiffness.effects import Effect, Parameter
from drake_stiffness.effects.compliance import BaseCompliance, JointCompliance, LinkCompliance
from drake_stiffness.effects.effect import Cases
from drake_stiffness.errors import InputError
from drake_stiffness.identification import identify
from drake_stiffness.observation import columns, measured, observe
from drake_stiffness.semidefinite import smallest_eigenvalue
from drake_stiffness.simulation import simulate_displacement
from drake_stiffness.statistics import covariance, goodness, statistics

K6 = np.array([0.33e-6, 0.30e-6, 0.42e-6, 2.8e-6, 2.9e-6, 3.4e-6])


def joints_only(cell, arm):
    return make_model(cell, arm, [JointCompliance(name) for name in arm.joint_names])


def beam_links(arm, rng, size=1.0):
    """Prismatic beams along the default axes, as matrices (n + 1, 6, 6), and the springs that describe them."""
    springs = [link_spring(arm, link, "beam", axis) for link, axis in zip(arm.link_names, "zxxxxxz", strict=True)]
    values = []
    for spring in springs:
        L, b = rng.uniform(0.3, 1.0), size * 1e-7 * rng.uniform(0.5, 2.0, 3)
        template = {
            "k11": 0.01 * b[0],
            "k22": L**2 * b[2] / 3,
            "k33": L**2 * b[1] / 3,
            "k44": b[0],
            "k55": b[1],
            "k66": b[2],
        }
        x = np.zeros((6, 6))
        for name, value in template.items():
            x[int(name[1]) - 1, int(name[2]) - 1] = value
        x[1, 5] = x[5, 1] = L * b[2] / 2
        x[2, 4] = x[4, 2] = -L * b[1] / 2
        turn = np.kron(np.eye(2), np.roll(np.eye(3), "xyz".index(spring.beam_axis), axis=0))
        values.append(turn @ x @ turn.T)
    return springs, np.array(values)


# -- noise-free ----------------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("method", ["sdp", "least-squares"])
@pytest.mark.parametrize("name", ["kr270", "free"])
def test_noise_free_joints_come_back_to_1e8_under_full_loads_and_weight(tmp_path, arms, cells, judges, method, name):
    arm, cell = arms[name], cells[name]
    cases = plan(arm, cell, 8, np.random.default_rng(0), [VERTICAL, SIDEWAYS, FORWARD])
    p = judges[name].positions(cases, points_of(cell), K6)
    solution = identify(joints_only(cell, arm), watched(tmp_path, cell, arm, cases, p, 1e-5), method)
    assert solution.model.x == pytest.approx(K6, rel=1e-8)


def test_noise_free_joints_of_an_arm_on_a_track_come_back_sliding_spring_included(tmp_path, arms, cells, judges):
    arm, cell = arms["track"], cells["track"]
    truth = np.concatenate([[4e-8], K6])
    cases = plan(arm, cell, 8, np.random.default_rng(1), [VERTICAL, SIDEWAYS, FORWARD])
    p = judges["track"].positions(cases, points_of(cell), truth)
    model = make_model(cell, arm, [e for e in spring_effects(cell, arm) if e.kind == "joint_compliance"])
    solution = identify(model, watched(tmp_path, cell, arm, cases, p, 1e-5))
    assert solution.model.x == pytest.approx(truth, rel=1e-8)


def predicted_again(model, arm, cell, judge, k_joint, k_link, rng, factor=1.0):
    """Largest relative error of displacements predicted for postures and loads that took no part."""
    cases = plan(arm, cell, 5, rng, [VERTICAL, SIDEWAYS, FORWARD], factor=factor)
    points, names = points_of(cell), np.array(list(model.points))
    truth = judge.positions(cases, points, k_joint, k_link) - judge.positions(cases.unloaded(), points, k_joint, k_link)
    number = cases.number
    found = simulate_displacement(model, cases, np.repeat(np.arange(number), 3), np.tile(names, number)).dp
    expected = truth.transpose(2, 0, 1).reshape(-1, 3).T
    return np.abs(found - expected).max() / np.abs(expected).max()


def test_without_weight_and_with_tiny_loads_all_identifiable_combinations_come_back_to_1e8(tmp_path, arms, cells):
    from drake_judge import Judge

    weightless = cells["kr270"].model_copy(update={"gravity_m_per_s2": (0.0, 0.0, 0.0)})
    weightless._path = cells["kr270"]._path
    arm, judge = replace(arms["kr270"], gravity=np.zeros(3)), Judge(weightless)
    rng = np.random.default_rng(2)
    springs, k_link = beam_links(arm, rng)
    model = make_model(weightless, arm, [*(JointCompliance(n) for n in arm.joint_names), *springs])
    # loads in mN: the second order of the equilibrium, a share of 1e-8 of the displacement at 10 N, is below 1e-11
    cases = plan(arm, weightless, 30, rng, [VERTICAL, SIDEWAYS, FORWARD], factor=4e-6)
    # positions of 2 m carry 4e-16 of rounding and would drown displacements of 1e-9 m: hand over what Drake's linear law gives
    p = np.zeros((3, 3, cases.number))
    order = np.array([3, 4, 5, 0, 1, 2])
    for i in range(cases.number):
        judge.pose(cases.q[:, i], np.zeros(6), [None] * 7)
        at_load = judge.jacobian(cases.p_ELoad)[order]
        for n, point in enumerate(points_of(weightless)):
            J = judge.jacobian(point)[order]
            for spring, k in zip(judge.e.joint_springs, K6, strict=True):
                own = spring.velocity_start()
                p[n, :, i] += k * J[:3, own] * (at_load[:, own] @ cases.wrench[:, i])
            for spring, k in zip(judge.e.link_springs, k_link, strict=True):
                own = spring.velocity_start() + order
                p[n, :, i] += J[:3, own] @ k @ at_load[:, own].T @ cases.wrench[:, i]
    o = watched(tmp_path, weightless, arm, cases, p, 4e-11, relative=True)
    A = columns(o, model)
    x_true = np.concatenate([K6, *(s.template.values(k) for s, k in zip(springs, k_link, strict=True))])
    for method in ("sdp", "least-squares"):
        solution = identify(model, o, method)
        assert solution.identifiability.rank < 62
        # combinations, in the metric of the data: what the campaign reads is reproduced to 1e-8 of itself
        scaled = A @ ((solution.model.x - x_true) / model.scales)
        assert np.abs(scaled).max() < 1e-8 * np.abs(A @ (x_true / model.scales)).max()


@pytest.mark.parametrize("method", ["sdp", "least-squares"])
def test_noise_free_joints_and_links_predict_new_postures_under_full_weight_and_load(
    tmp_path, arms, cells, judges, method
):
    arm, cell, judge, rng = arms["kr270"], cells["kr270"], judges["kr270"], np.random.default_rng(3)
    springs, k_link = beam_links(arm, rng)
    model = make_model(cell, arm, [*(JointCompliance(n) for n in arm.joint_names), *springs])
    cases = plan(arm, cell, 25, rng, [VERTICAL, SIDEWAYS, FORWARD])
    p = judge.positions(cases, points_of(cell), K6, k_link)
    solution = identify(model, watched(tmp_path, cell, arm, cases, p, 1e-5), method)
    assert solution.identifiability.rank < 62
    assert predicted_again(solution.model, arm, cell, judge, K6, k_link, np.random.default_rng(4)) < LEVEL
    if method == "sdp":
        assert smallest_eigenvalue(solution.model) >= -1e-9


# Weight acts on what the data leave open too, to second order: 2e-5 to 1e-4 of the displacement over seeds.
LEVEL = 2e-4


# -- noisy -----------------------------------------------------------------------------------------------------------------


def test_estimates_scatter_as_their_covariance_says(tmp_path, arms, cells, judges):
    arm, cell = arms["kr270"], cells["kr270"]
    sigma, draws, rng = 12e-6, 120, np.random.default_rng(5)
    cases = plan(arm, cell, 8, rng, [VERTICAL, SIDEWAYS], rest=2)
    p = judges["kr270"].positions(cases, points_of(cell), K6)
    m = table(tmp_path, cell, arm, cases, p)
    start, z, chi2, dof = joints_only(cell, arm), [], [], 0
    for _ in range(draws):
        o = observe(replace(m, position=m.position + sigma * rng.normal(size=m.position.shape)), True, noise(sigma))
        solution = identify(start, o, "least-squares")
        fit = goodness(solution, o)
        stats, how = statistics(solution, o, fit)
        if not fit.rejected:
            z.append((solution.model.x - K6) / stats.sigma)
        chi2.append(fit.chi2_per_dof)
        dof = fit.dof
        start = solution.model
    assert "stated noise" in how
    assert len(z) >= draws - 3
    number = np.array(z).size
    assert dof == 3 * m.case.size - 3 * 8 * 3 - 6
    assert abs(np.mean(z)) < 4 / np.sqrt(number)
    assert abs(np.std(z) - 1) < 4 / np.sqrt(2 * number)
    assert np.abs(np.mean(z, axis=0)).max() < 4 / np.sqrt(draws)
    assert np.abs(np.std(z, axis=0) - 1).max() < 4 / np.sqrt(2 * draws)
    assert abs(np.mean(chi2) - 1) < 4 * np.sqrt(2 / dof / draws)


def test_more_noise_than_stated_is_rejected_and_widens_the_intervals(tmp_path, arms, cells, judges):
    arm, cell, rng = arms["kr270"], cells["kr270"], np.random.default_rng(6)
    cases = plan(arm, cell, 20, rng, [VERTICAL, SIDEWAYS])
    p = judges["kr270"].positions(cases, points_of(cell), K6)
    o = watched(tmp_path, cell, arm, cases, p + 30e-6 * rng.normal(size=p.shape), 10e-6)
    solution = identify(joints_only(cell, arm), o)
    fit = goodness(solution, o)
    assert fit.rejected
    assert fit.chi2_per_dof == pytest.approx(9.0, rel=0.25)
    wide, how = covariance(solution, o, fit)
    assert "sandwich" in how
    ratio = np.sqrt(np.diag(wide) / np.diag(solution.identifiability.covariance()))
    assert np.median(ratio) == pytest.approx(3.0, rel=0.35)


# -- the semidefinite program ------------------------------------------------------------------------------------------------


def one_link(template="symmetric"):
    """A single 6x6 spring at the origin; position and rotation of that very point are read."""
    from drake_stiffness.model import Model

    arm = hand_made_arm([(0, 0, 0), (0, 0, 0)], [(0, 0, 1)])
    effect = LinkCompliance("l1", template, "x", 1.0)
    return Model({}, arm, {"P": np.zeros(3)}, np.zeros(3), (effect,), np.zeros(len(effect.parameters)))


def six_unit_loads(tmp_path, cells, model, deflection, sigma):
    """Readings under plus and minus each unit load, all six components with one sigma (m and rad)."""
    load = 1e-3
    wrench = load * np.hstack([np.zeros((6, 1)), np.eye(6), -np.eye(6)])
    cases = Cases(np.zeros((1, 13)), wrench, np.zeros(3), np.zeros(13, dtype=int), np.arange(13), np.zeros(13))
    d = load * np.hstack([np.zeros((6, 1)), deflection, -deflection])
    cell = cells["kr270"].model_copy(
        update={"reference_points_m": {"P": (0.0, 0.0, 0.0)}, "load_point_m": (0.0, 0.0, 0.0)}
    )
    return watched(tmp_path, cell, model.arm, cases, d[None, :3], sigma, relative=True, turn=d[3:], sigma_rad=sigma)


def indefinite(rng) -> np.ndarray:
    """Measured compliance of one link: eigenvalues of both signs, not symmetric, of the size 1e-6."""
    Q = np.linalg.qr(rng.normal(size=(6, 6)))[0]
    skew = rng.normal(size=(6, 6))
    return 1e-6 * (Q @ np.diag([2.0, 1.5, 1.0, 0.4, -0.3, -0.8]) @ Q.T + 0.1 * (skew - skew.T))


def test_with_one_noise_on_all_entries_the_sdp_clips_the_eigenvalues_of_the_symmetric_part(tmp_path, cells):
    found, rng = [], np.random.default_rng(7)
    for _ in range(3):
        measured_k = indefinite(rng)
        model = one_link()
        solution = identify(model, six_unit_loads(tmp_path, cells, model, measured_k, 1e-11))
        values, vectors = np.linalg.eigh((measured_k + measured_k.T) / 2)
        expected = vectors @ np.diag(np.maximum(values, 0)) @ vectors.T
        found = solution.model.effects[0].matrix(solution.model.x)
        assert np.abs(found - expected).max() < 1e-6 * np.abs(expected).max()
        assert smallest_eigenvalue(solution.model) >= -1e-9
        assert solution.active == ("l1",)


def test_least_squares_of_the_same_data_is_the_symmetric_part_or_with_36_unknowns_the_matrix_itself(tmp_path, cells):
    measured_k = indefinite(np.random.default_rng(8))
    for template, expected in (("symmetric", (measured_k + measured_k.T) / 2), ("full", measured_k)):
        model = one_link(template)
        solution = identify(model, six_unit_loads(tmp_path, cells, model, measured_k, 1e-11), "least-squares")
        found = model.effects[0].matrix(solution.model.x)
        assert np.abs(found - expected).max() < 1e-6 * np.abs(expected).max()


def test_the_sdp_is_refused_for_36_independent_entries_with_a_word_why(tmp_path, cells):
    model = one_link("full")
    o = six_unit_loads(tmp_path, cells, model, np.eye(6) * 1e-6, 1e-9)
    with pytest.raises(InputError, match=r"symmetric.*least-squares"):
        identify(model, o, "sdp")


def test_where_no_constraint_is_active_the_sdp_is_least_squares(tmp_path, arms, cells, judges):
    arm, cell, rng = arms["kr270"], cells["kr270"], np.random.default_rng(9)
    cases = plan(arm, cell, 6, rng, [VERTICAL, SIDEWAYS])
    p = judges["kr270"].positions(cases, points_of(cell), K6)
    o = watched(tmp_path, cell, arm, cases, p + 1e-5 * rng.normal(size=p.shape), 1e-5)
    sdp, ls = (identify(joints_only(cell, arm), o, method) for method in ("sdp", "least-squares"))
    assert (ls.model.x > 0).all()
    sigma = np.sqrt(np.diag(ls.identifiability.covariance())) * ls.model.scales
    assert np.abs((sdp.model.x - ls.model.x) / sigma).max() < 1e-4
    assert sdp.active == ()


def test_joint_compliances_under_sdp_are_nonnegative_least_squares(tmp_path, arms, cells, judges):
    arm, cell, rng = arms["kr270"], cells["kr270"], np.random.default_rng(10)
    truth = K6 * [1, 1, 1, 0, 1, 0]
    cases = plan(arm, cell, 4, rng, [VERTICAL, SIDEWAYS])
    p = judges["kr270"].positions(cases, points_of(cell), truth)
    hidden = 0
    for _ in range(6):
        o = watched(tmp_path, cell, arm, cases, p + 2e-4 * rng.normal(size=p.shape), 2e-4)
        model = joints_only(cell, arm)
        ls = identify(model, o, "least-squares")
        A = columns(o, model)
        target = measured(o) - measured(o) + A @ (ls.model.x / model.scales)  # the unconstrained optimum as data
        rival = lsq_linear(A, target, bounds=(0, np.inf), tol=1e-14).x * model.scales
        found = identify(model, o, "sdp").model.x
        assert np.abs(found - rival).max() < 1e-4 * np.abs(rival).max()
        assert (found >= 0).all()
        hidden += int((ls.model.x < 0).any())
    assert hidden >= 2


def two_symmetric_links(arm, cell, judge, rng, postures):
    """Joints, base and link 2 as whole symmetric matrices; positive-definite truth; the plan and noise-free readings."""
    _, k_link = random_springs(arm, rng)
    truth = [k_link[0], None, k_link[2], None, None, None, None]
    effects = [
        *(JointCompliance(n) for n in arm.joint_names),
        link_spring(arm, "base_link", "symmetric", "x"),
        link_spring(arm, "link_2", "symmetric", "x"),
    ]
    cases = plan(arm, cell, postures, rng, [VERTICAL, SIDEWAYS])
    return make_model(cell, arm, effects), cases, judge.positions(cases, points_of(cell), K6, truth)


def whole_matrix_cones(model, x):
    """Constraints on a cvxpy variable in units of scale, every link as one 6x6 matrix."""
    cones = [x[:6] >= 0]
    for effect, own in zip(model.effects[6:], model.slices[6:], strict=True):
        s = effect.component_scales
        basis = effect.template.basis * np.array([p.scale for p in effect.parameters])[:, None, None] / np.outer(s, s)
        K = sum(x[own][i] * basis[i] for i in range(21))
        cones.append((K + K.T) / 2 >> 0)
    return cones


def scaled_eigenvalues(model):
    for effect, own in zip(model.effects[6:], model.slices[6:], strict=True):
        s = effect.component_scales
        yield np.linalg.eigvalsh(effect.matrix(model.x[own]) / np.outer(s, s))


def test_where_data_leave_a_choice_the_sdp_takes_the_springs_of_least_norm(tmp_path, arms, cells, judges):
    """A rival: least norm among all whole matrices that the data cannot tell apart, by another solver."""
    arm, cell = arms["kr270"], cells["kr270"]
    model, cases, p = two_symmetric_links(arm, cell, judges["kr270"], np.random.default_rng(11), 8)
    solution = identify(model, watched(tmp_path, cell, arm, cases, p, 1e-5))
    assert solution.identifiability.unseen.shape[1] > 0
    ours, seen = solution.model.x / model.scales, solution.identifiability.seen
    x = cp.Variable(ours.size)
    rival = cp.Problem(cp.Minimize(cp.sum_squares(x)), [*whole_matrix_cones(model, x), seen.T @ x == seen.T @ ours])
    rival.solve(solver=cp.SCS, eps=1e-7, max_iters=100000)
    assert np.linalg.norm(ours) == pytest.approx(np.linalg.norm(x.value), rel=1e-3)
    assert np.abs(ours - x.value).max() < 2e-2 * np.abs(ours).max()
    for values in scaled_eigenvalues(solution.model):
        assert values[0] >= -1e-9 * max(1.0, values[-1])


@pytest.mark.parametrize("seed", [11, 12])
def test_noisy_whole_matrices_come_to_rest_and_fit_as_well_as_a_rival_conic_program(
    tmp_path, arms, cells, judges, seed
):
    arm, cell, rng = arms["kr270"], cells["kr270"], np.random.default_rng(seed)
    model, cases, p = two_symmetric_links(arm, cell, judges["kr270"], rng, 10)
    o = watched(tmp_path, cell, arm, cases, p + 1e-5 * rng.normal(size=p.shape), 1e-5)
    solution = identify(model, o)
    ours = solution.model.x / model.scales
    Q, R = np.linalg.qr(solution.A)
    right = Q.T @ (solution.residual + solution.A @ ours)
    x = cp.Variable(ours.size)
    rival = cp.Problem(cp.Minimize(cp.sum_squares(R @ x - right)), whole_matrix_cones(model, x))
    rival.solve(solver=cp.SCS, eps=1e-7, max_iters=100000)
    assert (
        float(((R @ ours - right) ** 2).sum()) <= rival.value + 0.1
    )  # chi-square: a tenth of one standard deviation squared
    for values in scaled_eigenvalues(solution.model):
        assert values[0] >= -1e-9 * max(1.0, values[-1])


def test_two_springs_that_act_alike_share_evenly(tmp_path, arms, cells, judges):
    """Joint 1 (vertical) and the base's twist: only the sum is seen; of least norm is one half each."""
    arm, cell = arms["kr270"], cells["kr270"]
    cases = plan(arm, cell, 6, np.random.default_rng(12), [VERTICAL, SIDEWAYS, FORWARD])
    k = 3e-7
    p = judges["kr270"].positions(cases, points_of(cell), k * np.eye(6)[0])

    class Twist(BaseCompliance):
        """The base's rotation about its vertical, nothing else."""

        @property
        def template(self):
            from drake_stiffness.springs import SpringTemplate

            return SpringTemplate(((5, 5),), symmetric=True)

    for method in ("sdp", "least-squares"):
        model = make_model(cell, arm, [JointCompliance("joint_1"), Twist("base", link="base_link")])
        solution = identify(model, watched(tmp_path, cell, arm, cases, p, 1e-5), method)
        assert solution.model.x == pytest.approx([k / 2, k / 2], rel=1e-7)


# -- bounds of other effects --------------------------------------------------------------------------------------------------


class Shift(Effect):
    """All readings are shifted along x and y of the tracker; bounded as a test asks."""

    kind, station = "shift", "reading"

    def __init__(self, where="tracker", lower=-np.inf, upper=np.inf):
        super().__init__(where)
        self.lower, self.upper = lower, upper

    @property
    def parameters(self):
        return (Parameter("s", "m", 1e-3, self.lower, self.upper),)

    def on_reading(self, reading, cases, x):
        return replace(reading, p=reading.p + np.array([[1.0], [1.0], [0.0]]) * x[0])


@pytest.mark.parametrize(
    ("truth", "lower", "upper"), [(-2e-3, 0.0, np.inf), (2e-3, -np.inf, 0.0), (2e-3, 0.0, 1e-3), (5e-3, 1e-3, np.inf)]
)
def test_bounds_of_an_effect_hold_and_the_rest_is_fitted_to_them(tmp_path, arms, cells, judges, truth, lower, upper):
    """Position data: clamping the shift at its bound changes what fits best for the joints."""
    arm, cell = arms["kr270"], cells["kr270"]
    rng = np.random.default_rng(13)
    cases = plan(arm, cell, 3, rng, [VERTICAL, SIDEWAYS])
    p = judges["kr270"].positions(cases, points_of(cell), K6) + truth * np.array([1.0, 1, 0])[:, None]
    o = watched(tmp_path, cell, arm, cases, p, 1e-4, displacement=False)
    model = make_model(cell, arm, [*(JointCompliance(n) for n in arm.joint_names), Shift("tracker", lower, upper)])
    solution = identify(model, o)
    shift = np.clip(truth, lower, upper)
    assert solution.model.x[-1] == pytest.approx(shift, abs=1e-8)
    # with the shift held where it must be, what remains is nonnegative least squares of the joints
    A, r = solution.A, solution.residual
    x = solution.model.x / model.scales
    rival = lsq_linear(A[:, :-1], r + A[:, :-1] @ x[:-1], bounds=(0, np.inf), tol=1e-14).x
    assert np.abs(rival - x[:-1]).max() < 1e-3 * np.abs(rival).max()


def test_the_springs_setting_of_a_cell_is_what_is_identified(tmp_path, arms, cells, judges):
    arm = arms["kr270"]
    cell = cells["kr270"].model_copy(update={"springs": Springs(joints=["joint_2"], links="none")})
    cases = plan(arm, cell, 3, np.random.default_rng(14), [VERTICAL])
    p = judges["kr270"].positions(cases, points_of(cell), K6 * [0, 1, 0, 0, 0, 0])
    solution = identify(make_model(cell, arm, spring_effects(cell, arm)), watched(tmp_path, cell, arm, cases, p, 1e-5))
    assert solution.model.names == ("joint_2",)
    assert solution.model.x == pytest.approx([K6[1]], rel=1e-8)
