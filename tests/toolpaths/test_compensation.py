"""Pre-deformed paths: the loaded tool stands where the program wanted it, judged by Drake and by the true plant."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import pytest
from scipy.optimize import root
from scipy.spatial.transform import Rotation

from drake_stiffness.arm import forward
from drake_stiffness.effects.effect import Cases
from drake_stiffness.effects.geometry import JointZeroOffset, LinkGeometry
from drake_stiffness.equilibrium import solve_equilibrium
from drake_stiffness.errors import UntrustworthyError
from drake_stiffness.model import Model
from drake_stiffness.simulation import linear_displacement
from toolpaths import compensation, job, loaded_path
from toolpaths.compensation import Bench, bench_of, mirror
from toolpaths.formats.krl import Krl
from toolpaths.job import compensate
from toolpaths.orientation import rotation_from_abc

KR270 = Path(__file__).parents[2] / "examples" / "kr270"
ALL = list(range(6))
WRENCH = np.array([[300.0, -150.0, -420.0, 20.0, -30.0, 15.0]]).T


def some_postures(number: int, seed: int = 3) -> np.ndarray:
    rng = np.random.default_rng(seed)
    middle = np.radians([[0.0, -70.0, 110.0, 20.0, -50.0, 5.0]]).T
    return middle + np.radians(rng.uniform(-15, 15, (6, number)))


def wrenches(number: int, seed: int = 4) -> np.ndarray:
    rng = np.random.default_rng(seed)
    return np.concatenate([rng.normal(0, 300, (3, number)), rng.normal(0, 30, (3, number))])


def corrected(bench, q, wrench, only=None, free=ALL):
    only = np.zeros(q.shape[1], bool) if only is None else only
    return mirror(bench, q, wrench, only, list(free))


def actual(bench, q, wrench):
    """Where the tool is (the states that the iteration starts from are its own business)."""
    return bench.actual(q, wrench)[:2]


def deviation(bench, q, wrench, R0, p0) -> np.ndarray:
    """(6, N) from where the tool is to where it is wanted, m and rad."""
    R, p = actual(bench, q, wrench)
    turn = np.einsum("ijn,kjn->nik", R0, R)
    return np.concatenate([p0 - p, Rotation.from_matrix(turn).as_rotvec().T])


def length_mm(v) -> np.ndarray:
    return np.linalg.norm(v, axis=0) * 1e3


@pytest.mark.parametrize("reference", ["unloaded", "rigid"])
@pytest.mark.parametrize("links", [True, False])
def test_the_loaded_tool_comes_back_to_where_it_was_wanted(model, reference, links):
    bench = bench_of(model if links else model.without_links, reference, False)
    q, wrench = some_postures(7), wrenches(7)
    result = corrected(bench, q, wrench)
    assert result.converged.all()
    R0, p0 = bench.commanded(q)
    off = deviation(bench, result.q, wrench, R0, p0)
    assert np.abs(off).max() < 1e-8
    np.testing.assert_array_less(np.linalg.norm(off[:3], axis=0), result.after + 1e-12)  # a bound, where it is no look
    assert result.after.max() < 1e-9 * np.sqrt(3)
    np.testing.assert_array_less(1e-4, result.before)
    # what is to be commanded is the rigid pose at the corrected joints
    R, p = bench.commanded(result.q)
    np.testing.assert_array_equal(R, result.R)
    np.testing.assert_array_equal(p, result.p)


@pytest.mark.parametrize("reference", ["unloaded", "rigid"])
def test_the_fixed_point_is_the_root_that_drake_s_elastic_plant_has(model, cell, reference):
    """Equilibria by Drake's own forces and Jacobians, the root by scipy: nothing shared but cell and springs."""
    from drake_judge import Judge

    judge = Judge(cell)
    s = model.structure
    R_ET = Rotation.from_euler("ZYX", [0, -90, 180], degrees=True).as_matrix()
    p_ET, weightless = np.array([0.18, 0.0, 0.22]), np.zeros(6)
    q0, wrench = np.radians([5.0, -75.0, 115.0, 25.0, -45.0, 8.0]), WRENCH[:, 0]

    def tool(X):
        return X[:3, :3] @ R_ET, X[:3, 3] + X[:3, :3] @ p_ET

    def rigid(q):
        return tool(judge.pose(q, np.zeros(6), [None] * 7))

    def actual(q):
        R, p = tool(judge.equilibrium(q, wrench, p_ET, s.k_joint, s.k_link)[0])
        if reference == "rigid":
            return R, p
        R_u, p_u = tool(judge.equilibrium(q, weightless, p_ET, s.k_joint, s.k_link)[0])
        R_c, p_c = rigid(q)
        return R @ R_u.T @ R_c, p_c + p - p_u

    R0, p0 = rigid(q0)

    def off(q):
        R, p = actual(q)
        return np.concatenate([p - p0, Rotation.from_matrix(R @ R0.T).as_rotvec()])

    found = root(off, q0, tol=1e-13, options={"eps": 1e-6})
    assert np.abs(off(found.x)).max() < 1e-10
    result = corrected(bench_of(model, reference, False), q0[:, None], wrench[:, None])
    np.testing.assert_allclose(result.q[:, 0], found.x, atol=2e-9)
    assert np.abs(found.x - q0).max() > 1e-4


