"""Workers of a Dask cluster: whoever has one names its scheduler."""

from __future__ import annotations

from collections.abc import Generator, Sequence
from contextlib import closing

from drake_stiffness.errors import InputError
from drake_stiffness.studies.state import State
from drake_stiffness.studies.worker import Task, perform

_TIMEOUT_S = 20


def on_cluster(tasks: Sequence[Task], address: str) -> Generator[State, None, None]:
    """Do tasks on the workers of a scheduler; states in the order in which they end. Closed early, it cancels the rest.

    Raises
    ------
    InputError
        If Dask is not installed, nothing answers at the address, or a worker cannot do the study's jobs.
    """
    try:
        from distributed import Client, as_completed
        from distributed.scheduler import KilledWorker
    except ImportError:
        raise InputError(
            "--scheduler: the package `distributed` (Dask) is not installed here; install it with "
            "`pip install 'drake-stiffness[cluster]'`, or leave --scheduler out to run on this machine."
        ) from None
    try:
        client = Client(address, timeout=_TIMEOUT_S)
    except (OSError, ValueError) as error:
        raise InputError(
            f"--scheduler: no Dask scheduler answers at '{address}' ({error}). Expected an address such as tcp://10.0.0.5:8786; "
            "`dask scheduler` prints it."
        ) from None
    with closing(client):
        futures = {client.submit(perform, task, pure=False): task for task in tasks}
        try:
            for future in as_completed(futures):
                if isinstance(future.exception(), KilledWorker):
                    state = futures[future].lost("its worker died, and so did those that tried again")
                    state.write(futures[future].folder)
                    yield state
                else:
                    yield future.result()
        finally:
            client.cancel(list(futures))
