"""What the readers of robot dialects with whole poses share: rows, refusals, frames in force, points that are stored once."""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Iterable
from dataclasses import replace
from typing import Any, ClassVar, NamedTuple

import numpy as np
from numpy.typing import NDArray

from toolpaths.conventions import Convention
from toolpaths.program import NO_STATUS, UNWRITTEN, FrameSetting, Program, Refusal
from toolpaths.program_builder import EXTERNALS, ProgramBuilder

# No digit can be shared between two parts of the pattern, so that a line that does not match fails at once.
NUMBER = rb"[+-]?(?:\d{1,12}(?:\.\d{0,25})?|\.\d{1,25})(?:[eE][+-]?(?:0?\d|[12]\d|3[0-8]))?"
# Where a dialect is looked for: programs of a million lines begin with what tells them.
HEAD_BYTES = 100_000
NO_EXTERNALS = (math.nan,) * EXTERNALS
Status = tuple[int, int, int]


class Unreadable(Exception):
    """What was found instead of a literal pose, at which byte offset of the file."""

    def __init__(self, at: int, found: str) -> None:
        super().__init__(found)
        self.at = at
        self.found = found


class NeedsWhole(Exception):
    """A program that cannot be read in pieces: something in it depends on what stands elsewhere."""


# So many lines before the end a place to cut at is looked for.
_CUT_WITHIN = 500


def cut_between(
    raw: bytes,
    ordinary: Callable[[bytes, int], re.Match[bytes] | None],
    whole: Callable[[re.Match[bytes], re.Match[bytes]], bool],
) -> int:
    """The last place, 0 for none, at which a program may be cut: between two ordinary lines of which the second is whole.

    Parameters
    ----------
    ordinary
        The line that begins at an offset, if it is one with a motion; its end included.
    whole
        Of a line and the one after it: whether the second keeps nothing of motions before it.
    """
    end = raw.rfind(b"\n") + 1
    after: re.Match[bytes] | None = None
    for _ in range(_CUT_WITHIN):
        start = raw.rfind(b"\n", 0, max(end - 1, 0)) + 1
        match = ordinary(raw, start)
        if match is not None and after is not None and whole(match, after):
            return after.start()
        after, end = match, start
        if not start:
            break
    return 0


class Target(NamedTuple):
    """A whole literal pose.

    Attributes
    ----------
    tokens, spans
        Numbers and byte spans of X, Y, Z and the orientation words.
    external
        Six external axes, NaN where there is none.
    status
        Shoulder, elbow, wrist; -1 unknown.
    point
        Key of the stored point these numbers belong to; None for a pose written in the motion.
    frame
        Frames that the point itself names, as (what, key).
    """

    tokens: tuple[bytes, ...]
    spans: tuple[tuple[int, int], ...]
    external: tuple[float, ...] = NO_EXTERNALS
    status: Status = NO_STATUS
    point: object = None
    frame: tuple[tuple[str, str], ...] = ()

    def elsewhere(self) -> Target:
        """The same pose for a piece of the program in which its numbers do not stand."""
        return self._replace(spans=(UNWRITTEN,) * len(self.spans))


class Continued(NamedTuple):
    """What a reader hands on to the next piece of a program.

    Attributes
    ----------
    line
        Lines so far.
    values, status, feed_mm_per_min
        The pose, what was last said of the branch, the feed.
    moved
        Whether the next motion starts from a place that is not known.
    frames
        Base and tool in force.
    modal
        What else is in force or declared in a reader of the dialect, by name (`Reading.MODAL`).
    """

    line: int
    values: tuple[float, ...]
    status: Status
    feed_mm_per_min: float
    moved: bool
    frames: tuple[FrameSetting, ...]
    modal: dict[str, Any]


