"""A learned policy as a controller of the pendulum."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import equinox as eqx
import jax.numpy as jnp

from ..areapo import policy as policies
from ..areapo.networks import Actor
from ..areapo.policy import Policy
from ..physics.parameters import Robot
from ..runtime.policy_file import read_pendulum_policy
from ..types import Scalar, State, Torque
from .controller import AbstractController


class PolicyController(AbstractController[None]):
    """The deterministic policy, called at whatever rate the loop runs; it remembers nothing."""

    policy: Policy[Actor]
    """From a state [q1, q2, dq1, dq2] to an action in [-1, 1]."""
    torque_limit: float
    """Torque of an action of 1 (N m)."""
    robot: Robot = eqx.field(static=True)
    """Which joint is driven."""

    def init(self) -> None:
        """Nothing to remember."""

    def __call__(self, carry: None, t: Scalar, x: State) -> tuple[None, Torque]:
        """The policy's torque on the driven joint."""
        action = self.policy(x).astype(x.dtype)
        return None, self.torque_limit * action * jnp.array(self.robot.actuation, x.dtype)


def save_controller(path: str | Path, controller: PolicyController, provenance: Mapping[str, Any]) -> None:
    """Write a controller as a policy file, with the robot, the torque limit and where it comes from.

    An ``estimator`` in the provenance says that one goes before the policy, with these settings.

    Raises:
        SwingupError: the file cannot be written.
    """
    head = {"robot": controller.robot.name, "torque_limit": float(controller.torque_limit)}
    policies.save_policy(path, controller.policy, {**head, **provenance})


def load_policy(path: str | Path, robot: Robot | str | None = None) -> tuple[PolicyController, dict[str, Any]]:
    """Read a policy file as a controller of the pendulum, and its metadata.

    This is the policy alone: ``get_controller`` puts the estimator before it that the metadata may ask for.

    Args:
        path: the policy file.
        robot: the robot that it must be for, if any.

    Raises:
        SwingupError: the file cannot be read, is no policy of a pendulum, asks for an impossible estimator, or is
            for another robot.
    """
    read = read_pendulum_policy(path, robot)
    return PolicyController(policies.make_policy(read.file), read.torque_limit, read.robot), dict(read.metadata)
