"""A policy as a controller by NumPy alone: what runs on the robot."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from ...plant.robots import Robot
from ..guard import GuardChoice
from ..pendulum import PendulumPolicy
from ..settings import choose_guard, default_estimator
from ..shipped import load_policy
from .estimator import NumpyEstimator
from .guard import NumpyGuard
from .identifier import NumpyIdentifier
from .network import NumpyNetwork
from .regulator import NumpyRegulator


class NumpyController:
    """A policy, with an estimator, a regulator or a guard where its file has one.

    It keeps to ``policy/contract.py``.

    Use one object for one pendulum, in one thread.
    """

    def __init__(self, policy: PendulumPolicy, estimator: bool | None = None, guard: GuardChoice = None) -> None:
        """Make a controller of a policy.

        Args:
            policy: what the file holds.
            estimator: where the file has one (None), never (False) or always (True). Settings that the file lacks
                have their defaults, in the units of its plant.
            guard: where the file has one (None), never (False), always (True), or its settings.
        """
        self.policy = policy
        settings = policy.estimator or default_estimator(policy.plant)
        wanted = policy.estimator is not None if estimator is None else estimator
        joint = policy.robot.joint
        self._joint, self._network = joint, NumpyNetwork(policy)
        found = policy.identifier if wanted else None
        self._identifier = None if found is None else NumpyIdentifier(found, policy.plant, joint)
        self._estimator = NumpyEstimator(settings, policy.plant, joint, self._identifier) if wanted else None
        self._regulator = None
        if policy.regulator is not None:
            self._regulator = NumpyRegulator(policy.regulator, policy.plant, joint, policy.torque_limit)
        chosen = choose_guard(guard, policy.guard, policy.period)
        self.guard = None if chosen is None else NumpyGuard(chosen, joint, policy.torque_limits)
        """What watches the loop; its ``fault`` says why it stopped the controller."""

    @property
    def robot(self) -> Robot:
        """Which joint is driven."""
        return self.policy.robot

    @property
    def passive_limit(self) -> float:
        """Largest torque on the passive joint (N m), which compensates friction."""
        return self.policy.torque_limits[1 - self._joint]

    def reset(self) -> None:
        """Forget the run so far."""
        for part in (self._estimator, self._regulator, self.guard):
            if part is not None:
                part.reset()

    def __call__(
        self,
        x: np.ndarray,
        t: float,
        measured: np.ndarray | None = None,
        added: np.ndarray | None = None,
    ) -> np.ndarray:
        """The torques [u1, u2] (N m), float64, for the state x (4,) (rad, rad/s) at time t (s).

        A torque is NaN where x is not finite; behind a guard it is safe then. The guard looks at ``measured`` (4,),
        what a filter made x of, if that is given, and limits the sum with the torques ``added`` (2,) by the caller.
        """
        x = np.asarray(x, np.float64)
        if self.guard is not None and not self.guard.allows(float(t), x if measured is None else measured):
            return self.guard.stopped()
        if self._estimator is not None:
            x = self._estimator.observe(float(t), x)
            if self._identifier is not None:
                self._tell(self._identifier.found.told)
        u = self._command(x)
        if self._estimator is not None:
            u = u + self._estimator.compensation(x)
        extra = np.zeros(2) if added is None else added
        u = u + extra
        if self.guard is not None:
            u = self.guard.limited(u)
        if self._estimator is not None:
            # With its own compensation: the estimator needs what the motors were given. The caller's belongs to the
            # plant, which then seems to have less friction; else an identifier would compensate it once more.
            self._estimator.remember(u - extra)
        return u

    def _tell(self, base: Sequence[float]) -> None:
        """Hand the plant found, base parameters θ (9,), to what depends on it."""
        self._network.tell(base)
        if self._regulator is not None:
            self._regulator.tell(base)

    def _command(self, x: np.ndarray) -> np.ndarray:
        """The torques (2,) of the policy or its regulator for the state shown."""
        u = np.zeros(2)
        regulated = None if self._regulator is None else self._regulator(x)
        u[self._joint] = self._network(x) if regulated is None else regulated
        return u


def load_controller(
    source: str | Path,
    robot: Robot | str | None = None,
    estimator: bool | None = None,
    guard: GuardChoice = None,
) -> NumpyController:
    """Load a controller from a policy file, or one that the package ships.

    Args:
        source: a policy file, or ``adaptive``, ``ar-eapo`` or ``global``.
        robot: the robot that it must be for; needed with a name.
        estimator: where the file has one (None), never (False) or always (True).
        guard: behind a safety guard where the file has one (None), never (False), always (True), or with these
            settings.

    Raises:
        SwingupError: there is no such controller, or the file is damaged, or for another robot, or a setting of the
            guard cannot work.
    """
    return NumpyController(load_policy(source, robot), estimator, guard)
