"""The single-link example over many seeds: how often the estimate is not physical, and what M1, M2 and the cone bring."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from drake_stiffness.intervals.cone_program import ConeLeastSquares
from drake_stiffness.rotations import Array
from drake_stiffness.single_link.example import LOAD, PAPER_RATIO, UNKNOWNS, SingleLink, is_definite
from drake_stiffness.single_link.prints import NONZERO, names_of
from drake_stiffness.springs import Template, spring_template
from drake_stiffness.thresholds import LOWER_RATIO, UPPER_RATIO

CONES: tuple[tuple[str, Template], ...] = (
    ("M1, semidefinite", "symmetric"),
    ("M1 + M2, semidefinite", "beam"),
)
METHODS = (*UNKNOWNS, *(name for name, _ in CONES))
# An eigenvalue below this share of the largest of its matrix, in scaled units, is at the border of the cone.
_BORDER = 1e-6


@dataclass(frozen=True, eq=False)
class SingleLinkStudy:
    """What many seeds show.

    Attributes
    ----------
    link : SingleLink
    seed, seeds : int
        The first seed and how many.
    matrices : (methods, seeds, 6, 6)
        Every estimate, SI; methods as in `METHODS`.
    not_definite : (methods,)
        Share of estimates that are not positive definite. Under the semidefinite constraint those on its border: they have
        an eigenvalue of zero, so their stiffness, the inverse, does not exist.
    rms_relative_error : (methods, 10)
        Root mean square of (estimate - truth) / |truth| for the ten nonzero entries, row by row.
    k11_negative, k11_nothing : (methods,)
        Share of estimates with k11 below zero, and with k11 at zero (a thousandth of its true value or less in size).
    k11_mean : (methods,)
        Mean of k11 over its true value.
    zeros_above : (seeds,)
        How many of the 26 entries that are zero by design have a ratio above 2 with 36 unknowns.
    split_holds, paper_claim_holds : float
        Share of seeds in which exactly the paper's nine entries have a ratio above 5; in which those nine exceed 50.
    """

    link: SingleLink
    seed: int
    seeds: int
    matrices: Array
    not_definite: Array
    rms_relative_error: Array
    k11_negative: Array
    k11_nothing: Array
    k11_mean: Array
    zeros_above: Array
    split_holds: float
    paper_claim_holds: float

    def to_dict(self) -> dict[str, object]:
        """For `--json`."""
        names, link = names_of(NONZERO), self.link
        return {
            "noise": {
                "setting": link.noise.name,
                "position_sigma_mm": 1e3 * link.noise.position_m,
                "orientation_sigma_mrad": 1e3 * link.noise.rotation_rad,
            },
            "load": {"force_N": LOAD, "moment_Nm": LOAD},
            "seeds": self.seeds,
            "seed": self.seed,
            "compliance": link.truth,
            "rank": link.rank,
            "condition": link.condition,
            "condition_weighted": link.condition_weighted,
            "ratios_exact": link.exact_ratio,
            "ratios_first_seed": np.abs(self.matrices[0, 0]) / link.fits[0].sigma,
            "estimate_m1_m2_first_seed": self.matrices[2, 0],
            "entries": names,
            "identifiable": names_of(link.identifiable),
            "relative_sigma": dict(zip(UNKNOWNS, link.relative_sigma(), strict=True)),
            "methods": [
                {
                    "method": name,
                    "not_positive_definite": self.not_definite[i],
                    "k11_negative": self.k11_negative[i],
                    "k11_nothing": self.k11_nothing[i],
                    "k11_mean_over_truth": self.k11_mean[i],
                    "rms_relative_error": dict(zip(names, self.rms_relative_error[i], strict=True)),
                }
                for i, name in enumerate(METHODS)
            ],
            "zero_entries_above_2_mean": self.zeros_above.mean(),
            "split_holds": self.split_holds,
            "paper_claim_holds": self.paper_claim_holds,
        }


def study_single_link(link: SingleLink, seeds: int = 1000, seed: int = 0) -> SingleLinkStudy:
    """Repeat the example with the seeds `seed`, `seed + 1`, ...

    Parameters
    ----------
    link : SingleLink
    seeds : int
        How many, at least 1.
    seed : int
        The first.
    """
    readings = np.array([link.readings(seed + i) for i in range(seeds)])
    matrices = np.stack(
        [fit.matrices(readings) for fit in link.fits]
        + [semidefinite_fits(link, template, readings) for _, template in CONES]
    )
    truth = link.truth[NONZERO]
    error = (matrices[..., NONZERO] - truth) / np.abs(truth)
    k11 = matrices[..., 0, 0]
    nothing = 1e-3 * truth[0]
    linear = len(UNKNOWNS)
    outside = np.concatenate([~is_definite(matrices[:linear]), _at_border(link, matrices[linear:])])
    ratio = np.abs(matrices[0]) / link.fits[0].sigma
    nine = NONZERO & (np.arange(36).reshape(6, 6) > 0)  # all but k11
    return SingleLinkStudy(
        link=link,
        seed=seed,
        seeds=seeds,
        matrices=matrices,
        not_definite=outside.mean(axis=1),
        rms_relative_error=np.sqrt((error**2).mean(axis=1)),
        k11_negative=(k11 < -nothing).mean(axis=1),
        k11_nothing=(np.abs(k11) <= nothing).mean(axis=1),
        k11_mean=k11.mean(axis=1) / truth[0],
        zeros_above=(ratio[:, ~NONZERO] > LOWER_RATIO).sum(axis=1),
        split_holds=float(((ratio > UPPER_RATIO) == nine).all(axis=(1, 2)).mean()),
        paper_claim_holds=float((ratio[:, nine] > PAPER_RATIO).all(axis=1).mean()),
    )


def semidefinite_fits(link: SingleLink, template: Template, readings: Array) -> Array:
    """Weighted least squares over positive-semidefinite matrices of a template, one for every row of readings.

    minimise || (A M x - dt) / sigma ||^2 subject to k(x) >= 0.

    Parameters
    ----------
    readings : (seeds, 36)

    Returns
    -------
    (seeds, 6, 6)
    """
    shape = spring_template(template)
    unit = _units(link)
    scale = np.array([unit[i] * unit[j] for i, j in shape.entries])
    M = shape.basis.reshape(len(shape.entries), 36).T
    sigma = link.noise.of_readings(6)
    program = ConeLeastSquares((link.A @ M) * scale / sigma[:, None], shape.cone_blocks)
    return np.array([shape.matrix(scale * program.solve(row / sigma)) for row in readings])


def _units(link: SingleLink) -> Array:
    """Scales of the six components: an entry on the diagonal is counted in its size, or in its noise if that is larger.

    A congruence: it keeps definiteness and the solution, and gives the solver numbers of the size of one.
    """
    return np.sqrt(np.maximum(np.diag(link.truth), np.diag(link.fits[0].sigma)))


def _at_border(link: SingleLink, matrices: Array) -> np.ndarray:
    unit = _units(link)
    values = np.linalg.eigvalsh(matrices / np.outer(unit, unit))
    return np.asarray(values[..., 0] <= _BORDER * values[..., -1])
