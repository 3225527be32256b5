"""Means over frames, some of which may not count, and running means of observations and rewards."""

from dataclasses import replace
from typing import Self

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float

from ..common.types import Flag, Scalar
from ..tasks.task import NormaliseStage

MIN_RELATIVE_DEVIATION = 1e-5
"""Rewards of a rollout that vary by less than this share of their mean count as constant: so large is the mean's
rounding in single precision."""
ROUNDING = 2.0**-21
"""Four spacings of single precision. A running deviation below this share of the mean is the rewards' rounding."""
Weights = Float[Array, "*frames"] | None
"""1 for a frame that counts, 0 for one that does not; None where all do."""

Axes = int | tuple[int, ...] | None

OBSERVATION_CLIP = 10.0  # Normalised observations are clipped to ± this (authors' code)
OBSERVATION_EPSILON = 1e-18  # Added to the variance: observations that vary by less than 1e-9 count as constant


def mean(values: Float[Array, "..."], weights: Weights = None, axis: Axes = None) -> Float[Array, "..."]:
    """Mean over the axes of the frames. Only frames that count enter; without any, the mean is 0.

    Weights broadcast against the values; ``axis`` has the axes of the frames, None for all.
    """
    # Where all rows count, the compiled program has no weights at all.
    if weights is None:
        return jnp.mean(values, axis=axis)
    total = jnp.sum(jnp.broadcast_to(weights, values.shape), axis=axis)
    # Weights are 0 or 1: a total below 1 is that of no frame, whose mean is 0 instead of NaN.
    return jnp.sum(values * weights, axis=axis) / jnp.maximum(total, 1.0)


def pair_mean(pairs: Float[Array, "steps envs 2"], weights: Weights = None) -> Float[Array, "2"]:
    """Mean of each objective over the frames of a rollout that count."""
    return mean(pairs, None if weights is None else weights[..., None], axis=(0, 1))


def standardise(values: Float[Array, "*frames"], weights: Weights = None) -> Float[Array, "*frames"]:
    """Shift and scale to mean 0 and standard deviation 1 over the frames that count."""
    centred = values - mean(values, weights)
    # 1e-8 keeps frames of equal values finite: they all become 0.
    return centred / (jnp.sqrt(mean(centred**2, weights)) + 1e-8)


class RunningStatistics(eqx.Module):
    """Mean and population variance of all rows so far (Welford's method, merged after Chan et al.)."""

    origin: Float[Array, "*n"]
    """The first row. Moments are those of the differences from it: single precision would lose, for example, a
    deviation of 1 beside a mean of 1e6."""
    difference: Float[Array, "*n"]
    """Mean less origin."""
    variance: Float[Array, "*n"]
    count: Scalar

    @property
    def mean(self) -> Float[Array, "*n"]:
        """Mean of all rows."""
        return self.origin + self.difference

    def update(self, batch: Float[Array, "b *n"], weights: Weights = None) -> Self:
        """The statistics after one more batch, of the rows that count."""
        size = jnp.asarray(float(batch.shape[0])) if weights is None else jnp.sum(weights)
        origin = jnp.where(self.count > 0, self.origin, batch[0])
        differences = batch - origin
        here = mean(differences, weights, axis=0)
        # Perhaps no row counts, and none did before.
        total = jnp.maximum(self.count + size, 1.0)
        delta = here - self.difference
        spread = self.variance * self.count + mean((differences - here) ** 2, weights, axis=0) * size
        return replace(
            self,
            origin=origin,
            difference=self.difference + delta * (size / total),
            variance=(spread + delta**2 * (self.count * size / total)) / total,
            count=self.count + size,
        )

    def update_all(self, batches: Float[Array, "steps b *n"], weights: Float[Array, "steps b"] | None) -> Self:
        """The statistics after all rows of a rollout that count."""
        flat = None if weights is None else weights.reshape(-1)
        return self.update(batches.reshape(-1, *self.origin.shape), flat)

    def stage(self) -> NormaliseStage:
        """The observation's normalisation with the statistics as they stand."""
        return NormaliseStage(self.mean, self.variance, OBSERVATION_CLIP, OBSERVATION_EPSILON)


def running_statistics(*shape: int) -> RunningStatistics:
    """Statistics of no row yet."""
    return RunningStatistics(jnp.zeros(shape), jnp.zeros(shape), jnp.zeros(shape), jnp.zeros(()))


def varies(statistics: RunningStatistics) -> Flag:
    """Whether rewards so far differ by more than their rounding."""
    return statistics.variance > (ROUNDING * statistics.mean) ** 2


def deviation(statistics: RunningStatistics) -> Scalar:
    """The rewards' deviation: their size where they are constant, and 1 while all are 0."""
    varied = varies(statistics)
    # The inner choice keeps the root's argument away from 0.
    constant = jnp.where(statistics.mean == 0.0, 1.0, jnp.abs(statistics.mean))
    return jnp.where(varied, jnp.sqrt(jnp.where(varied, statistics.variance, 1.0)), constant)
