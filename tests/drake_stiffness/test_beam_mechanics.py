"""Rules of beams against beams: numerically integrated ones of random sections, prismatic ones, ones that break an assumption."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.ndimage import binary_dilation
from scipy.sparse import lil_matrix
from scipy.sparse.linalg import spsolve
from scipy.spatial.transform import Rotation
from synthetic import hand_made_arm

from drake_stiffness.effects.compliance import BaseCompliance, LinkCompliance
from drake_stiffness.errors import InputError
from drake_stiffness.model import Model
from drake_stiffness.restoration.beam_mechanics import BEAM, beam_inequalities, beam_rules, link_beams
from drake_stiffness.restoration.sections import Section, SectionLimits, Sections, limits_of, read_sections

POINTS = {"P": np.zeros(3)}


def limits(
    length=0.8, width=(0.2, 0.2), radius=(0.01, 0.01), ratio=(2.3, 2.8), shear=(0.15, 1.0), torsion=(0.002, 1.0)
):
    return SectionLimits(length, width, radius, ratio, shear, torsion, None)


def entries(s, ds, F, axial, twist, shear):
    """The eight entries of a cantilever from its pieces, by the principle of virtual work.

    s: distance from the tip; F (n, 2, 2): curvature by bending moment about (z, y); axial, twist, (n, 2) shear flexibilities.
    """
    k66, k26, k22 = (float((F[:, 0, 0] * s**p) @ ds) for p in range(3))
    k55, k35, k33 = (float((F[:, 1, 1] * s**p) @ ds) for p in range(3))
    S = ds @ shear
    return np.array([axial @ ds, k22 + S[0], k26, k33 + S[1], -k35, twist @ ds, k55, k66])


def a_beam(seed: int, length: float):
    """A beam of many pieces, each a cloud of areas in a 0.4 m square with moduli of its own; its entries and true limits."""
    rng = np.random.default_rng(seed)
    n = 30
    s = np.sort(rng.uniform(0, length, n))
    ds = rng.dirichlet(np.ones(n)) * length
    E, ratio = rng.uniform(60e9, 210e9, n), rng.uniform(2.3, 2.8, n)
    cloud, area = (
        rng.uniform(-0.2, 0.2, (n, 12, 2)) * rng.uniform(0.2, 1.0, (n, 1, 2)),
        rng.uniform(1e-4, 1e-3, (n, 12)),
    )
    A = area.sum(axis=1)
    cloud = cloud - (area[..., None] * cloud).sum(axis=1)[:, None] / A[:, None, None]
    gyration = np.einsum("np,npi,npj->nij", area, cloud, cloud) / A[:, None, None]
    F = np.linalg.inv(gyration) / (E * A)[:, None, None]
    torsion = rng.uniform(0.002, 1.0, n)
    twist = ratio / 4 * (F[:, 0, 0] + F[:, 1, 1]) / torsion
    shear = (ratio / (E * A))[:, None] / rng.uniform(0.15, 1.0, (n, 2))
    k = entries(s, ds, F, 1 / (E * A), twist, shear)
    least = float(np.sqrt(np.linalg.eigvalsh(gyration)[:, 0].min()))
    most = np.abs(cloud).max(axis=(0, 1))
    return k, limits(length, (most[0], most[1]), (least, least))


def worst(rules, k):
    """The largest violation, each rule in units of its own terms; at most zero where all hold."""
    linear = (rules.rows @ k - rules.limits) / (np.abs(rules.rows) @ np.abs(k))
    cones = []
    for block in rules.blocks @ k:
        d = np.sqrt(np.maximum(np.diag(block), 1e-300))
        cones.append(-np.linalg.eigvalsh(block / np.outer(d, d))[0])
    return max(linear.max(), *cones)


@given(st.integers(0, 2**32 - 1), st.floats(0.1, 2.0))
@settings(max_examples=200, deadline=None)
def test_every_rule_holds_for_any_section_along_the_way_in_any_principal_axes(seed, length):
    k, true = a_beam(seed, length)
    assert worst(beam_rules(true), k) <= 1e-12


@pytest.mark.parametrize("entry", range(8))
def test_no_entry_may_be_ten_thousand_times_larger_or_of_the_other_sign(entry):
    k, true = a_beam(7, 0.8)
    for factor in (1e4, -1.0):
        wrong = k.copy()
        wrong[entry] *= factor
        assert worst(beam_rules(true), wrong) > 1e-6, (BEAM.names[entry], factor)


def rectangle(length, w, h, E=210e9, ratio=2.58):
    """Closed form of a solid prismatic bar, torsion by the series of Saint-Venant."""
    A, Iz, Iy = w * h, h * w**3 / 12, w * h**3 / 12
    a, b = max(w, h), min(w, h)
    n = np.arange(1, 40, 2)
    J = a * b**3 / 3 * (1 - 192 * b / (np.pi**5 * a) * (np.tanh(n * np.pi * a / (2 * b)) / n**5).sum())
    G, shear = E / ratio, length / (E / ratio * A * 5 / 6)
    bend = [length**3 / 3, length**2 / 2, length]
    z, y = np.array(bend) / (E * Iz), np.array(bend) / (E * Iy)
    return np.array([length / (E * A), z[0] + shear, z[1], y[0] + shear, -y[1], length / (G * J), y[2], z[2]])


def test_for_a_prismatic_beam_k11_is_the_bending_compliance_times_the_radius_of_gyration_squared():
    k = rectangle(0.9, 0.08, 0.12)
    r = (0.08 / np.sqrt(12), 0.12 / np.sqrt(12))
    rules = beam_rules(limits(0.9, r, r))
    axial = [i for i, name in enumerate(rules.names) if name.startswith("k11")]
    assert len(axial) == 4
    assert np.abs(rules.rows[axial] @ k) == pytest.approx(0.0, abs=1e-9 * k[0])
    assert worst(rules, k) <= 1e-12


def test_a_round_bar_twists_exactly_as_the_torsion_rule_says_at_least():
    r, L, E, G = 0.05, 0.7, 210e9, 81e9
    A, I = np.pi * r**2, np.pi * r**4 / 4  # noqa: E741
    k44, bend = L / (G * 2 * I), L / (E * I)
    rules = beam_rules(limits(L, ratio=(E / G, E / G)))
    row = rules.rows[rules.names.index("k44 >= (E/4G)(k55 + k66)")]
    k = np.array([L / (E * A), 0, 0, 0, 0, k44, bend, bend])
    assert row @ k == pytest.approx(0.0, abs=1e-12 * k44)


@pytest.mark.parametrize("shape", ["L", "cross", "wedge", "bar"])
def test_no_section_is_stiffer_in_torsion_than_the_ellipse_with_its_second_moments(shape):
    """Prandtl's membrane on a grid: laplace(f) = -2 inside, zero around; J = 2 integral f."""
    n = 48
    y, z = np.meshgrid(np.linspace(-1, 1, n), np.linspace(-1, 1, n), indexing="ij")
    inside = {
        "L": (np.abs(y + 0.5) < 0.3) | (np.abs(z + 0.5) < 0.3),
        "cross": (np.abs(y) < 0.3) | (np.abs(z) < 0.3),
        "wedge": y + 0.4 * z < 0.1,
        "bar": np.abs(y) < 0.4,
    }[shape] & (np.maximum(np.abs(y), np.abs(z)) < 0.9)
    h, number = 2 / (n - 1), -np.ones((n, n), dtype=int)
    number[inside] = np.arange(inside.sum())
    M = lil_matrix((inside.sum(), inside.sum()))
    for i, j in zip(*np.nonzero(inside), strict=True):
        M[number[i, j], number[i, j]] = 4.0
        for a, b in ((i + 1, j), (i - 1, j), (i, j + 1), (i, j - 1)):
            if inside[a, b]:
                M[number[i, j], number[a, b]] = -1.0
    J = 2 * spsolve(M.tocsc(), np.full(inside.sum(), 2 * h**2)).sum() * h**2
    # The membrane is held at the nodes around, so the section it spans reaches nearly there.
    whole = binary_dilation(inside)
    one, two = np.linalg.eigvalsh(np.cov(np.stack([y[whole], z[whole]]), bias=True) * whole.sum() * h**2)
    assert 0.02 < J / (4 * one * two / (one + two)) <= 1.0


