"""A running folder as a controller in plain Python, for the judge's loop: as fast as it goes, or in real time."""

import itertools
import math
import time
from dataclasses import dataclass, field

import numpy as np

from .process import FolderProcess

WATCHED_TIME = 0.0005
"""The last part of a wait (s) is spent looking at the clock: a sleep may last longer than asked."""


@dataclass
class Timing:
    """What was measured of a run's calls (s)."""

    calls: list[float] = field(default_factory=list)
    """Time inside each call."""
    sent: list[float] = field(default_factory=list)
    """When each call began."""
    missed: int = 0
    """Periods that ended without an answer: the motors kept the torques before."""
    late: int = 0
    """Periods that began late because the simulation, not the controller, was slow."""

    @property
    def periods(self) -> list[float]:
        """Times between calls."""
        return [after - before for before, after in itertools.pairwise(self.sent)]


class FolderController:
    """Calls the folder at every step and waits for its answer; a fault raises ``SwingupError``.

    With a period (s) it does so in real time, one step a period, as a robot's loop runs. A controller whose answer
    takes longer is not called again until it is there. Meanwhile the motors keep the torques before, and the
    simulation goes on.
    """

    def __init__(self, process: FolderProcess, period: float | None = None) -> None:
        """Wrap a running folder; the simulation's clock may say other periods than the nominal one."""
        self._process, self._period, self.timing = process, period, Timing()
        # The first period begins when it is asked for.
        self._begin, self._time = -math.inf, 0.0
        self._held, self._busy = np.zeros(2), False

    def get_control_output(self, x: np.ndarray, t: float) -> np.ndarray:
        """The torques (2,) (N m) that act from time t (s), for the state x (4,) that is measured then."""
        end = math.inf if self._period is None else self._wait(t, self._period) + self._period
        if not self._busy:
            self._process.send(t, x)
        reply = self._process.receive(end - time.perf_counter())
        self._busy = reply is None
        if reply is None:
            self.timing.missed += 1
        else:
            self._held, seconds = reply
            self.timing.calls.append(seconds)
        return self._held

    def _wait(self, t: float, period: float) -> float:
        """Wait for the period that begins at time t (s) of the simulation; when it began."""
        now, due = time.perf_counter(), self._begin + t - self._time
        # A loop that is late does not catch up: its next period begins now, as a robot's does.
        self.timing.late += math.isfinite(due) and not self._busy and now > due + 0.5 * period
        if due - now > WATCHED_TIME:
            time.sleep(due - now - WATCHED_TIME)
        while (now := time.perf_counter()) < due:
            pass
        self._begin, self._time = now, t
        if not self._busy:
            self.timing.sent.append(now)
        return now
