"""Limits of angle and speed, beyond which a robot stops or throws its pendulum."""

from typing import Annotated

import equinox as eqx
import jax.numpy as jnp

from ...common.types import Flag, Scalar, State
from ...plant.units import VELOCITY
from .supervisor import AbstractSupervisor, Intervention

BRAKE = 1.0
"""Torque of the brake over the speed of a joint (N m s/rad). Source: the public loop of RealAIGym's robots."""


class Limits(eqx.Module):
    """The largest angle and speed of either joint."""

    angle: float | Scalar
    """rad; angles are not wrapped."""
    speed: Annotated[float | Scalar, VELOCITY]
    """rad/s"""

    def exceeded(self, x: State) -> Flag:
        """Whether either joint of a state is beyond a limit."""
        return jnp.any(jnp.abs(x[:2]) > self.angle) | jnp.any(jnp.abs(x[2:]) > self.speed)


class Stop(AbstractSupervisor[Flag]):
    """Stops the run and brakes once a measured state is beyond the limits."""

    limits: Limits

    def start(self, dtype: jnp.dtype) -> Flag:
        """Not stopped."""
        return jnp.array(False)

    def __call__(self, memory: Flag, t: Scalar, x: State) -> tuple[Flag, Intervention]:
        """Brake from the first state beyond the limits on."""
        # For good: a robot that has stopped does not start by itself.
        stopped = memory | self.limits.exceeded(x)
        return stopped, Intervention(stopped, -BRAKE * x[2:], jnp.zeros_like(x[:2]), stopped)
