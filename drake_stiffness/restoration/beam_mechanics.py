r"""What the compliance matrix of a beam obeys, whatever its section does along the way.

The link is a straight cantilever of length L along x, clamped at its own joint, with its spring at the free end. A section at the
distance s from the free end (0 .. L) has axial, bending, torsional and shear stiffness EA, EI_z, EI_y, GJ, kGA. A wrench at the
free end makes it carry M_z = m_z + s f_y and so on, so by unit loads

    k66 = ∫ dm_z         k26 = ∫ s dm_z          k22 = ∫ s² dm_z + S_y       dm_z = ds / EI_z
    k55 = ∫ dm_y        -k35 = ∫ s dm_y          k33 = ∫ s² dm_y + S_z       dm_y = ds / EI_y
    k11 = ∫ ds / EA      k44 = ∫ ds / GJ         S_y = ∫ ds / (k_y G A)      S_z = ∫ ds / (k_z G A)

dm_z is a positive measure on [0, L]. From this alone follow all rules below; the shear S is eliminated exactly.

- **Moments.** 0 <= k26 <= L k66 and k22 - S_y <= L k26, because 0 <= s <= L; and the matrix of (k22 - S_y, k26, k66) is positive
  semidefinite (Cauchy and Schwarz). These are all conditions on three moments of a measure on an interval (Hausdorff).
- **Shear.** 1/(kGA) = (E/G)(1/k)(1/EA), so S is between a_low k11 and a_high k11 with a = (E/G)/k. k <= 1 for every section.
- **Axial.** EI_z = EA r_y², r_y the radius of gyration along y, so k11 = ∫ r_y² dm_z is between r_min² k66 and c² k66, c the half width.
  The same with k55 and z. For a prismatic beam k11 = r_y² k66 = r_z² k55.
- **Torsion.** J = min over warpings w of ∫ (w_y - z)² + (w_z + y)² dA; w = a y z with the best a gives J <= 4 I_y I_z / (I_y + I_z),
  with equality for the ellipse. So k44 >= (E/4G)(k55 + k66), and with J at least b times that, k44 <= (E/4Gb)(k55 + k66).
- **Absolute.** k11 is between L / (EA)_max and L / (EA)_min where the user states both.

Assumed: linear elastic; centre line straight and through the spring; plane sections that keep their shape (the shear factor is
energy's) and warp freely; E/G and everything else may vary along x. Principal axes need not be y and z: then dm is a 2x2 positive
measure, whose diagonal obeys all of this, because 1/EA is between r_min² (I^-1)_zz / E and c² (I^-1)_zz / E in any axes (r_min the
smallest over all axes), and the trace in the torsion rule does not turn. A centre line beside the axis breaks the axial rules: at
the distance e along y it adds e² k66 to k11.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from drake_stiffness.arm import Arm
from drake_stiffness.effects.compliance import LinkCompliance
from drake_stiffness.model import Model
from drake_stiffness.restoration.sections import SectionLimits, Sections, check_links, limits_of
from drake_stiffness.rotations import Array
from drake_stiffness.springs import spring_template

BEAM = spring_template("beam", "x")
K11, K22, K26, K33, K35, K44, K55, K66 = np.eye(8)
assert BEAM.names == ("k11", "k22", "k26", "k33", "k35", "k44", "k55", "k66")

# A link whose line to the next joint leans more than this against its long axis is no beam along that axis.
MOST_TILT_DEG = 15.0


@dataclass(frozen=True, eq=False)
class BeamRules:
    """Conditions on the eight entries k = (k11, k22, k26, k33, k35, k44, k55, k66) of a beam along x.

    Attributes
    ----------
    names : tuple of m
    rows, limits : (m, 8), (m,)
        rows @ k <= limits, SI.
    weights : (m,)
        For a centre of the range in the logarithmic sense: a pair low b <= a <= high b with these weights on the logarithms of
        its slacks has its maximum at a = sqrt(low high) b.
    block_names : tuple of 2
    blocks : (2, 2, 2, 8)
        blocks[i] @ k is positive semidefinite, (2, 2).
    """

    names: tuple[str, ...]
    rows: Array
    limits: Array
    weights: Array
    block_names: tuple[str, ...]
    blocks: Array


def beam_rules(limits: SectionLimits) -> BeamRules:
    """All conditions on a beam whose sections lie within limits."""
    L, (cy, cz), (ry, rz) = limits.length_m, limits.half_width_m, limits.radius_m
    ratio, (k_low, k_high), torsion = limits.elastic_ratio, limits.shear_factor, limits.torsion_factor
    shear_low, shear_high = ratio[0] / k_high, ratio[1] / k_low
    found: list[tuple[str, Array, float, float]] = []

    def add(name: str, row: Array, bound: float = 0.0, weight: float = 1.0) -> None:
        found.append((name, row, bound, weight))

    def between(what: str, a: Array, low: float, high: float, b: Array, words: tuple[str, str]) -> None:
        root = np.sqrt([low, high])
        add(f"{what} >= {words[0]}", low * b - a, weight=2 * root[0] / root.sum())
        add(f"{what} <= {words[1]}", a - high * b, weight=2 * root[1] / root.sum())

    between("k11", K11, ry**2, cy**2, K66, ("r_y^2 k66", "c_y^2 k66"))
    between("k11", K11, rz**2, cz**2, K55, ("r_z^2 k55", "c_z^2 k55"))
    quarter = (ratio[0] / (4 * torsion[1]), ratio[1] / (4 * torsion[0]))
    between("k44", K44, *quarter, K55 + K66, ("(E/4G)(k55 + k66)", "(E/4Gb)(k55 + k66)"))
    for bend, cross, sign, turn, word in ((K22, K26, 1, K66, "k26"), (K33, K35, -1, K55, "-k35")):
        end = "k66" if sign > 0 else "k55"
        add(f"{word} >= 0", -sign * cross)
        add(f"{word} <= L {end}", sign * cross - L * turn)
        add(f"k{'22' if sign > 0 else '33'} - shear <= L ({word})", bend - shear_high * K11 - sign * L * cross)
    if limits.axial_stiffness_N is not None:
        weakest, stiffest = limits.axial_stiffness_N
        add("k11 >= L / (EA)max", -K11, -L / stiffest)
        add("k11 <= L / (EA)min", K11, L / weakest)
    blocks = np.array([
        [[K22 - shear_low * K11, K26], [K26, K66]],
        [[K33 - shear_low * K11, K35], [K35, K55]],
    ])  # fmt: skip
    words = ("(k22 - shear) k66 >= k26^2", "(k33 - shear) k55 >= k35^2")
    names, rows, bounds, weights = zip(*found, strict=True)
    return BeamRules(names, np.array(rows), np.array(bounds), np.array(weights), words, blocks)


@dataclass(frozen=True, eq=False)
class LinkBeam:
    """A link of a model as a beam: its rules on the link's own unknowns.

    Attributes
    ----------
    link : str
    own : slice
        The link's part of the parameter vector.
    length_m : float
    tilt_deg : float
        Between the line from the link's own joint to its spring and the template's long axis.
    entries : (8, unknowns)
        The entries of the beam in its own frame (x along that line) as linear functions of the link's unknowns.
    rules : BeamRules
        On those entries.
    """

    link: str
    own: slice
    length_m: float
    tilt_deg: float
    entries: Array
    rules: BeamRules


def link_beams(model: Model, sections: Sections) -> tuple[list[LinkBeam], list[str]]:
    """Every link spring of a model as a beam, and why some are not.

    Raises
    ------
    InputError
        If sections name a link that is not there, or a link has no length.
    """
    check_links(sections, model.arm)
    beams, notes = [], []
    for effect, own in zip(model.effects, model.slices, strict=True):
        if not isinstance(effect, LinkCompliance):
            continue
        link = effect.link_name()
        if effect.template_name not in ("beam", "symmetric"):
            notes.append(
                f"{link}: template {effect.template_name} has no whole symmetric matrix; no rule of beams is used for it."
            )
            continue
        line = _line(effect, model.arm)
        reach = float(np.linalg.norm(line))
        limits = limits_of(sections, link, reach, model.arm.length_m)
        axis = np.eye(3)["xyz".index(effect.beam_axis)]
        R = beam_frame(line if reach > 1e-9 else axis)
        tilt = float(np.degrees(np.arccos(min(1.0, abs(float(R[:, 0] @ axis))))))
        if effect.template_name != "symmetric" and tilt > MOST_TILT_DEG:
            notes.append(
                f"{link}: the line from its joint to its spring leans {tilt:.0f} deg against the template's long axis {effect.beam_axis}; "
                "no rule of beams is used for it. With template symmetric it can be."
            )
            continue
        beams.append(LinkBeam(link, own, limits.length_m, tilt, _entries(effect, R), beam_rules(limits)))
    return beams, notes


def beam_inequalities(model: Model, sections: Sections) -> tuple[Array, Array]:
    """The linear rules of all links as G x <= h in the parameters of the model, SI.

    The optional prior of a fit that keeps all parameters under the semidefinite constraint (issue 3, item 3, "none" of the
    reductions): add `G @ (scales * y) <= h` to the program over y = x / scales. Rows differ by decades; divide each by its norm
    after scaling. The two 2x2 conditions of each link that tighten its cone by shear are in `link_beams` (`rules.blocks`).

    Returns
    -------
    G : (m, n), h : (m,)
    """
    beams, _ = link_beams(model, sections)
    G = np.zeros((sum(len(b.rules.names) for b in beams), model.x.size))
    ends = np.cumsum([0, *(len(b.rules.names) for b in beams)]).tolist()
    for beam, (start, end) in zip(beams, pairwise(ends), strict=True):
        G[start:end, beam.own] = beam.rules.rows @ beam.entries
    return G, np.concatenate([np.zeros(0), *(b.rules.limits for b in beams)])


def beam_frame(line: Array) -> Array:
    """Rotation (3, 3) of the beam's frame in the spring's: x along the line, y near the frame axis after the one nearest to x."""
    x = line / np.linalg.norm(line)
    near = np.roll(np.eye(3), -1, axis=0)[int(np.argmax(np.abs(x)))]
    y = near - (near @ x) * x
    y /= np.linalg.norm(y)
    return np.column_stack([x, y, np.cross(x, y)])


def _line(effect: LinkCompliance, arm: Arm) -> Array:
    """From the link's own joint to its spring, in the spring's frame, m."""
    _, k = effect.site(arm)
    return arm.R_PF[k].T @ arm.p_PF[k]


def _entries(effect: LinkCompliance, R: Array) -> Array:
    """(8, unknowns): entries of the beam in its own frame from the link's unknowns.

    A symmetric matrix is turned as a whole. A beam template whose axes lean by a few degrees keeps eight entries of the turned
    matrix and drops the small others, so there the map from the beam's entries to the template's is inverted.
    """
    Q = np.kron(np.eye(2), R)
    if effect.template_name == "symmetric":
        turned = np.einsum("ia,lij,jb->lab", Q, effect.basis, Q)
        return np.array([turned[:, i, j] for i, j in BEAM.entries])
    turned = np.einsum("ai,lij,bj->lab", Q, BEAM.basis, Q)
    return np.linalg.inv(np.array([turned[:, i, j] for i, j in effect.template.entries]))
