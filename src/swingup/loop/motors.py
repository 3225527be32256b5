"""What a motor makes of the torque that is asked for: a limited rate, a ripple, a lag and a gain."""

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from ..common.types import Scalar, Torque

SHORTEST_LAG = 1e-9
"""Shorter lags are none (s)."""


class Motor(eqx.Module):
    """Limits of a motor's torque besides its response: how fast it changes, and its ripple."""

    rate_limit: float | Scalar
    """Fastest change of its torque (N m/s)."""
    ripple: float | Scalar
    """Amplitude of the torque ripple, a sine of the joint's angle (N m)."""
    ripple_periods: float | Scalar
    """Its periods in a turn of the joint."""

    def follow(self, wanted: Torque, before: Torque, dt: float | Scalar) -> Torque:
        """The motor's own torque (N m) on its way from ``before`` to ``wanted``, dt (s) later."""
        most = self.rate_limit * dt
        return before + jnp.clip(wanted - before, -most, most)

    def ripple_torque(self, q: Float[Array, "2"]) -> Torque:
        """Ripple torque (N m) at angles q (rad)."""
        return self.ripple * jnp.sin(self.ripple_periods * q)


class Drive(eqx.Module):
    """A motor that follows late, and delivers another torque than it was asked for."""

    gain: Float[Array | np.ndarray, "2"]
    """Delivered over asked torque of each joint's motor."""
    lag: float | Scalar
    """Time constant of the first-order lag (s)."""

    def follow(self, wanted: Torque, before: Torque, dt: float | Scalar) -> tuple[Torque, Torque]:
        """The mean torque (N m) over the next dt (s), and the torque at its end, from ``before`` to ``wanted``.

        The plant gets the mean, which has the same impulse as the exponential.
        """
        ratio = dt / jnp.maximum(self.lag, SHORTEST_LAG)
        left = jnp.exp(-ratio)
        return wanted + (before - wanted) * (1.0 - left) / ratio, wanted + (before - wanted) * left
