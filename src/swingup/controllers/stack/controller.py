"""A policy as a controller of the pendulum in JAX, from its file to the loop."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Float

from ...areapo.networks import Actor
from ...common.errors import SwingupError
from ...common.types import Scalar, State, Torque
from ...plant.base_parameters import base_parameters
from ...plant.plant import LEADERBOARD, Plant, Robot
from ...policy.pendulum import PendulumPolicy, write_pendulum_policy
from ..interface.controller import AbstractPlantController
from .estimator import EstimatingController, with_estimator
from .policy import Policy, make_policy, network_of
from .regulator import RegulatingController, with_regulator


class PolicyController(AbstractPlantController[None]):
    """The deterministic policy, called at whatever rate the loop runs."""

    policy: Policy[Actor]
    """From a state [q1, q2, dq1, dq2] to an action in [-1, 1]."""
    torque_limit: float
    """Torque of an action of 1 (N m)."""
    robot: Robot = eqx.field(static=True)
    """Which joint is driven."""
    plant: Plant = eqx.field(static=True, default=LEADERBOARD)
    """The plant that the policy was made for."""
    base: Float[Any, "9"] | None = None
    """θ of the plant that it sees where a call does not say; None for that of ``plant``."""

    def init(self) -> None:
        """It remembers nothing."""

    def control(self, carry: None, t: Scalar, x: State, base: Float[Any, "9"] | None) -> tuple[None, Torque]:
        """The policy's torque on the driven joint, NaN if anything seen is not finite."""
        if x.shape != (4,):  # indices beyond an end would be clipped in silence
            raise SwingupError(f"x has shape {x.shape}: pass four numbers, [q1, q2, dq1, dq2] (rad, rad/s)")
        own = base_parameters(self.plant) if self.base is None else self.base
        torque = self.torque_limit * self.policy(x, own if base is None else base).astype(x.dtype)[0]
        # The clips of the observation must not hide it.
        torque = jnp.where(jnp.isfinite(x).all(), torque, jnp.nan)
        return None, torque * jnp.array(self.robot.actuation, x.dtype)


def make_controller(
    policy: PendulumPolicy, estimator: bool | None = None
) -> PolicyController | RegulatingController | EstimatingController:
    """Make a controller of a policy, with its regulator if the file has one.

    An estimator stands before it where the file has one (None), never (False) or always (True). Settings that the
    file lacks have their defaults. Its model is the policy's plant, or what the identifier in the file finds.
    """
    robot, plant = policy.robot, policy.plant.driven(policy.robot)
    acting: PolicyController | RegulatingController = policy_alone(policy)
    if policy.regulator is not None:
        acting = with_regulator(acting, robot, plant, policy.regulator, float(policy.torque_limit))
    if not (policy.estimator is not None if estimator is None else estimator):
        return acting
    return with_estimator(acting, robot, plant, policy.estimator, policy.identifier)


def policy_alone(policy: PendulumPolicy) -> PolicyController:
    """A policy without what stands around it; one that sees its plant is for the plant of its file."""
    return PolicyController(make_policy(policy.network), policy.torque_limit, policy.robot, policy.plant)


def plant_of(controller: PolicyController) -> Plant:
    """The plant that a policy was made for."""
    return controller.plant.driven(controller.robot)


def policy_of(controller: PolicyController) -> PendulumPolicy:
    """What a file holds of a controller, without what stands around it."""
    network, limit = network_of(controller.policy), float(controller.torque_limit)
    return PendulumPolicy(network, controller.robot, limit, plant_of(controller))


def save_controller(path: str | Path, controller: PolicyController, provenance: Mapping[str, Any]) -> None:
    """Write a controller as a policy file, with the robot, the torque limit and where it comes from.

    An ``estimator`` in the provenance holds the settings of an estimator before the policy, an ``identifier`` those
    of an identifier in it, a ``regulator`` those of a regulator that takes over near the top.
    """
    write_pendulum_policy(path, policy_of(controller), provenance)