class Reading:
    """A program being read: what was found so far, and the line that is being looked at."""

    # What a dialect hands on to the next piece of a program besides its rows and frames.
    MODAL: ClassVar[tuple[str, ...]] = ()

    def __init__(self, raw: bytes, convention: Convention, start: int = 0) -> None:
        self.raw = raw
        self.rows = ProgramBuilder(convention)
        self.frames: list[FrameSetting] = []
        self.refusals: list[Refusal] = []
        self.notes: list[Refusal] = []
        self.warnings: list[str] = []
        self.has_motion = False
        self.line = 1
        self._counted = self._line_start = start
        self._frame: dict[str, FrameSetting] = {}
        self._goes: list[tuple[int, object]] = []
        self._mentioned: dict[object, tuple[int | str, str]] = {}

    def take_over(self, before: Continued) -> None:
        """Go on where the piece before ended: a first row that nothing changes stands for its last motion."""
        self.line = before.line + 1
        self.frames = list(before.frames)
        self._frame = {setting.what: setting for setting in before.frames}
        self.rows.status = before.status
        self.rows.stand_in(before.line, "LIN", before.values, moved=before.moved)
        self.rows.feed_mm_per_min = before.feed_mm_per_min
        for name, value in before.modal.items():
            setattr(self, name, value.copy() if isinstance(value, dict | set) else value)

    def hand_on(self) -> Continued:
        """What the next piece needs to know.

        Raises
        ------
        NeedsWhole
            Something in this piece depends on others (as the dialect knows).
        """
        rows, lines = self.rows, self.to(len(self.raw)) - 1
        frames, modal = tuple(self._frame.values()), {name: _handed_on(getattr(self, name)) for name in self.MODAL}
        return Continued(lines, tuple(rows.values), rows.last_status(), rows.feed_mm_per_min, rows.moved, frames, modal)

    @property
    def goes_to_stored(self) -> bool:
        """Whether a motion under force goes to a stored point."""
        return any(self.rows.carries_force(row) for row, _ in self._goes)

    def to(self, at: int) -> int:
        """Go on to a byte further down; its 1-based line."""
        newlines = self.raw.count(b"\n", self._counted, at)
        if newlines:
            self.line += newlines
            self._line_start = self.raw.rfind(b"\n", self._counted, at) + 1
        self._counted = at
        return self.line

    def refuse(self, at: int, found: str, *, force: bool, fatal: bool = False, row: int | None = None) -> None:
        """Leave what stands at a byte of the present line; without a row, where the machine stands then is not known."""
        same_line = at >= self._line_start and self.raw.find(b"\n", self._line_start, at) < 0
        column = at - self._line_start + 1 if same_line else None
        refusal = Refusal(self.line, f"found {found}", column=column, carries_force=force, fatal=fatal)
        (self.refusals if force or fatal else self.notes).append(refusal)
        if row is None:
            self.rows.forget()

    def set_frame(self, what: str, key: str, text: str, pose: tuple[float, ...] | None = None, **said: object) -> None:
        """Base or tool from this line on; only what differs from the setting in force is kept."""
        before = self._frame.get(what)
        if before is not None and before.key == key:
            return
        origin = "controller" if pose is None else "literal"
        setting = replace(FrameSetting(self.line, what, origin, pose, text, key=key), **said)  # type: ignore[arg-type]
        if before is not None and before.line == self.line:
            self.refuse(
                self._counted, f"two settings of the {what} on one line: write them on two", force=True, fatal=True
            )
        self._frame[what] = setting
        self.frames.append(setting)

    def compute_frames(self, assigned: set[bytes]) -> None:
        """A base or tool that the program assigns to is no literal any more; names as in the keys, without an index."""
        for place, setting in enumerate(self.frames):
            if (setting.key or "").partition("[")[0].encode() in assigned:
                self.frames[place] = replace(setting, origin="expression", pose=None)

    def add(self, kind: str, role: str, target: Target, *, force: bool, refused: bool = False) -> None:
        """A row for a pose that a motion goes to."""
        rows = self.rows
        if target.point is None:
            rows.update(target.tokens)
        else:
            rows.update_stored(target.point, target.tokens)
            self._goes.append((len(rows), target.point))
        rows.values[rows.width :] = target.external
        rows.status = target.status
        rows.add(self.line, kind, role, target.spans, -1, carries_force=force, refused=refused)

    def mention(self, names: Iterable[object], how: str) -> None:
        """Stored points that this line uses otherwise than as the target of a motion."""
        for name in names:
            self._mentioned.setdefault(name, (self.line, how))

    def mention_elsewhere(self, other: Reading, name: str) -> None:
        """Stored points that another file of the program uses, as targets of its motions or otherwise."""
        for point, (line, how) in other._mentioned.items():
            self._mentioned.setdefault(point, (f"{line} of {name}", how))
        for row, target in other._goes:
            for point in self.called(target):
                self._mentioned.setdefault(point, (f"{other.rows.line(row)} of {name}", "a motion there goes to it"))

    def called(self, point: object) -> tuple[object, ...]:
        """What a stored point is called where other statements use it."""
        return (point,)

    def finish(self, dialect: str, path: str, unit: NDArray[np.float64] | None = None, **more: object) -> Program:
        """The program; points that something else depends on are refused, for a correction would reach that too."""
        for row, point in self._goes:
            use = next((self._mentioned[name] for name in self.called(point) if name in self._mentioned), None)
            if use is None or not self.rows.carries_force(row):
                continue
            self.rows.refuse(row)
            line = self.rows.line(row)
            reason = f"goes to a stored point that line {use[0]} uses too ({use[1]}), which a correction would change with it"
            if not (self.refusals and self.refusals[-1].line == line and self.refusals[-1].reason == reason):
                self.refusals.append(Refusal(line, reason))
        self.refusals.sort(key=lambda refusal: refusal.line)
        return self.rows.build(
            self.raw,
            dialect,
            path,
            unit,
            frames=tuple(self.frames),
            refusals=tuple(self.refusals),
            notes=tuple(self.notes),
            warnings=tuple(self.warnings),
            **more,  # type: ignore[arg-type]
        )


def _handed_on(value: Any) -> Any:
    """A setting for the next piece; of stored points the numbers stand in this one."""
    if not isinstance(value, dict):
        return value
    return {name: held.elsewhere() if isinstance(held, Target) else held for name, held in value.items()}


def blanked(raw: bytes, pattern: re.Pattern[bytes]) -> bytes:
    """The same bytes with every match (comments, strings) overwritten by blanks, line ends kept; offsets stay."""
    if pattern.search(raw) is None:
        return raw
    return pattern.sub(lambda found: b" " * (found.end() - found.start()), raw)


def arguments(code: bytes, start: int, end: int) -> list[tuple[int, int]]:
    """Spans of the pieces between commas that stand outside brackets of any kind."""
    pieces, depth, begin = [], 0, start
    for mark in _MARK.finditer(code, start, end):
        found = mark[0]
        if found in b"([{":
            depth += 1
        elif found in b")]}":
            depth -= 1
        elif depth == 0:
            pieces.append((begin, mark.start()))
            begin = mark.end()
    pieces.append((begin, end))
    return [_trimmed(code, *piece) for piece in pieces]


_MARK = re.compile(rb"[\[\](){},]")


def _trimmed(code: bytes, start: int, end: int) -> tuple[int, int]:
    piece = code[start:end]
    return start + len(piece) - len(piece.lstrip()), start + len(piece.rstrip())


def shown(raw: bytes, start: int, end: int, limit: int = 60) -> str:
    """A piece of a program for a message, in ASCII on one line."""
    return " ".join(raw[start:end][: 4 * limit].decode("ascii", "backslashreplace").split())[:limit]
