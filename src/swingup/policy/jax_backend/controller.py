"""A learned policy as a controller of the pendulum."""

import dataclasses
from collections.abc import Mapping
from importlib import resources
from pathlib import Path
from typing import Any

import equinox as eqx
import jax.numpy as jnp

from ...areapo.networks import Actor
from ...control.controller import AbstractController
from ...physics.parameters import Robot
from ...types import Observation, Scalar, State, Torque
from ..file import read_pendulum_policy
from ..settings import FRONT_END
from ..shipped import REFINED, shipped_file
from .front_end import FrontEnd, FrontEndMemory, choose
from .policy import Policy, make_policy, save_policy


class PolicyMemory(eqx.Module):
    """What a policy with a front end remembers."""

    time: Scalar
    """Time of the last call (s), -inf before the first."""
    front_end: FrontEndMemory


class PolicyController(AbstractController[PolicyMemory | None]):
    """The deterministic policy, called at whatever rate the loop runs; only a front end remembers anything."""

    policy: Policy[Actor]
    """From a state [q1, q2, dq1, dq2], or what the front end shows, to an action in [-1, 1]."""
    torque_limit: float
    """Torque of an action of 1 (N m)."""
    robot: Robot = eqx.field(static=True)
    """Which joint is driven."""
    front_end: FrontEnd | None = None
    """What stands between measurement, policy and motors, if anything."""

    def init(self) -> PolicyMemory | None:
        """Nothing measured yet."""
        return (
            None
            if self.front_end is None
            else PolicyMemory(jnp.array(-jnp.inf), self.front_end.begin(jnp.zeros(4)))
        )

    def __call__(self, carry: PolicyMemory | None, t: Scalar, x: State) -> tuple[PolicyMemory | None, Torque]:
        """The policy's torque on the driven joint, and the front end's on both."""
        if self.front_end is None:
            return None, self._torque(x) * jnp.array(self.robot.actuation, x.dtype)
        assert carry is not None
        pause, before = t - carry.time, carry.front_end
        going_on = (pause >= 0) & (pause <= 1.5 * self.front_end.settings.dt)
        going_on &= jnp.isfinite(before.past[0]).all() & jnp.isfinite(x).all()
        memory = choose(going_on, self.front_end.measure(before, x), self.front_end.begin(x))
        torque = self._torque(self.front_end.shown(memory))
        command = self.front_end.command(memory, torque, self.robot)
        memory = self.front_end.remember(memory, torque / self.torque_limit)
        return PolicyMemory(jnp.asarray(t, carry.time.dtype), memory), command

    def _torque(self, seen: Observation) -> Scalar:
        """NaN if anything seen is not finite: what is clipped must not hide it."""
        torque = self.torque_limit * self.policy(seen).astype(seen.dtype)[0]
        return jnp.where(jnp.isfinite(seen).all(), torque, jnp.nan)


def save_controller(path: str | Path, controller: PolicyController, provenance: Mapping[str, Any]) -> None:
    """Write a controller as a policy file, with the robot, the torque limit and where it comes from.

    An ``estimator`` in the provenance says that one goes before the policy, with these settings.

    Raises:
        SwingupError: the file cannot be written.
    """
    head: dict[str, Any] = {"robot": controller.robot.name, "torque_limit": float(controller.torque_limit)}
    if controller.front_end is not None:
        head[FRONT_END] = dataclasses.asdict(controller.front_end.settings)
    save_policy(path, controller.policy, {**head, **provenance})


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
    settings, seen = read.front_end, read.stage
    front_end = None if settings is None else FrontEnd(settings, seen.torques, seen.history)
    policy = make_policy(read.file)
    return PolicyController(policy, read.torque_limit, read.robot, front_end), dict(read.metadata)


def shipped_policy(robot: Robot | str, name: str = REFINED) -> tuple[PolicyController, dict[str, Any]]:
    """A policy that the package ships for a robot, without an estimator, and its metadata.

    Args:
        robot: which joint is driven.
        name: ``refined``, ``ar-eapo``, ``global`` or ``robot``.

    Raises:
        SwingupError: there is no such robot or policy, or the package lacks the file.
    """
    with resources.as_file(shipped_file(robot, name)) as path:
        return load_policy(path, robot)
