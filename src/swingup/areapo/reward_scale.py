"""Reward scaling: the learner learns on rewards divided by their running standard deviation.

``NormalizeReward`` of Gymnasium divides by the deviation of the discounted return. Average reward has no such
return: here it is the deviation of a step's reward. Gains, advantages and reported values stay in the task's units;
the critic's outputs, the temperature and the advantages in the loss are on the scale.
"""

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float

from ..common.types import Scalar
from .average import Weights, mean
from .networks import Critic

LEAST_DEVIATION = 1e-5
"""Rewards that vary by less than this share of their mean count as constant, and are not scaled: single precision
leaves constant ones such a variance."""


class RewardScale(eqx.Module):
    """Mean and population variance of all rewards so far (Welford's method, merged rollout by rollout)."""

    mean: Scalar
    variance: Scalar
    count: Scalar

    @property
    def deviation(self) -> Scalar:
        """σ, by which rewards are divided; 1 before the first reward and for constant ones."""
        varies = self.variance > (LEAST_DEVIATION * self.mean) ** 2
        # The inner choice keeps the root's argument away from 0.
        return jnp.where(varies, jnp.sqrt(jnp.where(varies, self.variance, 1.0)), 1.0)

    def update(self, rewards: Float[Array, "*frames"], weights: Weights = None) -> "RewardScale":
        """The moments after one more rollout, of the frames that count."""
        size = jnp.sum(jnp.ones_like(rewards) if weights is None else weights)
        here = mean(rewards, weights)
        spread = mean((rewards - here) ** 2, weights) * size + self.variance * self.count
        # A rollout may have no frame that counts.
        total = jnp.maximum(self.count + size, 1.0)
        delta = here - self.mean
        return RewardScale(
            mean=self.mean + delta * (size / total),
            variance=(spread + delta**2 * (self.count * size / total)) / total,
            count=self.count + size,
        )


def init_reward_scale() -> RewardScale:
    """The scale before the first reward."""
    return RewardScale(mean=jnp.zeros(()), variance=jnp.zeros(()), count=jnp.zeros(()))


def keep_values(critic: Critic, old: RewardScale, new: RewardScale) -> Critic:
    """The critic whose values under the new scale are those of the old critic under the old.

    Those of the rewards stay in the task's units. Those of the entropy are in units of σ, as the temperature is.
    """
    ratio = jnp.stack([1.0 / change(old, new), jnp.ones(())])
    heads = (critic.heads.weight * ratio[:, None], critic.heads.bias * ratio)
    return eqx.tree_at(lambda c: (c.heads.weight, c.heads.bias), critic, heads)


def change(old: RewardScale, new: RewardScale) -> Scalar:
    """The new σ over the old."""
    # Before the first reward there is no unit: an untrained critic's values are in units of σ, whatever that is.
    return jnp.where(old.count > 0, new.deviation / old.deviation, 1.0)
