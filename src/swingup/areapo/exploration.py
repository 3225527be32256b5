"""How much noise a task bears: the standard deviation of actions after the first rollout."""

import math
from dataclasses import replace

import jax.numpy as jnp

from .config import Config
from .networks import BOUNDS, Actor
from .state import LearnerState, Rollout
from .statistics import mean

COSTLY = 0.05
"""Noise costs much where squared actions explain this share of the variance of the rewards. With the deviation
`mujoco` begins with, the share is 0.12 to 1 on the ants, Reacher and Pusher, at most 0.006 on six other tasks."""
LEAST_SHARE = 0.15
"""What remains of the first deviation there."""


def fit_deviation(state: LearnerState, rollout: Rollout, config: Config) -> LearnerState:
    """After the first rollout, lower σ where Σ a² and the rewards of its steps fall and rise against each other.

    Where torques cost nothing, as on Swimmer, much noise finds more. Where they cost much, σ would fall by itself,
    but slowly: a reacher needs 100,000 steps, and until then they hide what else an action does.
    """
    actor = state.actor
    if config.deviation != "fitted" or not isinstance(actor, Actor) or actor.std_head is None:
        return state
    efforts = jnp.sum(BOUNDS[actor.bounds](rollout.latents) ** 2, axis=-1)
    efforts, rewards = (values - mean(values, rollout.counted) for values in (efforts, rollout.rewards))
    variances = mean(efforts**2, rollout.counted) * mean(rewards**2, rollout.counted)
    costly = mean(efforts * rewards, rollout.counted) < -jnp.sqrt(COSTLY * variances)
    bias = actor.std_head.bias
    lower = jnp.minimum(bias, config.log_std_init + math.log(LEAST_SHARE))
    bias = jnp.where((state.iterations == 0) & costly, lower, bias)
    return replace(state, actor=replace(actor, std_head=replace(actor.std_head, bias=bias)))
