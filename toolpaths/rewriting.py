"""The same program with other numbers: replaces number tokens of pose words, and not one other byte.

The output is the original, copied piece by piece between the tokens that change; with nothing to change it is the very
same object. Whether words a pose does not write can follow is settled in ``toolpaths.modal``.
"""

from __future__ import annotations

import heapq
import re
from bisect import bisect_right
from collections.abc import Iterator
from dataclasses import dataclass
from itertools import groupby, pairwise

import numpy as np
from numpy.typing import NDArray

from toolpaths.modal import NewWord, Poses, Withdrawal, carried_pairs, missing_words, settle
from toolpaths.printed import print_all
from toolpaths.program import Program, Refusal

Floats = NDArray[np.float64]
Bools = NDArray[np.bool_]

# Starts, ends and new texts, in the order of the file.
Edits = tuple[list[int], list[int], list[bytes]]

# New words are printed to this many mm or units of the convention, or finer.
NEW_WORD_RESOLUTION = 1e-3

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
    parts
        The bytes to write, one entry a file of the program.
    changed
        (N,) rows that have the wanted pose now (to half a printed digit; position only where the program says so).
        Every other row has exactly the pose it had (but see ``Program.free_orientation``).
    refusals
        Rows that were to be changed and could not be, with the words they lack.
    insertions
        Words added, only with `allow_insert`.
    """

    parts: tuple[bytes, ...]
    changed: Bools
    refusals: tuple[Refusal, ...]
    insertions: tuple[Insertion, ...]

    @property
    def raw(self) -> bytes:
        """The file with the motions."""
        return self.parts[0]


def rewrite(
    program: Program, position_mm: Floats, orientation: Floats, change: Bools, *, allow_insert: bool = False
) -> Rewritten:
    """Print wanted poses into a program.

    A number token changes only where its printed value does; decimals and style stay. Words that a pose does not write are
    kept from an earlier line, its correction included. Where that is not what is wanted, the row is refused - and with it
    the earlier row, if its correction would move a row that must stay - or gets the words it lacks.

    Parameters
    ----------
    program
        As read by ``toolpaths.formats.read_program``.
    position_mm, orientation
        (N, 3) and (N, K) wanted poses; read only where `change` is true. `orientation` is not read where
        ``program.position_only``.
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
    original = program.pose
    wanted = np.concatenate([position_mm, orientation], axis=1)
    wanted[program.position_only, 3:] = original[program.position_only, 3:]
    read = active[:, None] & np.ones_like(wanted, dtype=bool)
    read[program.position_only, 3:] = False
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
    # KRL prints all numbers of a program alike; G-code leaves out zeros, and with them the digits a correction needs.
    finest = (
        10.0 ** np.floor(np.log10(NEW_WORD_RESOLUTION / program.unit))
        if program.spaced_words
        else np.full(wanted.shape[1], np.inf)
    )
    new_words = list(missing_words(poses, pairs[insertable], program.source, program.role == "end", finest))
    inserted = [(at, text) for at, text, _ in _insertions(program, new_words)]
    edits = _replacements(program, poses)
    if inserted:
        both = heapq.merge(zip(*edits, strict=True), ((at, at, text) for at, text in inserted))
        starts, stops, texts = zip(*both, strict=True)
        edits = list(starts), list(stops), list(texts)
    return Rewritten(
        parts=_spliced(program.raw, edits, [part.end for part in program.parts]),
        changed=poses.active,
        refusals=tuple(_refusals(program, withdrawn)),
        insertions=tuple(listed for _, _, listed in _insertions(program, new_words)),
    )


def _refusals(program: Program, withdrawn: list[Withdrawal]) -> Iterator[Refusal]:
    """One refusal a line, in the order of the file."""
    by_row = sorted(withdrawn, key=lambda withdrawal: withdrawal.row)
    for line, group in groupby(by_row, key=lambda withdrawal: int(program.line[withdrawal.row])):
        reasons = list(group)
        missing = sorted({word for reason in reasons for word in reason.missing})
        words = tuple(program.words[word] for word in missing)
        row = reasons[0].row
        if words and program.written[row, missing[0]]:
            # A stored point is written once and used more than once.
            other, words = int(program.line[program.source[row, missing[0]]]), ()
            text = (
                f"goes to the same stored point as line {other}, and needs another correction there (other force or posture): "
                "give each motion a point of its own"
            )
        elif words:
            text = (
                f"the correction needs {', '.join(words)}, not written on this line (kept from an earlier one): "
                "write it there, or allow words to be inserted"
            )
        else:
            other = int(program.line[reasons[0].would_move])
            moved = reasons[0].would_move
            shared = (program.written[moved] & (program.source[moved] == row)).any()
            text = (
                f"line {other} goes to the same stored point, which must stay for it: give each motion a point of its own"
                if shared
                else f"line {other} keeps words of this one and would move with its correction, though it must not"
            )
        yield Refusal(line, text, words)


