"""Running mean and variance of the observations (Welford's method, merged batch by batch after Chan et al.)."""

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float

from ..common.types import Scalar
from ..tasks.observation import Normalise


class RunningStatistics(eqx.Module):
    """Mean and population variance of all observations so far."""

    mean: Float[Array, "n"]
    variance: Float[Array, "n"]
    count: Scalar

    def update(self, batch: Float[Array, "b n"]) -> "RunningStatistics":
        """The statistics after one more batch of observations."""
        size = batch.shape[0]
        total = self.count + size
        delta = jnp.mean(batch, axis=0) - self.mean
        spread = self.variance * self.count + jnp.var(batch, axis=0) * size
        return RunningStatistics(
            mean=self.mean + delta * (size / total),
            variance=(spread + delta**2 * (self.count * size / total)) / total,
            count=total,
        )

    def stage(self, clip: float) -> Normalise:
        """Normalisation with the statistics as they stand."""
        return Normalise(mean=self.mean, variance=self.variance, clip=clip)


def init_statistics(size: int) -> RunningStatistics:
    """Mean 0 and variance 1, with the weight of 1e-4 observations."""
    # 1e-4 is the weight in Stable-Baselines3, on which the authors' code builds.
    return RunningStatistics(mean=jnp.zeros(size), variance=jnp.ones(size), count=jnp.array(1e-4))
