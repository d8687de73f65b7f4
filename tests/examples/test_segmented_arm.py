"""The segmented arm against formulas of statics and against Drake."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from plants import drake_plant
from plants.beams import HollowBox, element_parts, tapered_parts
from plants.chain import RigidChain, for_drake, parse_plant, read_chain
from plants.repeatability import joint_errors
from plants.rigid_ik import ToolFrame, UnreachableError, newton, solve_path, tool_poses
from plants.segmented_arm import EquilibriumError, SegmentedArm
from plants.sensitivity import compliance_columns
from plants.truth import LinkTruth, Tool, Truth, load_truth

KR270 = Path(__file__).parents[2] / "examples" / "kr270"
LOAD_POINT = np.array([0.15, 0.05, 0.25])
BOX = HollowBox(width=0.2, height=0.3, wall=0.01, youngs_modulus=70e9, shear_modulus=26e9)

SLIDER = """<robot name="slider">
  <link name="bed"><inertial><mass value="50"/><origin xyz="0.1 0 0.2"/>
    <inertia ixx="9" iyy="9" izz="9" ixy="0" ixz="0" iyz="0"/></inertial></link>
  <joint name="track" type="prismatic"><parent link="bed"/><child link="carriage"/><origin xyz="0.1 0.2 0.5" rpy="0.2 0 0.3"/>
    <axis xyz="0.6 0.8 0"/><limit lower="-1" upper="1" effort="1" velocity="1"/></joint>
  <link name="carriage"><inertial><mass value="80"/><origin xyz="0 0.05 0.1"/>
    <inertia ixx="9" iyy="9" izz="9" ixy="0" ixz="0" iyz="0"/></inertial></link>
  <joint name="turn" type="revolute"><parent link="carriage"/><child link="arm"/><origin xyz="0 0.1 0.7"/>
    <axis xyz="0 1 0"/><limit lower="-2" upper="2" effort="1" velocity="1"/></joint>
  <link name="arm"><inertial><mass value="30"/><origin xyz="0.3 0 0"/>
    <inertia ixx="9" iyy="9" izz="9" ixy="0" ixz="0" iyz="0"/></inertial></link>
  <joint name="mount" type="fixed"><parent link="arm"/><child link="flange"/><origin xyz="0.8 0 0.1" rpy="0 1.2 0"/></joint>
  <link name="flange"><inertial><mass value="5"/><origin xyz="0 0 0.02"/>
    <inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial></link>
</robot>"""


@pytest.fixture(scope="module")
def arm() -> SegmentedArm:
    return SegmentedArm.from_files(KR270 / "kr270.urdf", KR270 / "true_arm.yaml")


@pytest.fixture(scope="module")
def slider(tmp_path_factory: pytest.TempPathFactory) -> SegmentedArm:
    path = tmp_path_factory.mktemp("slider") / "slider.urdf"
    path.write_text(SLIDER)
    links = {name: LinkTruth(BOX.scaled(0.5), taper=0.9) for name in ("bed", "carriage", "arm")}
    tool = Tool(7.0, np.array([0.02, 0.0, 0.1]))
    truth = Truth("flange", {"track": 1e-7, "turn": 2e-6}, links, tool, np.array([0.0, 0.0, -9.81]))
    return SegmentedArm.from_truth(read_chain(path), truth)


def postures(chain: RigidChain, count: int, seed: int = 0) -> np.ndarray:
    return np.random.default_rng(seed).uniform(chain.lower, chain.upper, size=(count, chain.size))


def cantilever(length: float, segments: int = 3) -> SegmentedArm:
    """A beam along x from the world, then a rigid hinge and a rigid stub: the flange, 1 m beyond, sees the beam's tip."""
    rigid = np.array([[1.0, 1.0, 1.0, 1.0], [1e15, 1e15, 1e15, 1e15]])
    chain = RigidChain(
        joint_names=("hinge",),
        link_names=("beam", "stub"),
        prismatic=(False,),
        axes=np.array([[0.0, 1.0, 0.0]]),
        end_R=np.tile(np.eye(3), (2, 1, 1)),
        end_p=np.array([[length, 0.0, 0.0], [1.0, 0.0, 0.0]]),
        masses=np.zeros(2),
        centers=np.zeros((2, 3)),
        lower=np.array([-1.0]),
        upper=np.array([1.0]),
    )
    truth = Truth(
        "flange",
        {"hinge": 0.0},
        {"beam": LinkTruth(BOX), "stub": LinkTruth(BOX)},
        Tool(0.0, np.zeros(3)),
        np.zeros(3),
        segments=segments,
        shear=False,
    )
    return SegmentedArm.from_truth(chain, truth).with_values(link_factors=rigid)


