"""Names that stand: held against forms that the catalogue lacks, and against readings that took no part.

Of several suspects that fit nearly as well the one that leads may be the wrong one, and readings that took no part then say so. It goes,
and the search starts anew without it - on the fitted readings, as before: what is held out refutes, it never chooses. What
is found in its place has to make the held-out readings clearly more probable, not merely no less. Where a form that the catalogue lacks did
better than a name the search ends: another name would only stand in for it again.
"""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass, replace

from drake_stiffness.diagnosis.bench import Named
from drake_stiffness.diagnosis.confirmation import HeldOut, held_out
from drake_stiffness.diagnosis.doubts import (
    NO_CHANCE,
    doubtful_names,
    own_rest,
    stand_ins,
    standing,
    unrefuted,
    wrong_forms,
)
from drake_stiffness.diagnosis.generic import Process, fit_process
from drake_stiffness.diagnosis.search import Search, search, weighed
from drake_stiffness.observation import Observations

# So often at most the search starts anew without what was refuted.
_MOST_ROUNDS = 5


@dataclass(frozen=True, eq=False)
class Stands:
    """A search, less the names that do not stand.

    Attributes
    ----------
    search : Search
    withdrawn : dict of name to reason
    as_good : dict of name to the form outside the catalogue that does about as well
    lost : tuple of Named
        Names that did not stand and that nothing took the place of, but what chance brings once in a hundred campaigns.
    """

    search: Search
    withdrawn: dict[str, str]
    as_good: dict[str, str]
    lost: tuple[Named, ...]


def of_fitting_form(found: Search) -> Stands:
    """The names whose form is the one that is there, as far as the fitted readings can say."""
    passed = found.named
    doubted, as_good = stand_ins(found, found.bench.left(()))
    found, withdrawn = standing(found, doubted)
    found, more = standing(found, wrong_forms(own_rest(found), process_of(found)))
    withdrawn |= more
    return Stands(found, withdrawn, as_good, _among(passed, withdrawn))


def proven(first: Stands, before: HeldOut, o_held: Observations, noise_ratio: float) -> Stands:
    """The names that held-out readings bear out; where they refute one, the search starts anew without it.

    Parameters
    ----------
    first : Stands
        See `of_fitting_form`.
    before : HeldOut
        The held-out readings under the base model.
    """
    now, refuted = _borne_out(first, before, o_held, noise_ratio)
    passed, barred = first.search.named, dict(now.withdrawn)
    unexplained = tuple(n for n in _among(passed, refuted) if n.tested.p_value < NO_CHANCE * n.level)
    misfit = bool(first.withdrawn)
    for _ in range(_MOST_ROUNDS):
        if misfit or not refuted:
            break
        kept = names_of(now.search)
        again = of_fitting_form(weighed(search(now.search.bench.without(barred))))
        misfit = bool(again.withdrawn)
        now, refuted = _borne_out(again, before, o_held, noise_ratio, kept)
        barred |= now.withdrawn
        if names_of(now.search) - kept:
            unexplained = ()  # what was found in their place explains what the refuted ones did
    return replace(now, withdrawn=barred, lost=(*now.lost, *unexplained))


def _borne_out(
    s: Stands, before: HeldOut, o_held: Observations, noise_ratio: float, kept: set[str] | None = None
) -> tuple[Stands, dict[str, str]]:
    """The same less names that held-out readings refute or doubt; and the refuted ones, with the reason."""
    found, refuted = unrefuted(s.search, o_held, noise_ratio, kept)
    after = held_out(found.solution, o_held, noise_ratio)[0]
    found, doubtful = standing(found, doubtful_names(found, before, after, noise_ratio))
    lost = (*s.lost, *_among(s.search.named, doubtful))
    return Stands(found, s.withdrawn | doubtful | refuted, s.as_good, lost), refuted


def process_of(found: Search) -> Process:
    """Smooth functions of what the model leaves."""
    return fit_process(found.left, found.solution.identifiability.seen)


def names_of(found: Search) -> set[str]:
    """What is named, without what cannot be told from it."""
    return {n.tested.suspect.name for n in found.named}


def _among(named: Sequence[Named], names: Collection[str]) -> tuple[Named, ...]:
    return tuple(n for n in named if n.tested.suspect.name in names)