def test_a_hinge_at_the_clamp_is_the_border_of_the_moment_rules():
    L = 0.6
    k = np.array([0, L**2, L, L**2, -L, 2.0, 1.0, 1.0])
    rules = beam_rules(limits(L))
    border = [i for i, name in enumerate(rules.names) if "<= L" in name]
    assert rules.rows[border] @ k == pytest.approx(0.0, abs=1e-15)
    further = k.copy()
    further[2] *= 1.01
    assert (rules.rows @ further).max() > 0


def test_a_beam_beside_the_line_through_its_spring_breaks_the_axial_rules_whatever_width_is_stated():
    """At the distance e along y k11 grows by e^2 k66, which no width along z has room for."""
    k, e = rectangle(0.9, 0.08, 0.12), 0.15
    assert worst(beam_rules(limits(0.9, (0.04, 0.06))), k) <= 0.0
    k[0] += e**2 * k[7]
    assert worst(beam_rules(limits(0.9, (0.04, 0.06))), k) > 0.1
    assert worst(beam_rules(limits(0.9, (0.04 + e, 0.06))), k) > 0.1


def bare_model(line, effects, R=None):
    arm = hand_made_arm([line, (0.3, 0, 0)], [(0, 0, 1)])
    if R is not None:
        arm = type(arm)(**{**vars(arm), "R_PF": np.stack([R, np.eye(3)])})
    return Model({}, arm, POINTS, np.zeros(3), effects, np.zeros(sum(len(e.parameters) for e in effects)))


