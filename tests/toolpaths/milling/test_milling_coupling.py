"""Depth and force drive each other: the arm gives, the cut gets shallower, the force falls - until both agree."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from slots import SLOT, STRAIGHT, along, load, process, stated, swept

from drake_stiffness.errors import UntrustworthyError
from drake_stiffness.simulation import cartesian_compliance
from toolpaths import job
from toolpaths.compensation import bench_of, command, deviation, mirror
from toolpaths.loaded_path import loaded_path
from toolpaths.milling.coupling import depth_gain

SIDE = stated(6, 2, "down") + ", feed_mm_per_min: 2400"
PATH = ((100, 0, 0), (110, 0, 0), (120, 10, 0))


def soft(model, factor):
    """The same arm, all springs softer."""
    return replace(model, x=factor * model.x)


def path_of(tools, tmp_path, model, milling=SIDE):
    return loaded_path(along(tools, *PATH), model, process(tmp_path, milling, feed=""), lambda *a: None)


@pytest.mark.parametrize("milling", [SIDE, SIDE + ", cutter: ball, rotation: counterclockwise"])
def test_the_uncorrected_tool_stands_where_depth_and_force_agree(model, tools, tmp_path, milling):
    """The fixed point of shift = deflection(force(shift)), found by hand."""
    path = path_of(tools, tmp_path, model, milling)
    follows = path.load.milling.at
    result = mirror(path.bench, path.postures.q, path.wrench, path.only, path.postures.free, follows=follows)
    shift = np.zeros((3, 3))
    _, p0 = path.bench.commanded(path.postures.q)
    for _ in range(20):
        _, p, _ = path.bench.actual(path.postures.q, follows(slice(None), shift))
        shift = p - p0
    np.testing.assert_allclose(result.deflection, shift, atol=3e-8)
    fixed = mirror(path.bench, path.postures.q, path.wrench, path.only, path.postures.free)
    assert np.abs(fixed.deflection - shift).max() > 2e-6


def after_one_shot(path) -> np.ndarray:
    """(N,) distance left when the deflection found at the true depth is commanded once, rounds of depth and force by hand."""
    bench, follows, q = path.bench, path.load.milling.at, path.postures.q
    R0, p0 = bench.commanded(q)

    def settled(q) -> np.ndarray:
        off = np.zeros((6, q.shape[1]))
        for _ in range(12):
            off = deviation(bench, q, follows(slice(None), -off[:3]), R0, p0, path.only)[0]
        return off

    return np.linalg.norm(settled(command(bench, q, settled(q), path.postures.free))[:3], axis=0)


def test_once_corrected_the_cut_has_the_stated_depth(model, tools, tmp_path):
    """The same commands as with the force of the stated depth; only the way there differs."""
    path = path_of(tools, tmp_path, model)
    arguments = (path.bench, path.postures.q, path.wrench, path.only, path.postures.free)
    coupled, fixed = mirror(*arguments, follows=path.load.milling.at), mirror(*arguments)
    assert coupled.converged.all()
    np.testing.assert_allclose(coupled.p, fixed.p, atol=5e-9)
    assert coupled.one_shot.max() > 3 * fixed.one_shot.max()  # the deeper the tool goes, the more it is pushed
    np.testing.assert_allclose(coupled.one_shot, after_one_shot(path), atol=5e-8)
    assert 0.01 < path.depth_gain.max() < 0.5
    assert coupled.contraction.max() < 2 * path.depth_gain.max()


def test_the_gain_is_compliance_times_slope(model, tools, tmp_path):
    """For an axial shift in a slot the force is proportional to the depth: dF/da = F/a."""
    text = SLOT + ", moments: false, feed_mm_per_min: 2400"
    path = path_of(tools, tmp_path, model, text)
    C = cartesian_compliance(path.bench.loaded, path.postures.q.T, path.bench.p_ET)[:, 2, :3]
    expected = np.abs(np.einsum("ni,in->n", C, path.wrench[:3])) / 3e-3
    np.testing.assert_allclose(path.depth_gain, expected, rtol=1e-5)
    slopes = path.load.milling.slopes(slice(None))
    np.testing.assert_allclose(slopes[:, :3, 2].T, -path.wrench[:3] / 3e-3, rtol=1e-5)
    assert np.abs(slopes[:, :, :2]).max() < 1e-6 * np.abs(slopes).max()


def test_the_gain_grows_with_what_the_arm_gives_and_is_refused_from_one_on(model, tools, tmp_path):
    path = path_of(tools, tmp_path, model)
    weak = soft(model, 2.0)
    bench = bench_of(weak, "unloaded", False)
    twice = depth_gain(bench.loaded, path.postures.q, bench.p_ET, path.load.milling)
    np.testing.assert_allclose(twice, 2 * path.depth_gain, rtol=1e-9)
    far = soft(model, 1.5 / path.depth_gain.max())
    with pytest.raises(UntrustworthyError, match=r"drive each other.*Cut less deep"):
        path_of(tools, tmp_path, far)
    assert path_of(tools, tmp_path, far, SIDE + ", coupled: false").depth_gain is None


@pytest.mark.parametrize(
    ("field", "cut", "share"),
    [(swept(6, 30), stated(3, 4, "up"), 0.12), (swept(-30, 30), stated(3, 20, "slot"), 0.06)],
    ids=["wall", "slot: sideways nothing changes"],
)
def test_a_height_field_has_the_slopes_of_the_engagement_it_finds(model, tools, tmp_path, field, cut, share):
    program = along(tools, (-20, 0, 0), (20, 0, 0), (40, 0, 0))
    one, other = (load(program, process(tmp_path, text), model).milling.slopes(slice(1, None)) for text in (field, cut))
    np.testing.assert_allclose(one[:, :3], other[:, :3], atol=share * np.abs(other).max())


def test_the_slopes_of_a_mirrored_cut_are_mirrored(model, tools, tmp_path):
    """The other sense of rotation along the mirrored path; into the wall is to the other side."""
    turn = ", rotation: counterclockwise"
    one = load(along(tools, *PATH), process(tmp_path, SIDE, feed=""), model).milling.slopes(slice(None))
    mirrored = along(tools, *((x, -y, z) for x, y, z in PATH))
    other = load(mirrored, process(tmp_path, SIDE + turn, feed=""), model).milling.slopes(slice(None))
    sign = np.array([1, -1, 1, -1, 1, -1.0])
    np.testing.assert_allclose(other, one * sign[:, None] * sign[:3], atol=1e-6 * np.abs(one).max())
    assert np.abs(one[:, :, 1]).max() > 1e3


def test_the_result_says_what_was_done(model, tools, tmp_path):
    result = job.compensate(along(tools, *PATH), model, process(tmp_path, SIDE, feed=""))
    said = " ".join(result.notes)
    for words in ("chatter are out of scope", "uncertain by 30 %", "follows the true depth of cut"):
        assert words in said
    assert result.after_mm.max() < 0.002 < 0.05 * result.before_mm.max()
    assert (result.account.interval.force_mm > 0.2 * result.before_mm).all()


def test_without_feed_across_the_tool_there_is_nothing_to_follow(model, tools, tmp_path):
    path = loaded_path(along(tools, *STRAIGHT[:1], (0, 0, 5)), model, process(tmp_path, SIDE, feed=""), lambda *a: None)
    assert not path.wrench.any()
    assert not path.depth_gain.any()
