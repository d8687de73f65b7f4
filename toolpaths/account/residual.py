"""The predicted residual of every point with an interval: how far the real tool may be from where it is wanted.

With the numbers as printed the model leaves the residual m (the printed digits are in it exactly). Around it the real residual
is r = m + c + e, e ~ N(0, C), with

- C_p = a C_x a^T, the covariance of the identified parameters carried to this posture and force, and c least squares less the
  model where a constraint is active (see `drake_stiffness.support`);
- C_F = s_F^2 d d^T, d the deflection by the process force and s_F the stated relative uncertainty of that force;
- C_m = s_m^2 |D|^2 / 3 in every direction, D the whole predicted deflection and s_m the relative error of the model's form that
  held-out readings show (`drake_stiffness.model_form`);
- C_j = p (1 - p) j j^T for every joint with backlash, j the jump of the tool and p the probability that the torque, uncertain as
  the force is, has the other sign.

The length |r| is the root of a weighted sum of non-central chi-squares. For the upper end its square is taken as a shifted, scaled
chi-square with the same first three cumulants (Imhof 1961), whose quantile comes from Wilson and Hilferty. For the lower end
|r| >= u . r with u along m, which is Gaussian: the end |m| - 1.96 sigma_u is never too high. Where that end is zero no length
lies below it, and all 5 % may lie above the upper end; elsewhere 2.5 %. With c the interval is the hull of those around m and around m + c. It speaks of one point: errors of parameters and force are nearly the same at all points of a program,
so the mean over a program is no surer than a single point.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from drake_stiffness.effects.effect import Cases
from drake_stiffness.model import Model
from drake_stiffness.model_form import stated
from drake_stiffness.support import Z95, displacement_support, position_support
from toolpaths.compensation import CHUNK

Floats = NDArray[np.float64]

LEVEL = 0.95
# A Gaussian exceeds so many standard deviations in 5 % of all cases.
_Z_ONE_SIDED = 1.6448536269514722
# What no model and no process.yaml says.
NOT_INCLUDED = ("repeatability of the robot", "setting of the workpiece", "temperature", "wear of the tool", "chatter")


@dataclass(frozen=True, eq=False)
class Interval:
    """Attributes
    ----------
    low_mm, high_mm : (N,)
        Ends of the 95 % interval of the residual's length.
    residual_mm : (N, 3)
        Predicted residual as printed, world axes.
    parameters_mm, force_mm, form_mm, jump_mm : (N,)
        Standard deviations, the root of the trace of each part of the covariance; zero where a part is not known.
    unsupported : (N,)
        Share of the prediction that the campaign does not support.
    carries, lacks : tuple of str
        What is in the interval, and what is not.
    """

    low_mm: Floats
    high_mm: Floats
    residual_mm: Floats
    parameters_mm: Floats
    force_mm: Floats
    form_mm: Floats
    jump_mm: Floats
    unsupported: Floats
    carries: tuple[str, ...]
    lacks: tuple[str, ...]


def residual_interval(
    model: Model,
    q: Floats,
    wrench: Floats,
    residual: Floats,
    deflection: Floats,
    by_force: Floats,
    relative_sigma: Floats | float,
    jump: Floats,
    measured_sigma: Floats | None = None,
    sag: bool = False,
) -> Interval:
    """Intervals of N points.

    Parameters
    ----------
    q, wrench : (n, N), (6, N)
    residual, deflection, by_force : (3, N)
        As printed; uncorrected; the part of the latter that the process force makes. m, world axes.
    relative_sigma : scalar or (N,)
        Standard deviation of the process force over its size; zero where not stated.
    jump : (3, J, N)
        Jumps of the tool, each times the root of p (1 - p), m.
    measured_sigma : (N,), optional
        Where a probe has seen the deviation: standard deviation of a coordinate of what is left of it, m, which stands for the model's
        covariances there; NaN elsewhere.
    sag : bool
        Whether sag under weight is corrected too (`reference: rigid`), so that its error counts.
    """
    N = q.shape[1]
    s_F = np.broadcast_to(np.asarray(relative_sigma, dtype=float), (N,))
    form = stated(model.fit)
    C_p, centre, unsupported = _support(model, q, wrench, sag)
    known: NDArray[np.bool_] = np.asarray(np.isfinite(C_p).all(axis=(1, 2)))
    C = np.where(known[:, None, None], C_p, 0.0)
    parameters = np.sqrt(np.einsum("nii->n", C))
    d = by_force.T * s_F[:, None]
    C += d[:, :, None] * d[:, None, :]
    size = np.sqrt((deflection**2).sum(axis=0)) * (form if np.isfinite(form) else 0.0)
    C += (size**2 / 3)[:, None, None] * np.eye(3)
    C += np.einsum("ijn,kjn->nik", jump, jump)
    if measured_sigma is not None:
        seen = np.isfinite(measured_sigma)
        C[seen] = (measured_sigma[seen] ** 2)[:, None, None] * np.eye(3)
        centre[seen] = 0.0
    low, high = length_interval(residual.T, C)
    moved = np.abs(np.nan_to_num(centre)).max(axis=1, initial=0.0) > 0
    if moved.any():
        low_c, high_c = length_interval(residual.T[moved] + centre[moved], C[moved])
        low[moved], high[moved] = np.minimum(low[moved], low_c), np.maximum(high[moved], high_c)
    carries: list[str] = ["printed digits"]
    lacks: list[str] = []
    (carries if known.all() and model.x.size else lacks).append("covariance of the parameters")
    (carries if s_F.any() else lacks).append("uncertainty of the process force")
    (carries if np.isfinite(form) else lacks).append(_form_in_words(model, form))
    if measured_sigma is not None and np.isfinite(measured_sigma).any():
        carries.append("what the probe leaves open, in place of the rest where it has measured")
    if jump.any():
        carries.append("jumps of backlash where the torque may have the other sign")
    return Interval(
        low_mm=low * 1e3,
        high_mm=high * 1e3,
        residual_mm=residual.T * 1e3,
        parameters_mm=np.where(known, parameters, np.nan) * 1e3,
        force_mm=np.sqrt((d**2).sum(axis=1)) * 1e3,
        form_mm=size * 1e3,
        jump_mm=np.sqrt((jump**2).sum(axis=(0, 1))) * 1e3,
        unsupported=unsupported,
        carries=tuple(carries),
        lacks=(*lacks, *NOT_INCLUDED),
    )


def _form_in_words(model: Model, form: float) -> str:
    """The error of the model's form, and how large one may hide where none shows."""
    said = "error of the model's form, from its held-out readings"
    hidden = (model.fit.get("model_form") or {}).get("detectable")
    if form == 0 and hidden:
        return f"{said} (they show no such error; one of up to {100 * hidden:.2g} % of the deflection could hide in their noise)"
    return said


