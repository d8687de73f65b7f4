r"""How much of the noise is the tracker's, and how much the arm's that does not come back exactly, from repeats.

Readings of one point that repeat posture and load differ by noise alone. With one free mean for every posture (or
experiment), load and point,

.. math:: y = X \beta + B u + e, \qquad u \sim N(0, \sigma_p^2 I), \quad e \sim N(0, \sigma^2 I)

where B holds what unit joint errors of every approach do to the readings (`posture_noise`), scaled so that
:math:`\sigma_p` is the standard deviation of a coordinate. Projecting off X leaves a singular value decomposition
:math:`A = U S V^T` of the projected B: independent coordinates :math:`z_j = U_j^T y` of variance
:math:`\sigma^2 + s_j^2 \sigma_p^2`, and a rest of n coordinates that only the tracker reaches. The restricted
likelihood (Patterson and Thompson 1971) of both variances,

.. math:: -2 \log L = n \log \sigma^2 + \frac{rest}{\sigma^2} + \sum_j \log(\sigma^2 + s_j^2 \sigma_p^2)
          + \frac{z_j^2}{\sigma^2 + s_j^2 \sigma_p^2},

is maximised, and its profile gives intervals (the rise that chi-square with one degree of freedom allows). Groups may
be of any size. What drifts between repeats, or does not come back for friction, counts as noise here.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from drake_stiffness.arm import Arm
from drake_stiffness.campaign import Measurements, Noise
from drake_stiffness.cell import Vector3
from drake_stiffness.hold_out import posture_groups
from drake_stiffness.posture_noise import Approach, lever, motions
from drake_stiffness.rotations import Array

CONFIDENCE = 0.95
# Singular values of the common motion, which is scaled to one, are rounding below this.
_ROUNDING = 1e-9
# With fewer coordinates of the tracker alone, its part cannot be told from the rest.
_FEWEST = 3
# Repeats that agree to this, m, were not read but computed.
_NOTHING_M = 1e-12
# The 95 % quantile of chi-square with one degree of freedom.
_CRITICAL = 3.841458820694124
# Logarithms of variances that are searched, in units of the mean square of all.
_RANGE = (-14.0, 14.0)


@dataclass(frozen=True)
class Component:
    """A standard deviation of one coordinate with its 95 % interval, mm, and the degrees of freedom behind it."""

    sigma_mm: float
    low_mm: float
    high_mm: float
    dof: int


@dataclass(frozen=True)
class NoiseComponents:
    """Where the noise comes from.

    Attributes
    ----------
    tracker : Component
    posture : Component or None
        The motion that all points of an approach share; None where nothing separates it from the tracker's noise.
    approach : 'per_experiment' or 'per_step'
        What was taken as one approach.
    repeats : int
        Readings beyond the first of their posture, load and point.
    """

    tracker: Component
    posture: Component | None
    approach: Approach
    repeats: int

    def to_dict(self) -> dict[str, Any]:
        """The entry of a fit."""
        p = self.posture
        return {
            "tracker_sigma_mm": self.tracker.sigma_mm,
            "tracker_low_mm": self.tracker.low_mm,
            "tracker_high_mm": self.tracker.high_mm,
            "posture_sigma_mm": None if p is None else p.sigma_mm,
            "posture_low_mm": None if p is None else p.low_mm,
            "posture_high_mm": None if p is None else p.high_mm,
            "posture_noise": self.approach,
            "repeats": self.repeats,
        }


def noise_line(entry: dict[str, Any], noise: Noise, displacement: bool) -> str:
    """The entry of a fit in one line for people, beside what the campaign states.

    Parameters
    ----------
    displacement : bool
        Whether displacements were fitted: then what an experiment's steps have in common is no matter.
    """
    low, high, posture = entry["tracker_low_mm"], entry["tracker_high_mm"], entry["posture_sigma_mm"]
    text = (
        f"Noise seen in {entry['repeats']} readings that repeat posture and load, of one coordinate: tracker "
        f"{entry['tracker_sigma_mm']:.3g} mm ({low:.2g} .. {high:.2g}; stated {noise.position_sigma_mm:.3g})"
    )
    if posture is None:
        return text + "; how exactly the arm comes back, these repeats do not show."
    low, high = entry["posture_low_mm"], entry["posture_high_mm"]
    per_step = entry["posture_noise"] == "per_step"
    how = "for every step" if per_step else "to a posture"
    text += f", arm that comes back {how} {posture:.2g} mm ({low:.2g} .. {high:.2g}"
    if noise.posture_sigma_mm is not None:
        return text + f"; stated {noise.posture_sigma_mm:.3g})."
    matters = low > 0.0 and (per_step or not displacement)
    hint = (
        f" Not stated: noise: {{posture_sigma_mm: {posture:.2g}, posture_noise: {entry['posture_noise']}}} counts it."
    )
    return text + ")." + (hint if matters else "")


def seen_noise(m: Measurements, arm: Arm, points: Mapping[str, Vector3], noise: Noise) -> dict[str, Any] | None:
    """The entry of a fit: what repeats show, by the campaign's own word on how the arm is driven if it says one."""
    stated = noise.posture_noise if noise.posture_sigma_mm is not None else None
    found = noise_components(m, arm, points, stated)
    return None if found is None else found.to_dict()