def matrix_of(k):
    return BEAM.matrix(k)


@pytest.mark.parametrize("axis", "xyz")
@pytest.mark.parametrize("sign", [1, -1])
def test_beams_along_any_axis_and_against_it_obey_the_same_rules(axis, sign):
    k, true = a_beam(11, 0.8)
    direction = sign * np.eye(3)["xyz".index(axis)]
    following = np.eye(3)[("xyz".index(axis) + 1) % 3]
    R = np.column_stack([direction, following, np.cross(direction, following)])
    Q = np.kron(np.eye(2), R)
    effect = BaseCompliance("base", "beam", axis, 0.8, "ground")
    x = effect.template.values(Q @ matrix_of(k) @ Q.T)
    (beam,), notes = link_beams(bare_model(0.8 * direction, (effect,)), Sections())
    assert not notes
    assert beam.length_m == pytest.approx(0.8)
    np.testing.assert_allclose(beam.entries @ x, k, rtol=1e-12)
    assert worst(beam_rules(true), beam.entries @ x) <= 1e-12


def test_a_leaning_link_is_turned_before_the_rules_are_asked():
    k, _ = a_beam(13, 0.8)
    lean = Rotation.from_euler("zy", [8, -6], degrees=True).as_matrix()
    Q = np.kron(np.eye(2), lean)
    K = Q @ matrix_of(k) @ Q.T
    for effect in (
        BaseCompliance("base", "symmetric", "x", 0.8, "ground"),
        BaseCompliance("base", "beam", "x", 0.8, "ground"),
    ):
        (beam,), _ = link_beams(bare_model(0.8 * lean[:, 0], (effect,)), Sections())
        assert beam.tilt_deg == pytest.approx(np.degrees(np.arccos(lean[0, 0])))
        # The rules do not ask how the section is turned about the line; turn it to the frame that link_beams chose.
        found = beam.entries @ effect.template.values(K)
        assert found[[0, 5]] == pytest.approx(k[[0, 5]], rel=1e-6 if effect.template_name == "symmetric" else 0.3)
        assert found[6] + found[7] == pytest.approx(
            k[6] + k[7], rel=1e-6 if effect.template_name == "symmetric" else 0.3
        )


