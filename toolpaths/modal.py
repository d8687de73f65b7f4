"""Words that are not written: a pose keeps them from an earlier line, and with them that line's correction.

A *pair* (row, word, source) says: `row` does not write `word` and takes its value from what `source` writes. Correcting
the source moves the row too. Each row ends in one of two states only: it has the pose that was wanted for it, or exactly
the pose the program gave it. Where that needs a word which is not written, either the word is inserted or rows are
withdrawn from the correction until the promise holds.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]
Ints = NDArray[np.int32]
Bools = NDArray[np.bool_]


@dataclass
class Poses:
    """What is wanted, what the program had, what would be printed: rows by the words of a pose (X, Y, Z, A, B, C in KRL).

    All in the unit of the token (the unit the program prints in). Mutable: withdrawing a row changes it.
    """

    active: Bools  # (N,) rows that are corrected
    wanted: Floats  # (N, 3 + K)
    original: Floats  # (N, 3 + K)
    printed: Floats  # (N, 3 + K) what the row's own tokens will read; meaningless where the row writes none
    quantum: Floats  # (N, 3 + K) worth of one printed digit of the row's own tokens, NaN where it writes none

    @classmethod
    def of(cls, active: Bools, wanted: Floats, original: Floats, quantum: Floats) -> Poses:
        """Round what is wanted to the printed digits of each token."""
        with np.errstate(invalid="ignore"):  # NaN: words that no line gives (no token, no correction)
            moved = active[:, None] & (np.abs(wanted - original) > 0.5 * quantum)
            printed = np.where(moved, np.rint(wanted / quantum) * quantum, original)
        return cls(active.copy(), np.where(active[:, None], wanted, original), original, printed, quantum)

    def withdraw(self, row: int) -> None:
        """Leave a row as the program has it."""
        self.active[row] = False
        self.wanted[row] = self.original[row]
        self.printed[row] = self.original[row]


def half_digit(quantum: Floats, value: Floats | float) -> Floats:
    """Half a printed digit, with room for the rounding of binary numbers of that size."""
    return 0.5 * quantum * (1 + 1e-6) + 4 * np.finfo(float).eps * np.abs(value)


def carried_pairs(source: Ints, also: Ints) -> Ints:
    """All pairs (row, word, source) of a program, ordered by row; shape (P, 3).

    Parameters
    ----------
    source
        (N, 3 + K) row whose token gives the value: the row itself where it writes the word, -1 where nothing known does.
    also
        (M, 3) further readings (row, word, source) of words that two rows could give, as at the end of an arc.
    """
    row, word = np.nonzero((source >= 0) & (source != np.arange(len(source), dtype=np.int32)[:, None]))
    pairs = np.column_stack([row, word, source[row, word]]).astype(np.int32)
    pairs = np.concatenate([pairs, also]) if len(also) else pairs
    return pairs[np.argsort(pairs[:, 0], kind="stable")]


@dataclass(frozen=True)
class Withdrawal:
    """A row that cannot be corrected: words it lacks, or the row that would be moved along with it."""

    row: int
    missing: tuple[int, ...] = ()
    would_move: int = -1


def settle(poses: Poses, pairs: Ints, role: NDArray[np.str_]) -> list[Withdrawal]:
    """Withdraw rows from the correction until every row has its wanted or its original pose.

    A row that lacks a word it needs is withdrawn; the row it takes the word from is withdrawn as well where its correction
    would move a row that must stay. A row is withdrawn at most once, so the work is linear in the number of pairs.

    Parameters
    ----------
    poses
        Changed in place: withdrawn rows become inactive.
    pairs
        (P, 3) rows, words and sources, ordered by row.
    role
        (N,) "via" and "end" mark the two rows of an arc, which are corrected together or not at all.
    """
    row, word, source = pairs.T
    apart = _disagreements(poses, row, word, source)
    active = poses.active.tolist()
    rows, sources = row.tolist(), source.tolist()

    def disagree(pair: int) -> bool:
        return apart[active[rows[pair]], active[sources[pair]]][pair]

    unsettled = deque(pair for pair in range(len(pairs)) if disagree(pair))
    if not unsettled:
        return []
    by_source = np.argsort(source, kind="stable").tolist()
    count = np.arange(len(active) + 1)
    row_ends = np.searchsorted(row, count).tolist()
    source_ends = np.searchsorted(np.sort(source), count).tolist()

    withdrawn: list[Withdrawal] = []
    while unsettled:
        pair = unsettled.popleft()
        if not disagree(pair):
            continue
        loser = rows[pair]
        if active[loser]:
            own = range(row_ends[loser], row_ends[loser + 1])
            withdrawn.append(Withdrawal(loser, missing=tuple(sorted({int(word[p]) for p in own if disagree(p)}))))
        else:
            loser = sources[pair]
            withdrawn.append(Withdrawal(loser, would_move=rows[pair]))
        for lost in {"via": (loser, loser + 1), "end": (loser - 1, loser)}.get(str(role[loser]), (loser,)):
            active[lost] = False
            poses.withdraw(lost)
            unsettled.extend(range(row_ends[lost], row_ends[lost + 1]))
            unsettled.extend(by_source[source_ends[lost] : source_ends[lost + 1]])
    return withdrawn


def _disagreements(poses: Poses, row: Ints, word: Ints, source: Ints) -> dict[tuple[bool, bool], list[bool]]:
    """Per pair, whether the row gets another value than it must have; by whether row and source are corrected."""
    tolerance = half_digit(poses.quantum[source, word], poses.original[source, word])
    row_value = {True: poses.wanted[row, word], False: poses.original[row, word]}
    source_value = {True: poses.printed[source, word], False: poses.original[source, word]}
    return {
        (r, s): (np.abs(source_value[s] - row_value[r]) > tolerance).tolist()
        for r in (True, False)
        for s in (True, False)
    }


@dataclass(frozen=True)
class NewWord:
    """A word to insert: row, word, decimals and the value as it will read, in the unit of the token."""

    row: int
    word: int
    decimals: int
    value: float


def missing_words(poses: Poses, pairs: Ints, source: Ints, arc_end: Bools, finest: Floats) -> Iterator[NewWord]:
    """Words to insert so that every row has its wanted pose (if corrected) or its original one.

    Rows are taken in the order of the program: an inserted word is what the rows after it keep.

    Parameters
    ----------
    poses
        What is wanted and what written tokens will read.
    pairs
        (P, 3) rows, words and sources, ordered by row.
    source
        (N, 3 + K) main source of each word.
    arc_end
        (N,) rows that end an arc; the row before each is its auxiliary point.
    finest
        (3 + K,) new words are printed to this, or finer where their neighbours are; infinity: as their neighbours. Programs that
        leave out trailing zeros would swallow a correction.
    """
    kept: dict[tuple[int, int], float] = {}
    inserted: set[tuple[int, int]] = set()
    row_decimals = _decimals(poses.quantum)
    for row, word, giver in pairs.tolist():
        if (row, word) in inserted:
            continue
        have = kept.get((giver, word), float(poses.printed[giver, word]))
        want = float(poses.wanted[row, word])
        quantum = min(poses.quantum[giver, word], finest[word])
        # Whether an arc's end keeps a word of the auxiliary point or of the start is not for us to guess.
        doubtful = bool(arc_end[row]) and (row - 1, word) in inserted
        if not doubtful and abs(have - want) <= half_digit(quantum, want):
            continue
        decimals = int(_decimals(quantum))
        if poses.active[row]:
            decimals = max(_neighbour_decimals(row_decimals[row], word, decimals), _least(finest[word]))
        value = round(want, decimals) + 0.0  # no minus zero
        inserted.add((row, word))
        kept[(giver, word)] = kept[(int(source[row, word]), word)] = value
        yield NewWord(row, word, decimals, value)


def _decimals(quantum: Floats) -> Floats:
    """Decimals that show a quantum; NaN stays NaN."""
    return np.maximum(0, np.rint(-np.log10(quantum)))


def _least(finest: float) -> int:
    return 0 if np.isinf(finest) else int(_decimals(np.array(finest)))


def _neighbour_decimals(decimals: Floats, word: int, otherwise: int) -> int:
    """Decimals of the row's words of the same kind (positions or angles), else of any of its words."""
    kin = decimals[:3] if word < 3 else decimals[3:]
    for group in (kin, decimals):
        if not np.isnan(group).all():
            return int(np.nanmax(group))
    return otherwise
