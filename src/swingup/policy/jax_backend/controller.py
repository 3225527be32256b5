"""A policy as a controller of the pendulum in JAX, from its file to the loop."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import equinox as eqx
import jax.numpy as jnp

from ...areapo.networks import Actor
from ...control.controller import AbstractController
from ...physics.base_parameters import base_parameters
from ...physics.parameters import Parameters
from ...robots import Robot, get_robot
from ...types import Scalar, State, Torque
from ..identifier_settings import IdentifierSettings
from ..pendulum import PendulumPolicy, read_pendulum_policy, write_pendulum_policy
from ..plant_facts import PLANT_NAMES, PolicyPlant, leaderboard_plant, modelled
from ..regulator_settings import RegulatorSettings, check_no_compensation
from ..settings import EstimatorSettings
from ..shipped import DEFAULT_ALONE, read_policy
from .choose import choose
from .estimator import EstimatingController, with_estimator
from .front_end import FrontEnd, FrontEndMemory
from .identifier import make_identifier
from .policy import Policy, make_policy, network_of
from .regulator import RegulatingController, with_regulator


class PolicyMemory(eqx.Module):
    """What a policy with a front end remembers."""

    time: Scalar
    """Time of the last call (s), -inf before the first."""
    front_end: FrontEndMemory


class PolicyController(AbstractController[PolicyMemory | None]):
    """The deterministic policy, called at whatever rate the loop runs; only a front end remembers anything."""

    policy: Policy[Actor]
    """From a state [q1, q2, dq1, dq2] to an action in [-1, 1]."""
    torque_limit: float
    """Torque of an action of 1 (N m)."""
    robot: Robot = eqx.field(static=True)
    """Which joint is driven."""
    front_end: FrontEnd | None = None
    """Filter and friction compensation, if any."""
    plant: PolicyPlant | None = eqx.field(static=True, default=None)
    """The plant that the policy was made for; None for the leaderboards'."""

    @property
    def passive_limit(self) -> float:
        """Largest torque on the passive joint (N m): the front end's compensation."""
        return 0.0 if self.front_end is None else self.front_end.settings.passive_limit

    def init(self) -> PolicyMemory | None:
        """Nothing measured yet."""
        if self.front_end is None:
            return None
        return PolicyMemory(jnp.array(-jnp.inf), self.front_end.begin(jnp.zeros(4)))

    def __call__(self, carry: PolicyMemory | None, t: Scalar, x: State) -> tuple[PolicyMemory | None, Torque]:
        """The policy's torque on the driven joint, and the front end's on both."""
        if self.front_end is None or carry is None:
            return None, self._torque(x) * jnp.array(self.robot.actuation, x.dtype)
        pause, before = t - carry.time, carry.front_end
        going_on = (pause >= 0) & (pause <= 1.5 * self.front_end.settings.dt)
        # A low-pass that has seen a value that is not finite would never recover.
        going_on &= jnp.isfinite(before.seen).all() & jnp.isfinite(x).all()
        memory = choose(going_on, self.front_end.measure(before, x), self.front_end.begin(x))
        command = self.front_end.command(memory, self._torque(memory.seen), self.robot)
        # In the memory's own type: a compiled loop keeps the types of its carry.
        return PolicyMemory(jnp.asarray(t, carry.time.dtype), memory), command

    def _torque(self, seen: State) -> Scalar:
        """NaN if anything seen is not finite: what is clipped must not hide it."""
        torque = self.torque_limit * self.policy(seen).astype(seen.dtype)[0]
        return jnp.where(jnp.isfinite(seen).all(), torque, jnp.nan)


def make_controller(
    policy: PendulumPolicy, estimator: bool | None = None
) -> PolicyController | RegulatingController | EstimatingController:
    """Make a controller of a policy, with its regulator if the file has one.

    Args:
        policy: what the file holds.
        estimator: where the file has one (None), never (False) or always (True). Settings that the file lacks have
            their defaults. Its model is the policy's plant, or what the identifier in the file finds.
    """
    alone, regulator = _alone(policy), policy.regulator
    if policy.estimator is not None if estimator is None else estimator:
        return behind_estimator(alone, policy.estimator, policy.identifier, regulator)
    return alone if regulator is None else regulated(alone, regulator)


