"""The metrics of an iteration."""

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float

from ..common.types import Scalar
from .reward_scale import reward_unit
from .state import LearnerState, Rollout, termination_rate
from .statistics import mean


class LossMetrics(eqx.Module):
    """The terms of a minibatch's loss, and how far the policy moved."""

    policy_loss: Scalar
    value_loss: Scalar
    entropy_value_loss: Scalar
    approximate_kl: Scalar
    clip_fraction: Scalar


class Metrics(eqx.Module):
    """Means over the frames of an iteration."""

    reward: Scalar
    """Reward of a step."""
    entropy: Scalar
    """-log π of the sampled actions (nats)."""
    gain: Scalar
    """ρ after its update."""
    entropy_gain: Scalar
    """ρ_H after its update, in units of the reward."""
    value: Scalar
    """Mean of v before any centring."""
    entropy_value: Scalar
    """Mean of v_H before any centring."""
    gradient_norm: Scalar
    """Joint norm before clipping."""
    termination_rate: Scalar
    """Terminations a step: resets of the task itself."""
    truncation_rate: Scalar
    """Truncations a step, without those of a step that also terminates: the task would continue."""
    reset_cost: Scalar
    """What a termination cost, where it costs something (units of the reward)."""
    losses: LossMetrics

    def as_dict(self) -> dict[str, float]:
        """Flat, as Python floats."""
        values = vars(self) | vars(self.losses)
        return {name: float(value) for name, value in values.items() if name != "losses"}


def make_metrics(
    state: LearnerState,
    rollout: Rollout,
    cost: Scalar,
    value_means: Float[Array, "2"],
    losses: LossMetrics,
    gradient_norm: Scalar,
) -> Metrics:
    """The metrics of one iteration, over the frames that count.

    The rollout is as it was collected, the state that after the iteration. Means of values are on the scale of the
    rewards that are learned on, as the state's gains are.
    """
    unit = reward_unit(state)
    gains, values = state.gains * unit, value_means * unit
    truncated = rollout.truncated & ~rollout.terminated
    return Metrics(
        reward=mean(rollout.rewards, rollout.counted),
        entropy=-mean(rollout.log_probs, rollout.counted),
        gain=gains[0],
        entropy_gain=gains[1],
        value=values[0],
        entropy_value=values[1],
        gradient_norm=gradient_norm,
        termination_rate=termination_rate(rollout),
        truncation_rate=mean(truncated.astype(jnp.float32), rollout.counted),
        reset_cost=cost,
        losses=losses,
    )
