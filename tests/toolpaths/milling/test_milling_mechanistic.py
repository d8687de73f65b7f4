"""Forces of teeth and their averages: the closed forms of the literature, quadrature over the turn, limits and mirror images."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.integrate import quad

from toolpaths.milling.cutters import Cutter
from toolpaths.milling.engagement import Engagement
from toolpaths.milling.laws import kienzle, linear_edge, sine_integrals
from toolpaths.milling.library import LIBRARY, RELATIVE_SIGMA
from toolpaths.milling.mechanistic import average_wrench, counterclockwise, wrench_over_turn

AL = linear_edge((767.01, 168.8, 222.0), (27.7, 26.6, 0.7))
KIENZLE = kienzle(700.0, 0.25, 0.35, 0.2)
CHIP = 1e-4


def cut(axial_mm, radial_mm, side) -> Engagement:
    return Engagement(np.array([axial_mm * 1e-3]), np.array([radial_mm * 1e-3]), np.array([side]))


def average(cutter, law, engagement, chip=CHIP) -> np.ndarray:
    return average_wrench(cutter, law, engagement, np.array([chip]))[:, 0]


def over_turn(cutter, law, engagement, chip=CHIP, number=480, slices=200) -> np.ndarray:
    """(6,) mean of the sum of all teeth over a pitch, after which everything repeats."""
    turn = np.linspace(0, 2 * np.pi / cutter.teeth, number, endpoint=False)
    return wrench_over_turn(cutter, law, engagement, chip, turn, slices).sum(axis=0).mean(axis=1)


def closed_form(N, a, c, entry, end, Kc, Ke) -> np.ndarray:
    """REFERENCE 3, in mm and N, z towards the tip as there."""

    def at(p):
        x = N * a * c / (8 * np.pi) * (Kc[0] * np.cos(2 * p) - Kc[1] * (2 * p - np.sin(2 * p)))
        x += N * a / (2 * np.pi) * (-Ke[0] * np.sin(p) + Ke[1] * np.cos(p))
        y = N * a * c / (8 * np.pi) * (Kc[0] * (2 * p - np.sin(2 * p)) + Kc[1] * np.cos(2 * p))
        y -= N * a / (2 * np.pi) * (Ke[0] * np.cos(p) + Ke[1] * np.sin(p))
        return np.array([x, y, N * a / (2 * np.pi) * (-Kc[2] * c * np.cos(p) + Ke[2] * p)])

    return at(end) - at(entry)


def test_the_check_vector_of_a_slot_in_aluminium():
    """z here points to the spindle, and the chip pulls a right-hand helix out of it: the axial force is towards the tip."""
    got = average(Cutter(0.010, 0.0, 4), AL, cut(3.0, 20.0, 0))
    np.testing.assert_allclose(got[:3] * [1, 1, -1], [-152.2, 335.9, 89.0], atol=0.06)


@pytest.mark.parametrize(("side", "radial"), [(0, 20.0), (1, 4.0), (-1, 4.0), (1, 13.0), (-1, 20.0)])
def test_averages_are_the_closed_forms_of_the_literature(side, radial):
    reach = np.arccos(1 - radial / 10.0)
    entry, end = {0: (0, np.pi), 1: (0, reach), -1: (np.pi - reach, np.pi)}[side]
    got = average(Cutter(0.010, 0.0, 3), AL, cut(2.5, radial, side))
    expected = closed_form(3, 2.5, 0.1, entry, end, (767.01, 168.8, 222.0), (27.7, 26.6, 0.7))
    np.testing.assert_allclose(got[:3] * [1, 1, -1], expected, rtol=1e-12, atol=1e-12)


@pytest.mark.parametrize("law", [AL, KIENZLE], ids=["linear edge", "Kienzle"])
@pytest.mark.parametrize("corner", [0.0, 0.003, 0.010], ids=["cylinder", "bull-nose", "ball"])
@pytest.mark.parametrize(("axial", "radial", "side"), [(3.0, 20.0, 0), (12.0, 7.0, 1), (1.0, 3.0, -1)])
def test_averages_agree_with_teeth_that_turn(law, corner, axial, radial, side):
    """Slices of a helical edge, tooth by tooth over a turn, against the integral in closed form; forces and moments."""
    cutter, engagement = Cutter(0.010, corner, 3, np.radians(30)), cut(axial, radial, side)
    got, slow = average(cutter, law, engagement), over_turn(cutter, law, engagement)
    np.testing.assert_allclose(got, slow, atol=4e-4 * np.abs(got[:3]).max())
    np.testing.assert_allclose(got[3:], slow[3:], atol=2e-3 * np.abs(got[3:]).max())


def test_a_bull_nose_without_nose_is_a_cylinder_and_with_a_full_one_a_ball():
    engagement = cut(4.0, 6.0, 1)
    cylinder = average(Cutter(0.010, 0.0, 4), AL, engagement)
    error = [np.abs(average(Cutter(0.010, rho, 4), AL, engagement) - cylinder).max() for rho in (1e-4, 1e-5, 1e-6)]
    assert error[0] > 5 * error[1] > 25 * error[2] > 0
    np.testing.assert_allclose(
        average(Cutter(0.010, 0.010 - 1e-9, 4), AL, engagement),
        average(Cutter(0.010, 0.010, 4), AL, engagement),
        rtol=1e-4,
    )


def test_a_ball_in_a_slot_by_elementary_integrals():
    """Edge forces off: F_y = N c K_tc / 4 times the area of the edge's profile; F_x = -N c / 4 int (K_r s + K_a c) s dA."""
    R, a, kappa = 0.01, 0.004, np.arccos(0.6)
    law = linear_edge((800.0, 300.0, 100.0), (0.0, 0.0, 0.0))
    got = average(Cutter(R, R, 2), law, cut(a * 1e3, 20.0, 0))
    share = 2 * CHIP / (2 * np.pi) * R  # teeth chip / 2 pi, db = R dkappa
    sin2 = 0.5 * kappa - 0.25 * np.sin(2 * kappa)
    np.testing.assert_allclose(got[1], share * np.pi / 2 * 800e6 * (1 - np.cos(kappa)), rtol=1e-9)
    along = 300e6 * sin2 + 100e6 * 0.5 * np.sin(kappa) ** 2
    np.testing.assert_allclose(got[0], -share * np.pi / 2 * along, rtol=1e-9)
    up = 300e6 * 0.5 * np.sin(kappa) ** 2 - 100e6 * sin2
    np.testing.assert_allclose(got[2], share * 2 * up, rtol=1e-9)
    np.testing.assert_allclose(got[5], share * 2 * 800e6 * R * sin2, rtol=1e-9)


