"""Controllers for RealAIGym's simulator and its robot: ``load_controller("adaptive", "acrobot")``.

Policies run with NumPy alone. JAX is imported only for baselines (``tvlqr``, ``ilqr-riccati``, ``ilqr-mpc``...) and
for other controllers of this package. RealAIGym's package is never imported.
"""

import copy
from pathlib import Path
from typing import Any

import numpy as np

from .common.errors import SwingupError
from .export.realaigym import RealAIGymController as RealAIGymController
from .export.realaigym import wrap_policy
from .plant.robots import TORQUE_LIMIT, Robot, get_robot
from .policy.contract import LoopController
from .policy.guard.settings import GuardChoice, choose_guard
from .policy.numpy_backend.controller import load_controller as load_policy_controller
from .policy.shipped import is_policy


def load_controller(
    name: str | Path,
    robot: Robot | str | None = None,
    estimator: bool | None = None,
    guard: GuardChoice = None,
) -> RealAIGymController:
    """A controller as RealAIGym calls it, ready: ``init()`` has been called.

    Args:
        name: a policy file, or a built-in name.
        robot: which joint is driven; needed with a name.
        estimator: behind a state estimator where the policy file has one (None), never (False) or always (True).
        guard: behind a safety guard where the policy file has one (None), never (False), always (True), or with
            these settings. Use one on a robot.

    Raises:
        SwingupError: there is no such controller, or it is damaged, or for another robot, or a setting of the guard
            cannot work.
    """
    if is_policy(name):
        return wrap_policy(load_policy_controller(name, robot, estimator, guard), str(name))
    if robot is None:
        raise SwingupError(f"controller {str(name)!r} needs a robot: name acrobot or pendubot")
    robot = get_robot(robot)
    limits = TORQUE_LIMIT * robot.actuation[0], TORQUE_LIMIT * robot.actuation[1]
    compiled = LoopController(
        _Compiled(str(name), robot, estimator), robot, limits, choose_guard(guard, None, None)
    )
    return RealAIGymController(compiled, {"controller": str(name)})


class _Compiled:
    """A controller in JAX as a function with a memory; its first call compiles it."""

    def __init__(self, name: str, robot: Robot, estimator: bool | None) -> None:
        try:
            import equinox as eqx
            import jax

            from .controllers.interface.controller import AbstractController
            from .controllers.registry import get_controller
        except ModuleNotFoundError as error:
            raise SwingupError(
                f"controller {name!r} needs {error.name}: install swingup with its dependencies, or use a policy"
            ) from error

        found = get_controller(name, robot, estimator)
        if not isinstance(found, AbstractController):
            raise SwingupError(f"controller {name!r} is in plain Python: hand it to RealAIGym as it is")
        self._x64 = jax.enable_x64
        with self._x64(True):
            self._call: Any = eqx.filter_jit(found)
            self._start = found.init()
        self.reset()
        self.act(np.zeros(4), 0.0)  # compiled now, not in the loop
        self.reset()

    def __deepcopy__(self, known: dict[int, Any]) -> "_Compiled":
        # Memories are replaced, never altered: a shallow copy has its own, and shares what is compiled.
        return copy.copy(self)

    def reset(self) -> None:
        """Nothing seen yet."""
        self._memory: Any = self._start

    def act(self, x: np.ndarray, t: float) -> np.ndarray:
        """The torques (2,) (N m)."""
        with self._x64(True):
            self._memory, u = self._call(self._memory, np.float64(t), x)
            return np.asarray(u, np.float64)

    def given(self, u: np.ndarray) -> None:
        """Its memory holds what it asked for itself."""
