"""Annealing: hyperparameters that change with the frames of a run."""

from dataclasses import replace

import jax.numpy as jnp

from ..types import Count
from .config import Config


def annealed(config: Config, iterations: Count) -> Config:
    """The hyperparameters of the iteration after so many; those of a run without annealing stay as they are.

    Up to ``anneal_begin`` frames they are as given. Until ``anneal_end`` frames the learning rate and the
    temperature change linearly to their parts, which they keep.
    """
    if not config.anneal_end:
        return config
    # As real numbers: a long run has more frames than 32 bits count.
    frames = config.rollout_size * jnp.asarray(iterations, jnp.float32)
    done = jnp.clip((frames - config.anneal_begin) / (config.anneal_end - config.anneal_begin), 0.0, 1.0)
    return replace(
        config,
        learning_rate=config.learning_rate * (1.0 - done * (1.0 - config.learning_rate_end)),
        temperature=config.temperature * (1.0 - done * (1.0 - config.temperature_end)),
    )