def _support(model: Model, q: Floats, wrench: Floats, sag: bool) -> tuple[Floats, Floats, Floats]:
    """Covariance (M, 3, 3), m^2, least squares less the model (M, 3), m, and unsupported share (M,) of the tool's deflection."""
    name, M = "(tool centre point)", q.shape[1]
    if not M:
        return np.zeros((0, 3, 3)), np.zeros((0, 3)), np.zeros(0)
    with_tcp = replace(model, points={**model.points, name: model.tcp[1]})
    cases = Cases(q, wrench, model.tcp[1], np.zeros(M, dtype=int), np.arange(M), np.full(M, np.nan))
    found = displacement_support(with_tcp, cases, np.arange(M), np.full(M, name))
    if not sag:
        return found.covariance, found.centre, found.unsupported
    chunks = [slice(a, a + CHUNK) for a in range(0, M, CHUNK)]
    whole = [position_support(with_tcp, cases, np.arange(M)[own], np.full(M, name)[own]) for own in chunks]
    covariance, centre = (np.concatenate([getattr(part, key) for part in whole]) for key in ("covariance", "centre"))
    return covariance, centre, found.unsupported


def length_interval(m: Floats, C: Floats) -> tuple[Floats, Floats]:
    """Ends (N,) of a 95 % interval of |m + e|, e ~ N(0, C): at most 2.5 % lies beyond each, or 5 % above where the lower one is zero.

    Parameters
    ----------
    m, C : (N, 3), (N, 3, 3)
    """
    C2 = C @ C
    Cm = np.einsum("nij,nj->ni", C, m)
    square, mCm = (m * m).sum(axis=1), (m * Cm).sum(axis=1)
    length = np.sqrt(square)
    along = np.sqrt(np.maximum(mCm, 0.0)) / np.where(length > 0, length, 1.0)
    low = np.maximum(length - Z95 * along, 0.0)
    z = np.where(low > 0, Z95, _Z_ONE_SIDED)
    # Cumulants of |r|^2, up to factors: c_j = tr C^j + j m^T C^(j-1) m.
    c1 = np.einsum("nii->n", C) + square
    c2 = np.einsum("nij,nij->n", C, C) + 2 * mCm
    c3 = np.einsum("nij,nij->n", C2, C) + 3 * (Cm * Cm).sum(axis=1)
    sure = ~(c2 > 1e-24 * c1**2)
    safe2, safe3 = np.where(sure, 1.0, c2), np.where(sure, 1.0, c3)
    h = safe2**3 / safe3**2
    chi2 = h * np.maximum(1 - 2 / (9 * h) + z * np.sqrt(2 / (9 * h)), 0.0) ** 3
    high = np.where(sure, c1, c1 + (chi2 - h) * np.sqrt(safe2 / h))
    return low, np.sqrt(np.maximum(high, 0.0))
