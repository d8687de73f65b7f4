"""Reductions: the maps of M1 and M2, M3 as printed against dropping in turn, masks, and what a reduced model is good for."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from synthetic import FORWARD, SIDEWAYS, VERTICAL, noise, plan, points_of, table, watched
from test_identification import beam_links

from drake_stiffness.assembly import link_spring, make_model, spring_effects
from drake_stiffness.cell import Springs
from drake_stiffness.effects.compliance import JointCompliance, LinkCompliance
from drake_stiffness.effects.gravity_compensator import GravityCompensator
from drake_stiffness.errors import InputError, UntrustworthyError
from drake_stiffness.identification import identify
from drake_stiffness.model import load_model
from drake_stiffness.observation import columns, observe
from drake_stiffness.reduction.elimination import Candidates, base, candidates, drop_at_once, drop_in_turn, ratios
from drake_stiffness.reduction.patterns import joints_only, keep_only, sparsed, symmetrised, widened
from drake_stiffness.reduction.reduction import neglecting, non_redundant, sequential
from drake_stiffness.simulation import simulate_displacement
from drake_stiffness.springs import mask_entries, masked_template, sparsing_map, symmetrisation_map

K6 = np.array([0.33e-6, 0.30e-6, 0.42e-6, 2.8e-6, 2.9e-6, 3.4e-6])
BEAMS = {"x": "k11 k22 k26 k33 k35 k44 k55 k66", "y": "k11 k16 k22 k33 k34 k44 k55 k66"}
BEAMS["z"] = "k11 k15 k22 k24 k33 k44 k55 k66"


def system(A, x, *, error=0.0, seed=0):
    """Candidates of a bare linear system with unit noise."""
    n = A.shape[1]
    g = A @ x + error * np.random.default_rng(seed).normal(size=A.shape[0])
    return Candidates(
        tuple(f"p{i}" for i in range(n)),
        tuple(np.array([i]) for i in range(n)),
        A,
        g,
        np.zeros((n, A.shape[0])),
        np.zeros(n, dtype=int),
        False,
        (),
    )


@pytest.fixture(scope="module")
def beams(arms, cells, judges, tmp_path_factory):
    """A campaign of 20 postures on a KR 270 of prismatic beams, judged by Drake: (model, observations, held-out displacement)."""
    arm, cell, rng = arms["kr270"], cells["kr270"], np.random.default_rng(3)
    springs, k_link = beam_links(arm, rng)
    model = make_model(cell, arm, [*(JointCompliance(n) for n in arm.joint_names), *springs])
    cases = plan(arm, cell, 20, rng, [VERTICAL, SIDEWAYS, FORWARD])
    p = judges["kr270"].positions(cases, points_of(cell), K6, k_link)
    p = p + 14e-6 * rng.normal(size=p.shape)
    o = watched(tmp_path_factory.mktemp("beams"), cell, arm, cases, p, 14e-6)
    others = plan(arm, cell, 8, rng, [VERTICAL, SIDEWAYS])
    truth = judges["kr270"].positions(others, points_of(cell), K6, k_link) - judges["kr270"].positions(
        others.unloaded(), points_of(cell), K6, k_link
    )
    return model, o, (others, truth.transpose(2, 0, 1).reshape(-1, 3).T)


def mean_error(model, held):
    cases, truth = held
    names = np.array(list(model.points))
    found = simulate_displacement(
        model, cases, np.repeat(np.arange(cases.number), names.size), np.tile(names, cases.number)
    )
    return float(np.linalg.norm(found.dp - truth, axis=0).mean())


# -- M1, M2 ----------------------------------------------------------------------------------------------------------------


def test_m1_merges_columns_of_twins_as_eq_22_says_and_m2_drops_columns_as_eq_24_says(tmp_path, arms, cells, judges):
    arm, cell = arms["kr270"], cells["kr270"]
    cases = plan(arm, cell, 4, np.random.default_rng(0))
    o = watched(tmp_path, cell, arm, cases, judges["kr270"].positions(cases, points_of(cell), K6), 1e-5)
    full = make_model(cell, arm, [link_spring(arm, "link_2", "full", "x")])
    symmetric = symmetrised(full)
    assert symmetrisation_map().shape == (36, 21)
    assert columns(o, symmetric) == pytest.approx(columns(o, full) @ symmetrisation_map(), rel=1e-10, abs=1e-9)
    for axis in "xyz":
        beam = sparsed(full, {"link_2": axis})
        assert beam.effects[0].template.names == tuple(BEAMS[axis].split())
        assert columns(o, beam) == pytest.approx(columns(o, symmetric) @ sparsing_map(axis), rel=1e-12, abs=1e-12)


def test_m1_takes_the_mean_of_twins_and_leaves_other_springs_alone(arms, cells):
    arm, cell = arms["kr270"], cells["kr270"]
    full = make_model(cell, arm, [JointCompliance("joint_1"), link_spring(arm, "link_2", "full", "x")])
    K = np.zeros((6, 6))
    K[1, 5], K[5, 1], K[0, 0] = 2.0, 4.0, 1.0
    reduced = symmetrised(full.with_x(np.concatenate([[7.0], K.ravel()])))
    assert reduced.x[0] == 7.0
    assert reduced.effects[1].matrix(reduced.x[1:])[5, 1] == 3.0
    assert len(widened(sparsed(full)).x) == 1 + 21


def test_m2_takes_the_default_axis_and_keeps_the_matrix_of_a_link_without_length(arms, cells):
    arm, cell = arms["kr270"], cells["kr270"]
    p_PF = arm.p_PF.copy()
    p_PF[5] = 0.0
    model = make_model(cell, replace(arm, p_PF=p_PF), [link_spring(arm, n, "symmetric", "x") for n in arm.link_names])
    templates = [e.template_name for e in sparsed(model).effects]
    assert templates == ["beam"] * 5 + ["symmetric", "beam"]


# -- ratios and dropping -----------------------------------------------------------------------------------------------------


def test_the_ratio_is_the_value_over_the_root_of_the_covariance_diagonal():
    rng = np.random.default_rng(1)
    A, x = rng.normal(size=(40, 4)), np.array([3.0, -1.0, 0.2, 0.0])
    s = system(A, x, error=1.0)
    value = np.linalg.lstsq(A, s.g, rcond=None)[0]
    expected = np.abs(value) / np.sqrt(np.diag(np.linalg.inv(A.T @ A)))
    assert ratios(s, [0, 1, 2, 3]) == pytest.approx(expected)


def test_an_effect_of_several_parameters_has_the_root_of_its_wald_statistic_as_ratio():
    rng = np.random.default_rng(2)
    A, x = rng.normal(size=(50, 5)), np.array([3.0, 0.4, -0.5, 0.3, 2.0])
    s = replace(
        system(A, x, error=1.0),
        names=("a", "effect", "b"),
        groups=(np.array([0]), np.array([1, 2, 3]), np.array([4])),
        part=np.zeros((3, 50)),
    )
    value, C = np.linalg.lstsq(A, s.g, rcond=None)[0], np.linalg.inv(A.T @ A)
    own = slice(1, 4)
    wald = value[own] @ np.linalg.solve(C[own, own], value[own])
    assert ratios(s, [0, 1, 2])[1] == pytest.approx(np.sqrt(wald))
    # the same effect, linearised away from zero: part of what it does stands in `part` instead of in its columns
    there = A[:, own] @ np.array([0.3, -0.2, 0.1])
    moved = replace(s, part=np.array([np.zeros(50), there, np.zeros(50)]))
    assert ratios(moved, [0, 1, 2])[1] == pytest.approx(np.sqrt(wald))


def test_of_a_collinear_pair_m3_as_printed_deletes_both_and_dropping_in_turn_keeps_one():
    rng = np.random.default_rng(3)
    a, b, c = rng.normal(size=(3, 200))
    s = system(np.column_stack([a, a + 0.01 * b, c]), np.array([1.0, 1.0, 1.0]))
    together = ratios(s, [0, 1, 2])
    assert (together[:2] < 2.0).all()
    kept, falls = drop_at_once(s, [0, 1, 2], 5.0, 1.0)
    assert kept == [2]
    assert [fall.name for fall in falls] == ["p0", "p1"]
    kept, falls = drop_in_turn(s, [0, 1, 2], 5.0, 1.0)
    assert len(falls) == 1
    assert 2 in kept
    assert ratios(s, kept).min() > 10.0


def test_thresholds_are_settable_and_a_larger_noise_drops_more():
    A, x = np.eye(6), np.array([1.0, 3.0, 4.5, 6.0, 10.0, 30.0])
    for upper, left in ((5.0, 3), (2.0, 5), (20.0, 1)):
        assert len(drop_in_turn(system(A, x), list(range(6)), upper, 1.0)[0]) == left
    assert len(drop_at_once(system(A, x), list(range(6)), 5.0, 3.0)[0]) == 1


def test_a_base_takes_joints_first_and_names_what_merges(beams):
    model, o, _ = beams
    s = candidates(identify(model, o), o)
    chosen, redundant = base(s)
    assert [s.names[i] for i in chosen[:6]] == list(model.arm.joint_names)
    A = columns(o, model)
    rank = np.linalg.matrix_rank(A / np.linalg.norm(A, axis=0), tol=1e-9)
    assert len(chosen) == rank
    assert len(chosen) + len(redundant) == 62


# -- reductions of a campaign ------------------------------------------------------------------------------------------------


def test_dropping_in_turn_predicts_better_than_m3_as_printed_and_far_better_than_joints_alone(beams):
    model, o, held = beams
    at_once, in_turn = neglecting(model, o), sequential(model, o)
    alone = identify(joints_only(model), o)
    errors = [mean_error(m, held) for m in (alone.model, at_once.model, in_turn.model, non_redundant(model, o).model)]
    assert errors[0] > 10 * errors[1]
    assert errors[1] > 1.2 * errors[2]
    assert errors[2] < 25e-6
    assert errors[3] < 25e-6
    assert (in_turn.ratio >= 5.0).all()
    assert len(in_turn.kept) < 32
    falls = {fall.name for fall in in_turn.dropped}
    assert falls | set(in_turn.kept) | set(in_turn.merged) == set(model.names)
    assert not falls & set(in_turn.kept)


def test_a_higher_threshold_keeps_fewer_and_one_that_nothing_passes_is_refused(beams):
    model, o, _ = beams
    few, many = sequential(model, o, 20.0), sequential(model, o, 2.0)
    assert len(few.kept) < len(sequential(model, o).kept) <= len(many.kept)
    assert all(fall.ratio < 20.0 for fall in few.dropped)
    with pytest.raises(UntrustworthyError, match="leaves nothing"):
        neglecting(model, o, 1e9)
    for wrong in (0.0, -1.0, np.nan):
        with pytest.raises(InputError, match="threshold"):
            sequential(model, o, wrong)


def test_what_is_protected_stays_and_an_unknown_name_is_told(beams):
    model, o, _ = beams
    fallen = sequential(model, o).dropped[0].name
    kept = sequential(model, o, protect=[fallen])
    assert fallen in kept.kept
    assert np.isnan(kept.ratio[kept.kept.index(fallen)])
    assert fallen in kept.model.names
    with pytest.raises(InputError, match="link_9"):
        sequential(model, o, protect=["link_9.k11"])


def test_for_the_cone_kept_entries_get_their_diagonal_back(beams):
    model, o, _ = beams
    found = sequential(model, o, fit="sdp")
    assert found.added
    for effect, x in zip(found.model.effects, found.model.values, strict=True):
        K = effect.matrix(x)
        size = np.sqrt(np.maximum(np.diag(K), 1e-300))
        assert np.linalg.eigvalsh(K / np.outer(size, size))[0] > -1e-6
        if isinstance(effect, LinkCompliance):
            assert effect.template.unsupported == ()


def test_a_compensator_that_is_not_there_falls_as_a_whole_and_one_that_is_protected_stays(beams):
    model, o, _ = beams
    spring = GravityCompensator("joint_2", anchor_m=[0.686, 0.12], lever_m=0.185, variant="stiffness")
    with_it = replace(model, effects=(*model.effects, spring), x=np.append(model.x, spring.initial()))
    found = sequential(with_it, o)
    assert "joint_2.gravity_compensator" in {fall.name for fall in found.dropped}
    assert not any(isinstance(e, GravityCompensator) for e in found.model.effects)
    kept = sequential(with_it, o, protect=["gravity_compensator"])
    assert any(isinstance(e, GravityCompensator) for e in kept.model.effects)
    assert "joint_2.gravity_compensator.preload" in kept.kept


def test_another_robot_is_reduced_alike(tmp_path, arms, cells, judges):
    """Six joints of an SDF arm whose axes lie along no frame axis, two springy links among symmetric ones."""
    arm, cell, rng = arms["free"], cells["free"], np.random.default_rng(8)
    k_link = [None] * 7
    k_link[2] = np.diag([1e-9, 2e-8, 2e-8, 1e-7, 1e-7, 1e-7])
    links = [link_spring(arm, name, "symmetric", "x") for name in arm.link_names[1:4]]
    model = make_model(cell, arm, [*(JointCompliance(n) for n in arm.joint_names), *links])
    cases = plan(arm, cell, 20, rng, [VERTICAL, SIDEWAYS, FORWARD])
    p = judges["free"].positions(cases, points_of(cell), K6, k_link)
    m = table(tmp_path, cell, arm, cases, p + 5e-6 * rng.normal(size=p.shape))
    found = sequential(model, observe(m, True, noise(5e-6)))
    assert set(arm.joint_names) <= set(found.kept)
    assert len(found.kept) < 30
    assert len(found.merged) + len(found.dropped) + len(found.kept) == 6 + 63
    others = plan(arm, cell, 6, rng, [VERTICAL, SIDEWAYS])
    truth = judges["free"].positions(others, points_of(cell), K6, k_link)
    truth = truth - judges["free"].positions(others.unloaded(), points_of(cell), K6, k_link)
    held = (others, truth.transpose(2, 0, 1).reshape(-1, 3).T)
    assert mean_error(found.model, held) < 2e-6
    assert mean_error(found.model, held) < 0.05 * mean_error(joints_only(found.model), held)


# -- masks -------------------------------------------------------------------------------------------------------------------


def test_a_mask_keeps_the_named_entries_in_order_and_says_what_the_cone_lacks():
    assert mask_entries(["k66", "k62", "k22"]) == ("k22", "k26", "k66")
    template = masked_template(("k22", "k26", "k66"))
    assert template.matrix(np.array([2.0, 1.0, 3.0]))[5, 1] == 1.0
    assert template.unsupported == ()
    assert [block.tolist() for block in template.cone_blocks] == [[[0, 1], [1, 2]]]
    assert masked_template(("k26", "k66")).unsupported == ("k22",)
    # a lone entry off the diagonal is a matrix with eigenvalues of both signs: it must not go unseen
    (block,) = masked_template(("k26",)).cone_blocks
    assert block.tolist() == [[-1, 0], [0, -1]]
    for wrong, said in ((["k77"], "k77"), (["k26", "k62"], "twice"), ([], "no entry")):
        with pytest.raises(ValueError, match=said):
            mask_entries(wrong)


def test_masks_of_a_cell_override_the_template_of_their_links(arms, cells):
    cell = cells["kr270"].model_copy(
        update={"springs": Springs(joints="none", links=("link_1", "link_2"), masks={"link_2": ("k66", "k26", "k22")})}
    )
    cell._path = cells["kr270"]._path
    effects = spring_effects(cell, arms["kr270"])
    assert [len(e.parameters) for e in effects] == [8, 3]
    assert effects[1].names == ("link_2.k22", "link_2.k26", "link_2.k66")
    model = make_model(cell, arms["kr270"], effects)
    assert model.names[-3:] == ("link_2.k22", "link_2.k26", "link_2.k66")


def test_the_semidefinite_program_refuses_a_mask_that_no_spring_has(beams):
    model, o, _ = beams
    wrong, _ = keep_only(model, ["joint_2", "link_2.k26"])
    with pytest.raises(InputError, match=r"link_2.*k22, k66"):
        identify(wrong, o, "sdp")
    assert identify(wrong, o, "least-squares").model.x.size == 2


def test_a_reduced_model_comes_back_from_its_file_and_predicts_the_same(beams, tmp_path):
    model, o, held = beams
    found = sequential(model, o).model
    found.save(tmp_path / "model.json")
    again = load_model(tmp_path / "model.json")
    assert again.names == found.names
    assert again.x == pytest.approx(found.x, rel=1e-12)
    assert mean_error(again, held) == pytest.approx(mean_error(found, held), rel=1e-9)
    assert again.impossible() is None
