"""Annealing: smaller steps, and another temperature, towards the end of a run."""

from dataclasses import replace
from typing import Any

import jax.numpy as jnp

from ..types import Count
from .config import Config


def annealed(config: Config, iterations: Count) -> Config:
    """The hyperparameters of the iteration after so many; those of a run without annealing stay as they are.

    Up to ``anneal_begin`` frames they are as given, from ``anneal_end`` frames on they are multiplied by their
    factors. In between learning rate and clip range fall geometrically, and the temperature changes linearly.
    """
    if not config.anneal_end:
        return config
    # As real numbers: a long run has more frames than 32 bits count.
    frames = config.rollout_size * jnp.asarray(iterations, jnp.float32)
    done = jnp.clip((frames - config.anneal_begin) / (config.anneal_end - config.anneal_begin), 0.0, 1.0)
    changed: dict[str, Any] = {
        "learning_rate": config.learning_rate * config.learning_rate_end**done,
        "clip_range": config.clip_range * config.clip_range_end**done,
        "temperature": config.temperature * (1.0 + done * (config.temperature_end - 1.0)),
    }
    return replace(config, **changed)
