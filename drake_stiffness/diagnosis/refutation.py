"""Refutation: names that readings which took no part speak against make room for others.

Of several suspects that fit nearly as well the one that leads may be the wrong one, and held-out readings then say so. It goes, and the search
starts anew without it - on the fitted readings, as before. What is found in its place is a second choice: that it is tried at all the
held-out readings brought about, so they have to speak for it, not merely not against it. Where a name was withdrawn because its form is not
the one that is there, no other is sought: it would only stand in for the same thing again.
"""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass, replace

from drake_stiffness.diagnosis.bench import Named
from drake_stiffness.diagnosis.confirmation import HeldOut, held_out
from drake_stiffness.diagnosis.doubts import doubtful_names, own_rest, stand_ins, standing, wrong_forms
from drake_stiffness.diagnosis.generic import Process, fit_process
from drake_stiffness.diagnosis.search import Search, names_of, search, weighed, what_may_be
from drake_stiffness.errors import UntrustworthyError
from drake_stiffness.observation import Observations

# Held-out readings that are less probable by this much (twice the log) with a name than without refute it. It is then taken for chance
# unless its p-value was below this share of what it had to be below.
_AGAINST, _NO_CHANCE = 6.0, 1e-3
# A second choice must make them ten times as probable (twice the log).
_SPEAKS_FOR = 4.6
# So often at most the search starts anew.
_MOST_SEARCHES = 5
# What other names leave more than the refuted ones did, as a share of what the strongest of those explained: below this they explain it.
_COVERED = 0.3


@dataclass(frozen=True, eq=False)
class Stands:
    """A search, less the names that do not stand.

    Attributes
    ----------
    search : Search
    process : Process
        Smooth functions of what its model leaves.
    withdrawn : dict of name to reason
    refuted : frozenset of str
        Those of them that held-out readings alone speak against.
    as_good : dict of name to the form outside the catalogue that does about as well
    lost : tuple of Named
        Names that did not stand and that nothing took the place of, but what chance brings once in a hundred campaigns.
    anew : bool
        Whether the search started anew.
    """

    search: Search
    process: Process
    withdrawn: dict[str, str]
    refuted: frozenset[str]
    as_good: dict[str, str]
    lost: tuple[Named, ...]
    anew: bool = False


@dataclass(frozen=True, eq=False)
class Against:
    """A name that held-out readings speak against, or as a second choice not for.

    Attributes
    ----------
    named : Named
    fall : float
        By how much twice the log of their density falls with it.
    """

    named: Named
    fall: float

    @property
    def name(self) -> str:
        return self.named.tested.suspect.name

    @property
    def refuted(self) -> bool:
        return self.fall > _AGAINST

    @property
    def why(self) -> str:
        if self.refuted:
            return f"readings that took no part are predicted worse with it (twice the log of their density falls by {self.fall:.1f})"
        return (
            "in place of a refuted name it would have to make readings that took no part ten times as probable (twice the log of their "
            f"density {'falls' if self.fall > 0 else 'rises'} by {abs(self.fall):.1f})"
        )


def of_fitting_form(found: Search) -> Stands:
    """The names whose form is the one that is there, as far as the fitted readings can say."""
    passed = found.named
    doubted, as_good = stand_ins(found, found.bench.left(()))
    found, withdrawn = standing(found, doubted)
    process = _process_of(found)
    found, more = standing(found, wrong_forms(own_rest(found), process))
    lost = _among(passed, withdrawn | more)
    return Stands(found, _process_of(found) if more else process, withdrawn | more, frozenset(), as_good, lost)


def borne_out(first: Stands, before: HeldOut, o_held: Observations, noise_ratio: float) -> Stands:
    """The names that held-out readings do not refute, found without those that they do.

    Parameters
    ----------
    first : Stands
        See `of_fitting_form`.
    before : HeldOut
        The held-out readings under the base model.
    """
    now, own, searches = first, names_of(first.search.named), 0
    gone: list[Against] = []
    while (worst := speaks_against(now.search, o_held, noise_ratio, own)) is not None:
        gone.append(worst)
        if now.withdrawn or searches == _MOST_SEARCHES:
            now = _without(now, {worst.name: worst.why})
            continue
        searches += 1
        now.search.bench.progress(f"searching without {worst.name}")
        bench = first.search.bench.without({a.name for a in gone if a.refuted})
        barred = frozenset(a.name for a in gone)
        now = of_fitting_form(weighed(search(bench, (), barred), (), barred))
    doubtful = doubtful_names(now.search, before, held_out(now.search.solution, o_held, noise_ratio)[0], noise_ratio)
    lost = (*now.lost, *_among(now.search.named, doubtful))
    now = _without(now, doubtful)
    possible = what_may_be(now.search.named)
    refuted = {a.name: a.why for a in gone if a.name not in possible}
    sure = tuple(a.named for a in gone if a.named.tested.p_value < _NO_CHANCE * a.named.level)
    if sure and not (searches and _covers(now.search, first.search, sure)):
        lost = (*lost, *sure)
    # All suspects against the base model are those of the first search.
    whole = replace(now.search, first=first.search.first, bench=first.search.bench)
    return replace(
        now,
        search=whole,
        withdrawn=now.withdrawn | refuted,
        refuted=frozenset(refuted),
        lost=lost,
        anew=searches > 0,
    )


def speaks_against(
    found: Search, o_held: Observations, noise_ratio: float, first_choices: Collection[str] | None = None
) -> Against | None:
    """The name that held-out readings speak against most, if they do: by how much their density falls beside the others.

    Of hundreds of suspects one may look good by chance, or stand for what only these postures show: then it makes unseen
    postures worse.

    Parameters
    ----------
    first_choices : names, optional
        All others are second choices and must make unseen postures better; by default there are none.
    """
    worst, most = None, 0.0
    own = held_out(found.solution, o_held, noise_ratio)[0].surprise
    for n in found.named:
        try:
            others = found.bench.fit([m.effect for m in found.named if m is not n])
        except UntrustworthyError:
            continue
        against = Against(n, own - held_out(others, o_held, noise_ratio)[0].surprise)
        first = first_choices is None or against.name in first_choices
        beyond = against.fall - (_AGAINST if first else -_SPEAKS_FOR)
        if beyond > most:
            worst, most = against, beyond
    return worst


def _without(s: Stands, withdrawn: dict[str, str]) -> Stands:
    """The same without further names."""
    if not withdrawn:
        return s
    found, more = standing(s.search, withdrawn)
    return replace(s, search=found, process=_process_of(found), withdrawn=s.withdrawn | more)


def _covers(now: Search, first: Search, gone: Sequence[Named]) -> bool:
    """Whether other names explain what those that are gone did."""
    more = float(now.left.r @ now.left.r) - float(first.left.r @ first.left.r)
    return more < _COVERED * max(n.tested.explained for n in gone)


def _process_of(found: Search) -> Process:
    return fit_process(found.left, found.solution.identifiability.seen)


def _among(named: Sequence[Named], names: Collection[str]) -> tuple[Named, ...]:
    return tuple(n for n in named if n.tested.suspect.name in names)
