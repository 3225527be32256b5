"""The executor of a sweep: local processes, or the workers of a Dask cluster."""

import contextlib
import os
from collections.abc import Iterator
from concurrent.futures import Executor
from dataclasses import dataclass

from ..common.checks import whole_number
from ..common.errors import SwingupError
from .local_workers import LocalWorkers

MOST_WORKERS = 1024


@dataclass(frozen=True)
class Workers:
    """An executor, and how many runs it does side by side."""

    executor: Executor
    count: int


@contextlib.contextmanager
def executor_for(scheduler: str | None, workers: int | None) -> Iterator[Executor]:
    """The executor of :func:`workers_for`."""
    with workers_for(scheduler, workers) as pool:
        yield pool.executor


@contextlib.contextmanager
def workers_for(scheduler: str | None, workers: int | None) -> Iterator[Workers]:
    """A Dask cluster's executor if an address is given, else fresh local processes.

    Args:
        scheduler: address of a running Dask scheduler, such as ``tcp://10.0.0.1:8786``.
        workers: local processes, by default one for every two cores, since a run uses about two; with a scheduler,
            runs of a search side by side, by default one for each of the workers' threads.

    Raises:
        SwingupError: Dask is not installed, its scheduler does not answer, or ``workers`` is out of range.
    """
    if workers is not None:
        whole_number("workers", workers, 1, MOST_WORKERS)
    if scheduler is None:
        count = workers or max(1, (os.cpu_count() or 1) // 2)
        with LocalWorkers(count) as pool:
            try:
                yield Workers(pool, count)
            # Ctrl-C is no Exception, and local runs must still be saved.
            except BaseException:
                pool.stop()
                raise
        return
    try:
        from distributed import Client
    except ImportError as error:
        raise SwingupError("--scheduler needs Dask: pip install 'swingup[dask]'") from error
    try:
        client = Client(scheduler, timeout=5)
    except (OSError, ValueError) as error:
        raise SwingupError(f"no Dask scheduler answers at {scheduler}: start one with dask scheduler") from error
    with client, client.get_executor() as executor:
        try:
            yield Workers(executor, workers or max(1, sum(client.nthreads().values())))
        except BaseException:
            executor.shutdown(wait=False)  # cancels the runs that have not started
            raise
