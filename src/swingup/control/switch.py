"""Switching from one controller to another, once and for good."""

import abc
from typing import Any

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Float

from ..physics.angles import UPRIGHT, wrap
from ..physics.parameters import Robot
from ..types import Flag, Scalar, State, Torque
from .controller import AbstractController, Carry


class AbstractSparing(AbstractController[Carry]):
    """A controller whose calls are expensive and that can spare the work where nobody uses its answer."""

    @abc.abstractmethod
    def answer(self, carry: Carry, t: Scalar, x: State, idle: Flag) -> tuple[Carry, Torque]:
        """As a call; where ``idle``, the answer is not used: any finite torque will do."""

    def __call__(self, carry: Carry, t: Scalar, x: State) -> tuple[Carry, Torque]:
        """The torques [u1, u2] (N m) for the state x measured at time t (s), and what to remember."""
        return self.answer(carry, t, x, jnp.array(False))


class LatchMemory(eqx.Module):
    """What both controllers remember, and which one is in charge."""

    first: Any
    second: Any
    latched: Flag


class Latching(AbstractController[LatchMemory]):
    """The first controller until the state comes near the goal once, the second ever after.

    Near: |wrap(x) - goal| < threshold in all four entries. The first controller is not called back when the second
    loses the pendulum.
    """

    first: AbstractController[Any]
    second: AbstractController[Any]
    threshold: Float[np.ndarray, "4"]
    """rad, rad/s"""
    robot: Robot = eqx.field(static=True)
    """Which joint is driven."""
    goal: Float[np.ndarray, "4"] = eqx.field(default_factory=UPRIGHT.copy)
    """Within the wrapped angles: q1 in [0, 2π), q2 in [-π, π)."""

    def init(self) -> LatchMemory:
        """Both fresh, the first in charge."""
        return LatchMemory(self.first.init(), self.second.init(), jnp.array(False))

    def __call__(self, carry: LatchMemory, t: Scalar, x: State) -> tuple[LatchMemory, Torque]:
        """The torques of the controller in charge (N m)."""
        latched = carry.latched | jnp.all(jnp.abs(wrap(x) - jnp.asarray(self.goal)) < jnp.asarray(self.threshold))
        if isinstance(self.first, AbstractSparing):
            first, u_first = self.first.answer(carry.first, t, x, latched)
        else:
            first, u_first = self.first(carry.first, t, x)
        second, u_second = self.second(carry.second, t, x)
        return LatchMemory(first, second, latched), jnp.where(latched, u_second, u_first)