def test_a_link_that_leans_far_from_its_template_is_left_out_and_named():
    effect = BaseCompliance("base", "beam", "x", 0.8, "ground")
    beams, notes = link_beams(bare_model((0.5, 0.5, 0), (effect,)), Sections())
    assert not beams
    assert "ground" in notes[0]
    assert "45 deg" in notes[0]


def test_the_inequalities_of_a_model_hold_for_its_true_links_and_not_for_others():
    k, true = a_beam(3, 0.8)
    effects = (BaseCompliance("base", "beam", "x", 0.8, "ground"), LinkCompliance("l1", "beam", "x", 0.8))
    section = Section(
        half_width_y_m=true.half_width_m[0], half_width_z_m=true.half_width_m[1], radius_y_m=true.radius_m[0],
        radius_z_m=true.radius_m[0], length_m=0.8,
    )  # fmt: skip
    model = bare_model((0.8, 0, 0), effects)
    G, h = beam_inequalities(model, Sections(default=section))
    x = np.concatenate([k, 2 * k])
    assert G.shape == (h.size, 16)
    assert (G @ x - h).max() <= 1e-18
    x[8] *= 1e3
    assert (G @ x - h).max() > 1e-9


def test_stated_moduli_and_areas_bound_the_axial_compliance_in_newtons():
    section = Section(youngs_modulus_GPa=(100.0, 200.0), area_m2=(0.002, 0.01))
    rules = beam_rules(limits_of(Sections(default=section), "l1", 0.5, 0.5))
    k11 = -rules.limits[rules.names.index("k11 >= L / (EA)max")], rules.limits[rules.names.index("k11 <= L / (EA)min")]
    assert k11 == pytest.approx((0.5 / 2e9, 0.5 / 0.2e9))


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("default: {half_width_y: 0.1}", "Did you mean 'half_width_y_m'"),
        ("default: {half_width_y_m: 0.1, radius_y_m: 0.2}", "no section has a radius of gyration"),
        ("default: {elastic_ratio: [2.8, 2.3]}", "low <= high"),
        ("default: {shear_factor: [0.5, 1.2]}", "no section exceeds 1"),
        ("default: {youngs_modulus_GPa: [70, 71]}", "state both or neither"),
        ("links: {l1: {half_width_y_m: -1}}", "greater than 0"),
    ],
)
def test_what_is_wrong_with_a_sections_file_is_said(tmp_path, text, said):
    (tmp_path / "sections.yaml").write_text(text)
    with pytest.raises(InputError, match=r"sections\.yaml") as error:
        read_sections(tmp_path / "sections.yaml")
    assert said in str(error.value)


def test_sections_of_unknown_links_and_links_without_length_are_refused():
    effect = BaseCompliance("base", "beam", "x", 0.8, "ground")
    with pytest.raises(InputError, match="no link 'forearm'; the arm has ground, l1"):
        link_beams(bare_model((0.8, 0, 0), (effect,)), Sections(links={"forearm": Section()}))
    with pytest.raises(InputError, match=r"links\.ground\.length_m"):
        link_beams(bare_model((0, 0, 0), (effect,)), Sections())
    (beam,), _ = link_beams(bare_model((0, 0, 0), (effect,)), Sections(links={"ground": Section(length_m=0.1)}))
    assert beam.length_m == 0.1


def test_what_a_link_states_goes_before_what_holds_for_all():
    sections = Sections(
        default=Section(half_width_y_m=0.2, elastic_ratio=(2.5, 2.6)), links={"a": Section(half_width_y_m=0.1)}
    )
    a, b = (limits_of(sections, name, 0.5, 0.4) for name in "ab")
    assert (a.half_width_m[0], b.half_width_m[0]) == (0.1, 0.2)
    assert a.radius_m == pytest.approx(
        (0.02, 0.02)
    )  # a fifth of what is stated, a tenth of what is not (half of 0.4 m)
    assert a.elastic_ratio == (2.5, 2.6)