def behind_estimator(
    controller: PolicyController,
    settings: EstimatorSettings | None = None,
    identifier: IdentifierSettings | None = None,
    regulator: RegulatorSettings | None = None,
) -> EstimatingController:
    """A policy behind an estimator whose model is the policy's plant.

    Args:
        controller: the policy alone.
        settings: what to expect of measurement and loop.
        identifier: settings of an identifier of that plant; None for the plant itself.
        regulator: settings of a regulator that takes over near the top, for the plant found; None for none.

    Raises:
        SwingupError: the identifier does not fit the estimator, the policy has a front end besides an identifier or
            a regulator, or no regulator holds the plant.
    """
    front_end = None if controller.front_end is None else controller.front_end.settings
    model = modelled(plant_of(controller), controller.robot, front_end)
    parameters = Parameters(**{name: getattr(model, name) for name in PLANT_NAMES})
    found = None if identifier is None else make_identifier(controller.robot, parameters, identifier)
    acting = controller if regulator is None else regulated(controller, regulator)
    return with_estimator(acting, controller.robot, parameters, settings, found)


def regulated(controller: PolicyController, settings: RegulatorSettings) -> RegulatingController:
    """A policy with a regulator, which holds the policy's plant until another one is told.

    Args:
        controller: the policy alone.
        settings: weights, recursion and bounds.

    Raises:
        SwingupError: the policy has a front end, or no regulator holds the plant.
    """
    check_no_compensation(controller.front_end)
    limit = float(controller.torque_limit)
    return with_regulator(controller, controller.robot, plant_of(controller), settings, limit)


def plant_of(controller: PolicyController) -> PolicyPlant:
    """The plant that a policy was made for."""
    return leaderboard_plant(controller.robot) if controller.plant is None else controller.plant


def policy_of(controller: PolicyController) -> PendulumPolicy:
    """What a file holds of a controller, without an estimator."""
    settings = None if controller.front_end is None else controller.front_end.settings
    network, limit = network_of(controller.policy), float(controller.torque_limit)
    return PendulumPolicy(network, controller.robot, limit, plant_of(controller), front_end=settings)


def save_controller(path: str | Path, controller: PolicyController, provenance: Mapping[str, Any]) -> None:
    """Write a controller as a policy file, with the robot, the torque limit and where it comes from.

    An ``estimator`` in the provenance holds the settings of an estimator before the policy, an ``identifier`` those
    of an identifier in it, a ``regulator`` those of a regulator that takes over near the top.

    Raises:
        SwingupError: the file cannot be written.
    """
    write_pendulum_policy(path, policy_of(controller), provenance)


def load_policy(path: str | Path, robot: Robot | str | None = None) -> tuple[PolicyController, dict[str, Any]]:
    """Read a policy file as a controller of the pendulum, and its metadata.

    This is the policy alone. ``get_controller`` also makes the estimator that the metadata may describe.

    Args:
        path: the policy file.
        robot: the robot that it must be for, if any.

    Raises:
        SwingupError: the file cannot be read, is no policy of a pendulum, has an estimator that cannot work, or is
            for another robot.
    """
    policy = read_pendulum_policy(path, robot)
    return _alone(policy), dict(policy.metadata)


def shipped_policy(robot: Robot | str, name: str = DEFAULT_ALONE) -> tuple[PolicyController, dict[str, Any]]:
    """A policy that the package ships for a robot, without what is around it, and its metadata.

    Estimator, identifier and regulator are left out: ``adaptive`` is then for the plant of its file.

    Args:
        robot: which joint is driven.
        name: ``adaptive``, ``refined``, ``ar-eapo``, ``global`` or ``robot``.

    Raises:
        SwingupError: there is no such robot or policy, or the package lacks the file.
    """
    policy = read_policy(name, get_robot(robot))
    return _alone(policy), dict(policy.metadata)


def _alone(policy: PendulumPolicy) -> PolicyController:
    front_end = None if policy.front_end is None else FrontEnd(policy.front_end)
    network = make_policy(policy.network, base_parameters(policy.plant))
    return PolicyController(network, policy.torque_limit, policy.robot, front_end, policy.plant)
