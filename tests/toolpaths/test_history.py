"""Play and friction see the points of a program as one history, and a correction that would chase them is said so."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.special import ndtr

from drake_stiffness.effects.effect import Cases
from drake_stiffness.effects.hysteresis import JointHysteresis
from drake_stiffness.effects.transmission import JointBacklash
from drake_stiffness.equilibrium import solve_equilibrium
from drake_stiffness.text import names_of
from toolpaths import job
from toolpaths.history import begins, path_order

POSE = "A 0.0000,B 0.0000,C 180.0000"


def with_effect(model, effect, value):
    return replace(model, effects=(*model.effects, effect), x=np.append(model.x, value))


@pytest.fixture(scope="module")
def friction(model):
    return with_effect(model, JointHysteresis("joint_1", threshold=25.0), 1.5e-4)


@pytest.fixture(scope="module")
def there_and_back(tools):
    """Out along y and back the same way, with a lift in the middle: joint 1's torque goes up and down again."""
    steps = [(0, y) for y in [*range(-300, 301, 100), 200, 100, 100, 0, -100, -200, -300]]
    lines = [f"LIN {{X {x}.0000,Y {y}.0000,Z 0.0000,{POSE}}}" for x, y in steps]
    return tools.program(*lines[:9], "PTP {X 0.0,Y 0.0,Z 50.0,A 0.0,B 0.0,C 180.0}", *lines[9:])


@pytest.fixture(scope="module")
def process(tools):
    return tools.process(
        workpiece={"position_m": [1.65, 0.0, 0.75]}, force=tools.constant("world", fx_N=600, fy_N=50, fz_N=-100)
    )


@pytest.fixture(scope="module")
def corrected(there_and_back, friction, process, tools):
    straight = tools.constant("world", fx_N=600, fz_N=-100)  # joint 1 carries -600 N y
    return job.compensate(there_and_back, friction, process.model_validate({**process.model_dump(), "force": straight}))


def states_by_hand(result, q):
    """The history as the machine lives it: cut, lift, come down, cut."""
    path, lift = result.path, 9
    point = [*range(lift), lift - 1, lift, *range(lift, q.shape[1])]
    loaded = np.array([True] * lift + [False, False] + [True] * (q.shape[1] - lift))
    return Cases(
        q[:, point],
        path.wrench[:, point] * loaded,
        path.bench.p_ET,
        np.zeros(len(point), dtype=int),
        np.arange(len(point)),
        np.full(len(point), np.nan),
    ), loaded


def tool(equilibrium, p_ET):
    return equilibrium.p_E + np.einsum("ijn,j->in", equilibrium.R_E, p_ET)


def test_the_corrected_path_run_in_order_meets_the_wanted_one(corrected, friction):
    from toolpaths.compensation import mirror

    path = corrected.path
    q = mirror(path.bench, path.postures.q, path.wrench, path.only, path.postures.free).q
    cases, loaded = states_by_hand(corrected, q)
    under, without = (solve_equilibrium(friction.structure, c) for c in (cases, cases.unloaded()))
    moved = (tool(under, path.bench.p_ET) - tool(without, path.bench.p_ET))[:, loaded]
    np.testing.assert_allclose(path.bench.commanded(q)[1] + moved, path.p.T, atol=5e-8)
    # the same corrections, had every point come straight from weight alone, would be off by what friction keeps back
    fresh = Cases(q, path.wrench, path.bench.p_ET)
    apart = tool(solve_equilibrium(friction.structure, fresh), path.bench.p_ET)
    apart = apart - tool(solve_equilibrium(friction.structure, fresh.unloaded()), path.bench.p_ET)
    assert np.abs(apart - moved).max() > 5e-5


def test_the_same_place_needs_another_correction_on_the_way_back(corrected):
    there, back = corrected.correction_mm[1:5], corrected.correction_mm[12:8:-1]
    np.testing.assert_allclose(corrected.target_mm[1:5], corrected.target_mm[12:8:-1])
    assert np.linalg.norm(there - back, axis=1).max() > 0.05


def test_where_friction_turns_round_is_said_by_line(corrected):
    (turning,) = corrected.to_dict()["turning_points"]
    assert turning["kind"] == "joint_hysteresis"
    assert turning["lines"] == [8]  # 60 N m after the turn at line 7; two half-widths are 50
    assert any("friction of joint_1 turns round at line" in note for note in corrected.notes)


def test_a_lift_stands_between_two_cuts(there_and_back):
    rows = np.flatnonzero(there_and_back.corrected)
    begin = begins(there_and_back, rows)
    assert np.flatnonzero(begin).tolist() == [0, 9]
    order = path_order(begin)
    assert order.point.tolist() == [*range(9), 8, 9, *range(9, 14)]
    assert np.flatnonzero(~order.loaded).tolist() == [9, 10]


def test_springs_alone_need_no_order(there_and_back, model, process):
    path = job.compensate(there_and_back, model, process).path
    assert path.bench.order is None
    assert not path.bench.remembers


def test_a_backlash_that_the_correction_chases_is_said_with_lines_and_the_jump(there_and_back, model, process):
    slack = with_effect(model, JointBacklash("joint_1"), 2e-4)
    result = job.compensate(there_and_back, slack, process)
    (turning,) = result.to_dict()["turning_points"]
    assert turning["kind"] == "joint_backlash"
    # x forward force on an arm of 1.65 m: its torque about joint 1 is -y fx + x fy, zero at y = 137 mm
    assert turning["lines"] == [6, 9]  # up between lines 5 and 6, back between 8 and 9
    assert turning["size_mm"] == pytest.approx(2e-4 * np.hypot(1650, 200), rel=0.01)
    (note,) = [note for note in result.notes if "chases the backlash" in note]
    assert "line 6, 9" in note
    assert "joint_1" in note
    jump = np.linalg.norm(np.diff(result.correction_mm, axis=0), axis=1)
    assert jump[4] > 0.3


def test_near_the_flip_the_interval_holds_the_whole_jump(there_and_back, model, process):
    """The jump times the root of p (1 - p), p the chance that a torque uncertain by 60 % has the other sign."""
    slack = with_effect(model, JointBacklash("joint_1"), 2e-4)
    force = process.force.model_copy(update={"relative_sigma": 0.6})
    result = job.compensate(there_and_back, slack, process.model_copy(update={"force": force}))
    p = job.compensate(there_and_back, model, process).path
    lever = np.linalg.norm(p.p[:, :2], axis=1) * 1e3
    torque = p.p[:, 0] * p.wrench[1] - p.p[:, 1] * p.wrench[0]
    other = ndtr(-np.abs(torque) / (0.6 * np.abs(torque)))  # about the vertical axis weight has no part
    np.testing.assert_allclose(result.account.interval.jump_mm, 2e-4 * lever * np.sqrt(other * (1 - other)), rtol=1e-3)
    assert "jumps of backlash where the torque may have the other sign" in result.account.interval.carries


def test_what_an_effect_other_than_a_spring_bends_has_a_share_of_its_own(corrected):
    causes = {(c["kind"], c["where"]): c for c in corrected.to_dict()["causes"]}
    assert abs(causes[("joint_hysteresis", "joint_1")]["mean_mm"]) > 0.02
    assert sum(c["share"] for c in causes.values()) == pytest.approx(1.0)
    names = names_of(corrected.to_dict()["causes"])
    assert {"joint_1 (joint hysteresis)", "joint_1 (joint compliance)", "joint_2", "second order"} <= set(names)
    assert abs(causes[("second order", "")]["share"]) < 0.01
