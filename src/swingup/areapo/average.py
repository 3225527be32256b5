"""Means over frames, some of which may not count."""

import jax.numpy as jnp
from jaxtyping import Array, Float

Weights = Float[Array, "*frames"] | None
"""1 for a frame that counts, 0 for one that does not; None where all do."""

Axes = int | tuple[int, ...] | None


def mean(values: Float[Array, "..."], weights: Weights = None, axis: Axes = None) -> Float[Array, "..."]:
    """Mean over the axes of the frames. Only frames that count enter; without any, the mean is 0.

    Args:
        values: one or more numbers a frame.
        weights: of the frames; they broadcast against the values.
        axis: the axes of the frames, None for all axes.
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
