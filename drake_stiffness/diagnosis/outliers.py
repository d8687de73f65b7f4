"""Whole experiments, or single steps, that fit nothing: named and left out, never silently down-weighted.

An experiment that is left out gives up its residual and as many degrees of freedom as it has rows. Beside that, mistakes of few
unknowns are tried: a step in which all points moved alike, an experiment whose load has another size or that stood at other angles.
It is an outlier when that is far beyond what the noise of the others explains, carries a good part of the whole gap, and does more than the best effect
does: an effect that is missing shows in many experiments, an outlier in its own.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from drake_stiffness.campaign import Measurements
from drake_stiffness.diagnosis.naming import Remaining
from drake_stiffness.observation import predicted, whitened
from drake_stiffness.rotations import Array

# More than this share of the experiments cannot all be outliers: then the model is wrong, or the data are.
MOST = 0.2
_LEVEL = 0.0008  # over all experiments and steps: of the 1 % that all of diagnosis may err by
# An outlier carries at least this share of all that is beyond noise.
_SHARE = 0.25
_WRONG_ANGLE = 1e-4  # rad or m: linear


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
    unknowns : int
        What it gives up: rows, or the unknowns of a mistake.
    instead : tuple of str
        Suspects that explain as much over all experiments together: it may be no outlier.
    """

    name: str
    p_value: float
    excess: float
    rms_sigma: float
    noise: float
    unknowns: int
    instead: tuple[str, ...] = ()


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
    tests = 2 * (len(m.experiments) + m.cases.number)
    total = float(left.r @ left.r)
    beyond = total - left.dof * noise_ratio**2
    experiment, mistakes = m.cases.experiment[m.case], _mistakes(left)
    found: list[Outlier] = []
    for e, name in enumerate(m.experiments):
        own = np.flatnonzero(experiment == e)
        if not own.size:
            continue
        whole = _tests(left, rows[own].ravel(), str(name), total, mistakes[rows[own].ravel()])
        steps = []
        for c in np.unique(m.case[own]):
            here = rows[own[m.case[own] == c]].ravel()
            shift = np.tile(np.eye(3), (here.size // 3, 1))
            steps += _tests(left, here, f"{name}:{m.cases.step[c]}", total, shift)
        sure = [s for s in steps if s.p_value * tests < _LEVEL]
        most = max(whole, key=lambda w: w.excess, default=None)
        # One bad step is named as such when it alone makes most of what its experiment has too much, or more for its few unknowns.
        best = max(sure, key=_worth, default=None)
        if best is not None and (most is None or best.excess > 0.7 * most.excess or _worth(best) > _worth(most)):
            found.append(best)
        else:
            found += [w for w in whole if w.p_value * tests < _LEVEL]
    if not found:
        return None
    best = max(found, key=_worth)
    # Both in units of the stated noise: what the outlier has too much, and what is too much in all.
    enough = max(_SHARE * beyond, best_gain * left.per_dof)
    return best if best.excess * best.noise >= enough else None


def _worth(outlier: Outlier) -> float:
    """What a mistake of few unknowns explains counts for more than what many numbers of one's own do."""
    return outlier.excess - outlier.unknowns


def _mistakes(left: Remaining) -> Array:
    """What one number that was written down wrongly does to a whole experiment, (rows, p): a load's size, or a joint's angle."""
    o = left.scene.o
    if o.displacement:
        return predicted(o, left.scene.model)[:, None]
    return whitened(o, left.scene.joint_columns.transpose(2, 1, 0) * _WRONG_ANGLE)


def _tests(left: Remaining, own: NDArray[np.int_], name: str, total: float, special: Array) -> list[Outlier]:
    """Rows that are left out, and what a special mistake (rows, p) makes of them."""
    found = (_test(left, own, name, total, np.eye(own.size)), _test(left, own, name, total, special))
    return [f for f in found if f is not None]


def _test(left: Remaining, own: NDArray[np.int_], name: str, total: float, C: Array) -> Outlier | None:
    """What unknowns of its own, C (rows, p), for some rows would take off the squared residual, F-tested against the rest."""
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
    scale = np.linalg.norm(C, axis=0)
    C = C[:, scale > 0] / scale[scale > 0]
    values, vectors = np.linalg.eigh(C.T @ M @ C)
    keep = values > 1e-9
    part = (vectors[:, keep].T @ (C.T @ left.r[own])) ** 2 / values[keep]
    f, p = float(part.sum()), int(keep.sum())
    rest_dof = left.dof - p
    if not p or rest_dof <= 0:
        return None
    noise = max(total - f, 1e-300) / rest_dof
    p_value = float(fdtrc(p, rest_dof, f / p / noise))
    return Outlier(name, p_value, f / noise - p, float(np.sqrt(f / p)), noise, p)


def joined(outliers: Sequence[Outlier], other: Outlier) -> tuple[Outlier, ...]:
    """With one more; a whole experiment speaks for those of its steps that were named before."""
    return (*(x for x in outliers if not x.name.startswith(f"{other.name}:")), other)


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
