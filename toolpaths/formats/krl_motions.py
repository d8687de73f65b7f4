"""Motions of a KRL program: their target, written in the motion or stored by name, what follows it, and the rows they become."""

from __future__ import annotations

import math
import re
import weakref
from collections.abc import Sequence
from typing import NamedTuple

from toolpaths.formats.krl_frames import Frames, Told
from toolpaths.formats.krl_points import REFERENCE, FrameData, Key, Points, key_of
from toolpaths.formats.krl_statements import POINT_TO_POINT, blend_of, blend_with, feed_with
from toolpaths.formats.krl_words import Aggregate, Unreadable, read_aggregate, shown, status_bits
from toolpaths.formats.reading import NeedsWhole
from toolpaths.program import NO_STATUS, FrameSetting, Refusal
from toolpaths.program_builder import ProgramBuilder

WORDS = ("X", "Y", "Z", "A", "B", "C")

# Approximation, and the settings of a spline segment.
_TAIL = re.compile(
    rb"(?:[\s,]*C_(?:DIS|VEL|ORI|PTP|SPL)\b)*(?:\s+WITH\b(.*?)(?:\s+C_(?:DIS|SPL))?)?\s*", re.IGNORECASE | re.DOTALL
)
_ARC_ANGLE = re.compile(rb"\s*,\s*CA\b\s*=?\s*[^,{}\s]+", re.IGNORECASE)
_ARCS = frozenset({"CIRC", "SCIRC"})


class Resume(NamedTuple):
    """What a reader hands on to the next piece of a program.

    Attributes
    ----------
    line
        Lines so far.
    values, status, feed_mm_per_min, blend
        The pose, what was last said of the branch, the feed, the distance of C_DIS and the name of the present path data.
    moved
        Whether the next motion starts from a place that is not known; None where no motion came before.
    lasting
        Base and tool in force.
    frame_data
        See `krl_frames.Told`.
    unknown_since
        Why words that are not known are not.
    """

    line: int
    values: tuple[float, ...]
    status: tuple[int, int, int]
    feed_mm_per_min: float
    blend: tuple[float, str | None]
    moved: bool | None
    lasting: tuple[FrameSetting, ...]
    frame_data: Told
    unknown_since: str


START = Resume(
    0, (math.nan,) * 12, NO_STATUS, math.nan, (math.nan, None), None, (), (None, ()), "no line before it says"
)