def test_one_shot_leaves_an_error_of_second_order(model):
    """Half the force: half the deflection, a quarter of what one shot leaves."""
    bench, q, wrench = bench_of(model, "unloaded", False), some_postures(5), wrenches(5)
    full, half = corrected(bench, q, wrench), corrected(bench, q, 0.5 * wrench)
    np.testing.assert_allclose(full.before / half.before, 2.0, rtol=0.01)
    np.testing.assert_allclose(full.one_shot / half.one_shot, 4.0, rtol=0.05)
    assert (full.one_shot > 1e3 * full.after).all()
    assert (full.one_shot < 0.02 * full.before).all()
    assert (full.contraction < 0.02).all()
    assert (full.contraction > 0).all()


def test_small_corrections_are_minus_the_linear_deflection(model):
    """Weightless and at a tenth of the force: p - p0 = -J k J^T W, and twice the force gives twice that."""
    light = replace(model, arm=replace(model.arm, gravity=np.zeros(3)))
    bench, q, wrench = bench_of(light, "unloaded", False), some_postures(5), 0.1 * wrenches(5)
    _, p0 = bench.commanded(q)
    once, twice = (corrected(bench, q, f * wrench).p - p0 for f in (1, 2))
    linear = linear_displacement(light.structure, q.T, wrench.T, light.tcp[1], light.tcp[1])[:, :3].T
    assert length_mm(once + linear).max() < 0.005 * length_mm(linear).max()
    assert length_mm(twice - 2 * once).max() < 0.005 * length_mm(once).max()


def test_links_take_part(model):
    q, wrench = some_postures(5), wrenches(5)
    full = corrected(bench_of(model, "unloaded", False), q, wrench)
    joints = corrected(bench_of(model.without_links, "unloaded", False), q, wrench)
    bench = bench_of(model, "unloaded", False)
    R0, p0 = bench.commanded(q)
    left = deviation(bench, joints.q, wrench, R0, p0)
    assert length_mm(left[:3]).max() > 0.05
    assert full.after.max() < 1e-8


def test_without_force_nothing_moves(model):
    q = some_postures(4)
    result = corrected(bench_of(model, "unloaded", False), q, np.zeros((6, 4)))
    np.testing.assert_array_equal(result.q, q)
    assert result.steps == 0
    assert result.converged.all()


def test_reference_rigid_takes_sag_away_too(model):
    """No force, weight only: the sagging tool stands where the rigid one would; `unloaded` leaves sag alone."""
    bench, q = bench_of(model, "rigid", False), some_postures(4)
    result = corrected(bench, q, np.zeros((6, 4)))
    assert (result.before > 1e-3).all()
    R0, p0 = bench.commanded(q)
    R, p = actual(bench, result.q, np.zeros((6, 4)))
    np.testing.assert_allclose(p, p0, atol=1e-9)
    np.testing.assert_allclose(R, R0, atol=1e-9)
    # upwards against weight
    assert (result.p[2] > p0[2]).all()