@pytest.mark.parametrize("segments", [1, 3, 7])
def test_cantilever_is_exact_for_tip_loads(segments: int) -> None:
    length, e, g = 1.2, BOX.youngs_modulus, BOX.shear_modulus
    beam, tip = cantilever(length, segments), np.array([-1.0, 0.0, 0.0])
    bend = e * BOX.bending_inertia_y

    def response(wrench: list[float]) -> np.ndarray:
        w = np.array([wrench])
        R, _ = beam.poses(np.zeros((1, 1)), w, tip)
        moved = beam.points(np.zeros((1, 1)), w, tip, tip[None])[0, 0] - [length, 0.0, 0.0]
        return np.concatenate([moved, [R[0, 2, 1], R[0, 0, 2], R[0, 1, 0]]])

    # Loads that move the tip by about 1e-5 m: the finite rotation shows at 1e-10 of that.
    force = 1e-5 * 3 * bend / length**3
    down = response([0, 0, force, 0, 0, 0])
    assert down[2] == pytest.approx(force * length**3 / (3 * bend), rel=1e-9)
    assert down[4] == pytest.approx(-force * length**2 / (2 * bend), rel=1e-9)
    moment = 1e-5 * 2 * bend / length**2
    turned = response([0, 0, 0, 0, moment, 0])
    assert turned[2] == pytest.approx(-moment * length**2 / (2 * bend), rel=1e-9)
    assert turned[4] == pytest.approx(moment * length / bend, rel=1e-9)
    twist = response([0, 0, 0, 100.0, 0, 0])
    assert twist[3] == pytest.approx(100.0 * length / (g * BOX.torsion_constant), rel=1e-8)
    pull = response([1e5, 0, 0, 0, 0, 0])
    assert pull[0] == pytest.approx(1e5 * length / (e * BOX.area), rel=1e-9)


def test_element_compliance_is_positive_definite_and_additive() -> None:
    whole = element_parts(BOX, 0.6).sum(axis=0)
    assert np.linalg.eigvalsh(whole).min() > 0
    half = element_parts(BOX, 0.3).sum(axis=0)
    # The tip of a beam of two halves: the first half's tip carried to the end, plus the second.
    carry = np.eye(6)
    carry[1, 5], carry[2, 4] = 0.3, -0.3
    np.testing.assert_allclose(carry @ half @ carry.T + half, whole, rtol=1e-12, atol=1e-20)


def test_three_tapered_elements_are_within_two_percent_of_many() -> None:
    def tip_compliance(count: int) -> np.ndarray:
        total = np.zeros((6, 6))
        for k, parts in enumerate(tapered_parts(BOX, 1.0, count, 0.8)):
            lever, carry = 1.0 - (k + 1) / count, np.eye(6)
            carry[1, 5], carry[2, 4] = lever, -lever
            total += carry @ parts.sum(axis=0) @ carry.T
        return total

    few, many = np.diag(tip_compliance(3)), np.diag(tip_compliance(300))
    np.testing.assert_allclose(few, many, rtol=0.02)


def test_chain_agrees_with_drake(arm: SegmentedArm, slider: SegmentedArm, tmp_path: Path) -> None:
    (tmp_path / "slider.urdf").write_text(SLIDER)
    for model, chain in ((KR270 / "kr270.urdf", arm.chain), (tmp_path / "slider.urdf", slider.chain)):
        plant, q = parse_plant(model), postures(chain, 5)
        R, p = chain.flange(q)
        context = plant.CreateDefaultContext()
        for k, one in enumerate(q):
            plant.SetPositions(context, for_drake(one))
            pose = plant.GetFrameByName("flange").CalcPoseInWorld(context)
            np.testing.assert_allclose(R[k], pose.rotation().matrix(), atol=1e-14)
            np.testing.assert_allclose(p[k], pose.translation(), atol=1e-14)


def test_jacobian_is_the_derivative(arm: SegmentedArm) -> None:
    q, step, point = postures(arm.chain, 4), 1e-6, LOAD_POINT
    jacobian = arm.chain.jacobian(q, point)
    for j in range(arm.chain.size):
        ends = []
        for sign in (1, -1):
            moved = q.copy()
            moved[:, j] += sign * step
            R, p = arm.chain.flange(moved)
            ends.append(p + R @ point)
        np.testing.assert_allclose((ends[0] - ends[1]) / (2 * step), jacobian[:, :3, j], atol=1e-8)


