"""The front end in JAX: a filter between measurement and policy, and friction compensation before the motors."""

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float

from ...physics.equations import friction
from ...physics.trigonometry import arctan
from ...robots import Robot
from ...types import Scalar, State, Torque
from ..settings import FrontEndSettings


class FrontEndMemory(eqx.Module):
    """What a front end remembers from call to call."""

    rates: Float[Array, "2"]
    """Filtered velocities (rad/s)."""
    seen: State
    """The state that the policy sees (rad, rad/s)."""


class FrontEnd(eqx.Module):
    """Low-pass filter and dead-band of the velocities, and friction compensation."""

    settings: FrontEndSettings = eqx.field(static=True, default=FrontEndSettings())
    """Filter and friction."""

    def begin(self, x: State) -> FrontEndMemory:
        """The memory after a first measurement x (rad, rad/s)."""
        return FrontEndMemory(x[2:], self._seen(x[:2], x[2:]))

    def measure(self, memory: FrontEndMemory, x: State) -> FrontEndMemory:
        """Take in a measurement (rad, rad/s)."""
        rates = memory.rates + self.settings.velocity_weight * (x[2:] - memory.rates)
        return FrontEndMemory(rates, self._seen(x[:2], rates))

    def command(self, memory: FrontEndMemory, torque: Scalar, robot: Robot) -> Torque:
        """The torques [u1, u2] of both motors (N m): the policy's, with compensation of friction."""
        rates, settings = memory.seen[2:], self.settings
        # The arctangent and the clip could make a finite torque of an infinite velocity.
        rates = jnp.where(jnp.isfinite(rates), rates, jnp.nan)
        damping, coulomb = jnp.array(settings.damping, rates.dtype), jnp.array(settings.coulomb, rates.dtype)
        compensation = friction(damping, coulomb, rates, arctan)
        passive = jnp.clip(compensation, -settings.passive_limit, settings.passive_limit)
        return jnp.where(jnp.array(robot.actuation) > 0, torque + compensation, passive)

    def _seen(self, q: Float[Array, "2"], rates: Float[Array, "2"]) -> State:
        return jnp.concatenate([q, jnp.where(jnp.abs(rates) < self.settings.dead_band, 0.0, rates)])
