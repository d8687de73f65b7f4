"""G-code piece by piece: where a program may be cut, and what a piece takes over from those before it."""

from __future__ import annotations

from copy import deepcopy
from typing import TYPE_CHECKING, NamedTuple

from toolpaths.formats import gcode_words as g
from toolpaths.formats.gcode_modal import Modal
from toolpaths.formats.reading import NeedsWhole, cut_between

if TYPE_CHECKING:
    from toolpaths.formats.gcode import Reader

_ANY_LINE = g.ordinary_line((*g.AXES, *g.ROTARY))
_FIRST_WORD = 3  # group of X in an ordinary line


class Resume(NamedTuple):
    """What a reader hands on to the next piece of a program.

    Attributes
    ----------
    line
        Lines so far.
    rotary
        Letters of the rotary words; None before the first piece, which finds them.
    modal
        What is in force.
    values, feed_mm_per_min
        The pose and the feed.
    moved
        Whether the next motion starts from a place that is not known.
    unknown_since
        Why words that are not known are not.
    """

    line: int
    rotary: tuple[str, ...] | None
    modal: Modal
    values: tuple[float, ...]
    feed_mm_per_min: float
    moved: bool
    unknown_since: str


START = Resume(0, None, Modal(), (), float("nan"), True, "")


def cut(raw: bytes) -> int:
    """Where the last place is at which a program may be cut in two, 0 for none: before an ordinary line with X, Y and Z."""
    return cut_between(raw, _ANY_LINE.match, lambda _, match: None not in match.groups()[_FIRST_WORD : _FIRST_WORD + 3])


def take_over(reader: Reader, resume: Resume) -> None:
    """Go on where the piece before ended.

    Raises
    ------
    NeedsWhole
        The first line leaves out a word that the program writes elsewhere: it keeps it from a piece that is corrected already.
    """
    first = _ANY_LINE.match(reader.raw, 0)
    words = dict(zip((*g.AXES, *g.ROTARY), first.groups()[_FIRST_WORD:], strict=False)) if first is not None else {}
    if any(words.get(letter) is None for letter in reader.letters):
        raise NeedsWhole
    reader.line, reader.unknown_since = resume.line, resume.unknown_since
    reader.modal = deepcopy(resume.modal)
    reader.modal.frames = reader.modal.frames[-1:]
    reader.rows.stand_in(resume.line, "G1", resume.values, moved=resume.moved)
    reader.rows.feed_mm_per_min = resume.feed_mm_per_min


def hand_on(reader: Reader) -> Resume:
    """What the next piece needs to know.

    Raises
    ------
    NeedsWhole
        A jump, which may lead into another piece.
    """
    if g.JUMP.search(reader.raw):
        raise NeedsWhole
    rows = reader.rows
    return Resume(
        reader.line,
        tuple(letter.decode() for letter in reader.letters[len(g.AXES) :]),
        deepcopy(reader.modal),
        tuple(rows.values),
        rows.feed_mm_per_min,
        rows.moved,
        reader.unknown_since,
    )