def with_geometry(model: Model, kinds) -> Model:
    effects, values = [], []
    rng = np.random.default_rng(5)
    for i, name in enumerate(model.arm.joint_names):
        if "zero" in kinds:
            effects.append(JointZeroOffset(name, model.arm.prismatic[i]))
            values.append(rng.normal(0, 1e-3, 1))
        if "links" in kinds:
            effects.append(LinkGeometry(name))
            values.append(rng.normal(0, 5e-4, 6))
    return replace(model, effects=(*model.effects, *effects), x=np.concatenate([model.x, *values]))


@pytest.mark.parametrize("reference", ["unloaded", "rigid"])
def test_geometry_true_takes_zero_offsets_away(model, reference):
    """The rigid arm whose joints stand off by d: commanding q - d puts its tool where the nominal arm's was."""
    offsets = with_geometry(model.subset([False] * len(model.effects)), ["zero"])
    bench, q = bench_of(offsets, reference, True), some_postures(4)
    result = corrected(bench, q, np.zeros((6, 4)))
    np.testing.assert_allclose(result.q, q - offsets.x[:, None], atol=1e-9)
    assert (result.before > 1e-4).all()


@pytest.mark.parametrize("reference", ["unloaded", "rigid"])
@pytest.mark.parametrize("kind", ["zero", "links"])
def test_geometry_true_puts_the_real_arm_under_load_where_it_was_wanted(model, reference, kind):
    bent = with_geometry(model, [kind])
    bench, q, wrench = bench_of(bent, reference, True), some_postures(4), wrenches(4)
    result = corrected(bench, q, wrench)
    p0 = bench_of(model, reference, False).commanded(q)[1]
    real, p_ET = bent.structure.arm, bent.tcp[1]
    cases = Cases(result.q, wrench, p_ET)
    loaded = solve_equilibrium(bent.structure, cases)
    got = loaded.p_E + np.einsum("ijn,j->in", loaded.R_E, p_ET)
    if reference == "unloaded":  # sag is left as it is
        unloaded, rigid = solve_equilibrium(bent.structure, cases.unloaded()), forward(real, result.q)
        got = got - (unloaded.p_E + np.einsum("ijn,j->in", unloaded.R_E, p_ET))
        got = got + rigid.p_E + np.einsum("ijn,j->in", rigid.R_E, p_ET)
    np.testing.assert_allclose(got, p0, atol=1e-8)


@pytest.mark.parametrize("reference", ["unloaded", "rigid"])
def test_geometry_false_leaves_geometric_errors_alone(model, reference):
    bent = with_geometry(model, ["zero", "links"])
    q, wrench = some_postures(4), wrenches(4)
    plain, other = (corrected(bench_of(m, reference, False), q, wrench) for m in (model, bent))
    np.testing.assert_allclose(plain.q, other.q, atol=1e-13)


def test_points_without_orientation_keep_the_commanded_one(model):
    bench, q, wrench = bench_of(model, "unloaded", False), some_postures(4), wrenches(4)
    only = np.array([True, False, True, False])
    result = corrected(bench, q, wrench, only)
    R0, p0 = bench.commanded(q)
    turned = np.abs(result.R - R0).max(axis=(0, 1))
    assert (turned[only] < 1e-9).all()
    assert (turned[~only] > 1e-5).all()
    _, p = actual(bench, result.q, wrench)
    np.testing.assert_allclose(p, p0, atol=1e-8)


def test_the_sense_of_the_correction_is_against_the_force(model):
    """Pushed sideways, the tool is commanded the other way."""
    bench, q = bench_of(model, "unloaded", False), some_postures(3)
    for axis in range(3):
        wrench = np.zeros((6, 3))
        wrench[axis] = 500.0
        moved = corrected(bench, q, wrench).p - bench.commanded(q)[1]
        assert (moved[axis] < -1e-5).all()


def test_chunks_make_no_difference(model, monkeypatch):
    bench, q, wrench = bench_of(model, "unloaded", False), some_postures(11), wrenches(11)
    whole = corrected(bench, q, wrench)
    monkeypatch.setattr(compensation, "CHUNK", 4)
    seen = []
    parts = mirror(bench, q, wrench, np.zeros(11, bool), ALL, seen.append)
    assert seen == [4, 8, 11]
    np.testing.assert_allclose(parts.q, whole.q, atol=1e-9)
    np.testing.assert_allclose(parts.before, whole.before)
    assert parts.converged.shape == (11,)


