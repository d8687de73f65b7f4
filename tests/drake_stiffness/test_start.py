"""A tracker that stands anywhere is found before the fit."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from synthetic import VERTICAL, plan, points_of, table, watched

from drake_stiffness.assembly import make_model
from drake_stiffness.effects import make_effect
from drake_stiffness.effects.compliance import JointCompliance
from drake_stiffness.identification import identify
from drake_stiffness.start import fitted_frame, starting_model

TURNS = [(0.0, 0.0, 0.0), (0.3, -1.2, 2.0), (0.0, 0.0, np.pi), (np.pi, 0.0, 0.0), (1.8, 1.8, 1.8)]


@pytest.mark.parametrize("r", TURNS)
def test_the_frame_carries_read_points_onto_those_of_the_world_half_turns_included(r):
    p_T = np.random.default_rng(0).normal(size=(3, 9))
    R, d = Rotation.from_rotvec(r).as_matrix(), np.array([4.0, -2.0, 1.0])
    x = fitted_frame(R @ p_T + d[:, None], p_T)
    assert np.allclose(Rotation.from_rotvec(x[3:]).as_matrix(), R, atol=1e-9)
    assert x[:3] == pytest.approx(d, abs=1e-9)


@pytest.mark.parametrize("r", TURNS)
def test_joints_are_found_by_a_tracker_that_stands_anywhere(tmp_path, arms, cells, judges, r):
    arm, cell = arms["kr270"], cells["kr270"]
    k = np.array([0.33e-6, 0.30e-6, 0.42e-6, 2.8e-6, 2.9e-6, 3.4e-6])
    cases = plan(arm, cell, 8, np.random.default_rng(1), [VERTICAL, (1500.0, 2500.0, 0)])
    p = judges["kr270"].positions(cases, points_of(cell), k)
    seen = np.einsum("ba,pbn->pan", Rotation.from_rotvec(r).as_matrix(), p - np.array([3.0, 1.0, 0.2])[:, None])
    model = make_model(
        cell, arm, [*(JointCompliance(n) for n in arm.joint_names), make_effect("tracker_frame", "tracker")]
    )
    begun = starting_model(model, table(tmp_path, cell, arm, cases, seen))
    o = watched(tmp_path, cell, arm, cases, seen, 1e-5, displacement=False)
    solution = identify(begun, o)
    found = solution.model.x
    information = solution.A.T @ solution.A
    assert solution.identifiability.covariance() @ information == pytest.approx(np.eye(12), abs=1e-3)
    assert found[:6] == pytest.approx(k, rel=1e-6)
    assert found[6:9] == pytest.approx([3.0, 1.0, 0.2], abs=1e-8)
    assert np.allclose(Rotation.from_rotvec(found[9:]).as_matrix(), Rotation.from_rotvec(r).as_matrix(), atol=1e-8)


def test_without_a_tracker_frame_or_with_displacements_the_start_stays(tmp_path, arms, cells):
    arm, cell = arms["kr270"], cells["kr270"]
    cases = plan(arm, cell, 2, np.random.default_rng(2), [VERTICAL])
    p = np.zeros((3, 3, cases.number))
    framed = make_model(cell, arm, [make_effect("tracker_frame", "tracker")])
    assert (starting_model(framed, table(tmp_path, cell, arm, cases, p, relative=True)).x == 0).all()
    bare = make_model(cell, arm, [JointCompliance("joint_1")])
    assert starting_model(bare, table(tmp_path, cell, arm, cases, p)) is bare


def test_what_frame_and_first_joint_cannot_be_told_apart_by_stays_where_the_start_put_it(tmp_path, arms, cells, judges):
    """A zero offset of a vertical first joint is a turn of the tracker: the fit is whole, and nothing runs off along it."""
    arm, cell, r, d = arms["kr270"], cells["kr270"], np.array([0.3, -1.2, 2.0]), np.array([3.0, 1.0, 0.2])
    cases = plan(arm, cell, 8, np.random.default_rng(3), [VERTICAL])
    p = judges["kr270"].positions(cases, points_of(cell), np.zeros(6))
    seen = np.einsum("ba,pbn->pan", Rotation.from_rotvec(r).as_matrix(), p - d[:, None])
    effects = [make_effect("joint_zero_offset", n) for n in ("joint_1", "joint_3")] + [
        make_effect("tracker_frame", "tracker")
    ]
    begun = starting_model(make_model(cell, arm, effects), table(tmp_path, cell, arm, cases, seen))
    solution = identify(begun, watched(tmp_path, cell, arm, cases, seen, 1e-5, displacement=False))
    assert solution.identifiability.rank == 7
    assert np.abs(solution.residual).max() < 1e-3
    assert solution.model.x == pytest.approx([0, 0, *d, *r], abs=1e-6)
