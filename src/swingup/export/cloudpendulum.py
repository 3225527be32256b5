"""A controller as CloudPendulum's client calls it, with NumPy alone.

Its example makes a new controller for each run by a call of ``ControllerType``, then calls
``get_control_output(state)`` in a loop. It gives no time: the controller reads a clock. Nothing is inherited from
the client's package, which is there only on its own machines.
"""

import time
from collections.abc import Callable, Sequence
from typing import Any, Protocol

import numpy as np

from ..policy.contract import LoopController
from ..policy.guard import Fault

WARM_UP = 20  # Calls before the first one: NumPy's own first calls take milliseconds


class MotorState(Protocol):
    """What the client tells of one joint."""

    position: float  # rad; 0 hangs down, and the elbow's counts from link 1
    velocity: float  # rad/s


class CloudPendulumController:
    """A controller for one run, or for more with ``reset()`` between them; in one thread.

    The first call is at time 0, however long ago the object was made.
    """

    def __init__(self, controller: LoopController[Any], clock: Callable[[], float] = time.perf_counter) -> None:
        """Wrap a controller; the clock tells the time (s) of any origin, and must not go backward."""
        self.robot, self.guard = controller.robot, controller.guard
        self._controller, self._clock = controller, clock
        for step in range(WARM_UP):
            # At increasing times, which a guard asks for.
            controller(np.zeros(4), 0.002 * step)
        self.reset()

    def reset(self) -> None:
        """Begin a run: no memory, and a guard lets the controller act again."""
        self._start: float | None = None
        self._controller.reset()

    @property
    def fault(self) -> Fault | None:
        """Why the safety guard stopped the controller; None while it acts, or without a guard."""
        return self._controller.fault

    def get_control_output(self, state: Sequence[MotorState]) -> list[float]:
        """The torques [u1, u2] (N m) for the measured positions (rad) and velocities (rad/s) of both joints."""
        # First of all: what the call takes is not a part of the measurement's time.
        now = self._clock()
        if self._start is None:
            self._start = now
        first, second = state[0], state[1]
        x = np.array([first.position, second.position, first.velocity, second.velocity], np.float64)
        torques: list[float] = self._controller(x, now - self._start).tolist()
        return torques
