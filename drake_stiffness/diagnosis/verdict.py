"""The verdict: does the model explain the data, with names or without (FORMATS: diagnosis.json)."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Literal

from drake_stiffness.diagnosis.confirmation import HeldOut
from drake_stiffness.diagnosis.naming import Remaining
from drake_stiffness.diagnosis.outliers import Outlier
from drake_stiffness.diagnosis.search import Search

Verdict = Literal["consistent", "explained", "partly_explained", "unexplained"]
_CONSISTENT = 0.001  # of the 1 % that all of diagnosis may err by: half for the fit, half for held-out readings
# The named effects explain the gap when they close this much of it, or what remains is noise; less is a part, little nothing.
_EXPLAINED, _PARTLY = 0.9, 0.1
# What a name's form misses of its truth explains less than this share of what the name does.
_MISSED = 0.3


def judge(
    found: Search, outliers: Sequence[Outlier], before: HeldOut, after: HeldOut, noise_ratio: float, yard: float
) -> Verdict:
    """The verdict (FORMATS: diagnosis.json); `yard` is the noise, over the stated one, that a gap can close to."""
    fits = min(p_of_fit(found.left, noise_ratio), after.p_value) > _CONSISTENT / 2
    if fits:
        return "explained" if found.named or outliers else "consistent"
    if not found.named:
        return "unexplained"
    closed = closed_share(before, after, yard)
    # Down to a noise that nothing but the fit itself shows is no explanation of all.
    if closed >= _EXPLAINED and yard == noise_ratio:
        return "explained"
    return "partly_explained" if closed >= _PARTLY else "unexplained"


def with_doubts(verdict: Verdict, found: Search, lost: float, unnamed: bool, sticking: bool) -> Verdict:
    """The same where something is there under a name that did not stand, or under none.

    Beside a far stronger name it may be what that one's form misses.

    Parameters
    ----------
    lost : float
        What the strongest name that did not stand had explained, squared sigma.
    unnamed : bool
        Whether a form that the catalogue lacks is there for sure.
    sticking : bool
        Whether a held-out experiment sticks out of what the others say.
    """
    if not found.named:
        return "unexplained" if lost or unnamed or sticking else verdict
    strongest = max(n.tested.explained for n in found.named)
    return "partly_explained" if sticking or lost > _MISSED * strongest else verdict


def p_of_fit(left: Remaining, noise_ratio: float) -> float:
    """Probability that noise leaves as much as a fit does."""
    from scipy.special import chdtrc

    return float(chdtrc(left.dof, float(left.r @ left.r) / noise_ratio**2))


def closed_share(before: HeldOut, after: HeldOut, noise_ratio: float) -> float:
    """Share of what is beyond noise on held-out readings that the named effects take away."""
    beyond = before.chi2 - before.dof * noise_ratio**2
    return (before.chi2 - after.chi2) / beyond if beyond > 0 else 0.0
