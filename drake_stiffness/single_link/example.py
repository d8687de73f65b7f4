"""The single-link example of the source paper (3.2): six unit loads on a clamped link, 36 compliances, noise.

The link is clamped at one end; at the other a load of 10 N or 10 N m acts along one axis after the other, and all six components
of the deflection are read: dt_j = k W_j + noise. The 36 readings are linear in the 36 entries of k (seed eq. 9 with J = 1), so
estimate (12), covariance (14) and ratios (20) are closed forms; M1 and M2 (seed eqs. 21, 24) are linear maps in front of them.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from drake_stiffness.identifiability import numerical_rank
from drake_stiffness.rotations import Array
from drake_stiffness.single_link.prints import NONZERO, ROTATION_ROW, reconstruct
from drake_stiffness.springs import sparsing_map, symmetrisation_map
from drake_stiffness.thresholds import UPPER_RATIO

NoiseName = Literal["printed", "stated"]

# The text's limits of the load, N and N m, and its noise, m and rad.
LOAD = 10.0
_STATED_NOISE = (25e-6, 0.25e-3)
# "The ratio is high enough (more than 50)", says the paper of its nine entries.
PAPER_RATIO = 50.0

UNKNOWNS = ("36 unknowns", "M1", "M1 + M2")


@dataclass(frozen=True)
class Noise:
    """One standard deviation of one component of a reading.

    Attributes
    ----------
    name : str
        'printed': what the ratios (17), (18) and the estimate (25) need; 'stated': what the text says, ten times more.
    position_m, rotation_rad : float
    """

    name: NoiseName
    position_m: float
    rotation_rad: float

    def of_readings(self, loads: int) -> Array:
        """Standard deviations of all readings of so many loads, (6 loads,)."""
        return np.tile(np.where(ROTATION_ROW, self.rotation_rad, self.position_m), loads)


def noise_setting(name: NoiseName) -> Noise:
    """The noise of that name: 'printed' is worked back from the printed tables (`reconstruct`)."""
    if name == "stated":
        return Noise("stated", *_STATED_NOISE)
    position, rotation = LOAD * reconstruct().sigma
    return Noise("printed", float(position), float(rotation))


def unit_loads() -> Array:
    """The six loads, one a column: 10 N along or 10 N m about one axis each, (6, 6)."""
    return LOAD * np.eye(6)


def observation_matrix(wrench: Array) -> Array:
    """The matrix of seed eq. (9) for a single link read at its loaded end: dt = A pi with pi all 36 entries, row-major.

    Parameters
    ----------
    wrench : (6, N)

    Returns
    -------
    (6 N, 36)
    """
    return np.vstack([np.kron(np.eye(6), load) for load in wrench.T])


def reduction(unknowns: str) -> Array:
    """The map from the unknowns to all 36 entries (seed eq. 21): (36, 36), (36, 21) after M1, (36, 8) after M1 and M2."""
    M1 = symmetrisation_map()
    return {"36 unknowns": np.eye(36), "M1": M1, "M1 + M2": M1 @ sparsing_map("x")}[unknowns]


@dataclass(frozen=True, eq=False)
class LinearFit:
    """Weighted least squares of one set of unknowns.

    Attributes
    ----------
    M : (36, p)
        From the unknowns to all entries.
    gain : (p, m)
        From readings to the estimate: (A'^T Sigma^-2 A')^-1 A'^T Sigma^-2 of seed eq. (12), A' = A M.
    covariance : (p, p)
        Seed eq. (14).
    """

    M: Array
    gain: Array
    covariance: Array

    def matrices(self, readings: Array) -> Array:
        """Estimated compliance matrices of one or many sets of readings (..., m), (..., 6, 6)."""
        return (readings @ (self.M @ self.gain).T).reshape(*readings.shape[:-1], 6, 6)

    @property
    def sigma(self) -> Array:
        """Standard deviations of all 36 entries, (6, 6); 0 where the template has no entry."""
        return np.sqrt(np.einsum("ap,pq,aq->a", self.M, self.covariance, self.M)).reshape(6, 6)


def linear_fit(A: Array, sigma: Array, M: Array) -> LinearFit:
    """Estimate (12) and covariance (14) with weights 1 / sigma, after the reduction M.

    Parameters
    ----------
    A : (m, 36)
    sigma : (m,)
    M : (36, p)
    """
    Q, R = np.linalg.qr((A @ M) / sigma[:, None])
    back = np.linalg.inv(R)
    return LinearFit(M, (back @ Q.T) / sigma, back @ back.T)


@dataclass(frozen=True, eq=False)
class SingleLink:
    """The example under one noise.

    Attributes
    ----------
    noise : Noise
    truth : (6, 6)
        Matrix (15) as rebuilt from print, SI.
    A : (36, 36)
        Observation matrix (9) of the six loads.
    rank : int
    condition : float
        Of the matrix in plain SI numbers, which is what the paper prints.
    condition_weighted : float
        Of the matrix with the weights 1 / sigma that (12) and (14) use.
    fits : tuple of LinearFit
        With 36 unknowns, after M1, after M1 and M2.
    exact_ratio : (6, 6)
        |k_ij| / sigma_ij of the true values (18).
    """

    noise: Noise
    truth: Array
    A: Array
    rank: int
    condition: float
    condition_weighted: float
    fits: tuple[LinearFit, ...]
    exact_ratio: Array

    def readings(self, seed: int) -> Array:
        """The noisy deflections of one seed, (36,)."""
        scatter = np.random.default_rng(seed).normal(size=self.A.shape[0])
        return self.A @ self.truth.ravel() + self.noise.of_readings(6) * scatter

    def relative_sigma(self) -> Array:
        """Standard deviation over size of the ten nonzero entries for every set of unknowns, (3, 10)."""
        return np.array([fit.sigma[NONZERO] / np.abs(self.truth[NONZERO]) for fit in self.fits])

    @property
    def identifiable(self) -> NDArray[np.bool_]:
        """(6, 6) which entries have an exact ratio above the threshold 5 of G1+."""
        return self.exact_ratio > UPPER_RATIO


def single_link(noise: Noise) -> SingleLink:
    """Set up the example: everything that needs no random number."""
    truth, A = reconstruct().compliance, observation_matrix(unit_loads())
    sigma = noise.of_readings(6)
    singular = np.asarray(np.linalg.svd(A, compute_uv=False), dtype=float)
    weighted = np.linalg.svd(A / sigma[:, None], compute_uv=False)
    fits = tuple(linear_fit(A, sigma, reduction(unknowns)) for unknowns in UNKNOWNS)
    return SingleLink(
        noise=noise,
        truth=truth,
        A=A,
        rank=numerical_rank(singular, coarse=False)[0],
        condition=float(singular[0] / singular[-1]),
        condition_weighted=float(weighted[0] / weighted[-1]),
        fits=fits,
        exact_ratio=np.abs(truth) / fits[0].sigma,
    )


def is_definite(matrices: Array) -> NDArray[np.bool_]:
    """Whether x^T k x > 0 for every x, of matrices (..., 6, 6) that need not be symmetric."""
    half = (matrices + matrices.swapaxes(-1, -2)) / 2
    return np.asarray(np.linalg.eigvalsh(half)[..., 0] > 0)
