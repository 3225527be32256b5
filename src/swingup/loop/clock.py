"""Periods of a robot's loop that vary, and the times at which its states were measured.

A period is the nominal one, or, with the probability ``late``, longer by an exponentially distributed time, up to
three nominal periods. Recordings of RealAIGym's robots look like this: their shortest period is the nominal one.
"""

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float

from ..common.types import Count, Scalar
from .loop import LONGEST_PERIOD


class Clock(eqx.Module):
    """How late the turns of a loop come."""

    late: float | Scalar
    """Probability that a period is longer than the nominal one."""
    lateness: float | Scalar
    """Mean excess of those periods (s)."""

    def period(self, uniform: Scalar, dt: float) -> Scalar:
        """The period (s) of a turn for an even draw from (0, 1), where dt (s) is the nominal one."""
        late = jnp.asarray(self.late, uniform.dtype)
        # The share of draws below `late` is again even on (0, 1): its logarithm is exponentially distributed.
        rank = jnp.maximum(uniform, jnp.finfo(uniform.dtype).tiny) / jnp.where(late > 0, late, 1.0)
        excess = jnp.where(uniform < late, -self.lateness * jnp.log(rank), 0.0)
        return jnp.minimum(dt + excess, LONGEST_PERIOD * dt)


class Times(eqx.Module):
    """The loop's own clock: the time now, and when the remembered states were measured."""

    now: Scalar
    """s"""
    past: Float[Array, "depth"]
    """Row k mod depth holds the time of step k (s), like the ring of states."""

    def remember(self, step: Count) -> "Times":
        """With the present time in the row of this step."""
        return Times(self.now, self.past.at[step % self.past.shape[0]].set(self.now))

    def age(self, step: Count) -> Scalar:
        """Time between this step and the one before it (s)."""
        depth = self.past.shape[0]
        return self.past[step % depth] - self.past[(step - 1) % depth]

    def after(self, period: float | Scalar) -> "Times":
        """A period (s) later."""
        return Times(self.now + period, self.past)


def start_times(depth: int, dt: float, dtype: jnp.dtype) -> Times:
    """The clock before the first step: at 0 s, and before that on time."""
    return Times(jnp.zeros((), dtype), (jnp.arange(depth, dtype=dtype) - depth) * dt)
