"""APT piece by piece: where a program may be cut, and what a piece takes over from those before it."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, NamedTuple

from toolpaths.formats import apt_records as records
from toolpaths.formats.reading import NeedsWhole, cut_between

if TYPE_CHECKING:
    from toolpaths.formats.apt import Reader

# What is modal in a reader besides its rows.
_MODAL = ("line", "mm", "rapid", "cycle", "blocked", "feed_unit", "systems", "direction", "axis_since", "indent")


class Resume(NamedTuple):
    """What a reader hands on to the next piece of a program.

    Attributes
    ----------
    modal
        What is in force, by name; nothing before the first piece.
    values, feed_mm_per_min
        The pose and the feed.
    moved
        Whether the next motion starts from a place that is not known.
    axis_written
        Whether a point has written the axis that is in force.
    """

    modal: dict[str, Any]
    values: tuple[float, ...]
    feed_mm_per_min: float
    moved: bool
    axis_written: bool


START = Resume({}, (), float("nan"), True, False)


def cut(raw: bytes) -> int:
    """Where the last place is at which a program may be cut in two, 0 for none: before a point with its axis, or any point."""
    ordinary = records.ORDINARY.match
    with_axis = cut_between(raw, ordinary, lambda _, match: match[4] is not None)
    return with_axis or cut_between(raw, ordinary, lambda *_: True)


def take_over(reader: Reader, resume: Resume) -> None:
    """Go on where the piece before ended.

    Raises
    ------
    NeedsWhole
        The first point keeps the axis of a point that is corrected already.
    """
    first = records.ORDINARY.match(reader.raw, 0)
    if first is None or (resume.axis_written and first[4] is None):
        raise NeedsWhole
    for name, value in resume.modal.items():
        setattr(reader, name, value.copy() if isinstance(value, dict) else value)
    reader.rows.stand_in(reader.line - 1, "GOTO", resume.values, moved=resume.moved)
    reader.rows.feed_mm_per_min = resume.feed_mm_per_min


def hand_on(reader: Reader) -> Resume:
    """What the next piece needs to know."""
    rows = reader.rows
    modal = {name: getattr(reader, name) for name in _MODAL}
    return Resume(modal, tuple(rows.values), rows.feed_mm_per_min, rows.moved, rows.source[3] >= 0)
