"""A controller in JAX as a robot's loop calls it: RealAIGym's simulator takes baselines so."""

import copy
from typing import Any

import equinox as eqx
import jax
import numpy as np

from ...common.errors import SwingupError
from ...plant.plant import TORQUE_LIMIT, Robot, get_robot
from ...policy.contract import LoopController
from ...policy.guard.settings import GuardChoice, choose_guard
from .controller import AbstractController, check_robot


class Compiled:
    """The torques of a controller, compiled when it is made and not in the loop."""

    shortest_pause = 0.0
    """It acts at each call (s)."""

    def __init__(self, controller: AbstractController[Any]) -> None:
        """Compile one call in double precision, as the judge runs it."""
        with jax.enable_x64(True):
            self._call: Any = eqx.filter_jit(controller)
            self._start = controller.init()
        self.reset()
        self.act(np.zeros(4), 0.0)
        self.reset()

    def __deepcopy__(self, known: dict[int, Any]) -> "Compiled":
        # Memories are replaced, never altered: a shallow copy has its own, and shares what is compiled.
        return copy.copy(self)

    def reset(self) -> None:
        """Forget the run so far."""
        self._memory: Any = self._start

    def act(self, x: np.ndarray, t: float) -> np.ndarray:
        """The torques (2,) (N m) for the state x (4,) at time t (s)."""
        with jax.enable_x64(True):
            self._memory, u = self._call(self._memory, np.float64(t), x)
            return np.asarray(u, np.float64)

    def given(self, u: np.ndarray) -> None:
        """Its memory holds what it asked for itself."""


def loop_controller(
    controller: Any, robot: Robot | str, guard: GuardChoice = None, limit: float = TORQUE_LIMIT
) -> LoopController[Compiled]:
    """Put a controller in JAX behind the contract of a robot's loop.

    Args:
        controller: what :func:`swingup.get_controller` gives.
        robot: which joint is driven.
        guard: behind a safety guard never (None, False), always (True), or with these settings.
        limit: torque limit of the driven joint (N m).

    Raises:
        SwingupError: the controller is in plain Python or for another robot, or a setting of the guard cannot work.
    """
    robot = get_robot(robot)
    if not isinstance(controller, AbstractController):
        raise SwingupError("this controller is in plain Python: call it as it is, only those in JAX are compiled")
    check_robot(controller, robot)
    limits = limit * robot.actuation[0], limit * robot.actuation[1]
    return LoopController(Compiled(controller), robot, limits, choose_guard(guard, None, None))
