"""Reward scaling: the learner learns on rewards divided by the deviation of their sums, so that values are near 1.

A sum is that of the rewards so far less their mean, in which a reward fades by γλ a step, as a δ does in an
advantage. ``NormalizeReward`` of Gymnasium has γ alone, which average reward cannot have. Values in units of one
step's deviation are in the tens: their loss then rules the gradients' joint norm, and the policy hardly moves. The
learner's gains, values and temperature are in this unit; the metrics are in the task's.

Without gains nothing takes up a constant in the rewards, and discounted values would have to reach m / (1 - γ) for
the mean m. There the running mean is subtracted, too (reward centring, arXiv 2405.09999).
"""

from dataclasses import replace

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from ..common.types import Scalar
from .config import Config
from .state import LearnerState, Rollout
from .statistics import RunningStatistics, mean

LEAST_DEVIATION = 1e-5
"""Rewards that vary by less than this share of their mean count as constant: single precision leaves constant ones
such a variance."""


def scale_rewards(state: LearnerState, rollout: Rollout, config: Config) -> tuple[LearnerState, Rollout]:
    """Divide a rollout's rewards by the unit σ of all rewards so far; without gains, less their mean m.

    ρ and v change with σ and m, so that they stay what they were in the task's units. ρ_H and v_H are in units of
    σ, as the temperature is. Beside centred values an end of the task, after which nothing follows, has the value
    -m / (1 - γ).
    """
    if not config.normalise_rewards:
        return state, rollout
    old, former = state.reward_statistics, reward_unit(state)
    new = old.update_all(rollout.rewards, rollout.counted)
    sums = state.sum_statistics.update_all(fading_sums(rollout, config), rollout.counted)
    state = replace(state, reward_statistics=new, sum_statistics=sums)
    # Before the first reward there is no unit: an untrained critic's values are in units of σ, whatever that is.
    unit, known = reward_unit(state), old.count > 0
    ratio, rewards, shift = jnp.where(known, former / unit, 1.0), rollout.rewards, jnp.zeros(())
    if config.gain == "none":
        forever = 1.0 / (1.0 - jnp.asarray(config.discount[0]))
        shift = jnp.where(known, forever * (new.mean - old.mean) / unit, 0.0)
        rewards = rewards - new.mean
        if config.terminations == "end":
            rewards = rewards - rollout.terminated * (forever - 1.0) * new.mean  # γ / (1 - γ) = 1 / (1 - γ) - 1
    pair = jnp.stack([ratio, jnp.ones(())])
    critic = state.critic.with_values(pair, jnp.stack([shift, jnp.zeros(())]))
    state = replace(state, critic=critic, gains=state.gains * pair)
    return state, replace(rollout, rewards=rewards / unit)


def reward_unit(state: LearnerState) -> Scalar:
    """σ, the deviation of the sums; that of a step's rewards where it is greater, as where they do not vary."""
    return jnp.maximum(deviation(state.reward_statistics), jnp.sqrt(state.sum_statistics.variance))


def fading_sums(rollout: Rollout, config: Config) -> Float[Array, "steps envs"]:
    """Σ (γλ)^k (r_{t-k} - m) over the steps of a rollout until each step, from 0 after a reset.

    m is the rollout's mean. Beside the mean of all rewards so far, what the policy gained by learning would add up:
    the unit would grow, and the temperature with it.
    """
    # Less the first reward, so that single precision keeps small differences of large rewards.
    differences = rollout.rewards - rollout.rewards[0, 0]
    centred = differences - mean(differences, rollout.counted)
    fading = config.discount[0] * config.gae_lambda[0] * (1.0 - (rollout.terminated | rollout.truncated))

    def add(before: Array, step: tuple[Array, Array]) -> tuple[Array, Array]:
        total = before + step[0]
        return total * step[1], total

    return jax.lax.scan(add, jnp.zeros_like(centred[0]), (centred, fading))[1]


def deviation(statistics: RunningStatistics) -> Scalar:
    """The rewards' deviation: their size where they are constant, and 1 while all are 0."""
    varies = statistics.variance > (LEAST_DEVIATION * statistics.mean) ** 2
    # The inner choice keeps the root's argument away from 0.
    constant = jnp.where(statistics.mean == 0.0, 1.0, jnp.abs(statistics.mean))
    return jnp.where(varies, jnp.sqrt(jnp.where(varies, statistics.variance, 1.0)), constant)
