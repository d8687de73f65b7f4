"""Whole experiments, or single steps, that fit nothing: named and left out, never silently down-weighted.

An experiment that is left out gives up its residual and as many degrees of freedom as it has rows. It is an outlier when that is
far beyond what the noise of the others explains, carries a good part of the whole gap, and does more than the best effect
does: an effect that is missing shows in many experiments, an outlier in its own.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from drake_stiffness.campaign import Measurements
from drake_stiffness.diagnosis.naming import Remaining

# More than this share of the experiments cannot all be outliers: then the model is wrong, or the data are.
MOST = 0.2
_LEVEL = 0.001  # over all experiments and steps: a tenth of what all of diagnosis may err by
# An outlier carries at least this share of all that is beyond noise.
_SHARE = 0.25


@dataclass(frozen=True)
class Outlier:
    """What fits nothing.

    Attributes
    ----------
    name : str
        "E07", or "E07:4" for one of its steps.
    p_value : float
        Against the noise of the others, before the search over all experiments and steps is paid for.
    excess : float
        Squared residual beyond its degrees of freedom, in units of the others' noise.
    rms_sigma : float
        Its residual by coordinate, in sigma of the stated noise.
    noise : float
        Squared noise of the others, in units of the stated one.
    """

    name: str
    p_value: float
    excess: float
    rms_sigma: float
    noise: float


def find_outlier(left: Remaining, best_gain: float, noise_ratio: float) -> Outlier | None:
    """The worst outlier of a fit, or None.

    Parameters
    ----------
    best_gain : float
        What the best effect would gain, in units of the noise the data show.
    noise_ratio : float
        Noise that the readings show over the stated one (1 if nothing shows it).
    """
    m = left.scene.o.measurements
    rows = np.arange(3 * m.case.size).reshape(-1, 3)
    found: list[Outlier] = []
    tests = len(m.experiments) + m.cases.number
    total = float(left.r @ left.r)
    beyond = total - left.dof * noise_ratio**2
    experiment = m.cases.experiment[m.case]
    for e, name in enumerate(m.experiments):
        own = np.flatnonzero(experiment == e)
        whole = _test(left, rows[own].ravel(), name, total)
        if whole is None or whole.p_value * tests > _LEVEL:
            continue
        steps = [
            _test(left, rows[own[m.case[own] == c]].ravel(), f"{name}:{m.cases.step[c]}", total)
            for c in np.unique(m.case[own])
        ]
        worst = max((s for s in steps if s is not None), key=lambda s: s.excess, default=None)
        # One bad step is named as such when it alone makes most of what its experiment has too much.
        found.append(worst if worst is not None and worst.excess > 0.7 * whole.excess else whole)
    if not found:
        return None
    best = max(found, key=lambda f: f.excess)
    # Both in units of the stated noise: what the outlier has too much, and what is too much in all.
    enough = max(_SHARE * beyond, best_gain * left.per_dof)
    return best if best.excess * best.noise >= enough else None


def _test(left: Remaining, own: NDArray[np.int_], name: str, total: float) -> Outlier | None:
    """What leaving rows out would take off the squared residual, F-tested against the others."""
    from scipy.special import fdtrc

    o = left.scene.o
    M = np.eye(own.size) - left.Q[own] @ left.Q[own].T
    if o.whitening is not None:
        M -= o.whitening.reference_share(own)
    elif o.displacement:
        reading = own // 3
        group, count = o.group[reading], np.bincount(o.group)
        same = (group[:, None] == group) & ((own % 3)[:, None] == own % 3)
        M -= same / count[group][:, None]
    values, vectors = np.linalg.eigh(M)
    keep = values > 1e-9
    part = (vectors[:, keep].T @ left.r[own]) ** 2 / values[keep]
    f, p = float(part.sum()), int(keep.sum())
    rest_dof = left.dof - p
    if not p or rest_dof <= 0:
        return None
    noise = max(total - f, 1e-300) / rest_dof
    p_value = float(fdtrc(p, rest_dof, f / p / noise))
    return Outlier(name, p_value, f / noise - p, float(np.sqrt(f / p)), noise)


def without(m: Measurements, name: str) -> Measurements:
    """The measurements less an outlier."""
    experiment, _, step = name.rpartition(":") if name not in m.experiments else (name, "", "")
    e = m.experiments.index(experiment)
    gone = m.cases.experiment == e
    if step:
        gone &= m.cases.step == int(step)
    keep = ~gone[m.case]
    return replace(
        m,
        case=m.case[keep],
        row=m.row[keep],
        point=m.point[keep],
        position=None if m.position is None else m.position[keep],
        orientation=m.orientation[keep],
    )
