"""The cost of a reset where the task ends itself and goes on from a new start (ATRPO, arXiv 2106.07329)."""

from dataclasses import replace

import jax.numpy as jnp

from ..common.types import Scalar
from .average import mean
from .config import Config
from .state import LearnerState, Rollout, termination_rate

TERMINATION_TARGET = 1e-3
"""f*: terminations a step that the adaptive cost permits (RVI-SAC, arXiv 2408.01972)."""
COST_STEP = 2.0
"""η_c: the most by which a rollout changes the adaptive cost (steps)."""


def charge_resets(state: LearnerState, rollout: Rollout, config: Config) -> tuple[LearnerState, Rollout, Scalar]:
    """Subtract the cost of a reset from the rewards of terminated steps; also the cost (units of the reward).

    A fixed cost is in units of the reward, as in arXiv 2501.06937's continuing MuJoCo tasks. An adaptive cost is a
    number of steps: a reset costs what so many earn in this rollout, and nothing where they earn less than 0. A
    discount γ has such a cost, of 1 / (1 - γ) steps. With any other meaning of a termination nothing changes.
    """
    if config.terminations == "reset_cost":
        cost = state.reset_cost
    elif config.terminations == "adaptive_cost":
        cost = state.reset_cost * jnp.maximum(0.0, mean(rollout.rewards, rollout.counted))
        state = replace(state, reset_cost=adapted_cost(state.reset_cost, termination_rate(rollout)))
    else:
        return state, rollout, jnp.zeros(())
    charged = jnp.where(rollout.terminated, rollout.rewards - cost, rollout.rewards)
    return state, replace(rollout, rewards=charged), cost


def adapted_cost(cost: Scalar, rate: Scalar) -> Scalar:
    """The cost after a rollout with f terminations a step, c ← max(0, c + η_c min(f / f* - 1, 1)).

    The cost is the multiplier of the constraint f ≤ f* (after RVI-SAC). It never changes by more than η_c: a policy
    that has learnt nothing yet falls a hundred times too often, and would make it so high that it stands still.
    """
    return jnp.maximum(0.0, cost + COST_STEP * jnp.minimum(rate / TERMINATION_TARGET - 1.0, 1.0))
