"""Reward scaling: the learner learns on rewards divided by their running standard deviation.

``NormalizeReward`` of Gymnasium divides by the deviation of the discounted return. Average reward has no such
return: here it is the deviation of a step's reward. The learner's gains, values and temperature are in units of it;
the metrics are in the task's units.
"""

from dataclasses import replace

import jax.numpy as jnp

from ..common.types import Scalar
from .config import Config
from .normalise import RunningStatistics
from .state import LearnerState, Rollout

LEAST_DEVIATION = 1e-5
"""Rewards that vary by less than this share of their mean count as constant, and are not scaled: single precision
leaves constant ones such a variance."""


def scale_rewards(state: LearnerState, rollout: Rollout, config: Config) -> tuple[LearnerState, Rollout]:
    """Divide a rollout's rewards by the deviation σ of all rewards so far.

    ρ and v change with σ, so that they stay what they were in the task's units. ρ_H and v_H are in units of σ, as
    the temperature is.
    """
    if not config.normalise_rewards:
        return state, rollout
    old = state.reward_statistics
    counted = None if rollout.counted is None else rollout.counted.reshape(-1)
    new = old.update(rollout.rewards.reshape(-1), counted)
    # Before the first reward there is no unit: an untrained critic's values are in units of σ, whatever that is.
    ratio = jnp.where(old.count > 0, deviation(old) / deviation(new), 1.0)
    pair = jnp.stack([ratio, jnp.ones(())])
    critic = state.critic.with_values(pair, jnp.zeros(2))
    state = replace(state, critic=critic, gains=state.gains * pair, reward_statistics=new)
    return state, replace(rollout, rewards=rollout.rewards / deviation(new))


def deviation(statistics: RunningStatistics) -> Scalar:
    """σ, by which rewards are divided; 1 before the first reward and for constant ones."""
    varies = statistics.variance > (LEAST_DEVIATION * statistics.mean) ** 2
    # The inner choice keeps the root's argument away from 0.
    return jnp.where(varies, jnp.sqrt(jnp.where(varies, statistics.variance, 1.0)), 1.0)
