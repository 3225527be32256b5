"""A policy as a controller by NumPy alone: what runs on the robot."""

from pathlib import Path

import numpy as np

from ...plant.base_parameters import base_parameters
from ...plant.equations import NUMPY
from ...plant.plant import Robot
from ...plant.units import TORQUE, arm_scales
from ..contract import LoopController
from ..estimator import core as estimator
from ..estimator.settings import default_estimator
from ..guard.settings import GuardChoice, choose_guard
from ..identifier import core as identifier
from ..identifier.core import Found
from ..identifier.settings import SHORTEST_STEP
from ..pendulum import PendulumPolicy
from ..regulator import core as regulator
from ..shipped import load_policy
from .network import NumpyNetwork
from .regulator import held, regulator_loop


class NumpyPolicy:
    """The torques of a policy, with an estimator and a regulator where its file has one."""

    found: Found | None = None
    """What the identifier has found of the plant; None without one."""

    def __init__(self, policy: PendulumPolicy, estimated: bool | None = None) -> None:
        """Take a policy behind an estimator where its file has one (None), never (False) or always (True)."""
        self.policy, self._joint, self._network = policy, policy.robot.joint, NumpyNetwork(policy)
        joint, scales = self._joint, arm_scales(policy.plant)
        # All but the network computes in C.1's units; kept, since finding them takes as long as a small network.
        self._state_units, self._base_units = np.array(scales.state), np.array(scales.base)
        self._torque_unit = scales.of(TORQUE)
        self.loop: estimator.Loop | None = None
        self.shortest_pause = 0.0
        if policy.estimator is not None if estimated is None else estimated:
            settings = policy.estimator or default_estimator(policy.plant)
            self.loop = estimator.make_loop(settings, policy.plant, joint, policy.identifier)
            self.shortest_pause = SHORTEST_STEP * settings.dt
        self._regulator: regulator.Loop | None = None
        if policy.regulator is not None:
            self._regulator = regulator_loop(policy.regulator, policy.plant, joint, policy.torque_limit)
            self._held = held(self._regulator, (base_parameters(policy.plant) / self._base_units).tolist())
        self.reset()

    def reset(self) -> None:
        """Forget the run so far."""
        if self.loop is not None:
            # From the first call on there is a plant to act for: the prior's.
            self.state = estimator.begin(NUMPY, self.loop)
            self._tell()
        if self._regulator is not None:
            self._regulated = regulator.begin(NUMPY, self._regulator)

    def act(self, x: np.ndarray, t: float) -> np.ndarray:
        """The torques (2,) (N m) for the state x (4,) measured at time t (s), NaN where x is not finite."""
        # What is not finite or overflows fails a comparison, and starts again.
        with np.errstate(all="ignore"):
            x = x / self._state_units
            if self.loop is not None:
                self.state, x = estimator.observe(NUMPY, self.loop, self.state, self.found, t, x)
                self._tell()
            u = np.zeros(2)
            u[self._joint] = self._torque(x)
            if self.loop is not None and self.found is not None:
                u = u + self._torque_unit * estimator.compensation(NUMPY, self.loop, self.found, x)
            return u

    def given(self, u: np.ndarray) -> None:
        """Note what the motors were given of the torques (2,) (N m)."""
        if self.loop is not None:
            self.state = estimator.remember(NUMPY, self.loop, self.state, u / self._torque_unit)

    def _tell(self) -> None:
        """Hand the plant found to what depends on it."""
        assert self.loop is not None  # the caller has looked
        if self.loop.finding is None or self.state.identified is None:
            return
        self.found = identifier.found(NUMPY, self.loop.finding, self.state.identified)
        if self._regulator is not None:
            self._held = held(self._regulator, self.found.residual_base)

    def _torque(self, x: np.ndarray) -> float:
        """The torque (N m) of the regulator where it acts, or of the policy, for the state in C.1's units."""
        if self._regulator is not None:
            self._regulated, torque = regulator.regulate(NUMPY, self._regulator, self._regulated, self._held, x)
            if self._regulated.acting:
                return float(torque) * self._torque_unit
        if self.found is not None:
            # The network sees a plant in its own units, as it was trained.
            self._network.set_plant(self._base_units * self.found.residual_base)
        return self._network(x * self._state_units)


def numpy_controller(
    policy: PendulumPolicy, estimated: bool | None = None, guard: GuardChoice = None
) -> LoopController[NumpyPolicy]:
    """A controller of a policy; use one object for one pendulum, in one thread.

    An estimator and a safety guard are those of the file (None), never there (False) or always (True). Settings
    that the file lacks have their defaults, in the units of its plant.
    """
    settings = choose_guard(guard, policy.guard, policy.period)
    return LoopController(NumpyPolicy(policy, estimated), policy.robot, policy.torque_limits, settings)


def load_controller(
    source: str | Path,
    robot: Robot | str | None = None,
    estimator: bool | None = None,
    guard: GuardChoice = None,
) -> LoopController[NumpyPolicy]:
    """Load a controller from a policy file, or one that the package ships.

    Args:
        source: a policy file, or ``adaptive``, ``ar-eapo`` or ``global``.
        robot: the robot that it must be for; needed with a name.
        estimator: as :func:`numpy_controller` takes it; so is the guard.
        guard: the safety guard.

    Raises:
        SwingupError: there is no such controller, or the file is damaged, or for another robot, or a setting of the
            guard cannot work.
    """
    return numpy_controller(load_policy(source, robot), estimator, guard)