class Motions:
    """What has been found so far in a source, and how a motion adds to it."""

    def __init__(self, raw: bytes, others: Sequence[tuple[str, bytes]], *, piece: bool = False) -> None:
        self.raw = raw
        self.piece = piece
        self.others = others
        self.rows = ProgramBuilder()
        # Held weakly: a reader that holds itself would keep its piece of the program until the collector comes.
        frame_data = weakref.WeakMethod(self._frame_data)
        self.frames = Frames(lambda name: found(name) if (found := frame_data()) is not None else None)
        self.refusals: list[Refusal] = []
        self.notes: list[Refusal] = []
        self.warnings: list[str] = []
        self.has_motion = False
        self.line = 0
        self.line_start = 0
        self.unknown_since = "no line before it says"
        self.blend_distance = math.nan
        self.path_data: str | None = None
        self.counter: dict[str, int] = {}
        self._points: Points | None = None
        self._stored: list[tuple[int, Key]] = []

    def points(self) -> Points:
        """The stored points; they are looked for when the first motion names one."""
        if self._points is None:
            self._points = Points(b"" if self.piece else self.raw, self.others)
            if self._points.has_global:
                self.warnings.append(
                    "points are declared GLOBAL: other programs that go to them get the corrected ones too"
                )
        return self._points

    def _frame_data(self, name: str) -> FrameData | None:
        return self.points().frame_data(name)

    def take_over(self, resume: Resume) -> None:
        """Go on where the piece before ended: a first row that nothing changes stands for its last motion."""
        self.line = resume.line
        self.unknown_since = resume.unknown_since
        self.frames.take_over(resume.lasting, resume.frame_data)
        rows = self.rows
        rows.values = list(resume.values)
        if resume.moved is not None:
            rows.status = resume.status
            rows.stand_in(resume.line, "LIN", resume.values, moved=resume.moved)
            rows.status = NO_STATUS
        rows.feed_mm_per_min = resume.feed_mm_per_min
        self.blend_distance, self.path_data = resume.blend

    def hand_on(self) -> Resume:
        """What the next piece needs to know."""
        rows = self.rows
        said = rows.last_status()
        moved = rows.moved if len(rows) else None
        lasting, name = self.frames.hand_on()
        return Resume(
            self.line,
            tuple(rows.values),
            said,
            rows.feed_mm_per_min,
            (self.blend_distance, self.path_data),
            moved,
            lasting,
            name,
            self.unknown_since,
        )

    def finish(self) -> None:
        """Refuse points that something else than a motion uses too: a correction would change that as well."""
        self.refusals += self.frames.refusals
        if self._points is None or not self._stored:
            return
        used = self._points.used_otherwise({key for _, key in self._stored})
        for row, key in self._stored:
            if key in used and self.rows.carries_force(row):
                self.rows.refuse(row)
                reason = (
                    f"goes to a stored point that line {used[key]} uses too, which a correction would change with it"
                )
                self.refusals.append(Refusal(self.rows.line(row), reason))
        self.refusals.sort(key=lambda refusal: refusal.line)

    def forget(self, since: str, *, moved: bool = True) -> None:
        self.rows.forget(moved=moved)
        self.unknown_since = since

    def refuse(self, kind: str, at: int, found: str) -> None:
        """Leave a motion without a row: its pose is not known, nor what it leaves behind."""
        force = kind not in POINT_TO_POINT
        refusal = Refusal(self.line, f"found {found}", column=at - self.line_start + 1, carries_force=force)
        (self.refusals if force else self.notes).append(refusal)
        self.forget(f"the motion in line {self.line}")

    def motion(self, kind: str, at: int, end: int) -> None:
        """A motion that is not an ordinary line: `at` is the byte after its keyword."""
        raw = self.raw
        if b"\r" in raw[at:end].rstrip():
            self.refuse(kind, at, "a carriage return in the middle of the line")
            return
        if kind.endswith("_REL"):
            self.refuse(kind, self.line_start, f"{kind}: a relative motion starts from the corrected point before it")
            return
        try:
            first = self.target(kind, at, end)
            if kind in _ARCS:
                comma = _skip_blanks(raw, first.end, end)
                if raw[comma:end][:1] != b",":
                    raise Unreadable(comma, "no end point after the auxiliary point of the arc")
                self.arc(kind, first, self.target(kind, comma + 1, end), end)
                return
            feed = self.check_tail(kind, first.end, end)
            if first.is_axes and kind in POINT_TO_POINT:
                self.forget(f"the axis angles in line {self.line}")
                self.rows.update((None,) * 6 + first.tokens[6:])
                return
            if first.is_axes:
                raise Unreadable(max(first.body, at), "axis angles in a motion along a path")
            self.at_feed(feed, kind, first)
        except Unreadable as error:
            self.refuse(kind, error.at, error.found)

    def at_feed(self, feed: float | None, kind: str, aggregate: Aggregate) -> None:
        """A motion with a feed of its own."""
        before = self.rows.feed_mm_per_min
        self.rows.feed_mm_per_min = before if feed is None else feed
        self.point(kind, aggregate)
        self.rows.feed_mm_per_min = before

    def target(self, kind: str, at: int, end: int) -> Aggregate:
        raw = self.raw
        at = _skip_blanks(raw, at, end)
        if raw[at:end][:1] == b"{":
            return read_aggregate(raw, at, end)
        named = REFERENCE.match(raw, at, end)
        what = shown(raw, at, end)
        if named is None:
            raise Unreadable(
                at, f"{what!r}: a named point or an expression, whose numbers are not here" if what else "no target"
            )
        if raw[_skip_blanks(raw, named.end(), end) : end][:1] == b":":
            raise Unreadable(
                at,
                f"{what!r}: a named point or an expression: the frame before ':' is computed, so where it lies is not known",
            )
        if self.piece:
            if kind not in POINT_TO_POINT:
                raise NeedsWhole
            raise Unreadable(at, f"{what!r}: a named point")
        found = self.points().find(at, key_of(named, self.counter), shown(raw, at, named.end()))
        return found._replace(end=named.end())

    def check_tail(self, kind: str, at: int, end: int) -> float | None:
        """What follows a target: the blend of the next row; the feed that a segment sets for itself, if any."""
        tail = _TAIL.fullmatch(self.raw, at, end)
        if tail is None:
            at = _skip_blanks(self.raw, at, end)
            raise Unreadable(at, f"{shown(self.raw, at, end)!r} after the pose, which may change where it is")
        unknown = self.frames.borrow(tail[1] or b"", self.line)
        if unknown is not None:
            raise Unreadable(tail.start(1), unknown)
        own = blend_with(tail[1] or b"")
        self.rows.blend_mm = blend_of(kind.encode(), tail[0], self.blend_distance if own is None else own)
        return feed_with(tail[1] or b"")

    def point(self, kind: str, aggregate: Aggregate) -> None:
        """A literal pose reached by a motion."""
        self.has_motion = True
        self.take(aggregate)
        force = kind not in POINT_TO_POINT
        reason = self.unknown_words(self.rows.values) if force and -1 in self.rows.source else None
        if reason is not None:
            self.refusals.append(Refusal(self.line, reason, column=aggregate.body - self.line_start + 1))
        # Motions along a path keep the arm's branch whatever S and T say; only point-to-point motions follow them.
        self.rows.status = NO_STATUS if force or aggregate.status is None else status_bits(aggregate.status)
        self.add(kind, "point", aggregate, force, refused=reason is not None)
        self.rows.status = NO_STATUS

    def take(self, aggregate: Aggregate) -> None:
        """Take over the words of a pose that is written, or of a stored one."""
        if aggregate.point is None:
            self.rows.update(aggregate.tokens)
        else:
            self.rows.update_stored(aggregate.point, aggregate.tokens)

    def arc(self, kind: str, via: Aggregate, end: Aggregate, stop: int) -> None:
        """Auxiliary and end pose of an arc."""
        angle = _ARC_ANGLE.match(self.raw, end.end, stop)
        feed = self.check_tail(kind, angle.end() if angle else end.end, stop)
        if via.is_axes or end.is_axes:
            raise Unreadable(max(via.body, self.line_start), "axis angles in a motion along a path")
        rows = self.rows
        feed_before = rows.feed_mm_per_min
        rows.feed_mm_per_min = feed_before if feed is None else feed
        start = rows.values, rows.source
        rows.values, rows.source = start[0].copy(), start[1].copy()
        self.take(via)
        kept_values, kept_source = self.kept_at_end(start, via, end)
        end_values = [kept if t is None else float(t) for t, kept in zip(end.tokens, kept_values, strict=True)]
        reason = self.unknown_words(rows.values) or self.unknown_words(end_values)
        if reason is not None:
            self.refusals.append(Refusal(self.line, reason, column=max(via.body - self.line_start, 0) + 1))
        self.add(kind, "via", via, True, refused=reason is not None)
        rows.values, rows.source = kept_values, kept_source
        self.take(end)
        self.add(kind, "end", end, True, refused=reason is not None)
        rows.feed_mm_per_min = feed_before
        if angle is not None:
            self.warnings.append(
                f"line {self.line}: with CA the arc ends elsewhere than printed; its two printed points are corrected"
            )
            self.forget(f"the arc to an angle (CA) in line {self.line}")

    def kept_at_end(
        self, start: tuple[list[float], list[int]], via: Aggregate, end: Aggregate
    ) -> tuple[list[float], list[int]]:
        """What the end of an arc keeps for words it does not write.

        The controller takes "the value of the previous position", which may be read as that of the start or of the
        auxiliary point. Where both say the same, the word is known, and both must go on saying the same (`also`).
        Called when the auxiliary pose is the present one and has no row yet.
        """
        rows = self.rows
        values, source = start[0].copy(), start[1].copy()
        for word in range(12):
            if end.tokens[word] is not None or via.tokens[word] is None:
                continue
            if rows.values[word] != values[word]:  # also where the start is not known: NaN
                values[word] = math.nan
                if word < 6:
                    source[word] = -1
            elif word < 6:
                rows.also.extend((len(rows) + 1, word, len(rows)))
        return values, source

    def unknown_words(self, values: list[float]) -> str | None:
        """Why a pose along a path cannot be used: words it keeps from nowhere."""
        unknown = [word for word, value in zip(WORDS, values, strict=False) if math.isnan(value)]
        if not unknown:
            return None
        return f"{', '.join(unknown)} not written here and not known: {self.unknown_since} (write them on this line)"

    def add(self, kind: str, role: str, aggregate: Aggregate, force: bool, *, refused: bool) -> None:
        if aggregate.point is not None:
            self._stored.append((len(self.rows), aggregate.point))  # type: ignore[arg-type]
        self.rows.add(self.line, kind, role, aggregate.spans, aggregate.body, carries_force=force, refused=refused)


def _skip_blanks(raw: bytes, at: int, end: int) -> int:
    while at < end and raw[at] in b" \t":
        at += 1
    return at
