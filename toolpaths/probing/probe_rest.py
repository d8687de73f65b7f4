"""What named causes leave of a probe's deviations: how much of it is noise, and what neighbours share."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from toolpaths.probing.probe import Probe

Floats = NDArray[np.float64]
Ints = NDArray[np.int_]

# Noise of a probe where it is not stated and cannot be seen.
_NOISE_MM, _LEAST_MM = 0.01, 1e-4
# Correlation of neighbours that makes a rest correctable.
_SHARED = 0.3
# The width around a single place; readings and points of the path that are worked on at once.
_ALONE_MM, _READINGS, _CHUNK = 20.0, 1500, 512


def fit(A: Floats, y: Floats, noise: Floats, prior: Floats) -> tuple[Floats, Floats]:
    """Least squares with priors around zero: values and covariance.

    Parameters
    ----------
    A, y, noise, prior : (K, n), (K,), (K,), (n,)
    """
    information = (A / noise[:, None] ** 2).T @ A + np.diag(prior**-2.0)
    C: Floats = np.asarray(np.linalg.inv(information), dtype=float)
    return C @ ((A / noise[:, None] ** 2).T @ y), C


def nearest_other(seen_at: Floats) -> Ints:
    """(M,) the place nearest to each, in space: the next pass may be nearer than the next point of the path."""
    from scipy.spatial import cKDTree

    if seen_at.shape[0] < 2:
        return np.zeros(seen_at.shape[0], dtype=int)
    near = cKDTree(seen_at).query(seen_at, k=2)[1]
    own = np.arange(seen_at.shape[0])
    return np.asarray(np.where(near[:, 0] == own, near[:, 1], near[:, 0]))


def noise_of(probe: Probe, place: Ints, y: Floats, beside: Ints, A: Floats, prior: Floats) -> Floats:
    """(K,) as stated; else what neighbours differ by after a first fit."""
    stated = probe.sigma_mm[place]
    if np.isfinite(stated).all():
        return stated
    x, _ = fit(A, y, np.full(y.size, _NOISE_MM), prior)
    steps = _neighbour_pairs(place, y - A @ x, beside, probe)
    seen = float(np.sqrt((steps**2).mean() / 2)) if steps.size >= 6 else _NOISE_MM
    return np.where(np.isfinite(stated), stated, max(seen, _LEAST_MM))


def _neighbour_pairs(place: Ints, left: Floats, beside: Ints, probe: Probe) -> Floats:
    """Differences of like readings of every place and the one beside it."""
    single = int(probe.along_normal.sum())
    by_place = np.zeros((probe.size, 3))
    by_place[place[:single], 0] = left[:single]
    by_place[place[single::3]] = left[single:].reshape(-1, 3)
    a, b = np.arange(beside.size), beside
    alike = probe.along_normal[a] == probe.along_normal[b]
    both = alike & probe.along_normal[a]
    alike &= ~both | ((probe.normal[a] * probe.normal[b]).sum(axis=1) > 0.9)
    step = (by_place[b] - by_place[a])[alike]
    return np.concatenate([step[both[alike], 0], step[~both[alike]].reshape(-1)])


def neighbours_agree(place: Ints, left: Floats, beside: Ints, probe: Probe) -> bool:
    """Whether the rest is alike at places beside each other (von Neumann's ratio)."""
    steps = _neighbour_pairs(place, left, beside, probe)
    power = float((left**2).mean())
    return bool(steps.size >= 3 and power > 0 and 1 - float((steps**2).mean()) / (2 * power) > _SHARED)


def near_rest(
    seen_at: Floats,
    beside: Ints,
    place: Ints,
    direction: Floats,
    left: Floats,
    noise: Floats,
    target: Floats,
    power: float,
) -> tuple[NDArray[np.bool_], Floats, Floats]:
    """The rest near the places it was seen at: the conditional mean of a Gaussian process with the covariance

        power exp(-distance^2 / 2 width^2) n_i . n_j + noise^2    of readings along n_i and n_j,

    which meets what was measured to its noise and goes to nothing away from it. The width is the spacing of the places.

    Parameters
    ----------
    seen_at, beside : (M, 3), (M,)
        Points of the path where the places were cut, mm, and the place beside each (`nearest_other`).
    place, direction, left, noise : (K,), (K, 3), (K,), (K,)
        Readings: their place, direction, what named causes leave and its noise, mm.
    target : (N, 3)
        Points of the path.
    power : float
        Variance of a coordinate of the rest, mm^2; zero: nothing is corrected.

    Returns
    -------
    near : (N,) bool
        Whether a place is within a width.
    rest : (N, 3), mm
    variance : (N,)
        Of a coordinate of it, mm^2.
    """
    from scipy.linalg import cho_factor, cho_solve
    from scipy.spatial import cKDTree

    gaps = np.linalg.norm(seen_at[beside] - seen_at, axis=1)
    width = max(float(np.median(gaps)), 1.0) if gaps.any() else _ALONE_MM
    near = np.asarray(cKDTree(seen_at).query(target)[0] <= width)
    rest, variance = np.zeros_like(target), np.full(target.shape[0], power)
    if power <= 0.0:
        return near, rest, variance
    # A survey of thousands of places is thinned here: the rest is smooth between them.
    some = np.unique(np.linspace(0, place.size - 1, min(place.size, _READINGS)).astype(int))
    at, n = seen_at[place[some]], direction[some]

    def alike(a: Floats, b: Floats) -> Floats:
        square = ((a[:, None] - b[None]) ** 2).sum(axis=2)
        return np.asarray(power * np.exp(-0.5 * square / width**2))

    factor = cho_factor(alike(at, at) * (n @ n.T) + np.diag(noise[some] ** 2))
    weights = cho_solve(factor, left[some])
    for start in range(0, target.shape[0], _CHUNK):
        own = slice(start, start + _CHUNK)
        across = alike(target[own], at)
        rest[own] = (across * weights) @ n
        for c in range(3):
            column = (across * n[:, c]).T
            variance[own] -= (column * cho_solve(factor, column)).sum(axis=0) / 3
    return near, rest, np.maximum(variance, 0.0)