def test_the_signs_are_those_of_a_shop():
    """Clockwise spindle: the tool is pushed back, to the left in a slot; climbing pushes it off the wall on its right."""
    slot, up, down = (average(Cutter(0.01, 0.0, 4), AL, cut(3, w, s)) for w, s in ((20, 0), (2, 1), (2, -1)))
    assert slot[0] < 0 < slot[1]
    assert down[1] > 0  # the wall is on the right
    assert up[0] < 0 < down[0]  # climbing pulls the tool along
    assert slot[5] > 0  # the cut resists the turn, which is about -z
    ball = average(Cutter(0.01, 0.01, 4), linear_edge((767, 169, 0), (27, 27, 0)), cut(0.5, 20, 0))
    assert ball[2] > 0  # a ball rides up


def test_a_cutter_that_turns_the_other_way_is_the_mirror_image():
    """Teeth placed and driven by hand, counterclockwise: h = c sin(phi), phi from -y."""
    cutter, law = Cutter(0.01, 0.0, 1), AL
    got = counterclockwise(average(cutter, law, cut(3.0, 20.0, 0))[:, None])[:, 0]
    phi = (np.arange(20000) + 0.5) * np.pi / 20000
    h = CHIP * np.sin(phi)
    ft, fr, fa = (3e-3 * (k[0] * h + k[1]) for k in zip(*law.k, strict=True))
    place = np.stack([np.sin(phi), -np.cos(phi)]) * 0.01
    outward, speed = place / 0.01, np.stack([np.cos(phi), np.sin(phi)])
    force = -ft * speed - fr * outward
    full = np.concatenate([force, -fa[None]])
    moment = np.cross(np.concatenate([place, 0 * phi[None] + 1.5e-3]).T, full.T).T
    np.testing.assert_allclose(got, np.concatenate([full, moment]).mean(axis=1) / 2, rtol=1e-6)


@pytest.mark.parametrize("power", [0.0, 0.62, 0.75, 1.0])
def test_integrals_of_powers_of_the_sine(power):
    for start, end in ((0.0, np.pi), (0.3, 1.2), (0.5, 2.9), (2.0, np.pi)):
        got = sine_integrals(power, np.array(start), np.array(end))
        for value, f in zip(
            got,
            (
                lambda x: np.sin(x) ** power,
                lambda x: np.sin(x) ** power * np.cos(x),
                lambda x: np.sin(x) ** (power + 1),
            ),
            strict=True,
        ):
            np.testing.assert_allclose(value, quad(f, start, end)[0], atol=1e-8)


def test_kienzle_s_force_of_a_chip_of_one_millimetre_is_kc1_1():
    law = kienzle(1700.0, 0.25, 0.4, 0.1)
    thin, thick = (law.k[0][0] * h ** law.powers[0] / h for h in (1e-4, 1e-3))
    assert thick * 1e-6 == pytest.approx(1700.0)
    assert thin / thick == pytest.approx(10**0.25)


def test_helix_smooths_the_force_and_leaves_its_mean():
    turn = np.linspace(0, 2 * np.pi, 360, endpoint=False)
    engagement = cut(10.0, 4.0, 1)
    straight, twisted = (
        wrench_over_turn(Cutter(0.01, 0.0, 2, np.radians(b)), AL, engagement, CHIP, turn).sum(axis=0) for b in (0, 45)
    )
    assert twisted[1].max() < 0.8 * straight[1].max()
    np.testing.assert_allclose(twisted.mean(axis=1)[:2], straight.mean(axis=1)[:2], atol=0.02 * 200)


def test_air_cuts_nothing():
    for corner in (0.0, 0.002, 0.01):
        assert not average(Cutter(0.01, corner, 4), AL, cut(0.0, 20.0, 0)).any()


def test_the_spread_that_is_assumed_is_that_of_published_sets():
    sets = [LIBRARY[name] for name in ("Al7075-T6", "Al7075-HSS", "Al7075")]
    force = [
        np.linalg.norm(average(Cutter(0.01, 0.0, 4), linear_edge(s.cutting, s.edge), cut(3, 20, 0))[:3]) for s in sets
    ]
    assert np.std(force, ddof=1) / np.mean(force) == pytest.approx(RELATIVE_SIGMA, abs=0.05)
