"""Workers on this machine: one process each, used for job after job, so that Drake is imported once a worker.

Every worker is a pool of its own. A pool does not say which of its processes died, and ends all of them when one does; so a
job that kills its worker is known, and the others go on.
"""

from __future__ import annotations

import faulthandler
import multiprocessing
import os
import signal
import sys
import threading
import time
from collections import deque
from collections.abc import Generator, Iterator, Sequence
from concurrent.futures import FIRST_COMPLETED, Future, ProcessPoolExecutor, wait
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager
from io import TextIOWrapper

from drake_stiffness.studies.state import State
from drake_stiffness.studies.worker import ONE_THREAD, Task, perform


def on_this_machine(tasks: Sequence[Task], processes: int) -> Generator[State, None, None]:
    """Do tasks in so many processes; states in the order in which they end. Closed early, it ends the workers."""
    waiting, running = deque(tasks), dict[Future[State], tuple[Task, _Worker, float]]()
    with _one_thread_each():
        workers = [_Worker() for _ in range(min(processes, len(tasks)))]
        try:
            free = list(workers)
            while waiting or running:
                while waiting and free:
                    task, worker = waiting.popleft(), free.pop()
                    running[worker.submit(task)] = task, worker, time.monotonic()
                for future in wait(running, return_when=FIRST_COMPLETED).done:
                    task, worker, since = running.pop(future)
                    free.append(worker)
                    yield _ended(future, task, worker, time.monotonic() - since)
        finally:
            for worker in workers:
                worker.stop(at_once=bool(running))


def _ended(future: Future[State], task: Task, worker: _Worker, seconds: float) -> State:
    """The state of a task that is over, also if its worker is."""
    try:
        return future.result()
    except BrokenProcessPool:
        state = task.lost(f"its worker process {worker.end()}", round(seconds, 3))
    state.write(task.folder)
    return state


class _Worker:
    """A process that does one task after the other, and is made anew if it dies."""

    def __init__(self) -> None:
        self._pool: ProcessPoolExecutor | None = None
        self._process: multiprocessing.process.BaseProcess | None = None

    def submit(self, task: Task) -> Future[State]:
        """Begin a task."""
        if self._pool is not None:
            try:
                return self._pool.submit(perform, task)
            except BrokenProcessPool:  # it died between two tasks
                self._pool.shutdown(wait=False)
        # A forked process would hold half of what the threads of this one were doing.
        self._pool = ProcessPoolExecutor(1, mp_context=multiprocessing.get_context("spawn"), initializer=_begin)
        before = set(multiprocessing.active_children())
        future = self._pool.submit(perform, task)
        self._process = next(iter(set(multiprocessing.active_children()) - before), None)
        return future

    def end(self) -> str:
        """How the process ended, in words."""
        if self._pool is not None:
            self._pool.shutdown()  # its process is waited for, so that how it ended is known
        code = None if self._process is None else self._process.exitcode
        if code is None or code >= 0:
            return f"ended by itself (exit code {code})"
        name = signal.Signals(-code).name
        hint = " (out of memory?)" if name == "SIGKILL" else ""
        return f"was killed by {name}{hint}"

    def stop(self, at_once: bool) -> None:
        """End the process, in the middle of a task if need be."""
        if self._pool is None:
            return
        if at_once and self._process is not None:
            self._process.kill()
        self._pool.shutdown(wait=not at_once, cancel_futures=True)


def _begin() -> None:
    """Set a new worker up: it leaves Ctrl-C to the study, ends with it, and says where it crashes."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    threading.Thread(target=_end_with_the_study, daemon=True).start()
    faulthandler.enable()
    if isinstance(sys.stdout, TextIOWrapper):
        sys.stdout.reconfigure(line_buffering=True)


def _end_with_the_study() -> None:
    parent = multiprocessing.parent_process()
    if parent is not None:
        parent.join()
        os._exit(1)


@contextmanager
def _one_thread_each() -> Iterator[None]:
    """Processes that are started within use one thread for their matrices."""
    before = {name: os.environ.get(name) for name in ONE_THREAD}
    os.environ.update(ONE_THREAD)
    try:
        yield
    finally:
        for name, value in before.items():
            if value is None:
                os.environ.pop(name)
            else:
                os.environ[name] = value