@pytest.mark.parametrize("which", ["arm", "slider"])
def test_equilibrium_satisfies_drakes_statics(which: str, request: pytest.FixtureRequest) -> None:
    true: SegmentedArm = request.getfixturevalue(which)
    q = postures(true.chain, 4, seed=3)
    wrench = np.random.default_rng(4).normal(size=(4, 6)) * [2e3, 2e3, 2e3, 200, 200, 200]
    shape, theta = true.equilibrium(q, wrench, LOAD_POINT)
    carried = true.generalized_forces(shape, wrench, LOAD_POINT, true.gravity)
    plant, compliance = drake_plant.build(true), true.element_compliance()
    links, pieces = true.segments.masses.shape
    assert plant.num_positions() == 6 * links * pieces + true.chain.size
    for k in range(len(q)):
        positions = drake_plant.coordinates(q, theta, k)
        R, p = drake_plant.flange_pose(plant, positions)
        np.testing.assert_allclose(shape.R[k], R, atol=1e-13)
        np.testing.assert_allclose(shape.p[k], p, atol=1e-13)
        forces = drake_plant.generalized_forces(plant, positions, wrench[k], LOAD_POINT)
        np.testing.assert_allclose(drake_plant.coordinates(0 * q, carried, k), forces, atol=1e-8)
        # theta = C tau with Drake's tau.
        at = 0
        for link in range(links):
            for s in range(pieces):
                np.testing.assert_allclose(
                    theta.elements[link, s, k], compliance[link, s] @ forces[at : at + 6], atol=1e-12
                )
                at += 6
            if link < true.chain.size:
                assert abs(theta.joints[link, k] - true.joint_compliance[link] * forces[at]) < 1e-12
                at += 1


def test_reciprocity(arm: SegmentedArm) -> None:
    """Maxwell-Betti: the work of load a on the displacement by load b equals that of b on a."""
    q, rng = postures(arm.chain, 6, seed=5), np.random.default_rng(6)
    points = rng.normal(size=(2, 3)) * 0.2
    force = rng.normal(size=(2, 3)) * 20.0

    def displacement(cause: int, effect: int) -> np.ndarray:
        ends = []
        for sign in (1.0, -1.0):
            wrench = np.tile(np.concatenate([sign * force[cause], np.zeros(3)]), (len(q), 1))
            ends.append(arm.points(q, wrench, points[cause], points[effect][None], weight=False)[:, 0])
        return 0.5 * (ends[0] - ends[1])

    np.testing.assert_allclose(displacement(0, 1) @ force[1], displacement(1, 0) @ force[0], rtol=1e-6)


def test_work_of_the_load_is_stored_in_the_springs(arm: SegmentedArm) -> None:
    q = postures(arm.chain, 3, seed=7)
    wrench = np.array([1500.0, -2000.0, 2500.0, 0.0, 0.0, 0.0])
    nodes, weights = np.polynomial.legendre.leggauss(8)
    levels = 0.5 * (nodes + 1.0)

    def along(level: float) -> np.ndarray:
        return (
            arm.points(q, np.tile(level * wrench, (3, 1)), LOAD_POINT, LOAD_POINT[None], weight=False)[:, 0]
            @ wrench[:3]
        )

    # Integration by parts: the work is F.p at the end less the integral of p over the load.
    work = along(1.0) - 0.5 * sum(w * along(level) for w, level in zip(weights, levels, strict=True))
    shape, theta = arm.equilibrium(q, np.tile(wrench, (3, 1)), LOAD_POINT, weight=False)
    carried = arm.generalized_forces(shape, np.tile(wrench, (3, 1)), LOAD_POINT, np.zeros(3))
    stored = 0.5 * np.einsum("lsni,lsni->n", theta.elements, carried.elements)
    stored += 0.5 * np.einsum("kn,kn->n", theta.joints, carried.joints)
    np.testing.assert_allclose(work, stored, rtol=1e-9)


def test_cutting_keeps_mass_and_centre(arm: SegmentedArm) -> None:
    seg, chain = arm.segments, arm.chain
    np.testing.assert_allclose(seg.masses.sum(axis=1), chain.masses)
    for k in range(len(chain.link_names)):
        starts = np.arange(3)[:, None] * np.array([seg.step[k], 0.0, 0.0])
        center = seg.masses[k] @ (starts + seg.centers[k]) / seg.masses[k].sum()
        np.testing.assert_allclose(seg.beam_R[k] @ center, chain.centers[k], atol=1e-15)


