"""Numbers as a program prints them: how much one printed digit is worth, and how to print another value alike."""

from __future__ import annotations

import re

import numpy as np
from numpy.typing import NDArray

# No digit can be shared between two parts, so that a long run of digits that is no number fails at once.
NUMBER = rb"[+-]?(?:\d+(?:\.\d*)?|\.\d+)(?:[eE][+-]?\d+)?"

# A REAL of a robot controller is a single-precision number. A larger exponent is a damaged program, and would overflow.
LARGEST_EXPONENT = 38
# More digits than this before the point (or after it) are damage as well, and would leave the range of a double.
LONGEST_NUMBER = 60
# Digits beyond these are not held by a double; decimals of a mantissa that hold all of a single-precision number.
_EXHAUSTED, _SINGLE_PRECISION = 17, 9

_NUMBER = re.compile(NUMBER)
_STYLE = re.compile(rb"([+-]?)(\d*)(\.?)(\d*)((?:[eE][+-]?\d+)?)")


def read_number(token: bytes) -> float | None:
    """Value of a literal number, or None where the token is none that a controller could hold."""
    if _NUMBER.fullmatch(token) is None or len(token) > LONGEST_NUMBER:
        return None
    exponent = token.upper().partition(b"E")[2]
    if exponent and abs(int(exponent)) > LARGEST_EXPONENT:
        return None
    return float(token)


def print_like(token: bytes, value: float) -> bytes:
    """Print a value in the style of an existing number token.

    Kept are the number of decimals, an explicit plus sign, zero padding, a missing zero before or missing digits after
    the point, and the exponent as written (so that the worth of a printed digit stays what it was; a power that is far too
    small for the value is replaced by its own). Zero is never
    printed with a minus sign. Blanks around the token are not ours: columns may shift by a character where a value gains
    a digit.

    Parameters
    ----------
    token
        The number as the program has it, for example ``b"-0.000"``, ``b"+07.5"``, ``b"1.20E-1"``.
    value
        The value to print, in the unit of the token.
    """
    match = _STYLE.fullmatch(token)
    if match is None:
        raise ValueError(f"not a number token: {token!r}")
    sign, whole, point, decimals, exponent = match.groups()
    if exponent:
        power = int(exponent[1:])
        scaled = value * 10.0**-power if power < 0 else value / 10.0**power
        if len(b"%.0f" % abs(scaled)) + len(decimals) > _EXHAUSTED:
            # A rest like 8.9E-31 becomes a number of another size: more digits than a number holds would say nothing.
            text = b"%.*e" % (max(len(decimals), _SINGLE_PRECISION), value)
            return text.upper() if exponent.isupper() else text
        value = scaled
    digits = b"%.*f" % (len(decimals), abs(value))
    head, _, tail = digits.partition(b".")
    if not whole and head == b"0":
        head = b""
    elif len(whole) > 1 and whole[:1] == b"0":
        head = head.zfill(len(whole))
    shown = b"" if value >= 0 or not digits.strip(b"0.") else b"-"
    return (shown or (b"+" if sign == b"+" else b"")) + head + point + tail + exponent


def print_all(
    raw: bytes, span: NDArray[np.int32], values: NDArray[np.float64], quantum: NDArray[np.float64]
) -> list[bytes]:
    """Print many values as `print_like` does; tokens of the usual style (``-12.345``) all at once.

    Parameters
    ----------
    span
        (M, 2) start and end of the number tokens.
    values, quantum
        (M,) in the unit of the token.
    """
    if not len(values):
        return []
    buffer = np.frombuffer(raw, dtype=np.uint8)
    start, end = span.T
    signed = (buffer[start] == ord("-")).astype(np.int32)
    first, second = buffer[start + signed], buffer[np.minimum(start + signed + 1, end - 1)]
    marks = np.flatnonzero((buffer == ord("E")) | (buffer == ord("e")))
    padded = (first == ord("0")) & _is_digit(second) & (end - start - signed > 1)
    usual = _is_digit(first) & ~padded & _is_digit(buffer[end - 1]) & ~_first_inside(marks, start, end)[1]
    decimals = np.rint(-np.log10(quantum)).astype(int)
    usual &= (decimals >= 0) & (decimals + np.log10(np.maximum(np.abs(values), 1.0)) < _EXHAUSTED)
    texts = np.empty(len(values), dtype=object)
    for places in np.unique(decimals[usual]).tolist():
        own = np.flatnonzero(usual & (decimals == places))
        shown = np.where(np.abs(values[own]) < 0.5 * 10.0**-places, 0.0, values[own])  # zero has no sign
        texts[own] = ((f"%.{places}f\n" * own.size) % tuple(shown.tolist())).encode().split(b"\n")[:-1]
    for other in np.flatnonzero(~usual).tolist():
        texts[other] = print_like(raw[start[other] : end[other]], float(values[other]))
    return list(texts)


def _is_digit(byte: NDArray[np.uint8]) -> NDArray[np.bool_]:
    return np.asarray((byte >= ord("0")) & (byte <= ord("9")))


def print_quanta(raw: bytes, span: NDArray[np.int32]) -> NDArray[np.float64]:
    """What one unit in the last printed digit of each number token is worth, in the unit of the token.

    Parameters
    ----------
    raw
        The bytes of the program.
    span
        (N, K, 2) start and end of number tokens; -1 where there is none.

    Returns
    -------
    (N, K) quanta, for example 0.001 for ``12.345``, 1 for ``500``, 0.01 for ``1.2E-1``; NaN where there is no token.
    """
    start, end = span[..., 0], span[..., 1]
    written = start >= 0
    buffer = np.frombuffer(raw, dtype=np.uint8)
    mantissa_end = end.copy()
    power = np.zeros(start.shape)
    mark, has_exponent = _first_inside(np.flatnonzero((buffer == ord("E")) | (buffer == ord("e"))), start, end)
    for index in zip(*np.nonzero(has_exponent), strict=True):
        power[index] = int(raw[mark[index] + 1 : end[index]])
        mantissa_end[index] = mark[index]
    dot, has_dot = _first_inside(np.flatnonzero(buffer == ord(".")), start, mantissa_end)
    decimals = np.where(has_dot, mantissa_end - dot - 1, 0)
    return np.where(written, 10.0 ** (power - decimals), np.nan)


def _first_inside(
    places: NDArray[np.intp], start: NDArray[np.int32], end: NDArray[np.int32]
) -> tuple[NDArray[np.int32], NDArray[np.bool_]]:
    """First of the sorted `places` at or after each start, and whether it lies before the end."""
    padded = np.append(places, np.iinfo(np.int32).max).astype(np.int32)
    first = padded[np.searchsorted(places, start)]
    return first, (start >= 0) & (first < end)
