"""The public interface carries effects of users: nonlinear, history-dependent, of the force sensor, of the tracker.

Truth comes from Drake's plant with the effect put in by hand; the effect's own class only identifies.
"""

from dataclasses import replace

import numpy as np
import pytest
from synthetic import plan, points_of, watched

from drake_stiffness.assembly import make_model
from drake_stiffness.effects import Effect, Parameter, effect_kinds, make_effect
from drake_stiffness.effects.compliance import JointCompliance
from drake_stiffness.errors import InputError
from drake_stiffness.identification import identify
from drake_stiffness.model import load_model
from drake_stiffness.simulation import simulate_readings

K = np.array([0.4e-6, 0.30e-6, 0.5e-6, 2.8e-6, 2.9e-6, 3.4e-6])
# Unloading stops half way: what play keeps of the way there is seen.
LEVELS = [tuple(f * np.array([900.0, 1200.0, -1500.0])) for f in (2, 1, -1, -2, -1)]


class Hardening(Effect):
    """theta += c tau^3 at one joint."""

    kind, station = "cubic_hardening", "spring"

    @property
    def parameters(self):
        return (Parameter("c", "rad/(N m)^3", 1e-14),)

    def deflection(self, arm, carried, cases, x):
        joint = arm.joint_names.index(self.where)
        return {joint: x[0] * carried.tau_joint[joint] ** 3}


class Play(Effect):
    """theta += c p, p the play of half width `half_Nm` behind tau over the steps, from the state that weight gives."""

    kind, station = "torque_play", "spring"

    def __init__(self, where, half_Nm=800.0):
        super().__init__(where)
        self.half_Nm = half_Nm

    @property
    def parameters(self):
        return (Parameter("c", "rad/(N m)", 1e-6),)

    def settings(self):
        return {"half_Nm": self.half_Nm}

    def deflection(self, arm, carried, cases, x):
        joint = arm.joint_names.index(self.where)
        tau, p = carried.tau_joint[joint], np.empty(cases.number)
        for e in np.unique(cases.experiment):
            mine = np.flatnonzero(cases.experiment == e)
            mine = mine[np.argsort(cases.step[mine])]
            state = carried.weight_joint[joint, mine[0]]
            for i in mine:
                state = min(max(state, tau[i] - self.half_Nm), tau[i] + self.half_Nm)
                p[i] = state
        return {joint: x[0] * p}


class ForceBias(Effect):
    """The sensor, fixed to the flange, hides a constant force: what acts is what was stated plus R b."""

    kind, station = "sensor_bias", "wrench"

    @property
    def parameters(self):
        return tuple(Parameter(c, "N", 50.0) for c in "xyz")

    def on_wrench(self, wrench, cases, R_E, x):
        out = wrench.copy()
        out[:3] += np.einsum("ijn,j->in", R_E, x)
        return out


class Drift(Effect):
    """The tracker creeps by a constant velocity."""

    kind, station = "steady_drift", "reading"

    @property
    def parameters(self):
        return tuple(Parameter(c, "m/s", 1e-8) for c in "xyz")

    def on_reading(self, reading, cases, x):
        return replace(reading, p=reading.p + x[:, None] * cases.time_s[reading.case])


@pytest.fixture
def world(arms, cells, judges):
    arm, cell = arms["kr270"], cells["kr270"]
    return arm, cell, judges["kr270"], plan(arm, cell, 6, np.random.default_rng(0), LEVELS)


def truth(judge, cell, cases, law=None, wrench=None):
    """(P, 3, N) from Drake; `law(i, tau, weight)` bends joints further and may remember."""
    points, out = points_of(cell), []
    for i in range(cases.number):
        q, w = cases.q[:, i], cases.wrench[:, i]
        judge.pose(q, np.zeros(6), [None] * 7)
        weight, _ = judge.torques(np.zeros(6), cases.p_ELoad, [None] * 7)
        w = w if wrench is None else wrench(w, judge.pose(q, np.zeros(6), [None] * 7)[:3, :3])
        bend = None if law is None else (lambda tau, i=i, weight=weight: law(i, tau, weight))
        X, _, _ = judge.equilibrium(q, w, cases.p_ELoad, K, [None] * 7, bend)
        out.append(points @ X[:3, :3].T + X[:3, 3])
    return np.array(out).transpose(1, 2, 0)


def fitted(tmp_path, arm, cell, cases, p, effect, **options):
    model = make_model(cell, arm, [*(JointCompliance(n) for n in arm.joint_names), effect])
    return identify(model, watched(tmp_path, cell, arm, cases, p, 1e-5, **options)).model


def simulated(arm, cell, cases, effect, x):
    model = make_model(cell, arm, [*(JointCompliance(n) for n in arm.joint_names), effect], np.concatenate([K, x]))
    names, number = np.array(list(model.points)), cases.number
    p = simulate_readings(model, cases, np.repeat(np.arange(number), names.size), np.tile(names, number)).p
    return p.reshape(3, number, names.size).transpose(2, 0, 1)


