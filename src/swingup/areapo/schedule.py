"""Schedules: hyperparameters that change with the frames of a run."""

from dataclasses import replace
from typing import Any

import jax.numpy as jnp

from ..common.types import Count
from .config import Config

SCHEDULED = ("learning_rate", "clip_range", "temperature")
"""Hyperparameters that have a schedule, the field NAME_schedule."""


def at_iteration(config: Config, iterations: Count) -> Config:
    """The hyperparameters of the iteration after so many: each with a schedule is multiplied by its factor.

    A schedule is a line through its pairs of a part of ``schedule_frames`` and a factor; outside it is constant.
    After ``schedule_frames`` it stays at its end, or begins anew with ``schedule_repeats``.
    """
    if not config.schedule_frames:
        return config
    # As real numbers: a long run has more frames than 32 bits count.
    part = config.rollout_size * jnp.asarray(iterations, jnp.float32) / config.schedule_frames
    if config.schedule_repeats:
        part %= 1
    changed: dict[str, Any] = {}
    for name in SCHEDULED:
        pairs = getattr(config, f"{name}_schedule")
        if pairs:
            factor = jnp.interp(part, jnp.array(pairs[0::2]), jnp.array(pairs[1::2]))
            changed[name] = getattr(config, name) * factor
    return replace(config, **changed)
