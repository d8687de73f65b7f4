"""What an effect that was not named could at most be: the size that would have been found with 90 % power.

A suspect is found when its F exceeds the quantile at the level the search left it. With S' what is left of its columns beside the model
and lambda the noncentrality at which that happens nine times in ten, it had to be of a size with x^T S'^T S' x = lambda s^2, s^2 the noise the
data show. That is said as the displacement it makes, root mean square over the readings (references taken off, over all directions
of x alike), and for a single parameter as its value.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from drake_stiffness.diagnosis.naming import Remaining, Round
from drake_stiffness.diagnosis.suspects import Suspect
from drake_stiffness.effects import Effect
from drake_stiffness.identifiability import HIDDEN_BELOW
from drake_stiffness.rotations import Array

POWER = 0.9


@dataclass(frozen=True)
class Limit:
    """The least size of an effect that this campaign finds.

    Attributes
    ----------
    kind, where : str
    rms_um : float
        Displacement it makes, root mean square over the readings of its length.
    parameter, unit : str or None
        Its one parameter; None if it has more.
    value : float or None
    """

    kind: str
    where: str
    rms_um: float
    parameter: str | None
    value: float | None
    unit: str | None


def detection_limits(left: Remaining, last: Round, unnamed: list[Suspect]) -> list[Limit]:
    """Limits of all suspects that the last round tried and did not name, the best known ones first."""
    if last.level <= 0:
        return []
    best = {t.suspect.name: t.effect for t in (*last.passed, *last.failed)}
    found = [_limit(left, last.level, best.get(s.name, s.variants[0])) for s in unnamed if s.name not in last.faults]
    return sorted((limit for limit in found if limit is not None), key=lambda limit: limit.rms_um)


def noncentrality(p: int, dof: int, level: float) -> float:
    """The noncentrality at which an F-test of `p` and `dof` degrees of freedom at `level` finds nine in ten."""
    from scipy.special import fdtri, ncfdtrinc

    return float(ncfdtrinc(p, dof, 1 - POWER, fdtri(p, dof, 1 - level)))


def _limit(left: Remaining, level: float, effect: Effect) -> Limit | None:
    o = left.scene.o
    S = left.columns_of(effect)
    rest = left.beside(S)
    if not np.isfinite(rest).all():
        return None
    # Directions that the noise hides, or that the model's own parameters mimic, are not this effect's to show.
    _, s, Vt = np.linalg.svd(rest, full_matrices=False)
    keep = s > max(HIDDEN_BELOW, 1e-6 * float(s.max(initial=0.0)))
    p = int(keep.sum())
    if not p or left.dof <= p:
        return None
    size = noncentrality(p, left.dof - p, level) * left.per_dof
    moves: Array = S[: 3 * o.measurements.case.size] @ (Vt[keep].T / s[keep])
    rms = float(np.sqrt(size * (moves**2).sum() / p / o.measurements.case.size)) * o.sigma_p
    if len(effect.parameters) > 1:
        return Limit(effect.kind, effect.where, rms * 1e6, None, None, None)
    parameter = effect.parameters[0]
    value = float(np.sqrt(size)) / float(s[0]) * parameter.scale
    return Limit(effect.kind, effect.where, rms * 1e6, parameter.name, value, parameter.unit)