@pytest.mark.parametrize("links", [True, False])
def test_a_driven_joint_is_left_to_the_program(track_model, links):
    model = track_model if links else track_model.without_links
    bench = bench_of(model, "unloaded", False)
    q = np.vstack([[[0.4, -0.3, 1.2]], some_postures(3)])
    result = corrected(bench, q, wrenches(3), free=range(1, 7))
    np.testing.assert_array_equal(result.q[0], q[0])
    assert result.converged.all()
    assert result.after.max() < 1e-8


@dataclass(frozen=True, eq=False)
class Runaway(Bench):
    """A tool whose deflection grows by 1.6 times whatever the command moves: the iteration cannot contract."""

    center: object = None

    def actual(self, q, wrench, *_):
        R, p = self.commanded(q)
        return R, p + 1e-3 + 1.6 * (p - self.center), None


def runaway(bench, q):
    return Runaway(bench.arm, bench.loaded, bench.R_ET, bench.p_ET, bench.reference, center=bench.commanded(q)[1])


def test_an_iteration_that_does_not_contract_is_reported(model):
    q = some_postures(2)
    result = corrected(runaway(bench_of(model, "unloaded", False), q), q, wrenches(2))
    assert not result.converged.any()
    assert (result.contraction > 1.2).all()


# -- whole programs -------------------------------------------------------------------------------------------------------


def run(program, model, process, **options):
    return job.compensate(program, model, process, **options)


def test_zero_force_leaves_every_byte(pocket, model, tools):
    result = run(pocket, model, tools.process(force=tools.constant("tool")))
    assert result.raw == pocket.raw
    assert not result.correction_mm.any()


def test_zero_force_leaves_more_digits_than_arithmetic_holds(model, tools):
    """Way to the world and back rounds the sixteenth digit; the numbers must come back all the same."""
    program = tools.program(
        "LIN {X 104.00001250997277,Y 56.000008940645538,Z 1.4999959259060056,A 3.00011479342827952,B -6,C 164}",
        "LIN {X 103.99999844478253,Y 55.999984880467149,Z 0.00000000000000000000012,A 3.0002,B -6,C 164.00001234567890123}",
    )
    workpiece = {"position_m": [1.6543, -0.1021, 0.7501], "rpy_deg": [0.37, -1.21, 4.73]}
    result = run(program, model, tools.process(workpiece=workpiece, force=tools.constant("tool")))
    assert result.raw == program.raw
    assert not result.correction_mm.any()


def test_a_corrected_program_is_met_by_the_loaded_tool(pocket, model, tools):
    """Read back by nothing but its numbers: inverse kinematics, load, and the tool is where the original program says."""
    process = tools.process()
    result = run(pocket, model, process)
    again = Krl().parse(result.raw, "test.src")
    bench = bench_of(model, "unloaded", False)
    base = np.array(process.workpiece.position_m)
    rows = result.rows
    start = np.radians(process.posture_deg)
    q = loaded_path.postures_on(
        again,
        model,
        bench,
        rows,
        rotation_from_abc(again.orientation)[rows],
        again.position_mm[rows] * 1e-3 + base,
        start,
        {},
    ).q
    R, p = actual(bench, q, np.vstack([result.force_N.T, np.zeros((3, rows.size))]))
    wanted = pocket.position_mm[rows] * 1e-3 + base
    error = np.linalg.norm(p.T - wanted, axis=1) * 1e3
    assert error.max() < 0.001  # half a micrometre a word
    np.testing.assert_allclose(error, result.after_mm, atol=1e-6)
    np.testing.assert_allclose(R.transpose(2, 0, 1), rotation_from_abc(pocket.orientation)[rows], atol=2.1e-5)
    np.testing.assert_allclose(result.correction_mm, again.position_mm[rows] - pocket.position_mm[rows])
    assert result.before_mm.min() > 0.5


