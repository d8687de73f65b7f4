"""What a campaign cannot tell from a named effect: suspects that carry its signature, or that fit as well within noise."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from drake_stiffness.diagnosis.evidence import Tested
from drake_stiffness.rotations import Array

# Two suspects are one class when what is left of their signatures has a canonical correlation above this.
SAME_ABOVE = 0.95
# A suspect is kept in the class unless it is excluded: the truth once in a hundred, which is so many deviations of a normal variable.
_EXCLUDED, _EXCLUDED_AT = 0.01, 2.33
# A variant that explains this share of what the best one does could have been chosen by another draw of the noise.
_COULD_HAVE = 0.5
# But who is fifty times less likely than another of the class is not kept in it (twice the log).
_FAR_AHEAD = 7.8
# Who explains less than this share of what the chosen one does, its bounds respected, is not of its class, whatever its columns span.
_SOMETHING = 0.1


def confounded_with(
    chosen: Tested, others: Sequence[Tested], r: Array, per_dof: float, searched: Mapping[str, Sequence[Array]]
) -> list[Tested]:
    """Suspects that this campaign cannot tell from the chosen one.

    Those whose left-over columns carry the chosen signature with a correlation above `SAME_ABOVE`, and those that may be the truth
    all the same (`may_be`), none of the class far ahead of them (`beyond_noise`).

    Parameters
    ----------
    r : (rows,)
        What the model leaves.
    per_dof : float
        Its squares per degree of freedom.
    searched : dict of name to bases
        What the constants of a suspect were searched among, where that is more than the `bases` of its test.
    """
    size = max(float(np.linalg.norm(chosen.fit)), 1e-300)
    choices = _choices(chosen, r, searched)
    like, able = [], []
    for other in others:
        if other.suspect.name == chosen.suspect.name or other.explained < _SOMETHING * chosen.explained:
            continue
        if max(float(np.linalg.norm(Q.T @ chosen.fit)) / size for Q in other.bases) > SAME_ABOVE:
            like.append(other)
        elif may_be(other, chosen, per_dof, choices):
            able.append(other)
    worth = {t.suspect.name: beyond_noise(t, per_dof, _choices(t, r, searched)) for t in (chosen, *like, *able)}
    least = max(worth.values()) - _FAR_AHEAD
    kept = {t.suspect.name for t in (*like, *(t for t in able if worth[t.suspect.name] > least))}
    return [t for t in others if t.suspect.name in kept]


def _choices(t: Tested, r: Array, searched: Mapping[str, Sequence[Array]]) -> int:
    return choices_among(searched.get(t.suspect.name, t.bases), r)


def beyond_noise(t: Tested, per_dof: float, choices: int) -> float:
    """Squared sigma that a suspect explains less what noise alone would: one for a value, 2 log n for the best of n constants."""
    return t.explained / per_dof - t.basis.shape[1] - 2 * float(np.log(choices))


def choices_among(bases: Sequence[Array], r: Array) -> int:
    """How many a choice among variants is worth: those that explain half of what the best one does, neighbours counted once.

    Neighbours correlate above `SAME_ABOVE`. Variants that explain little could not have been chosen.

    Parameters
    ----------
    r : (rows,)
        What the model leaves.
    """
    explained = [float(((Q.T @ r) ** 2).sum()) for Q in bases]
    enough = _COULD_HAVE * max(explained, default=0.0)
    kept: list[Array] = []
    for Q, own in zip(bases, explained, strict=True):
        if own < enough or not Q.shape[1]:
            continue
        if not any(np.sum((P.T @ Q) ** 2) > SAME_ABOVE**2 * Q.shape[1] for P in kept):
            kept.append(Q)
    return max(len(kept), 1)


def may_be(other: Tested, chosen: Tested, per_dof: float, choices: int = 1) -> bool:
    """Whether one that explains less may be the truth all the same.

    Were it, with P its projector, P_c that of the chosen one and f what it truly does, the chosen one's lead in explained squares
    would have the mean -d^2 + p_c - p, with d^2 = |f - P_c f|^2, and two sources of spread: 2 d times a normal one, and that of
    chi-square with as many degrees of freedom as directions are not shared. Noise in its fit adds p - tr(P_c P) to d^2. The best of
    n choices leads by up to 2 log n more.
    """
    from scipy.special import chdtri

    Q, Q_c = other.basis, chosen.basis
    outside = other.fit - Q_c @ (Q_c.T @ other.fit)
    shared = float(np.sum((Q_c.T @ Q) ** 2))
    p, p_c = Q.shape[1], Q_c.shape[1]
    d2 = max(float(outside @ outside) / per_dof - (p - shared), 0.0)
    apart = max(p + p_c - 2 * shared, 1e-6)
    spread = np.hypot(2 * _EXCLUDED_AT * np.sqrt(d2), chdtri(apart, _EXCLUDED) - apart)
    return (chosen.explained - other.explained) / per_dof <= p_c - p - d2 + float(spread) + 2 * np.log(choices)