def _replacements(program: Program, poses: Poses) -> Edits:
    """Every token that reads differently now."""
    # What was settled on is what is printed: a value in doubt between two digits must not be rounded a second time.
    own = program.source == np.arange(len(program), dtype=np.int32)[:, None]  # a stored point is printed once
    rows, words = np.nonzero(poses.active[:, None] & own & (poses.printed != poses.original))
    spans = program.span[rows, words]
    order = np.argsort(spans[:, 0], kind="stable")
    rows, words, spans = rows[order], words[order], spans[order]
    texts = print_all(program.raw, spans, poses.printed[rows, words], poses.quantum[rows, words])
    if not program.spaced_words:
        for place in _held_apart_by_sign(program.raw, spans):
            if texts[place][:1] not in (b"+", b"-"):
                texts[place] = b"+" + texts[place]
    return spans[:, 0].tolist(), spans[:, 1].tolist(), texts


def _held_apart_by_sign(raw: bytes, spans: NDArray[np.int32]) -> list[int]:
    """Numbers that follow a letter at once, with a sign between: ``X-1.0`` is a word and its number, ``X1.0`` a name."""
    buffer = np.frombuffer(raw, dtype=np.uint8)
    before, first = buffer[np.maximum(spans[:, 0] - 1, 0)] | 0x20, buffer[spans[:, 0]]
    letter = (before >= ord("a")) & (before <= ord("z"))
    found: list[int] = np.flatnonzero(letter & ((first == ord("-")) | (first == ord("+")))).tolist()
    return found


def _insertions(program: Program, new_words: list[NewWord]) -> Iterator[tuple[int, bytes, Insertion]]:
    """Place, text and listing of inserted words, one entry a pose."""
    for row, group in groupby(new_words, key=lambda new: new.row):
        words = sorted(group, key=lambda new: new.word)
        at, separator, gap, lower, first = _neighbour_style(program, row)
        text = b""
        for new in words:
            name = program.words[new.word].lower() if lower else program.words[new.word]
            word = name.encode() + gap + b"%.*f" % (new.decimals, new.value)
            text += word + separator if first else separator + word
        listed = Insertion(int(program.line[row]), tuple(program.words[new.word] for new in words), text.decode())
        yield at, text, listed


def _neighbour_style(program: Program, row: int) -> tuple[int, bytes, bytes, bool, bool]:
    """Where new words go in a pose, the separator, gap before the number, lower case, and whether other words follow them."""
    raw = program.raw
    spans = sorted((start, end) for start, end in program.span[row].tolist() if start >= 0)
    if not spans:
        return int(program.body[row]), b", ", b" ", False, True
    named = raw[int(program.body[row]) : spans[-1][0]].rstrip()
    lower = named[-1:].islower()
    if program.spaced_words:
        letter = int(program.body[row]) + len(named) - 1
        tight = re.fullmatch(rb"[A-Za-z0-9.]", raw[max(letter - 1, 0) : letter]) is not None
        return spans[-1][1], b"" if tight else b" ", raw[letter + 1 : spans[-1][0]], lower, False
    for (_, end), (start, _) in pairwise(spans):
        between = _SEPARATOR.fullmatch(raw, end, start)
        if between is not None:
            return spans[-1][1], between[1], between[2] or b" ", lower, False
    return spans[-1][1], b",", b" ", lower, False


def _spliced(raw: bytes, edits: Edits, ends: list[int]) -> tuple[bytes, ...]:
    """The bytes with the spans of ordered, disjoint edits replaced, cut where the files end; untouched files are the same bytes."""
    starts, stops, texts = edits
    if not starts and len(ends) == 1:
        return (raw,)
    if (np.array(starts[1:]) < np.array(stops[:-1])).any():
        raise ValueError("edits overlap")
    parts = []
    begin = first = 0
    for end in ends:
        last = bisect_right(stops, end)
        kept = [raw[a:b] for a, b in zip([begin, *stops[first:last]], [*starts[first:last], end], strict=True)]
        pieces: list[bytes] = [b""] * (2 * len(kept) - 1)
        pieces[::2], pieces[1::2] = kept, texts[first:last]
        parts.append(b"".join(pieces))
        begin, first = end, last
    return tuple(parts)