def test_angles_stay_on_the_branch_of_the_program(model, tools):
    """A 179.99 and -180.01, A beyond a turn: printed angles move by the correction, not by whole turns or to 180 - B."""
    program = tools.program(
        "LIN {X 100.0000,Y 100.0000,Z 0.0000,A 0.0000,B 0.0000,C 179.9999}",
        "LIN {X 110.0000,Y 100.0000,Z 0.0000,A 0.0000,B 0.0000,C -179.9999}",
        "LIN {X 120.0000,Y 100.0000,Z 0.0000,A 360.0000,B 0.0000,C 180.0000}",
        "LIN {X 130.0000,Y 100.0000,Z 0.0000,A 180.0000,B 180.0000,C 0.0000}",
    )
    result = run(program, model, tools.process())
    again = Krl().parse(result.raw, "test.src")
    assert np.abs(again.orientation - program.orientation).max() < 0.1
    assert (np.abs(again.orientation - program.orientation).max(axis=1) > 0.005).all()
    # all four are one orientation, so the tool is turned alike to within the step of 10 mm
    change = rotation_from_abc(again.orientation) @ rotation_from_abc(program.orientation).transpose(0, 2, 1)
    assert np.abs(change - change[0]).max() < 2e-5


def test_rows_that_write_no_angles_get_positions_only_and_the_user_hears_of_it(model, tools):
    program = tools.program(
        "LIN {X 100.0,Y 100.0,Z 0.0,A 0.0,B 0.0,C 180.0}",
        "LIN {X 110.0,Y 100.0,Z 0.0}",
        "LIN {X 120.0,Y 100.0,Z 0.0,A 0.0,B 0.0,C 180.0}",
    )
    result = run(program, model, tools.process())
    again = Krl().parse(result.raw, "test.src")
    np.testing.assert_array_equal(again.orientation[:2], program.orientation[:2])
    assert np.abs(again.position_mm - program.position_mm).max(axis=1).min() > 0.5
    assert any("2 of 3 points write no orientation" in note for note in result.notes)
    assert b"LIN {X 110" not in result.raw


def test_point_to_point_motions_are_never_changed(model, tools):
    approach = "PTP {X 100.0,Y 100.0,Z 50.0,A 0.0,B 0.0,C 180.0}"
    program = tools.program(approach, "LIN {X 100.0,Y 100.0,Z 0.0,A 0.0,B 0.0,C 180.0}", approach)
    lines = run(program, model, tools.process()).raw.decode().splitlines()
    assert lines[0] == lines[2] == approach
    assert lines[1] != program.raw.decode().splitlines()[1]


def test_a_program_that_prints_coarsely_is_told_so(model, tools):
    program = tools.program("LIN {X 100,Y 100,Z 0,A 0,B 0,C 180}")
    result = run(program, model, tools.process(force=tools.constant("tool", fz_N=-100)))
    assert result.quantum_mm == 0.5
    assert any("print more decimals" in note for note in result.notes)


def test_reference_rigid_is_said_and_moves_the_program_against_sag(pocket, model, tools):
    force = tools.constant("world")
    result = run(pocket, model, tools.process(reference="rigid", force=force))
    assert any("sag" in note for note in result.notes)
    assert (result.correction_mm[:, 2] > 1.0).all()  # the base frame is parallel to the world


def test_a_path_that_does_not_contract_is_refused_by_line(pocket, model, tools, monkeypatch):
    first = bench_of(model, "unloaded", False)
    rows = np.flatnonzero(pocket.corrected)
    base = np.array([1.65, -0.10, 0.75])

    @dataclass(frozen=True, eq=False)
    class Soft(Bench):
        def actual(self, q, wrench, *_):
            R, p = self.commanded(q)
            return R, p + 1e-3 + 1.6 * (p - (pocket.position_mm[rows[: p.shape[1]]] * 1e-3 + base).T), None

    monkeypatch.setattr(
        loaded_path, "bench_of", lambda *_: Soft(first.arm, first.loaded, first.R_ET, first.p_ET, "unloaded")
    )
    with pytest.raises(UntrustworthyError, match=r"does not come to rest.*line 2, 3, 4"):
        run(pocket, model, tools.process())


