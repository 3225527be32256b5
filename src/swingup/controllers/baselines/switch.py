"""A switch from one controller to another, which never switches back."""

import abc
from typing import Any

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Float

from ...common.types import Flag, Scalar, State, Torque
from ...dynamics.dynamics import UPRIGHT, wrap
from ...plant.plant import Robot
from ..interface import AbstractController, Carry, Time, TimeLike, never, since_first_call


class AbstractExpensiveController(AbstractController[Carry]):
    """A controller whose calls are expensive, and that can skip the work when its answer is not used.

    Subclasses implement ``control``; a call is ``control`` that is not idle.
    """

    @abc.abstractmethod
    def control(self, carry: Carry, t: Scalar, x: State, idle: Flag) -> tuple[Carry, Torque]:
        """Do what a call does. Where ``idle``, the answer is not used, and any finite torque is right."""

    def __call__(self, carry: Carry, t: Scalar, x: State) -> tuple[Carry, Torque]:
        """The torques [u1, u2] (N m) for the state x measured at time t (s), and the memory for the next call."""
        return self.control(carry, t, x, jnp.array(False))


class SwitchMemory(eqx.Module):
    """The memories of both controllers, which of them acts, and when they were first called."""

    first: Any
    second: Any
    latched: Flag
    begun: Time


class LatchingSwitch(AbstractController[SwitchMemory]):
    """The first controller until the state has been near the goal once; the second from then on.

    Near means |wrap(x) - upright| < threshold in all four entries. The second controller stays in charge even when
    it loses the pendulum. Time counts from the first call: the first controller may follow a trajectory.
    """

    first: AbstractController[Any]
    second: AbstractController[Any]
    threshold: Float[np.ndarray, "4"]
    """rad, rad/s"""
    robot: Robot = eqx.field(static=True)
    """Which joint is driven."""

    def init(self) -> SwitchMemory:
        """Both controllers' first memories; the first controller acts."""
        return SwitchMemory(self.first.init(), self.second.init(), jnp.array(False), never())

    def __call__(self, carry: SwitchMemory, t: TimeLike, x: State) -> tuple[SwitchMemory, Torque]:
        """The torques of the controller in charge (N m)."""
        begun, t = since_first_call(t, carry.begun)
        error = wrap(x) - jnp.asarray(UPRIGHT, x.dtype)
        latched = carry.latched | jnp.all(jnp.abs(error) < jnp.asarray(self.threshold))
        # Both controllers are computed: in a batch some members have switched and others have not.
        if isinstance(self.first, AbstractExpensiveController):
            first, u_first = self.first.control(carry.first, t, x, latched)
        else:
            first, u_first = self.first(carry.first, t, x)
        second, u_second = self.second(carry.second, t, x)
        return SwitchMemory(first, second, latched, begun), jnp.where(latched, u_second, u_first)
