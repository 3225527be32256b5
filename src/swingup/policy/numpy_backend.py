"""A policy as a controller by NumPy alone: what runs on the robot."""

import math
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from ..plant.base_parameters import BASE, base_parameters
from ..plant.equations import NUMPY
from ..plant.plant import Plant, Robot
from ..plant.units import TORQUE, arm_scales
from . import estimator, identifier, regulator
from .contract import LoopController, guarded
from .estimator import EstimatorConstants, EstimatorSettings, EstimatorState, default_estimator, estimator_constants
from .guard import GuardChoice
from .identifier import MIN_STEP, IdentifiedPlant
from .network import Bounds
from .pendulum import PendulumPolicy
from .policy import NumpyNetwork
from .regulator import RICCATI_STEPS, Held, Loop, Q, R, RegulatorSettings
from .shipped import load_pendulum_policy

BOUNDS: dict[Bounds, Callable[[float], float]] = {"tanh": math.tanh, "clip": lambda z: max(-1.0, min(1.0, z))}


class TorqueNetwork:
    """The deterministic policy: x = [q1, q2, dq1, dq2] (rad, rad/s) to the torque of the driven joint (N m).

    A call works in buffers of its own: use one object in one thread.
    """

    def __init__(self, policy: PendulumPolicy) -> None:
        """Take the arrays of a policy; a policy that sees its plant begins with its file's."""
        self._network = NumpyNetwork(policy.folded)
        self._torque_limit, self._bound = policy.torque_limit, BOUNDS[policy.network.bounds]
        # The biases of the first layer, which take up what the plant adds (``policy/network.py: fold``).
        self._plant_bias = self._network.layers[0][1]
        self._plant_stage, first = policy.network.plant_stage, policy.network.layers[0]
        self._weight, self._bias = first.weight[:, -BASE:].astype(np.float64), first.bias.astype(np.float64)

    def set_plant(self, base: Sequence[float] | np.ndarray) -> None:
        """Show the policy a plant with base parameters θ (9,) from now on, if it sees its plant."""
        if self._plant_stage is not None:
            self._plant_bias[:] = self._bias + self._weight.dot(self._plant_stage.inputs(np.asarray(base)))

    def __call__(self, x: np.ndarray) -> float:
        """The torque (N m) for a state of shape (4,); NaN where that is not finite."""
        # The clips of the observation would hide it.
        if not all(map(math.isfinite, x.tolist())):
            return math.nan
        return self._torque_limit * self._bound(self._network(x).item())


