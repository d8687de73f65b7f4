"""Many ordinary KRL lines at once: lines that differ from the one before them in the digits of their numbers alone.

A milling program is thousands of such lines in a row. Where the bytes between the numbers are the same and stand in the same
order, the number tokens are where they are in the first line, counted in runs of digits, and their values follow from the digits.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]
Bytes = NDArray[np.uint8]

# Digits of a number of which a double holds every one, and whose quotient by a power of ten is therefore the nearest double.
_DIGITS = 15
_LONGEST = 20
_NEWLINE, _POINT, _PLUS, _MINUS = b"\n.+-"
_IN_NUMBER = np.zeros(256, dtype=bool)
_IN_NUMBER[list(b"0123456789.+-")] = True


@dataclass(frozen=True, eq=False)
class Run:
    """L lines alike, after the first.

    Attributes
    ----------
    end
        The byte after the last of them.
    start
        (L,) where each begins.
    span
        (L, T, 2) byte spans of the T number tokens that may differ.
    value
        (L, T) their values.
    """

    end: int
    start: Ints
    span: Ints
    value: Floats

    def __len__(self) -> int:
        return len(self.start)


def alike(raw: bytes, at: int, end: int, tokens: list[tuple[int, int]], window: int) -> Run | None:
    """The lines after the one from `at` to `end` that are alike, within `window` bytes; None where the next one is not.

    Parameters
    ----------
    tokens
        Spans of the numbers in the first line that may differ from line to line. All other bytes must be the same.
    """
    stop = raw.rfind(b"\n", end, end + window) + 1
    if stop <= end:
        return None
    bytes_ = np.frombuffer(raw, dtype=np.uint8, count=stop - at, offset=at)
    inside = _IN_NUMBER[bytes_]
    edge = np.diff(inside, prepend=False, append=False)
    begins, ends = np.flatnonzero(edge).reshape(-1, 2).T
    lines = np.concatenate([[0], np.flatnonzero(bytes_ == _NEWLINE) + 1])
    first_run = np.searchsorted(begins, lines)
    outside = np.concatenate([[0], np.cumsum(~inside)])
    number, length = int(first_run[1] - first_run[0]), int(outside[lines[1]])
    same = (np.diff(first_run) == number) & (np.diff(outside[lines]) == length)
    L = _prefix(same)
    begins, ends = begins[: L * number].reshape(L, number), ends[: L * number].reshape(L, number)
    starts = lines[:L]
    frame = bytes_[: lines[L]][~inside[: lines[L]]].reshape(L, length)
    same = (frame == frame[0]).all(axis=1)
    places = outside[begins] - outside[starts][:, None]
    same &= (places == places[0]).all(axis=1)
    run_of = {int(b): n for n, b in enumerate(begins[0].tolist())}
    mine = [run_of.get(start - at, -1) for start, _ in tokens]
    if -1 in mine:
        return None
    for n in set(range(number)) - set(mine):
        same &= _equal(bytes_, begins[:, n], ends[:, n])
    value, good = _values(bytes_, begins[:, mine], ends[:, mine])
    L = _prefix(same & good)
    if L < 2:
        return None
    span = np.stack([begins[1:L, mine], ends[1:L, mine]], axis=2) + at
    return Run(int(lines[L]) + at, starts[1:L] + at, span, value[1:L])


def _prefix(same: NDArray[np.bool_]) -> int:
    """How many lead before the first that is false."""
    return len(same) if same.all() else int(same.argmin())


def _equal(bytes_: Bytes, begin: Ints, end: Ints) -> NDArray[np.bool_]:
    """Which runs of bytes are the first one."""
    first = bytes_[begin[0] : end[0]]
    same = end - begin == len(first)
    here = np.minimum(begin[:, None] + np.arange(len(first)), len(bytes_) - 1)
    return np.asarray(same & (bytes_[here] == first).all(axis=1))


def _values(bytes_: Bytes, begin: Ints, end: Ints) -> tuple[Floats, NDArray[np.bool_]]:
    """Values (L, T) of number tokens, and which lines hold plain numbers only: ``[+-]digits[.digits]`` of few digits."""
    longest = int((end - begin).max(initial=0))
    if longest > _LONGEST:
        return np.zeros(begin.shape), np.zeros(len(begin), dtype=bool)
    mantissa, digits, decimals = np.zeros(begin.shape), np.zeros(begin.shape, int), np.zeros(begin.shape, int)
    points = np.zeros(begin.shape, int)
    # ``X+1.0`` is a word and its value, ``X1.0`` is another word.
    first, before = bytes_[begin], bytes_[begin - 1]
    good = (before == ord(" ")) | (before == ord("\t")) | (first == _PLUS) | (first == _MINUS)
    for n in range(longest):
        here = begin + n
        valid = here < end
        byte = bytes_[np.minimum(here, len(bytes_) - 1)]
        digit = valid & (byte >= ord("0")) & (byte <= ord("9"))
        mantissa = np.where(digit, 10 * mantissa + (byte - 48.0), mantissa)
        digits += digit
        decimals += digit & (points > 0)
        points += valid & (byte == _POINT)
        if n:
            good &= ~(valid & ((byte == _PLUS) | (byte == _MINUS)))
    good &= (digits > 0) & (digits <= _DIGITS) & (digits - decimals <= 9) & (points <= 1)
    sign = np.where(bytes_[begin] == _MINUS, -1.0, 1.0)
    return sign * mantissa / 10.0**decimals, np.asarray(good.all(axis=1))
