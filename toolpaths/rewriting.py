"""The same program with other numbers: replaces number tokens of pose words, and not one other byte.

The output is the original, copied piece by piece between the tokens that change; with nothing to change it is the very
same object. Whether words a pose does not write can follow is settled in ``toolpaths.modal``.
"""

from __future__ import annotations

import heapq
import re
from collections.abc import Iterator
from dataclasses import dataclass
from itertools import groupby, pairwise

import numpy as np
from numpy.typing import NDArray

from toolpaths.modal import NewWord, Poses, Withdrawal, carried_pairs, missing_words, settle
from toolpaths.printed import print_like
from toolpaths.program import WORDS, Program, Refusal

Floats = NDArray[np.float64]
Bools = NDArray[np.bool_]

_SEPARATOR = re.compile(rb"([ \t]*,[ \t]*)[A-Za-z]([ \t]*)")


@dataclass(frozen=True)
class Insertion:
    """Words added to a pose: 1-based line, their names, and the text as inserted."""

    line: int
    words: tuple[str, ...]
    text: str


@dataclass(frozen=True, eq=False)
class Rewritten:
    """A rewritten program.

    Attributes
    ----------
    raw
        The bytes to write.
    changed
        (N,) rows that have the wanted pose now (to half a printed digit; position only where the program says so).
        Every other row has exactly the pose it had (but see ``Program.free_orientation``).
    refusals
        Rows that were to be changed and could not be, with the words they lack.
    insertions
        Words added, only with `allow_insert`.
    """

    raw: bytes
    changed: Bools
    refusals: tuple[Refusal, ...]
    insertions: tuple[Insertion, ...]


def rewrite(
    program: Program, position_mm: Floats, abc_deg: Floats, change: Bools, *, allow_insert: bool = False
) -> Rewritten:
    """Print wanted poses into a program.

    A number token changes only where its printed value does; decimals and style stay. Words that a pose does not write are
    kept from an earlier line, its correction included. Where that is not what is wanted, the row is refused - and with it
    the earlier row, if its correction would move a row that must stay - or gets the words it lacks.

    Parameters
    ----------
    program
        As read by ``toolpaths.formats.read_program``.
    position_mm, abc_deg
        (N, 3) wanted poses; read only where `change` is true. `abc_deg` is not read where ``program.position_only``.
    change
        (N,) rows to change. Rows that carry no force or were refused by the reader stay, whatever this says.
    allow_insert
        Insert words that are not written, right after the last pose word. This may add words to a point-to-point motion
        too: those that keep its pose where it was.

    Raises
    ------
    ValueError
        A wanted pose of a row to change is not finite.
    """
    active = np.asarray(change, dtype=bool) & program.corrected
    original = np.concatenate([program.position_mm, program.abc_deg], axis=1)
    wanted = np.concatenate([position_mm, abc_deg], axis=1)
    wanted[program.position_only, 3:] = original[program.position_only, 3:]
    read = np.concatenate(
        [active[:, None].repeat(3, 1), (active & ~program.position_only)[:, None].repeat(3, 1)], axis=1
    )
    bad = np.flatnonzero((read & ~np.isfinite(wanted)).any(axis=1))
    if bad.size:
        raise ValueError(
            f"{program.path}: line {program.line[bad[0]]}: the wanted pose is not finite: {wanted[bad[0]]}"
        )

    poses = Poses.of(active, wanted / program.unit, original / program.unit, program.quantum / program.unit)
    pairs = carried_pairs(program.source, program.also)
    pairs = pairs[~(program.free_orientation[pairs[:, 0]] & (pairs[:, 1] >= 3))]
    # A dialect that cannot insert words settles its pairs the strict way even when insertion is allowed.
    insertable = program.body[pairs[:, 0]] >= 0 if allow_insert else np.zeros(len(pairs), dtype=bool)
    withdrawn = settle(poses, pairs[~insertable], program.role)
    new_words = list(missing_words(poses, pairs[insertable], program.source, program.role == "end"))
    inserted = [(at, text) for at, text, _ in _insertions(program, new_words)]
    raw = _spliced(program.raw, heapq.merge(_replacements(program, poses), ((at, at, text) for at, text in inserted)))
    return Rewritten(
        raw=raw,
        changed=poses.active,
        refusals=tuple(_refusals(program, withdrawn)),
        insertions=tuple(listed for _, _, listed in _insertions(program, new_words)),
    )