def test_a_hardening_joint_is_simulated_and_found(tmp_path, world):
    arm, cell, judge, cases = world
    c = -4e-15
    p = truth(judge, cell, cases, lambda i, tau, weight: np.array([0, c * tau[1] ** 3, 0, 0, 0, 0]))
    linear = truth(judge, cell, cases)
    assert np.abs(p - linear).max() > 1e-5
    assert np.abs(simulated(arm, cell, cases, Hardening("joint_2"), [c]) - p).max() < 1e-9
    model = fitted(tmp_path, arm, cell, cases, p, Hardening("joint_2"))
    assert model.x == pytest.approx(np.concatenate([K, [c]]), rel=1e-5)


def test_a_joint_with_play_remembers_its_steps_and_is_found(tmp_path, world):
    arm, cell, judge, cases = world
    c, half, states = 5e-7, 800.0, {}

    def law(i, tau, weight):
        before = weight[1] if cases.step[i] == 0 else states[i - 1]
        states[i] = min(max(before, tau[1] - half), tau[1] + half)
        return np.array([0, c * states[i], 0, 0, 0, 0])

    p = truth(judge, cell, cases, law)
    assert np.abs(simulated(arm, cell, cases, Play("joint_2", half), [c]) - p).max() < 1e-9
    model = fitted(tmp_path, arm, cell, cases, p, Play("joint_2", half))
    assert model.x == pytest.approx(np.concatenate([K, [c]]), rel=1e-6)


def test_history_does_not_run_over_from_one_experiment_into_the_next(world):
    """Each experiment alone gives what it gives among the others, in whatever order experiments stand."""
    arm, cell, _, cases = world
    together = simulated(arm, cell, cases, Play("joint_2"), [5e-7])
    for e in (0, 3):
        mine = np.flatnonzero(cases.experiment == e)
        assert (
            np.abs(simulated(arm, cell, cases.take(mine), Play("joint_2"), [5e-7]) - together[:, :, mine]).max() < 1e-12
        )


BIAS = np.array([60.0, -45.0, 80.0])


def biased(judge, cell, cases):
    return truth(judge, cell, cases, wrench=lambda w, R: w + np.concatenate([R @ BIAS, np.zeros(3)]))


def test_a_bias_of_the_force_sensor_is_simulated(world):
    arm, cell, judge, cases = world
    p = biased(judge, cell, cases)
    assert np.abs(simulated(arm, cell, cases, ForceBias("force_sensor"), BIAS) - p).max() < 1e-9
    assert np.abs(truth(judge, cell, cases) - p).max() > 1e-5


def test_a_bias_of_the_force_sensor_is_found_though_a_rigid_arm_would_not_show_it(tmp_path, world):
    arm, cell, judge, cases = world
    p = biased(judge, cell, cases)
    model = fitted(tmp_path, arm, cell, cases, p, ForceBias("force_sensor"), displacement=False)
    assert model.x == pytest.approx(np.concatenate([K, BIAS]), rel=1e-5)


@pytest.mark.parametrize("displacement", [True, False])
def test_a_drift_in_time_is_simulated_and_found_though_rows_are_not_in_order_of_time(tmp_path, world, displacement):
    arm, cell, judge, cases = world
    velocity = np.array([2e-8, -1e-8, 3e-8])
    p = truth(judge, cell, cases) + velocity[:, None] * cases.time_s
    assert (np.diff(cases.time_s) < 0).all()
    model = fitted(tmp_path, arm, cell, cases, p, Drift("tracker"), displacement=displacement)
    assert model.x == pytest.approx(np.concatenate([K, velocity]), rel=1e-6)


class _Point:
    """An installed package's entry point, as importlib.metadata hands it out."""

    def __init__(self, name, cls):
        self.name, self.cls = name, cls

    def load(self):
        return self.cls


def install(monkeypatch, *points):
    from drake_stiffness.effects import catalogue

    monkeypatch.setattr(catalogue, "entry_points", lambda group: points if group == "drake_stiffness.effects" else ())
    effect_kinds.cache_clear()


@pytest.fixture(autouse=True)
def _forget():
    yield
    effect_kinds.cache_clear()


def test_kinds_that_packages_register_are_made_saved_and_loaded(monkeypatch, tmp_path, arms, cells):
    install(monkeypatch, _Point("play", Play))
    assert "torque_play" in effect_kinds()
    model = make_model(
        cells["kr270"], arms["kr270"], [make_effect("torque_play", "joint_3", {"half_Nm": 12.5})], np.array([3e-7])
    )
    model.save(tmp_path / "model.json")
    again = load_model(tmp_path / "model.json")
    assert (again.effects[0].half_Nm, again.x.tolist(), again.names) == (12.5, [3e-7], ("joint_3.torque_play",))
    monkeypatch.undo()
    effect_kinds.cache_clear()
    with pytest.raises(InputError, match="torque_play"):
        load_model(tmp_path / "model.json")


def test_registered_things_that_are_no_effects_or_take_a_name_are_refused(monkeypatch):
    install(monkeypatch, _Point("odd", dict))
    with pytest.raises(InputError, match="odd"):
        effect_kinds()

    class Other(Drift):
        kind = "payload"

    install(monkeypatch, _Point("other", Other))
    with pytest.raises(InputError, match="'payload' exists already"):
        effect_kinds()
