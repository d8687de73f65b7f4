"""Feeds damaged programs and plain noise to every dialect's reader: nothing but InputError may come out, soon, in bounded memory.

    python benchmarks/fuzz_dialects.py [--examples 2000] [--seed 0] [--dialect gcode ...]

Three kinds of input a dialect: real programs and snippets with pieces deleted, doubled, swapped and overwritten; words of all
dialects in any order; long runs of one piece (a parser that looks back at what it has read takes the square of their length).
What is read must be written back byte for byte with no correction, and a corrected program must read as the same motions.
Prints what it fed and what came out; exit code 1 where a reader failed, with the smallest input found. Needs the test extra.
"""

from __future__ import annotations

import argparse
import resource
import signal
import sys
import time
from collections import Counter
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path

import numpy as np
from fuzz_seeds import POINTS, SNIPPETS, VAL3, WORDS, long_runs, mutated, seeds_of
from hypothesis import HealthCheck, Phase, given, seed, settings
from hypothesis import strategies as st

from drake_stiffness.errors import InputError
from toolpaths.formats import DIALECTS, Dialect
from toolpaths.linearise import linearise
from toolpaths.rewriting import rewrite

# Processor seconds for one input of at most a few kB, and for a long one; bytes of address space that all of it may take beyond the start.
SECONDS, LONG_SECONDS, MEMORY = 5.0, 30.0, 2 << 30


@dataclass
class Tally:
    """What came out of one dialect's reader."""

    fed: Counter[str] = field(default_factory=Counter)
    read: int = 0
    motions: int = 0
    refused: int = 0
    slowest: float = 0.0
    failures: list[str] = field(default_factory=list)


class TooLong(Exception):
    """An input took longer than it may."""


@contextmanager
def at_most(seconds: float) -> Iterator[None]:
    """Interrupts what takes longer on the processor, however busy the machine is."""

    def late(*_: object) -> None:
        raise TooLong(f"longer than {seconds:g} s")

    before = signal.signal(signal.SIGPROF, late)
    signal.setitimer(signal.ITIMER_PROF, seconds)
    try:
        yield
    finally:
        signal.setitimer(signal.ITIMER_PROF, 0)
        signal.signal(signal.SIGPROF, before)


def feed(
    dialect: Dialect, raw: bytes, tally: Tally, kind: str, seconds: float = SECONDS, points: bytes | None = None
) -> None:
    """One input through reader, rewriter and reader again; raises where a promise is broken."""
    tally.fed[kind] += 1
    name, own = POINTS.get(dialect.name, ("", b""))
    others = [(name, own if points is None else points)] if name else []
    begin = time.process_time()
    with at_most(seconds):
        dialect.recognises(raw, "")
        try:
            program = dialect.parse(raw, "fuzzed", others)
        except InputError:
            tally.refused += 1
            return
        finally:
            tally.slowest = max(tally.slowest, time.process_time() - begin)
        tally.read += 1
        tally.motions += len(program)
        change = np.ones(len(program), bool)
        same = rewrite(program, program.position_mm, program.orientation, change)
        assert b"".join(same.parts) == program.raw, "no correction, and other bytes"
        known = np.isfinite(program.position_mm).all(axis=1)
        for insert in (False, True):
            out = rewrite(program, program.position_mm + 0.37, program.orientation, known, allow_insert=insert)
            again = dialect.parse(out.parts[0], "fuzzed", [(name, part) for part in out.parts[1:]])
            assert len(again) == len(program), "the corrected program reads as another number of motions"
            assert insert or b"".join(out.parts).count(b"\n") == program.raw.count(b"\n"), "other lines"
        if dialect.name in ("gcode", "apt"):
            with suppress(InputError):
                moves = linearise(program, 0.1)
                assert len(moves.raw) < 100 * len(raw) + 10_000_000, "too many straight moves"


def fuzz(dialect: Dialect, examples: int, number: int) -> Tally:
    """All kinds of input for one dialect."""
    tally, seeds = Tally(), seeds_of(dialect)
    quiet = settings(
        max_examples=examples,
        deadline=None,
        database=None,
        suppress_health_check=list(HealthCheck),
        phases=[Phase.generate, Phase.shrink],
    )
    kinds = {
        "damaged programs": mutated(seeds),
        "words in any order": st.lists(WORDS, max_size=60).map(b"".join),
        "noise": st.binary(max_size=400),
    }
    if dialect.name in POINTS:
        kinds["damaged points"] = mutated([POINTS[dialect.name][1]])
    whole = VAL3 if dialect.name == "val3" else SNIPPETS[-1]
    for kind, inputs in kinds.items():
        run = partial(feed, dialect, tally=tally, kind=kind)
        if kind == "damaged points":
            run = partial(_feed_points, dialect, whole, tally)
        try:
            _feeder(run, inputs, quiet, number)()
        except Exception as error:
            notes = " ".join(getattr(error, "__notes__", []))[:600]
            tally.failures.append(f"{kind}: {type(error).__name__}: {error}; {notes}")
    for raw in long_runs(seeds):
        try:
            feed(dialect, raw, tally, "long runs", LONG_SECONDS)
        except Exception as error:
            tally.failures.append(
                f"long runs: {type(error).__name__}: {error}; input: {raw[len(seeds[0]) :][:30]!r} again and again"
            )
    return tally


def _feed_points(dialect: Dialect, program: bytes, tally: Tally, points: bytes) -> None:
    feed(dialect, program, tally, "damaged points", points=points)


def _feeder(
    feed_one: Callable[[bytes], None], inputs: st.SearchStrategy[bytes], quiet: settings, number: int
) -> Callable[[], None]:
    @seed(number)
    @quiet
    @given(inputs)
    def run(raw: bytes) -> None:
        try:
            feed_one(raw)
        except Exception as error:
            error.add_note(f"input: {raw!r}")
            raise

    return run


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--examples", type=int, default=2000, help="inputs of each random kind and dialect")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--dialect", nargs="*", help="default: all")
    options = parser.parse_args()
    used = (
        int(Path("/proc/self/statm").read_text().split()[0]) * resource.getpagesize() if Path("/proc").exists() else 0
    )
    resource.setrlimit(resource.RLIMIT_AS, (used + MEMORY, resource.RLIM_INFINITY))
    failed = False
    print(
        f"{'dialect':10} {'fed':>7} {'read':>7} {'motions':>8} {'InputError':>10} {'failures':>8} {'slowest, s':>10} {'seconds':>8}"
    )
    for dialect in DIALECTS:
        if options.dialect and dialect.name not in options.dialect:
            continue
        begin = time.perf_counter()
        tally = fuzz(dialect, options.examples, options.seed)
        spent = time.perf_counter() - begin
        fed = sum(tally.fed.values())
        print(
            f"{dialect.name:10} {fed:7} {tally.read:7} {tally.motions:8} {tally.refused:10} {len(tally.failures):8} "
            f"{tally.slowest:10.2f} {spent:8.1f}",
            flush=True,
        )
        for failure in tally.failures:
            print("   ", failure, flush=True)
        failed = failed or bool(tally.failures)
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / (1 << 20 if sys.platform == "darwin" else 1 << 10)
    print(f"peak memory {peak:.0f} MiB, limit {(used + MEMORY) >> 20} MiB of addresses")
    return 1 if failed else 0


if __name__ == "__main__":
    raise SystemExit(main())