def _refusals(program: Program, withdrawn: list[Withdrawal]) -> Iterator[Refusal]:
    """One refusal a line, in the order of the file."""
    by_row = sorted(withdrawn, key=lambda withdrawal: withdrawal.row)
    for line, group in groupby(by_row, key=lambda withdrawal: int(program.line[withdrawal.row])):
        reasons = list(group)
        words = tuple(WORDS[word] for word in sorted({word for reason in reasons for word in reason.missing}))
        if words:
            text = (
                f"the correction needs {', '.join(words)}, not written on this line (kept from an earlier one): "
                "write it there, or allow words to be inserted"
            )
        else:
            other = int(program.line[reasons[0].would_move])
            text = f"line {other} keeps words of this one and would move with its correction, though it must not"
        yield Refusal(line, text, words)


def _replacements(program: Program, poses: Poses) -> Iterator[tuple[int, int, bytes]]:
    """Start, end and new text of every token that reads differently now, in the order of the file."""
    # What was settled on is what is printed: a value in doubt between two digits must not be rounded a second time.
    rows, words = np.nonzero(poses.active[:, None] & program.written & (poses.printed != poses.original))
    spans = program.span[rows, words]
    order = np.argsort(spans[:, 0], kind="stable")
    values = poses.printed[rows, words][order]
    raw = program.raw
    for (start, end), value in zip(spans[order].tolist(), values.tolist(), strict=True):
        token = raw[start:end]
        text = print_like(token, value)
        if float(text) != float(token):
            yield start, end, text


def _insertions(program: Program, new_words: list[NewWord]) -> Iterator[tuple[int, bytes, Insertion]]:
    """Place, text and listing of inserted words, one entry a pose."""
    for row, group in groupby(new_words, key=lambda new: new.row):
        words = sorted(group, key=lambda new: new.word)
        at, separator, gap, lower, first = _neighbour_style(program, row)
        text = b""
        for new in words:
            name = WORDS[new.word].lower() if lower else WORDS[new.word]
            word = name.encode() + gap + b"%.*f" % (new.decimals, new.value)
            text += word + separator if first else separator + word
        listed = Insertion(int(program.line[row]), tuple(WORDS[new.word] for new in words), text.decode())
        yield at, text, listed


def _neighbour_style(program: Program, row: int) -> tuple[int, bytes, bytes, bool, bool]:
    """Where new words go in a pose, the separator, gap before the number, lower case, and whether other words follow them."""
    raw = program.raw
    spans = sorted((start, end) for start, end in program.span[row].tolist() if start >= 0)
    if not spans:
        return int(program.body[row]), b", ", b" ", False, True
    lower = raw[int(program.body[row]) : spans[-1][0]].rstrip()[-1:].islower()
    for (_, end), (start, _) in pairwise(spans):
        between = _SEPARATOR.fullmatch(raw, end, start)
        if between is not None:
            return spans[-1][1], between[1], between[2] or b" ", lower, False
    return spans[-1][1], b",", b" ", lower, False


def _spliced(raw: bytes, edits: Iterator[tuple[int, int, bytes]]) -> bytes:
    """The bytes with the spans of ordered, disjoint edits replaced."""
    out = bytearray()
    done = 0
    for start, end, text in edits:
        if start < done:
            raise ValueError(f"edits overlap at byte {start}")
        out += raw[done:start]
        out += text
        done = end
    if not done:
        return raw
    out += raw[done:]
    return bytes(out)
