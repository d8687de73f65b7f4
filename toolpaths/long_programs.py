"""`compensate` for a file of any length: long programs are corrected piece by piece, in two processes, in constant memory.

Every piece is a job of its own (`job.compensate`). What a piece needs of those before it - frames, feed, external axes, the
last position - the dialect hands on; the posture that its branch goes on from is at first a guess, the last one known, and is
checked when the piece before is done: where the guess would have led to another branch, the piece is done again. A program of
one piece is that one job. What must see the whole path at once (friction and play, a probe, the choice of the spin, a removal
model, stored points) is not cut.
"""

from __future__ import annotations

import contextlib
import hashlib
import os
import tempfile
import weakref
from collections import deque
from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from itertools import islice
from pathlib import Path
from typing import IO, Any

import numpy as np
from numpy.typing import NDArray

from drake_stiffness.errors import InputError
from drake_stiffness.model import Model
from toolpaths.account.evenness import End, Evenness, across
from toolpaths.account.folding import KEPT, LongCompensation, folded, give_bins, rows_of, tallied, thinned
from toolpaths.compensation import bench_of
from toolpaths.forces import ForceRows
from toolpaths.formats import read_program
from toolpaths.formats.pieces import PIECE_BYTES, comes_in_pieces, length, pack, pieces
from toolpaths.formats.reading import NeedsWhole
from toolpaths.job import Progress, compensate, silent
from toolpaths.loaded_path import postures_on, targets
from toolpaths.process import Process, external_positions, governing, posture, refuse_changes
from toolpaths.program import FrameSetting, Program, Refusal, quantum_mm
from toolpaths.refusals import refuse
from toolpaths.result import Compensation
from toolpaths.rotary import declare

Floats = NDArray[np.float64]
Ints = NDArray[np.int_]

PROCESSES = 2
# Postures agree to this (rad and m) where a piece was started from the right one.
_SAME_POSTURE = 1e-6


def compensate_file(
    path: Path,
    model: Model,
    process: Process,
    *,
    dialect: str | None = None,
    allow_insert: bool = False,
    keep_refused: bool = False,
    linear: bool = False,
    output: Path | None = None,
    size: int = PIECE_BYTES,
    processes: int = PROCESSES,
    progress: Progress = silent,
) -> Compensation:
    """Correct a program of any length; see `job.compensate` for what is said of every piece.

    Parameters
    ----------
    dialect, allow_insert, keep_refused, linear
        See `formats.read_program` and `job.compensate`.
    output : Path, optional
        Where the corrected program will go: a long one is gathered in a file beside it. Without it nothing is kept.
    size : bytes of a piece, about
    processes : how many work at once

    Raises
    ------
    InputError, UntrustworthyError
        As `job.compensate`, for the first piece that fails.
    """
    if comes_in_pieces(path, dialect, size) and not _needs_whole(model, process):
        with contextlib.suppress(NeedsWhole):
            job = _Job(path, model, process, dialect, allow_insert, keep_refused, linear, output, size)
            return job.run(processes, progress)
    program = read_program(path, dialect)
    return compensate(
        program, model, process, allow_insert=allow_insert, keep_refused=keep_refused, linear=linear, progress=progress
    )


def _needs_whole(model: Model, process: Process) -> bool:
    milling = process.force.milling
    if milling is not None and (milling.heightfield is not None or milling.engagement is not None):
        return True
    return bench_of(model, process.reference, process.geometry).remembers


@dataclass(frozen=True, eq=False)
class _Done:
    """A piece.

    Attributes
    ----------
    raw
        The corrected bytes.
    result, facts
        Its account, thinned, and what it says of itself; None and nothing where it has no motion under force.
    first, last
        Postures of its first and last point.
    begin, end
        These points where the path goes on to them from the piece before, and from them to the piece after.
    """

    raw: bytes
    result: Compensation | None = None
    facts: dict[str, Any] = field(default_factory=dict)
    first: Floats | None = None
    last: Floats | None = None
    begin: End | None = None
    end: End | None = None


def _correct(
    program: Program, model: Model, process: Process, options: dict[str, bool], lead: Floats | None, most: int
) -> _Done:
    """One piece; also run in other processes."""
    if not program.corrected.any():
        refuse(program, program.refusals, options["keep_refused"])
        return _Done(program.raw)
    result = compensate(program, model, process, lead=lead, **options)  # type: ignore[arg-type]
    q, rows = result.path.postures.q, result.rows
    return _Done(
        result.raw,
        thinned(result, most),
        result.to_dict(tallied),
        q[:, 0].copy(),
        q[:, -1].copy(),
        # The first row of a piece stands for the last motion of the one before.
        _end(result, 0) if rows[0] == 1 and result.program.follows[1] else None,
        _end(result, -1) if rows[-1] == len(result.program) - 1 else None,
    )


def _end(result: Compensation, at: int) -> End:
    quantum = float(quantum_mm(result.program)[result.rows[at]])
    return End(result.target_mm[at].copy(), result.correction_mm[at].copy(), quantum, int(result.line[at]))


