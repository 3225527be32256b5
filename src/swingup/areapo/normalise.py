"""Running mean and variance, of the observations or of the rewards (Welford's method, merged after Chan et al.)."""

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float

from ..common.types import Scalar
from ..tasks.observation import Normalise
from .average import Weights, mean

OBSERVATION_CLIP = 10.0
"""Normalised observations are clipped to ± this (authors' code)."""


class RunningStatistics(eqx.Module):
    """Mean and population variance of all rows so far."""

    mean: Float[Array, "*n"]
    variance: Float[Array, "*n"]
    count: Scalar

    def update(self, batch: Float[Array, "b *n"], weights: Weights = None) -> "RunningStatistics":
        """The statistics after one more batch, of the rows that count."""
        size = jnp.asarray(float(batch.shape[0])) if weights is None else jnp.sum(weights)
        here = mean(batch, weights, axis=0)
        # Perhaps no row counts, and none did before.
        total = jnp.maximum(self.count + size, 1.0)
        delta = here - self.mean
        spread = self.variance * self.count + mean((batch - here) ** 2, weights, axis=0) * size
        return RunningStatistics(
            mean=self.mean + delta * (size / total),
            variance=(spread + delta**2 * (self.count * size / total)) / total,
            count=self.count + size,
        )

    def stage(self) -> Normalise:
        """The observation's normalisation with the statistics as they stand."""
        return Normalise(mean=self.mean, variance=self.variance, clip=OBSERVATION_CLIP)


def observation_statistics(size: int) -> RunningStatistics:
    """Mean 0 and variance 1, with the weight of 1e-4 observations."""
    # 1e-4 is the weight in Stable-Baselines3, on which the authors' code builds.
    return RunningStatistics(mean=jnp.zeros(size), variance=jnp.ones(size), count=jnp.array(1e-4))


def reward_statistics() -> RunningStatistics:
    """No reward yet."""
    return RunningStatistics(mean=jnp.zeros(()), variance=jnp.zeros(()), count=jnp.zeros(()))