def test_a_correction_that_leaves_the_limits_is_refused(model, tools):
    """Joint 2 a hair inside its limit; the correction would push it over."""
    program = tools.program("LIN {X 100.0,Y 100.0,Z 0.0,A 0.0,B 0.0,C 180.0}")
    free = run(program, model, tools.process())
    bench = bench_of(model, "unloaded", False)
    q0 = loaded_path.postures_on(
        program, model, bench, free.rows, rotation_from_abc(program.orientation), np.array([[1.75, 0.0, 0.75]]),
        np.radians([0, -70, 120, 0, -50, 0.0]), {},
    ).q[:, 0]  # fmt: skip
    moved = corrected(bench, q0[:, None], np.vstack([free.force_N.T, np.zeros((3, 1))])).q[:, 0] - q0
    joint = int(np.abs(moved).argmax())
    limits = {"upper": model.arm.upper.copy(), "lower": model.arm.lower.copy()}
    limits["upper" if moved[joint] > 0 else "lower"][joint] = q0[joint] + 0.3 * moved[joint]
    with pytest.raises(UntrustworthyError, match="line 1"):
        run(program, replace(model, arm=replace(model.arm, **limits)), tools.process())


def test_an_external_axis_carries_the_arm_along(track_model, tools):
    """A slide by E1 with the workpiece moved along: the same joints, the same corrections."""
    arm = track_model.arm
    pose = "A 0.0000,B 0.0000,C 180.0000"
    direction = forward(arm, np.zeros((7, 1))).axis[0][:, 0]
    results = []
    for e1 in (0.0, 800.0):
        program = tools.program(*(f"LIN {{X {x}.0000,Y 20.0000,Z 0.0000,{pose},E1 {e1}}}" for x in (0, 10, 20)))
        place = np.array([1.75, 0.0, 1.05]) + direction * e1 * 1e-3
        process = tools.process(
            workpiece={"position_m": place.tolist()},
            external_axes={"E1": "track"},
            force=tools.constant("world", fx_N=300),
        )
        results.append(run(program, track_model, process))
    assert results[0].correction_mm.any()
    np.testing.assert_allclose(results[0].correction_mm, results[1].correction_mm, atol=2e-4)
    assert results[1].method == "eaik"
    # E1 itself is the program's business
    assert b"E1 800.0}" in results[1].raw


@pytest.mark.parametrize(
    ("axes", "posture", "expected"),
    [
        ({"E1": "track"}, [0, -70, 120, 0, -50, 0], [1, 2, 3, 4, 5, 6]),
        ({}, [200, 0, -70, 120, 0, -50, 0], [1, 2, 3, 4, 5, 6]),  # nothing drives the slide: it stands
        ({"E1": "joint_1"}, [200, 0, -70, 120, 0, -50, 0], [0, 2, 3, 4, 5, 6]),
    ],
)
def test_the_joints_that_a_correction_may_move(track_model, tools, monkeypatch, axes, posture, expected):
    """Those that the program's pose decides; not those that words of their own drive, nor a slide that stands."""
    moved = []

    def watched(bench, q0, wrench, only, free, *rest):
        result = mirror(bench, q0, wrench, only, free, *rest)
        moved.append((free, np.flatnonzero(np.abs(result.q - q0).max(axis=1) > 0).tolist()))
        return result

    monkeypatch.setattr(job, "mirror", watched)
    word = ",E1 1.0" if axes else ""  # a word that drives nothing we know would be refused
    program = tools.program(f"LIN {{X 0.000,Y 200.000,Z 0.000,A 0.000,B 0.000,C 180.000{word}}}")
    process = tools.process(workpiece={"position_m": [1.75, 0.0, 1.05]}, posture_deg=posture, external_axes=axes)
    result = run(program, track_model, process)
    assert moved == [(expected, expected)]
    assert result.after_mm.max() < 0.002


# -- the true plant ---------------------------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def truth():
    from plants.segmented_arm import SegmentedArm

    return SegmentedArm.from_files(KR270 / "kr270.urdf", KR270 / "true_arm.yaml")


@pytest.fixture(scope="module")
def identified():
    from drake_stiffness.jobs import identify_campaign

    return {
        "full": identify_campaign(KR270 / "campaign.yaml"),
        "joints": identify_campaign(KR270 / "campaign_joints_only.yaml").model,
    }