def noise_components(
    m: Measurements, arm: Arm, points: Mapping[str, Vector3], approach: Approach | None = None
) -> NoiseComponents | None:
    """Estimate both components, or None where nothing repeats, or repeats without any noise.

    Parameters
    ----------
    m : Measurements
        With readings; repeats are rows of one step (column `repeat`), steps of an experiment with one load, and
        experiments of one posture with one load.
    approach : 'per_experiment' or 'per_step', optional
        Whether the arm stands still between the steps of an experiment. Default: per_experiment where experiments
        share a posture and positions were read (displacements lose what an experiment has in common), else per_step.
    """
    if m.position is None:
        return None
    experiment = m.cases.experiment[m.case]
    group = posture_groups(m.cases)[experiment]
    shared = not m.relative and np.unique(group).size < np.unique(experiment).size
    if approach is None:
        approach = "per_experiment" if shared else "per_step"
    unit = group if shared else experiment
    cell = _cells(m, unit)
    kept = np.bincount(cell)[cell] > 1
    if not kept.any():
        return None
    repeats = int(kept.sum()) - np.unique(cell[kept]).size
    B = motions(arm, points, m)[:, :3] / lever(arm, points, m)
    block = experiment if approach == "per_experiment" else m.case
    z, s, rest, dof = [], [], 0.0, 0
    for u in np.unique(unit[kept]):
        own = np.flatnonzero(kept & (unit == u))
        parts = _split(m.position[own], B[own], cell[own], block[own])
        z.append(parts[0])
        s.append(parts[1])
        rest, dof = rest + parts[2], dof + parts[3]
    return _estimate(np.concatenate(z), np.concatenate(s), rest, dof, approach, repeats)


def _cells(m: Measurements, unit: NDArray[np.int_]) -> NDArray[np.int_]:
    """(M,) readings of one number repeat each other: same posture (or experiment), load and point."""
    _, point = np.unique(m.point, return_inverse=True)
    load = np.round(m.cases.wrench[:, m.case], 6).T
    keys = np.column_stack([unit, point.reshape(-1), load])
    return np.asarray(np.unique(keys, axis=0, return_inverse=True)[1]).reshape(-1)


