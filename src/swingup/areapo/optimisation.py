"""Adam's steps, the order of their frames, and the hyperparameters that change over a run."""

from dataclasses import replace
from typing import Any

import jax
import jax.numpy as jnp
import optax
from jaxtyping import Array, Int

from ..common.types import Count, Key, Scalar
from .config import Config

ADAM_EPSILON = 1e-5  # Adam's ε (authors' code)
SMALLEST_START = 1e-3  # Smallest 1 - λ from which the schedule anneal_lambda starts
FINAL_LAMBDA = 0.9  # λ at the end of the schedule anneal_lambda, when the critic is trained
WORD_BITS = 32  # Bits of each number that is sorted for a random order
MIN_RANDOM_BITS = 12  # Random bits of each such number that shuffle well enough


def make_optimiser(config: Config, scale: Scalar | float = 1.0) -> optax.GradientTransformation:
    """One Adam for both networks, with ``scale`` times the learning rate; clips the gradients' joint norm first."""
    return optax.chain(
        optax.clip_by_global_norm(config.max_grad_norm),
        optax.scale_by_adam(eps=ADAM_EPSILON),
        optax.scale(-config.learning_rate * scale),
    )


def scheduled(config: Config, iterations: Count) -> Config:
    """The hyperparameters of the next iteration after a number of iterations, as ``config.schedule`` says.

    ``anneal``: in the second half of each cycle the learning rate falls to 0.1 of itself and the clip range to
    0.15, by the same factor in equal times: late policies fall less often. ``anneal_entropy``: before, with 0.55 of
    the temperature from 0.15 to 0.4 of a cycle, a better swing-up is found. Warm restarts: arXiv 1608.03983.
    ``anneal_lambda``: with a small λ an untrained critic misleads; a trained one spares the noise of a large λ. So
    λ falls, 1 - λ by the same factor in equal times, from the first third of ``schedule_frames`` to their end.
    """
    if config.schedule == "constant":
        return config
    # Rounded up: a run of just one cycle ends before the next begins.
    cycle = -(-config.schedule_frames // config.rollout_size)
    if config.schedule == "anneal_lambda":
        fallen = jnp.clip((3.0 * iterations / cycle - 1.0) / 2.0, 0.0, 1.0)
        # From the larger λ; from 1 itself it could not fall by a factor.
        start = jnp.maximum(1.0 - jnp.maximum(*config.gae_lambda), SMALLEST_START)
        maximum = 1.0 - start ** (1.0 - fallen) * (1.0 - FINAL_LAMBDA) ** fallen
        lambdas: Any = tuple(jnp.minimum(each, maximum) for each in config.gae_lambda)
        return replace(config, gae_lambda=lambdas)
    done, half = iterations % cycle, max(1, cycle // 2)
    rate = optax.exponential_decay(1.0, half, 0.1, transition_begin=cycle - half)(done)
    clip = optax.exponential_decay(1.0, half, 0.15, transition_begin=cycle - half)(done)
    config = replace(config, learning_rate=config.learning_rate * rate, clip_range=config.clip_range * clip)
    if config.schedule == "anneal":
        return config
    falling, rising = optax.linear_schedule(1.0, 0.55, 0.15 * cycle), optax.linear_schedule(0.55, 1.0, 0.25 * cycle)
    entropy = optax.join_schedules([falling, rising], [0.4 * cycle])(done)
    return replace(config, temperature=config.temperature * entropy)


def adapted_step(scale: Scalar, divergence: Scalar, target: float) -> Scalar:
    """The learning rate's factor after a rollout: changed by a factor of at most 1.5, within 0.1 and 10.

    Without bounds it would grow for ever once a policy has converged and does not move.
    """
    # The divergence grows as the square of the step.
    change = jnp.clip(jnp.sqrt(target / jnp.maximum(divergence, 1e-12)), 1 / 1.5, 1.5)
    return jnp.clip(scale * change, 0.1, 10.0)


def shuffled(key: Key, epochs: int, size: int) -> Int[Array, "epochs size"]:
    """The numbers from 0 to size - 1, in a random order for each epoch.

    Random bits are sorted that have a frame's number in their last bits: XLA's CPU backend sorts one array of
    integers seven times faster than numbers by other numbers, as ``argsort`` does. Where random bits tie, frames
    keep their order; this matters only where a minibatch ends, and ties are few.
    """
    bits = jax.random.bits(key, (epochs, size))
    last = (size - 1).bit_length()
    if WORD_BITS - last < MIN_RANDOM_BITS:
        return jnp.argsort(bits, axis=-1)
    mask = jnp.uint32(2**last - 1)
    tagged = (bits & ~mask) | jnp.arange(size, dtype=jnp.uint32)
    return (jnp.sort(tagged, axis=-1) & mask).astype(jnp.int32)
