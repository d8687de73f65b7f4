"""Cutting laws: the force on a piece of edge from the thickness of the chip it cuts.

Every law here is a sum of powers of the chip thickness h, per unit of chip width db,

    (dF_t, dF_r, dF_a) = sum_j (k_t, k_r, k_a)_j h^p_j db

tangential (against the cutting speed), radial (into the tool, along the normal) and axial (along the edge's profile, away from the
spindle). Linear edge has p = 1 and 0, Kienzle p = 1 - m_c.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]

_MM = 1e-3


@dataclass(frozen=True)
class CuttingLaw:
    """Attributes
    ----------
    powers : J exponents p_j, from 0 to 1
    k : J triples (k_t, k_r, k_a), SI: N / m^(1 + p)
    relative_sigma : standard deviation of the force as a share of it; one common factor on all components
    """

    powers: tuple[float, ...]
    k: tuple[tuple[float, float, float], ...]
    relative_sigma: float = 0.0


def linear_edge(
    cutting: tuple[float, float, float], edge: tuple[float, float, float], relative_sigma: float = 0.0
) -> CuttingLaw:
    """dF = (K_c h + K_e) db (REFERENCE: mechanistic force, linear edge).

    Parameters
    ----------
    cutting : K_tc, K_rc, K_ac in N/mm^2
    edge : K_te, K_re, K_ae in N/mm
    """
    per_area = (cutting[0] / _MM**2, cutting[1] / _MM**2, cutting[2] / _MM**2)
    per_length = (edge[0] / _MM, edge[1] / _MM, edge[2] / _MM)
    return CuttingLaw((1.0, 0.0), (per_area, per_length), relative_sigma)


def kienzle(kc1_1: float, mc: float, radial: float, axial: float, relative_sigma: float = 0.0) -> CuttingLaw:
    """dF_t = k_c1.1 h0 (h/h0)^(1 - m_c) db with h0 = 1 mm; radial and axial force are shares of it.

    Parameters
    ----------
    kc1_1 : N/mm^2, the specific force of a chip of 1 mm x 1 mm
    mc : exponent, 0 <= mc < 1
    radial, axial : F_r / F_t and F_a / F_t
    """
    power = 1.0 - mc
    k = kc1_1 / _MM**2 * _MM**mc
    return CuttingLaw((power,), ((k, k * radial, k * axial),), relative_sigma)


def sine_integrals(power: float, start: Floats, end: Floats) -> tuple[Floats, Floats, Floats]:
    """Integrals of sin^p, sin^p cos and sin^(p+1) from `start` to `end`, both in [0, pi]."""
    if power == 0.0:
        return end - start, np.sin(end) - np.sin(start), np.cos(start) - np.cos(end)
    if power == 1.0:
        half = 0.5 * (end - start) - 0.25 * (np.sin(2 * end) - np.sin(2 * start))
        return np.cos(start) - np.cos(end), 0.5 * (np.sin(end) ** 2 - np.sin(start) ** 2), half
    s0, s1 = np.maximum(np.sin(start), 0.0), np.maximum(np.sin(end), 0.0)
    along = (s1 ** (power + 1) - s0 ** (power + 1)) / (power + 1)
    plain, more = (_sine_power(p, end) - _sine_power(p, start) for p in (power, power + 1))
    return plain, along, more


def _sine_power(power: float, angle: Floats) -> Floats:
    """Integral of sin^p from 0 to an angle in [0, pi]: half of the incomplete beta function of sin^2."""
    from scipy.special import beta, betainc

    a = 0.5 * (power + 1)
    half = 0.5 * beta(a, 0.5)
    first: Floats = half * betainc(a, 0.5, np.clip(np.sin(angle) ** 2, 0.0, 1.0))
    return np.where(angle <= np.pi / 2, first, 2 * half - first)