def _milled(truth, corrected_program: Path):
    from plants.replay import replay_files

    return replay_files(truth, KR270 / "pocket.src", corrected_program, KR270 / "process.yaml")


def test_on_the_true_plant_the_full_model_comes_near_the_oracle(truth, identified, tmp_path):
    """The oracle knows the true structure and fits it to the same 22 experiments; joints alone leave ten times more."""
    from plants import oracle
    from plants.krl_reader import read_program as read_by_plants
    from plants.mirror import compensate as compensate_by_plants
    from plants.process import Process as PlantProcess
    from plants.readings import read_measurements

    from toolpaths.formats import read_program
    from toolpaths.process import read_process

    result = identified["full"]
    kept = [e for e, held in zip(result.measurements.experiments, result.held, strict=True) if not held]
    points = {n: np.array(p) for n, p in result.model.cell["reference_points_m"].items()}
    data = read_measurements(KR270 / "measurements.csv", truth.chain.joint_names, points, experiments=kept)
    fitted = oracle.fit(oracle.wrong_start(truth), data, np.array(result.model.cell["load_point_m"]), 12e-6).arm
    best = compensate_by_plants(
        fitted, read_by_plants(KR270 / "pocket.src"), PlantProcess.from_file(KR270 / "process.yaml")
    )
    (tmp_path / "oracle.src").write_bytes(best.encode("latin-1"))
    for name, model in (("full", result.model), ("joints", identified["joints"])):
        process = "process.yaml" if name == "full" else "process_joints_only.yaml"
        out = run(read_program(KR270 / "pocket.src"), model, read_process(KR270 / process))
        (tmp_path / f"{name}.src").write_bytes(out.raw)
    before = _milled(truth, KR270 / "pocket.src")
    after = {n: _milled(truth, tmp_path / f"{n}.src") for n in ("oracle", "full", "joints")}
    percent = {n: e.percent_compensated(before) for n, e in after.items()}
    assert before.mean_mm > 1.0
    assert after["full"].mean_mm < 1.5 * after["oracle"].mean_mm
    assert after["full"].p95_mm < 1.5 * after["oracle"].p95_mm
    assert percent["full"] > 99.5
    assert 80 < percent["joints"] < 97
    assert after["joints"].mean_mm > 10 * after["full"].mean_mm


@pytest.mark.parametrize("reference", ["unloaded", "rigid"])
def test_superposition_differs_from_the_equilibrium_by_the_second_order(model, reference):
    """Half the load, half the deflection, a quarter of the difference."""
    whole = bench_of(model, reference, False)
    light = replace(
        whole,
        arm=replace(whole.arm, gravity=np.zeros(3)),
        loaded=replace(whole.loaded, arm=replace(whole.arm, gravity=np.zeros(3))),
    )
    q, wrench = some_postures(6), wrenches(6)
    apart = []
    for share in (1.0, 0.5):
        exact, superposed = (b.actual(q, share * wrench)[1] for b in (light, replace(light, linear=True)))
        apart.append(length_mm(exact - superposed))
        assert (apart[-1] < 0.02 * length_mm(exact - light.commanded(q)[1])).all()
    np.testing.assert_allclose(apart[0] / apart[1], 4.0, rtol=0.05)
    with_weight = [length_mm(b.actual(q, wrench)[1] - b.commanded(q)[1]) for b in (whole, replace(whole, linear=True))]
    np.testing.assert_allclose(with_weight[0], with_weight[1], rtol=0.02)


def test_a_linear_job_says_how_far_the_equilibrium_is(model, pocket, tools):
    exact, linear = (compensate(pocket, model, tools.process(), linear=on) for on in (False, True))
    (note,) = [note for note in linear.notes if "superposed" in note]
    stated = float(note.split("up to ")[1].split(" mm")[0])
    apart = np.linalg.norm(exact.correction_mm - linear.correction_mm, axis=1).max()
    assert 0.3 * apart < stated + 1e-3
    assert apart < 0.02 * exact.before_mm.max()
    assert not any("superposed" in note for note in exact.notes)
