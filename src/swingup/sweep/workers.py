"""The workers of a sweep: local processes, or those of a Dask cluster."""

import contextlib
import multiprocessing
import os
import signal
import threading
from collections.abc import Callable, Iterator
from concurrent.futures import Executor, Future, ProcessPoolExecutor, ThreadPoolExecutor
from multiprocessing.connection import Connection
from typing import Any

from ..common import cores
from ..common.checks import whole_number
from ..common.errors import SwingupError, needing


@contextlib.contextmanager
def workers_for(scheduler: str | None = None, count: int | None = None) -> Iterator[tuple[Executor, int]]:
    """An executor of local processes, or at a Dask scheduler's address, and how many runs it does side by side.

    The count of processes is by default one for every two cores, since a run uses about two; with a scheduler, of
    the trials of a search, one for each of the workers' threads.
    """
    if count is not None:
        whole_number("workers", count, 1, 1024)
    if scheduler is None:
        count = count or max(1, cores() // 2)
        with _local_processes(count) as executor:
            yield executor, count
        return
    with needing("Dask", "dask", "--scheduler"):
        from distributed import Client
    try:
        client = Client(scheduler, timeout=5)
    except (OSError, ValueError) as error:
        raise SwingupError(f"no Dask scheduler answers at {scheduler}: start one with dask scheduler") from error
    with client, client.get_executor() as executor:
        try:
            yield executor, count or max(1, sum(client.nthreads().values()))
        except BaseException:
            executor.shutdown(wait=False)  # cancels the runs that have not started
            raise


@contextlib.contextmanager
def _local_processes(count: int) -> Iterator[Executor]:
    """Threads that run each call in a fresh process; the processes end with an interrupt and with this process."""
    context = multiprocessing.get_context("spawn")  # JAX does not survive a fork
    # Nothing is ever sent. The system closes our end when this process dies, even by SIGKILL.
    lifeline, ours = context.Pipe(duplex=False)

    class FreshProcesses(ThreadPoolExecutor):
        def submit(self, fn: Callable[..., Any], /, *args: Any, **kwargs: Any) -> Future[Any]:
            def run() -> Any:
                # A process that dies, for example by its need for memory, breaks this pool and no other run.
                with ProcessPoolExecutor(1, context, _begin_worker, (lifeline,)) as pool:
                    return pool.submit(fn, *args, **kwargs).result()

            return super().submit(run)

    with lifeline, ours, FreshProcesses(count) as executor:
        try:
            yield executor
        except BaseException:  # Ctrl-C is not an Exception
            ours.close()
            executor.shutdown(cancel_futures=True)
            raise


def _begin_worker(lifeline: Connection) -> None:
    """Let a worker leave Ctrl-C to the process that started it, and end with it."""

    def wait_for_end() -> None:
        with contextlib.suppress(EOFError, OSError):
            lifeline.recv_bytes()
        os._exit(1)  # the run resumes from its checkpoint

    signal.signal(signal.SIGINT, signal.SIG_IGN)
    threading.Thread(target=wait_for_end, daemon=True).start()
