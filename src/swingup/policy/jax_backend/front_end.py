"""The front end in JAX: what stands between measurement, policy and motors on a robot, for training and judging.

``numpy_backend/front_end.py`` has the same in NumPy, for the robot.
"""

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from ...physics.parameters import Robot
from ...types import Observation, Scalar, State, Torque
from ..settings import STEEPNESS
from ..settings import FrontEndSettings as FrontEndSettings


class FrontEndMemory(eqx.Module):
    """What is remembered from call to call."""

    rates: Float[Array, "2"]
    """Filtered velocities (rad/s)."""
    torques: Float[Array, "calls"]
    """The policy's torques at the last calls in units of its limit, newest first."""
    past: Float[Array, "calls 4"]
    """States as they were seen, this call's first."""


class FrontEnd(eqx.Module):
    """Low-pass filter and dead-band of the velocities, a memory of torques and states, friction compensation."""

    settings: FrontEndSettings = eqx.field(static=True, default=FrontEndSettings())
    """Filter, spacing and friction."""
    torques: int = eqx.field(static=True, default=0)
    """How many past torques the policy is shown."""
    history: int = eqx.field(static=True, default=0)
    """How many earlier states it is shown."""

    def begin(self, x: State) -> FrontEndMemory:
        """The memory after a first measurement x: no torques, and it was always so."""
        spacing = self.settings.spacing
        past = jnp.tile(self._seen(x[:2], x[2:]), (self.history * spacing + 1, 1))
        return FrontEndMemory(x[2:], jnp.zeros(self.torques * spacing, x.dtype), past)

    def measure(self, memory: FrontEndMemory, x: State) -> FrontEndMemory:
        """Take in a measurement (rad, rad/s)."""
        rates = memory.rates + self.settings.velocity_weight * (x[2:] - memory.rates)
        past = jnp.concatenate([self._seen(x[:2], rates)[None], memory.past[:-1]])
        return FrontEndMemory(rates, memory.torques, past)

    def shown(self, memory: FrontEndMemory) -> Observation:
        """What the policy is shown: the filtered state, the past torques, the earlier states."""
        means = memory.torques.reshape(self.torques, self.settings.spacing).mean(axis=1)
        earlier = memory.past[self.settings.spacing :: self.settings.spacing]
        return jnp.concatenate([memory.past[0], means, earlier.reshape(-1)])

    def remember(self, memory: FrontEndMemory, action: Scalar) -> FrontEndMemory:
        """Note the policy's torque, in units of its limit."""
        torques = jnp.concatenate([action[None], memory.torques])[: memory.torques.size]
        return FrontEndMemory(memory.rates, torques, memory.past)

    def command(self, memory: FrontEndMemory, torque: Scalar, robot: Robot) -> Torque:
        """The torques [u1, u2] of both motors (N m): the policy's, and what makes up for friction."""
        rates, settings = memory.past[0, 2:], self.settings
        rates = jnp.where(jnp.isfinite(rates), rates, jnp.nan)
        damping, coulomb = jnp.array(settings.damping, rates.dtype), jnp.array(settings.coulomb, rates.dtype)
        friction = damping * rates + coulomb * jnp.arctan(STEEPNESS * rates)
        passive = jnp.clip(friction, -settings.passive_limit, settings.passive_limit)
        return jnp.where(jnp.array(robot.actuation) > 0, torque + friction, passive)

    def _seen(self, q: Float[Array, "2"], rates: Float[Array, "2"]) -> State:
        return jnp.concatenate([q, jnp.where(jnp.abs(rates) < self.settings.dead_band, 0.0, rates)])


def choose(condition: jax.Array, yes: FrontEndMemory, no: FrontEndMemory) -> FrontEndMemory:
    """One memory or the other."""
    return jax.tree.map(lambda one, other: jnp.where(condition, one, other), yes, no)