WEIGHTS = np.diag([*Q, 0.0, R])
CONSTANT = (0.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
"""f stays, and u is chosen anew: the last rows of a step."""


def regulator_loop(settings: RegulatorSettings, plant: Plant, joint: int, limit: float) -> Loop:
    """What a regulator knows of a plant, whose driven joint's torque has a limit (N m)."""
    return regulator.make_loop(settings, plant, joint, limit, lambda P: np.pad(P, (0, 1)), advanced, cost, command)


def held(loop: Loop, base: Sequence[float], far: bool) -> Held:
    """What to hold for base parameters θ (9,), far or near: its step is [A d b; 0 1 0; 0 0 0]."""
    found = regulator.held(NUMPY, loop, base, far)
    (a1, a2, a3, a4), (d1, d2, d3, d4), (b1, b2, b3, b4) = found.step
    rows = [*a1, d1, b1, *a2, d2, b2, *a3, d3, b3, *a4, d4, b4, *CONSTANT]
    return found._replace(step=np.array(rows).reshape(6, 6))


def advanced(P: np.ndarray, step: np.ndarray) -> np.ndarray:
    """P after the steps of one call."""
    across = step.T
    for _ in range(RICCATI_STEPS):
        V = across.dot(P.dot(step))
        V += WEIGHTS
        coupled = V[5:]
        # Zeros at u again, but for rounding, which the zeros of the step pass over.
        P = V - coupled.T.dot(coupled / coupled.item(5))
        P[4, 4] = 0.0
    symmetric: np.ndarray = 0.5 * (P + P.T)
    return symmetric


def cost(P: np.ndarray, e: tuple[float, ...]) -> float:
    """The cost-to-go eᵀ P e."""
    error = np.array([*e, 0.0, 0.0])
    return float(P.dot(error).dot(error))


def command(P: np.ndarray, step: np.ndarray, e: tuple[float, ...]) -> float:
    """The torque -K [e, f] (N m)."""
    coupled = step.T[5].dot(P).dot(step)
    gains = coupled / (R + coupled.item(5))
    # The gain of the torque itself has no meaning.
    return -float(gains[:5].dot(e))


class EstimatedSource:
    """What computes torques from a state, perhaps behind an estimator; in C.1's units inside."""

    identified_plant: IdentifiedPlant | None = None  # What the identifier knows of the plant; None without one
    state: EstimatorState

    def __init__(
        self, plant: Plant, joint: int, settings: EstimatorSettings | None, identifier: Any = None
    ) -> None:
        """Take the estimator's plant and its settings; None for the measurement as it is."""
        # Kept, since finding them takes as long as a small network.
        scales = arm_scales(plant)
        self._state_units, self._base_units = np.array(scales.state), np.array(scales.base)
        self._torque_unit, self._joint = scales.of(TORQUE), joint
        self.constants: EstimatorConstants | None = None
        self.min_pause, self.period = 0.0, None if settings is None else settings.dt
        if settings is not None:
            self.constants = estimator_constants(settings, plant, joint, identifier)
            self.min_pause = MIN_STEP * settings.dt

    def reset(self) -> None:
        """Forget the run so far."""
        if self.constants is not None:
            self.state = estimator.begin(NUMPY, self.constants)

    def observed(self, x: np.ndarray, t: float) -> np.ndarray:
        """The estimate for the state (4,) measured at time t (s), in C.1's units; or the measurement in them."""
        x = x / self._state_units
        if self.constants is not None:
            self.state, x = estimator.observe(NUMPY, self.constants, self.state, self.identified_plant, t, x)
        return x

    def remember(self, u: np.ndarray) -> None:
        """Note the torques (2,) (N m) that the motors were given."""
        if self.constants is not None:
            self.state = estimator.remember(NUMPY, self.constants, self.state, u / self._torque_unit)


class NumpyPolicy(EstimatedSource):
    """The torques of a policy, with an estimator and a regulator where its file has one."""

    def __init__(self, policy: PendulumPolicy, estimated: bool | None = None) -> None:
        """Take a policy behind an estimator where its file has one (None), never (False) or always (True)."""
        self.policy, joint, self._network = policy, policy.robot.joint, TorqueNetwork(policy)
        wanted = policy.estimator is not None if estimated is None else estimated
        settings = (policy.estimator or default_estimator(policy.plant)) if wanted else None
        super().__init__(policy.plant, joint, settings, policy.identifier)
        self._regulator: regulator.Loop | None = None
        if policy.regulator is not None:
            self._regulator = regulator_loop(policy.regulator, policy.plant, joint, policy.torque_limit)
        self._base = (base_parameters(policy.plant) / self._base_units).tolist()
        self.reset()

    def reset(self) -> None:
        """Forget the run so far."""
        super().reset()
        # From the first call on there is a plant to act for: the prior's.
        self._update_plant()
        if self._regulator is not None:
            self._regulated = regulator.begin(NUMPY, self._regulator)

    def act(self, x: np.ndarray, t: float) -> np.ndarray:
        """The torques (2,) (N m) for the state x (4,) measured at time t (s).

        Where x is not finite, the driven joint's is NaN and the passive one's 0.
        """
        # What is not finite or overflows fails a comparison, and starts again.
        with np.errstate(all="ignore"):
            x = self.observed(x, t)
            self._update_plant()
            u = np.zeros(2)
            u[self._joint] = self._torque(x)
            if self.constants is not None and self.identified_plant is not None:
                against = estimator.compensation(NUMPY, self.constants, self.identified_plant, x)
                u = u + self._torque_unit * against
            return u

    def _update_plant(self) -> None:
        constants = None if self.constants is None else self.constants.identifier
        if constants is None or self.state.identifier is None:
            return
        self.identified_plant = identifier.identified_plant(NUMPY, constants, self.state.identifier)
        self._base = self.identified_plant.residual_base

    def _torque(self, x: np.ndarray) -> float:
        """The torque (N m) of the regulator where it acts, or of the policy, for the state in C.1's units."""
        if self._regulator is not None:
            plant = held(self._regulator, self._base, bool(self._regulated.far))
            self._regulated, torque = regulator.regulate(NUMPY, self._regulator, self._regulated, plant, x)
            if self._regulated.acting:
                return float(torque) * self._torque_unit
        if self.identified_plant is not None:
            # The network sees a plant in its own units, as it was trained.
            self._network.set_plant(self._base_units * self.identified_plant.residual_base)
        return self._network(x * self._state_units)


def numpy_controller(
    policy: PendulumPolicy, estimated: bool | None = None, guard: GuardChoice = None
) -> LoopController[NumpyPolicy]:
    """A controller of a policy; use one object for one pendulum, in one thread.

    An estimator and a safety guard are those of the file (None), never there (False) or always (True). Settings
    that the file lacks have their defaults, in the units of its plant.
    """
    return guarded(NumpyPolicy(policy, estimated), policy, guard)


def load_controller(
    source: str | Path, robot: Robot | str | None = None, estimator: bool | None = None, guard: GuardChoice = None
) -> LoopController[NumpyPolicy]:
    """Load a controller from a policy file, or by a name of the package's: ``adaptive``, ``ar-eapo`` or ``global``.

    A name needs the robot; a file must be for it. Estimator and guard are those of :func:`numpy_controller`.

    Raises:
        SwingupError: there is no such controller, or the file is damaged, or for another robot, or a setting of the
            guard cannot work.
    """
    return numpy_controller(load_pendulum_policy(source, robot), estimator, guard)
