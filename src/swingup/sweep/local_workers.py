"""Fresh local processes for the runs of a sweep; the death of one does not affect the others."""

import multiprocessing
import threading
from collections.abc import Callable
from concurrent.futures import Executor, Future, ProcessPoolExecutor, ThreadPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from typing import Any

from ..common.errors import SwingupError
from .signals import stop_on_signals

ATTEMPTS = 2
"""Attempts at a job whose worker dies: the job itself may kill it, for example by its need for memory."""


class LocalWorkers(Executor):
    """Several local processes, each in a pool of its own.

    In one common pool the death of a process would break all jobs. Here its job starts again in a fresh process,
    where a training run resumes from its checkpoint. The other processes continue.
    """

    def __init__(self, count: int) -> None:
        """Prepare ``count`` processes, which start when they are first needed."""
        self._threads = ThreadPoolExecutor(count, "sweep")
        # The program's own processes, which stop() leaves alone.
        self._others = set(multiprocessing.active_children())
        self._lock = threading.Lock()
        self._idle: list[ProcessPoolExecutor] = []
        self._closing = False

    def submit(self, fn: Callable[..., Any], /, *args: Any, **kwargs: Any) -> Future[Any]:
        """Call a function in the next process that is free."""
        return self._threads.submit(self._call, fn, args, kwargs)

    def shutdown(self, wait: bool = True, *, cancel_futures: bool = False) -> None:
        """Accept no more calls, and free the processes."""
        self._threads.shutdown(wait=wait, cancel_futures=cancel_futures)
        for pool in self._idle:
            pool.shutdown(wait=wait)

    def stop(self) -> None:
        """Ask the jobs in progress to end, wait until they have saved, and start no other."""
        with self._lock:
            self._closing = True
        for worker in set(multiprocessing.active_children()) - self._others:
            # SIGTERM: the worker saves its run before it ends (stop_on_signals).
            worker.terminate()
        self.shutdown(cancel_futures=True)

    def _call(self, fn: Callable[..., Any], args: tuple[Any, ...], kwargs: dict[str, Any]) -> Any:
        for _ in range(ATTEMPTS):
            # Under the lock, so that no process starts after ``stop`` looked for them.
            with self._lock:
                if self._closing:
                    raise SwingupError("the sweep was stopped: give the same command again, it goes on")
                pool = self._idle.pop() if self._idle else _new_pool()
                future = pool.submit(fn, *args, **kwargs)
            error = future.exception()  # waits for the job
            if not isinstance(error, BrokenProcessPool):
                with self._lock:
                    self._idle.append(pool)
                return future.result()
            pool.shutdown()
        raise SwingupError(
            f"its worker died {ATTEMPTS} times: was memory short? The same command goes on from its checkpoint"
        )


def _new_pool() -> ProcessPoolExecutor:
    # A fresh process: JAX does not survive a fork.
    return ProcessPoolExecutor(1, multiprocessing.get_context("spawn"), stop_on_signals)