def _split(p: Array, B: Array, cell: NDArray[np.int_], block: NDArray[np.int_]) -> tuple[Array, Array, float, int]:
    """One posture's readings: coordinates that common motion reaches, its size there, the rest's square sum and dof."""
    _, cell = np.unique(cell, return_inverse=True)
    _, block = np.unique(block, return_inverse=True)
    cell, block = cell.reshape(-1), block.reshape(-1)
    count, n = len(p), B.shape[2]
    Z = np.zeros((count, 3, int(block.max()) + 1, n))
    Z[np.arange(count), :, block] = B
    indicator = np.zeros((count, int(cell.max()) + 1))
    indicator[np.arange(count), cell] = 1.0
    # The same means are free in x, y and z: a basis of what is orthogonal to them, for every coordinate.
    basis = np.linalg.qr(indicator, mode="complete")[0][:, indicator.shape[1] :]
    y = (basis.T @ p).ravel()
    A = np.einsum("mk,mcbn->kcbn", basis, Z).reshape(y.size, -1)
    U, s, _ = np.linalg.svd(A, full_matrices=False)
    reached = s > _ROUNDING
    z = U[:, reached].T @ y
    return z, s[reached], max(float(y @ y - z @ z), 0.0), int(y.size - reached.sum())


def _estimate(z: Array, s: Array, rest: float, dof: int, approach: Approach, repeats: int) -> NoiseComponents | None:
    if dof < _FEWEST:  # nothing is the tracker's alone (one point, no repeat at rest): all of it stands together
        rest, dof, z, s = rest + float(z @ z), dof + z.size, z[:0], s[:0]
    # In units of the mean square of all, so that logarithms of variances are of order one.
    unit = (rest + float(z @ z)) / (dof + z.size)
    if unit < _NOTHING_M**2:
        return None
    alone, zz, ss = rest / unit, z**2 / unit, s**2

    def deviance(tracker: float, posture: float) -> float:
        """-2 log of the restricted likelihood of two variances."""
        v = tracker + ss * posture
        return alone / tracker + dof * float(np.log(tracker)) + float((np.log(v) + zz / v).sum())

    def best_tracker(posture: float) -> float:
        return _lowest(lambda a: deviance(float(np.exp(a)), posture))[1]

    def best_posture(tracker: float) -> float:
        if not z.size:
            return deviance(tracker, 0.0)
        return min(deviance(tracker, 0.0), _lowest(lambda b: deviance(tracker, float(np.exp(b))))[1])

    at, least = _lowest(lambda a: best_posture(float(np.exp(a))))
    low, high = _where(lambda a: best_posture(float(np.exp(a))) - least - _CRITICAL, at)
    tracker = _component([at, low, high], unit, dof)
    if not z.size:
        return NoiseComponents(tracker, None, approach, repeats)
    at, least = _lowest(lambda b: best_tracker(float(np.exp(b))))
    low, high = _where(lambda b: best_tracker(float(np.exp(b))) - least - _CRITICAL, at)
    if best_tracker(0.0) <= least + 1e-6:
        at = -np.inf
    if best_tracker(0.0) <= least + _CRITICAL:
        low = -np.inf
    return NoiseComponents(tracker, _component([at, low, high], unit, z.size), approach, repeats)


def _component(logs: list[float], unit: float, dof: int) -> Component:
    sigma, low, high = (1e3 * float(np.sqrt(unit * np.exp(value))) for value in logs)
    return Component(sigma, low, high, dof)


def _lowest(function: Callable[[float], float]) -> tuple[float, float]:
    """Where a function of the logarithm of a variance is least, and how low it is."""
    from scipy.optimize import minimize_scalar

    found = minimize_scalar(function, bounds=_RANGE, method="bounded", options={"xatol": 1e-6})
    return float(found.x), float(found.fun)


def _where(excess: Callable[[float], float], at: float) -> tuple[float, float]:
    """Logarithms on either side of the minimum where the deviance has risen far enough; infinite where it does not."""
    from scipy.optimize import brentq

    low = float(brentq(excess, _RANGE[0], at, xtol=1e-6)) if excess(_RANGE[0]) > 0 else -np.inf
    high = float(brentq(excess, at, _RANGE[1], xtol=1e-6)) if excess(_RANGE[1]) > 0 else np.inf
    return low, high
