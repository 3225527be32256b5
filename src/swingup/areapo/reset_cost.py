"""The cost of a reset where the task ends itself and goes on from a new start (ATRPO, arXiv 2106.07329)."""

from dataclasses import replace

import jax.numpy as jnp

from ..common.types import Scalar
from .config import Config
from .reward_scale import deviation
from .state import LearnerState, Rollout, termination_rate

TERMINATION_TARGET = 1e-3
"""f*: terminations a step that the adaptive cost permits (RVI-SAC, arXiv 2408.01972)."""
COST_STEP = 1.5
"""η_c: what each termination beyond those adds to the adaptive cost (deviations of the rewards)."""


def charge_resets(state: LearnerState, rollout: Rollout, config: Config) -> tuple[LearnerState, Rollout, Scalar]:
    """Subtract the cost of a reset from the rewards of terminated steps; also the cost (units of the reward).

    A fixed cost is in units of the reward, as in arXiv 2501.06937's continuing MuJoCo tasks. An adaptive cost is in
    deviations of the task's rewards so far: neither their unit nor a constant in them changes what it means. With
    any other meaning of a termination nothing changes.
    """
    if config.terminations == "reset_cost":
        cost = state.reset_cost
    elif config.terminations == "adaptive_cost":
        seen = state.task_rewards.update_all(rollout.rewards, rollout.counted)
        cost = state.reset_cost * deviation(seen)
        adapted = adapted_cost(state.reset_cost, termination_rate(rollout), config.rollout_size)
        state = replace(state, reset_cost=adapted, task_rewards=seen)
    else:
        return state, rollout, jnp.zeros(())
    charged = jnp.where(rollout.terminated, rollout.rewards - cost, rollout.rewards)
    return state, replace(rollout, rewards=charged), cost


def adapted_cost(cost: Scalar, rate: Scalar, frames: int) -> Scalar:
    """The cost after N frames with f terminations a step, c ← max(0, c + η_c min(N (f - f*), max(N f*, 1))).

    The cost is the multiplier of the constraint f ≤ f* (after RVI-SAC), and follows it at the same rate for every
    length of a rollout. No more terminations count than are permitted, or one: a policy that has learnt nothing yet
    falls a hundred times too often, and would make the cost so high that it stands still.
    """
    permitted = TERMINATION_TARGET * frames
    excess = jnp.minimum(rate * frames - permitted, max(permitted, 1.0))
    return jnp.maximum(0.0, cost + COST_STEP * excess)
