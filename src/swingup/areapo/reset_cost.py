"""The cost of a reset as a dual variable: it rises while terminations exceed their target, and falls below it."""

import jax.numpy as jnp

from ..common.types import Scalar
from .average import mean
from .config import Config
from .state import LearnerState, Rollout, termination_rate


def reset_cost(state: LearnerState, rollout: Rollout, config: Config) -> Scalar:
    """What a termination in a rollout costs, in units of the reward; 0 where it means something else.

    A relative cost is what a number of steps earns in this rollout, and 0 where they earn less than nothing.
    """
    if config.ending != "reset_cost":
        return jnp.zeros(())
    cost = jnp.asarray(config.reset_cost if state.reset_cost is None else state.reset_cost, jnp.float32)
    if config.relative_reset_cost:
        return cost * jnp.maximum(0.0, mean(rollout.rewards, rollout.counted))
    return cost


def adapt_reset_cost(cost: Scalar | None, rollout: Rollout, config: Config) -> Scalar | None:
    """The cost after a rollout, c ← max(0, c + η_c min(f / f* - 1, 1)); None, a fixed cost, stays None.

    The rollout has f terminations a step, and their target is f*. The cost never changes by more than η_c: a policy
    that has learnt nothing yet falls a hundred times too often, and would make it so high that it stands still.
    The idea is that of RVI-SAC (arXiv 2408.01972): the cost is the multiplier of the constraint f ≤ f*.
    """
    if cost is None:
        return None
    excess = termination_rate(rollout) / config.termination_target - 1.0
    return jnp.maximum(0.0, cost + config.reset_cost_step * jnp.minimum(excess, 1.0))
