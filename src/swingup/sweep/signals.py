"""Signals to a local worker: the run in progress is saved before the worker ends.

The module is light, so that a fresh process starts at once; what a job needs is imported with the job.
"""

import signal
from types import FrameType
from typing import Protocol


class Stoppable(Protocol):
    """What can be asked to end: a training run."""

    def stop(self) -> None:
        """End after the chunk in progress."""


in_progress: list[Stoppable] = []
"""The runs that this process trains."""


def stop_on_signals() -> None:
    """In a local worker, let Ctrl-C and SIGTERM end the worker after the run in progress has saved its chunk."""

    def end(number: int, frame: FrameType | None) -> None:
        if number == signal.SIGINT or not in_progress:  # a second Ctrl-C does not wait
            signal.signal(number, signal.SIG_DFL)
        if not in_progress:
            signal.raise_signal(number)
        for run in in_progress:
            run.stop()

    signal.signal(signal.SIGINT, end)
    signal.signal(signal.SIGTERM, end)
