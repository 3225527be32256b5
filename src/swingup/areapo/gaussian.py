"""The tanh-squashed Gaussian on [-1, 1].

Samples are kept before the tanh: recovering them with atanh loses precision near saturation.
"""

import math

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from .distribution import AbstractDistribution

_LOG_2 = math.log(2.0)
_LOG_SQRT_2PI = 0.5 * math.log(2.0 * math.pi)


class SquashedGaussian(AbstractDistribution):
    """Distribution of a = tanh(z), z ~ N(mean, exp(log_std)²), entries independent; batch axes come last."""

    mean: Float[Array, "m *batch"]
    log_std: Float[Array, "m *batch"]

    def sample(self, noise: Float[Array, "m *batch"]) -> Float[Array, "m *batch"]:
        """z, the action before tanh, for normal noise."""
        return self.mean + jnp.exp(self.log_std) * noise

    def log_prob(self, z: Float[Array, "m *batch"]) -> Float[Array, "*batch"]:
        """Log density of a = tanh(z) on [-1, 1]: log N(z) - log(1 - tanh(z)²), summed over the entries."""
        standardised = (z - self.mean) * jnp.exp(-self.log_std)
        gaussian = -0.5 * standardised**2 - self.log_std - _LOG_SQRT_2PI
        # 1 - tanh(z)² = 4 / (e^z + e^-z)², which this form evaluates without cancellation for any z.
        log_slope = 2.0 * (_LOG_2 - z - jax.nn.softplus(-2.0 * z))
        return jnp.sum(gaussian - log_slope, axis=0)

    def action(self, z: Float[Array, "m *batch"]) -> Float[Array, "m *batch"]:
        """The action of a sample."""
        return jnp.tanh(z)
