"""What all benchmarks share: machine and versions, tables, stopwatches, and children of their own for peak memory.

Nothing here judges: a benchmark prints what it measured, and people read it.
"""

from __future__ import annotations

import json
import os
import platform
import resource
import statistics
import subprocess
import sys
import time
from collections import defaultdict
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from datetime import date
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any

ROOT = Path(__file__).parents[1]
KR270 = ROOT / "examples" / "kr270"
# On a machine that does other things as well, two BLAS threads that wait for each other turn 1 ms into 100 ms. Benchmarks
# therefore run with one; set these variables to measure with more.
THREADS = ("OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "VECLIB_MAXIMUM_THREADS")
PACKAGES = ("drake-stiffness", "numpy", "drake", "cvxpy", "clarabel", "eaik", "pin")


def machine() -> str:
    """CPU model, cores this process may use, memory, and how busy the machine is with other things."""
    model = platform.processor() or platform.machine()
    info = Path("/proc/cpuinfo")
    if info.exists():
        names = [
            line.split(":", 1)[1].strip() for line in info.read_text().splitlines() if line.startswith("model name")
        ]
        model = names[0] if names else model
    cores = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count()
    memory = os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES") / 2**30
    return f"{model}, {cores} cores, {memory:.0f} GiB, {platform.system()}; load average {os.getloadavg()[0]:.1f}, BLAS threads {environment()[THREADS[0]]}"


def versions() -> str:
    """Python and the packages that matter, without importing them."""
    found = [f"python {platform.python_version()}"]
    for name in PACKAGES:
        try:
            found.append(f"{name} {version(name)}")
        except PackageNotFoundError:
            found.append(f"{name} not installed")
    return ", ".join(found)


def show(title: str, header: Sequence[str], rows: Sequence[Sequence[str]], notes: Sequence[str] = ()) -> None:
    """Print a table, what it was measured on, and notes; as Markdown where stdout is no terminal."""
    print(f"\n{title}\n\n{machine()}\n{versions()}; {date.today().isoformat()}\n")
    if sys.stdout.isatty():
        from rich.console import Console
        from rich.table import Table

        table = Table()
        for place, name in enumerate(header):
            table.add_column(name, justify="right" if place else "left")
        for row in rows:
            table.add_row(*row)
        Console().print(table)
    else:
        width = [max(len(cell) for cell in column) for column in zip(header, *rows, strict=True)]
        rule = [("-" * w if not place else "-" * (w - 1) + ":") for place, w in enumerate(width)]
        for row in (header, rule, *rows):
            cells = (c.rjust(w) if place else c.ljust(w) for place, (c, w) in enumerate(zip(row, width, strict=True)))
            print(f"| {' | '.join(cells)} |")
    print("\n".join(("", *notes)) if notes else "", flush=True)


class Stopwatch:
    """Seconds by name; the time of inner stopwatches is taken off the outer one, so that names never overlap."""

    def __init__(self, clock: Callable[[], float] = time.perf_counter) -> None:
        self._clock = clock
        self.seconds: dict[str, float] = defaultdict(float)
        self._inner: list[float] = []

    @contextmanager
    def __call__(self, name: str) -> Iterator[None]:
        self._inner.append(0.0)
        start = self._clock()
        try:
            yield
        finally:
            spent = self._clock() - start
            self.seconds[name] += spent - self._inner.pop()
            if self._inner:
                self._inner[-1] += spent

    def watch(self, owner: Any, attribute: str, name: str) -> None:
        """Count every call of a function or method of a module or class under `name`, from now on."""
        function = getattr(owner, attribute)

        def counted(*args: Any, **kwargs: Any) -> Any:
            with self(name):
                return function(*args, **kwargs)

        setattr(owner, attribute, counted)


def timed(function: Callable[[], object]) -> float:
    """Seconds of one call."""
    start = time.perf_counter()
    function()
    return time.perf_counter() - start


def in_turn(functions: dict[str, Callable[[], object]], rounds: int) -> dict[str, list[float]]:
    """Seconds of every function, one after the other in every round, so that a busy machine slows all of them alike."""
    seconds: dict[str, list[float]] = {name: [] for name in functions}
    for _ in range(rounds):
        for name, function in functions.items():
            seconds[name].append(timed(function))
    return seconds


def spread(values: Sequence[float], scale: float = 1.0, digits: int = 2) -> str:
    """Median with smallest and largest."""
    low, middle, high = min(values) * scale, statistics.median(values) * scale, max(values) * scale
    return f"{middle:.{digits}f} ({low:.{digits}f}-{high:.{digits}f})"


def peak_mib() -> float:
    """Largest resident memory of this process so far, MiB (of this program alone, not of what started it)."""
    status = Path("/proc/self/status")
    if status.exists():
        for line in status.read_text().splitlines():
            if line.startswith("VmHWM"):
                return int(line.split()[1]) / 1024
    unit = 1 if sys.platform == "darwin" else 1024
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * unit / 2**20


def environment() -> dict[str, str]:
    """Of children: one BLAS thread unless the caller says otherwise (see `THREADS`)."""
    return {name: "1" for name in THREADS} | dict(os.environ)


@dataclass(frozen=True)
class Child:
    """How a process of its own ended: what it printed as JSON, or why it gave nothing; wall seconds, peak memory."""

    result: dict[str, Any] | None
    why: str
    seconds: float
    peak_mib: float


def child(command: Sequence[str], *, limit_s: float = 120.0, limit_gib: float = 12.0, parse: bool = True) -> Child:
    """Run a process alone with limits on time and address space, and watch its peak memory."""

    def confine() -> None:
        if sys.platform == "linux":
            resource.setrlimit(resource.RLIMIT_AS, (int(limit_gib * 2**30),) * 2)

    start = time.perf_counter()
    pipe = subprocess.PIPE
    with subprocess.Popen(command, stdout=pipe, stderr=pipe, preexec_fn=confine, env=environment()) as process:
        try:
            out, err = process.communicate(timeout=limit_s)
        except subprocess.TimeoutExpired:
            process.kill()
            process.communicate()
            return Child(None, f"more than {limit_s:.0f} s", time.perf_counter() - start, float("nan"))
    seconds = time.perf_counter() - start
    if process.returncode:
        last = err.decode(errors="replace").strip().splitlines()[-1:] or [f"exit code {process.returncode}"]
        memory = process.returncode < 0 or "MemoryError" in last[0] or "alloc" in last[0]
        why = f"out of memory ({limit_gib:.0f} GiB allowed)" if memory else last[0]
        return Child(None, why, seconds, float("nan"))
    result = json.loads(out.decode().strip().splitlines()[-1])
    return Child(result, "", seconds, float(result["peak_mib"]))


def worker(script: str, *args: str) -> list[str]:
    """The command that runs a benchmark's own file again as a child."""
    return [sys.executable, script, "--worker", *args]