@dataclass(eq=False)
class _Job:
    """The job of a long program."""

    path: Path
    model: Model
    process: Process
    dialect: str | None
    allow_insert: bool
    keep_refused: bool
    linear: bool
    output: Path | None
    size: int

    def run(self, processes: int, progress: Progress) -> LongCompensation:
        """Correct all pieces and fold what they say."""
        self.options = {
            "allow_insert": self.allow_insert,
            "keep_refused": self.keep_refused,
            "linear": self.linear,
        }
        number = -(-length(self.path, self.dialect, self.size) // self.size)
        self.most = -(-KEPT // number)
        self.last: Floats | None = None  # of the latest piece that is done
        self.sent: dict[int, tuple[Program, Process, Floats | None]] = {}
        self.frames: list[FrameSetting] = []
        self.before = hashlib.sha256()
        spool, after = _Spool(self.output), hashlib.sha256()
        results, facts = [], []
        borders: list[tuple[Evenness, Ints]] = []
        before: End | None = None
        left: list[Refusal] = []
        notes: list[str] = []
        for index, done in enumerate(self._done(processes)):
            done = self._on_the_right_branch(index, done)
            program = self.sent.pop(index)[0]
            after.update(done.raw)
            spool.write(done.raw)
            if before is not None and done.begin is not None:
                borders.append(across(before, done.begin))
            before = done.end
            if done.result is not None:
                self.last = done.last
                results.append(done.result)
                facts.append(done.facts)
                if len(facts) > 1:
                    give_bins(facts[0], facts[-1])
            else:
                left += program.refusals
                notes += [*program.warnings, *(f"line {note.line}: {note.reason}" for note in program.notes)]
            progress("lines corrected", int(program.line[-1]) if len(program) else 0, 0)
        if not results:
            raise InputError(
                f"{self.path}: no linear or circular motion with a literal pose; there is nothing to correct."
            )
        written = spool.close()
        if written is not None:
            pack(self.path, self.dialect, written, self.size)
        result = folded(results, facts, borders, written, (self.before.hexdigest(), after.hexdigest()))
        result.facts["lines"] = self.lines
        result.notes.extend(list(dict.fromkeys(notes))[:20])
        kept = replace(result, refusals=(*result.refusals, *left))
        spool.belongs_to(kept)
        return kept

    def _done(self, processes: int) -> Iterator[_Done]:
        """The pieces in order; with more than one process a few are ahead."""
        if processes < 2 or not _plain(self.model):
            for program, process, lead in self._tasks():
                yield _correct(program, self.model, process, self.options, lead, self.most)
            return
        # A pool of its own: joblib would take a reusable one for one of those that it made, and fail.
        from joblib.externals.loky import ProcessPoolExecutor

        pool = ProcessPoolExecutor(max_workers=processes)
        ahead: deque[Any] = deque()
        tasks = self._tasks()
        try:
            while True:
                for program, process, lead in islice(tasks, processes + 1 - len(ahead)):
                    ahead.append(pool.submit(_correct, program, self.model, process, self.options, lead, self.most))
                if not ahead:
                    return
                yield ahead.popleft().result()
        finally:
            for task in ahead:
                task.cancel()
            pool.shutdown(wait=False, kill_workers=True)

    def _tasks(self) -> Iterator[tuple[Program, Process, Floats | None]]:
        """Every piece, its share of the force table, and the posture it is guessed to go on from."""
        table = ForceRows(self.process) if self.process.force.table is not None else None
        self.lines = 0
        for index, program in enumerate(pieces(self.path, self.dialect, self.size)):
            self.before.update(program.raw)
            self.lines += program.raw.count(b"\n")
            ended = program.raw.endswith(b"\n")
            self.frames += governing(program)
            refuse_changes(program, self.frames)
            self.frames = list({setting.what: setting for setting in self.frames}.values())
            rows = table.take(program) if table is not None else None
            process = self.process.with_force_rows(rows)
            self.sent[index] = program, process, self.last
            yield self.sent[index]
        self.lines += not ended
        if table is not None:
            table.finish(str(self.path))

    def _on_the_right_branch(self, index: int, done: _Done) -> _Done:
        """The piece as it is when its branch goes on from the piece before."""
        program, process, lead = self.sent[index]
        if done.first is None or self.last is None or lead is self.last:
            return done
        first = _first_posture(program, self.model, process, self.last)
        if np.abs(first - done.first).max() < _SAME_POSTURE:
            return done
        return _correct(program, self.model, process, self.options, self.last, self.most)


def _first_posture(program: Program, model: Model, process: Process, lead: Floats) -> Floats:
    """Posture (n,) of the first corrected point where the branch goes on from a given one."""
    one = declare(rows_of(program, np.flatnonzero(program.corrected)[:1]), process.gcode, process.path)
    bench, rows = bench_of(model, process.reference, process.geometry), np.zeros(1, dtype=int)
    R, p = targets(one, process, bench, posture(process, model))
    given = external_positions(process, one, model, rows)
    return np.asarray(postures_on(one, model, bench, rows, R, p, lead, given).q[:, 0])


def _plain(model: Model) -> bool:
    """Whether another process can know all effects: those of the user's own files are known here only."""
    return all(type(effect).__module__.startswith("drake_stiffness.") for effect in model.effects)


class _Spool:
    """The corrected program in the making: a file beside the output that goes when nobody takes it."""

    def __init__(self, output: Path | None) -> None:
        self._file: IO[bytes] | None = None
        self.path: Path | None = None
        if output is None:
            return
        try:
            number, name = tempfile.mkstemp(dir=output.parent, prefix=f".{output.name}.")
        except OSError as error:
            raise InputError(f"{output}: cannot be written ({error.strerror}); check that the folder exists.") from None
        self._file, self.path = os.fdopen(number, "wb"), Path(name)
        self._finalizer = weakref.finalize(self, _remove, str(self.path))

    def write(self, raw: bytes) -> None:
        if self._file is not None:
            self._file.write(raw)

    def close(self) -> Path | None:
        if self._file is not None:
            self._file.close()
        return self.path

    def belongs_to(self, owner: object) -> None:
        """The file goes with its owner instead, if it is still there then."""
        if self.path is not None:
            self._finalizer.detach()
            weakref.finalize(owner, _remove, str(self.path))


def _remove(path: str) -> None:
    with contextlib.suppress(FileNotFoundError):
        os.unlink(path)
