"""Collects the rows of a program while a dialect reads it."""

from __future__ import annotations

import math
from array import array
from collections.abc import Iterable
from itertools import chain

import numpy as np
from numpy.typing import NDArray

from toolpaths.conventions import KUKA, Convention
from toolpaths.program import EXTERNALS, NO_STATUS, POSITION_WORDS, UNWRITTEN, Part, Program

Floats = NDArray[np.float64]
Ints = NDArray[np.int32]
Offsets = NDArray[np.int64]


class ProgramBuilder:
    """Collects rows while a dialect reads, and keeps the values of words that later rows may leave out.

    Rows are held in compact arrays, never as objects. `values` (the 3 + K words, then E1..E6) and `source` are the pose the
    machine is in after the rows so far: NaN and -1 where unknown. `status`, `feed_mm_per_min` and `blend_mm` are those of the next row.
    """

    def __init__(self, convention: Convention = KUKA) -> None:
        self.convention = convention
        self.width = len(POSITION_WORDS) + len(convention.words)
        self.values = [math.nan] * (self.width + EXTERNALS)
        self.source = [-1] * self.width
        self._stored: dict[object, int] = {}
        self.status: tuple[int, int, int] = NO_STATUS
        self.feed_mm_per_min = math.nan
        self.blend_mm = math.nan
        self.also = array("i")
        self._line, self._body, self._source, self._span = array("i"), array("i"), array("i"), array("i")
        self._poses, self._feed, self._blend = array("d"), array("d"), array("d")
        self._status = array("b")
        self._kind: list[str] = []
        self._role: list[str] = []
        self._flags = bytearray()
        self._moved = True

    def __len__(self) -> int:
        return len(self._line)

    def forget(self, *, moved: bool = True) -> None:
        """From here on, the words of the pose are not known; with `moved` not even where the machine stands."""
        self._moved = self._moved or moved
        self.values = [math.nan] * (self.width + EXTERNALS)
        self.source = [-1] * self.width

    @property
    def moved(self) -> bool:
        """Whether the next row starts from a place that is not known."""
        return self._moved

    def last_status(self) -> tuple[int, int, int]:
        """What was last said of each bit of the branch; -1 where nothing was."""
        said = np.frombuffer(self._status, dtype=np.int8).reshape(-1, 3)
        last = [int(bit[bit >= 0][-1]) if (bit >= 0).any() else -1 for bit in said.T]
        return last[0], last[1], last[2]

    def update(self, numbers: Iterable[bytes | None]) -> None:
        """Take over the words that are written (None: not written) into the pose that the next row will have."""
        row, values, source, width = len(self._line), self.values, self.source, self.width
        for word, token in enumerate(numbers):
            if token is not None:
                values[word] = float(token)
                if word < width:
                    source[word] = row

    def update_stored(self, point: object, numbers: Iterable[bytes | None]) -> None:
        """As `update`, for a point that is stored once and may be gone to more than once."""
        first = self._stored.setdefault(point, len(self._line))
        tokens = list(numbers)
        self.update(tokens)
        for word in range(self.width):
            if tokens[word] is not None:
                self.source[word] = first

    def add(
        self,
        line: int,
        kind: str,
        role: str,
        span: Iterable[tuple[int, int]],
        body: int,
        *,
        carries_force: bool,
        refused: bool,
    ) -> None:
        """Append a row with the present pose."""
        self._line.append(line)
        self._kind.append(kind)
        self._role.append(role)
        self._flags.append(carries_force + 2 * refused + 4 * (not self._moved))
        self._moved = False
        self._poses.extend(self.values)
        self._source.extend(self.source)
        self._span.extend(chain.from_iterable(span))
        self._body.append(body)
        self._status.extend(self.status)
        self._feed.append(self.feed_mm_per_min)
        self._blend.append(0.0 if role == "via" else self.blend_mm)

    def stand_in(self, line: int, kind: str, values: Iterable[float], *, moved: bool = False) -> None:
        """A first row that nothing changes, for the last motion of the piece of the program before this one."""
        self.values = list(values)
        self.add(line, kind, "point", [UNWRITTEN] * self.width, -1, carries_force=False, refused=False)
        self._moved = moved

    def add_run(self, line: int, kind: str, spans: Offsets, values: Floats, words: list[int], body: Offsets) -> None:
        """Append L rows of motions under force on consecutive lines, each of which writes all words of the pose.

        Parameters
        ----------
        line
            Of the first.
        spans, values
            (L, T, 2) and (L, T) of the words (of `values`) that are written; the others stay what they are.
        body
            (L,) see `Program.body`.
        """
        count, width = len(values), self.width
        rows = np.arange(len(self), len(self) + count, dtype=np.int32)
        poses = np.tile(np.array(self.values), (count, 1))
        poses[:, words] = values
        self._line.frombytes(np.arange(line, line + count, dtype=np.int32).tobytes())
        self._kind.extend([kind] * count)
        self._role.extend(["point"] * count)
        self._flags.extend([1 + 4 * (not self._moved), *[5] * (count - 1)])
        self._moved = False
        self._poses.frombytes(poses.tobytes())
        self._source.frombytes(np.repeat(rows, width).tobytes())
        pose = [words.index(word) for word in range(width)]
        self._span.frombytes(np.ascontiguousarray(spans[:, pose], dtype=np.int32).tobytes())
        self._body.frombytes(body.astype(np.int32).tobytes())
        self._status.extend(self.status * count)
        self._feed.extend([self.feed_mm_per_min] * count)
        self._blend.extend([self.blend_mm] * count)
        self.values = poses[-1].tolist()
        self.source = [int(rows[-1])] * width

    def line(self, row: int) -> int:
        """Line of a row."""
        return self._line[row]

    def carries_force(self, row: int) -> bool:
        """Whether a row is of a motion that carries force."""
        return self._flags[row] & 1 == 1

    def refuse(self, row: int) -> None:
        """Mark a row that turns out not to be correctable after all; both rows of an arc."""
        other = {"via": row + 1, "end": row - 1}.get(self._role[row], row)
        for mine in (row, other):
            self._flags[mine] |= 2

    def build(
        self,
        raw: bytes,
        dialect: str,
        path: str,
        unit: Floats | None = None,
        others: Iterable[tuple[str, bytes]] = (),
        **said: object,
    ) -> Program:
        """The program.

        Parameters
        ----------
        raw, path
            The file with the motions.
        unit
            (3 + K,) scales words from tokens to mm and units of the convention.
        others
            Path and bytes of further files; their spans count on from the end of the file before.
        said
            Frames, refusals, notes, warnings.
        """
        count, width = len(self._line), self.width
        unit = np.ones(width) if unit is None else unit
        files = [(path, raw), *others]
        ends = np.cumsum([len(content) for _, content in files]).tolist()
        parts = tuple(Part(name, end - len(content), end) for (name, content), end in zip(files, ends, strict=True))
        poses = np.frombuffer(self._poses, dtype=float).reshape(count, width + EXTERNALS)
        flags = np.frombuffer(bytes(self._flags), dtype=np.uint8)
        return Program(
            raw=b"".join(content for _, content in files) if len(files) > 1 else raw,
            dialect=dialect,
            path=path,
            parts=parts,
            convention=self.convention,
            line=_ints(self._line, count),
            kind=np.array(self._kind, dtype=np.str_),
            role=np.array(self._role, dtype=np.str_),
            carries_force=(flags & 1) == 1,
            refused=(flags & 2) == 2,
            position_mm=poses[:, :3] * unit[:3],
            orientation=poses[:, 3:width] * unit[3:],
            external=poses[:, width:].copy(),
            status=np.frombuffer(self._status, dtype=np.int8).reshape(count, 3).astype(np.int32),
            feed_mm_per_min=np.frombuffer(self._feed, dtype=float).copy(),
            blend_mm=np.frombuffer(self._blend, dtype=float).copy(),
            span=_ints(self._span, count, width, 2),
            source=_ints(self._source, count, width),
            also=_ints(self.also, len(self.also) // 3, 3),
            body=_ints(self._body, count),
            unit=unit,
            follows=(flags & 4) == 4,
            **said,  # type: ignore[arg-type]
        )


def _ints(values: array[int], *shape: int) -> Ints:
    return np.frombuffer(values, dtype=np.int32).reshape(shape).copy()