def test_stiff_links_leave_the_rigid_arm_with_joint_springs(arm: SegmentedArm) -> None:
    q = postures(arm.chain, 3)
    stiff = arm.with_link_stiffness(1e12).with_values(joint_compliance=np.zeros(6))
    for mine, rigid in zip(stiff.poses(q), arm.chain.flange(q), strict=True):
        np.testing.assert_allclose(mine, rigid, atol=1e-12)
    soft = SegmentedArm.from_files(KR270 / "kr270.urdf", KR270 / "true_arm.yaml", link_stiffness_factor=0.5)
    np.testing.assert_allclose(soft.element_compliance(), 2.0 * arm.element_compliance())


def test_single_pose_equals_batch_and_none_is_weight_only(arm: SegmentedArm) -> None:
    q = postures(arm.chain, 2)
    R, p = arm.flange_pose(q[1], np.zeros(6), LOAD_POINT)
    many_R, many_p = arm.poses(q)
    np.testing.assert_allclose(R, many_R[1], atol=1e-13)
    np.testing.assert_allclose(p, many_p[1], atol=1e-13)
    assert np.linalg.norm(p - arm.chain.flange(q)[1][1]) > 1e-3


def test_buckling_is_refused_by_name(arm: SegmentedArm) -> None:
    soft = arm.with_values(joint_compliance=arm.joint_compliance * 3e3)
    with pytest.raises(EquilibriumError, match="posture 0"):
        soft.poses(np.deg2rad([[0.0, -90.0, 0.0, 0.0, 0.0, 0.0]]))


def test_columns_are_derivatives_up_to_load_stiffness(arm: SegmentedArm) -> None:
    q = postures(arm.chain, 3, seed=8)
    wrench = np.tile([1e3, -2e3, -2e3, 0.0, 0.0, 0.0], (3, 1))
    shape, _ = arm.equilibrium(q, wrench, LOAD_POINT)
    loads = arm.generalized_forces(shape, wrench, LOAD_POINT, arm.gravity)
    columns = compliance_columns(arm, shape, loads, shape.p)
    for j in (1, 4):
        compliance = arm.joint_compliance.copy()
        compliance[j] *= np.exp(1e-4)
        moved = arm.with_values(joint_compliance=compliance).poses(q, wrench, LOAD_POINT)[1]
        np.testing.assert_allclose((moved - shape.p) / 1e-4, columns[:, :, j], rtol=0.03, atol=3e-5)
    for link, part in ((0, 1), (2, 0), (3, 2)):
        factors = arm.link_factors.copy()
        factors[link, part] *= np.exp(-1e-4)
        moved = arm.with_values(link_factors=factors).poses(q, wrench, LOAD_POINT)[1]
        np.testing.assert_allclose((moved - shape.p) / 1e-4, columns[:, :, 6 + 4 * link + part], rtol=0.03, atol=3e-5)


def test_repeatability_moves_the_flange_by_what_is_stated(arm: SegmentedArm) -> None:
    q = postures(arm.chain, 4000)
    errors = joint_errors(arm.chain, q, 0.06e-3, np.random.default_rng(9))
    moved = arm.chain.flange(q + errors)[1] - arm.chain.flange(q)[1]
    assert np.sqrt(np.mean(np.sum(moved**2, axis=1))) == pytest.approx(0.06e-3, rel=0.03)


def test_inverse_kinematics_and_its_refusal(arm: SegmentedArm) -> None:
    chain, tool = arm.chain, ToolFrame(np.eye(3), np.array([0.1, 0.0, 0.3]))
    q = np.deg2rad([[10.0, -80.0, 110.0, 20.0, -40.0, 30.0], [12.0, -78.0, 112.0, 22.0, -42.0, 25.0]])
    R, p = tool_poses(chain, q, tool)
    np.testing.assert_allclose(solve_path(chain, R, p, q[0] + 0.1, tool), q, atol=1e-10)
    _, error = newton(chain, R, p, np.deg2rad([0.0, -90.0, 90.0, 0.0, 0.0, 0.0]), tool)
    assert error.max() < 1e-11
    with pytest.raises(UnreachableError, match="pose 1"):
        solve_path(chain, R, p + [[0, 0, 0], [5.0, 0, 0]], q, tool)


def test_truth_that_lacks_a_joint_or_is_impossible_is_refused(arm: SegmentedArm) -> None:
    truth = load_truth(KR270 / "true_arm.yaml")
    lacking = replace(truth, joint_compliance={"joint_1": 1e-6})
    with pytest.raises(KeyError, match="joint_2"):
        SegmentedArm.from_truth(arm.chain, lacking)
    with pytest.raises(ValueError, match="wall"):
        replace(BOX, wall=0.2)
    with pytest.raises(ValueError, match="length"):
        element_parts(BOX, 0.0)
