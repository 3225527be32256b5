"""Reward scaling: the learner learns on rewards divided by their running standard deviation.

``NormalizeReward`` of Gymnasium divides by the deviation of the discounted return. Average reward has no such
return: here it is the deviation of a step's reward. The learner's gains, values and temperature are in units of it;
the metrics are in the task's units.

Without gains nothing takes up a constant in the rewards, and discounted values would have to reach m / (1 - γ) for
the mean m. There the running mean is subtracted, too (reward centring, arXiv 2405.09999).
"""

from dataclasses import replace

import jax.numpy as jnp

from ..common.types import Scalar
from .config import Config
from .normalise import RunningStatistics
from .state import LearnerState, Rollout

LEAST_DEVIATION = 1e-5
"""Rewards that vary by less than this share of their mean count as constant: single precision leaves constant ones
such a variance."""


def scale_rewards(state: LearnerState, rollout: Rollout, config: Config) -> tuple[LearnerState, Rollout]:
    """Divide a rollout's rewards by the deviation σ of all rewards so far; without gains, less their mean m.

    ρ and v change with σ and m, so that they stay what they were in the task's units. ρ_H and v_H are in units of
    σ, as the temperature is. Beside centred values an end of the task, after which nothing follows, has the value
    -m / (1 - γ).
    """
    if not config.normalise_rewards:
        return state, rollout
    old = state.reward_statistics
    new = old.update_all(rollout.rewards, rollout.counted)
    # Before the first reward there is no unit: an untrained critic's values are in units of σ, whatever that is.
    unit, known = deviation(new), old.count > 0
    ratio, rewards, shift = jnp.where(known, deviation(old) / unit, 1.0), rollout.rewards, jnp.zeros(())
    if config.gain == "none":
        forever = 1.0 / (1.0 - jnp.asarray(config.discount[0]))
        shift = jnp.where(known, forever * (new.mean - old.mean) / unit, 0.0)
        rewards = rewards - new.mean
        if config.terminations == "end":
            rewards = rewards - rollout.terminated * (forever - 1.0) * new.mean  # γ / (1 - γ) = 1 / (1 - γ) - 1
    pair = jnp.stack([ratio, jnp.ones(())])
    critic = state.critic.with_values(pair, jnp.stack([shift, jnp.zeros(())]))
    state = replace(state, critic=critic, gains=state.gains * pair, reward_statistics=new)
    return state, replace(rollout, rewards=rewards / unit)


def deviation(statistics: RunningStatistics) -> Scalar:
    """σ, the unit of the rewards: their size where they are constant, and 1 while all are 0."""
    varies = statistics.variance > (LEAST_DEVIATION * statistics.mean) ** 2
    # The inner choice keeps the root's argument away from 0.
    constant = jnp.where(statistics.mean == 0.0, 1.0, jnp.abs(statistics.mean))
    return jnp.where(varies, jnp.sqrt(jnp.where(varies, statistics.variance, 1.0)), constant)
