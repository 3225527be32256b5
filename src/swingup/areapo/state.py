"""The state between iterations, the rollout of one iteration, and its metrics."""

import dataclasses
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import optax
from jaxtyping import Array, Bool, Float, Shaped

from ..common.types import Count, Key, Scalar
from .advantage import Gains
from .average import mean
from .loss import LossMetrics
from .networks import AbstractActor, Critic
from .normalise import RunningStatistics
from .popart import ValueScale
from .reward_scale import RewardScale


class LearnerState(eqx.Module):
    """Everything that training needs to continue bit for bit."""

    actor: AbstractActor
    critic: Critic
    optimiser: optax.OptState
    gains: Gains
    statistics: RunningStatistics
    task_states: Any
    """States of the environments (leading axis: environment); None where the host steps them."""
    observations: Float[Array, "envs n"]
    """Their observations, normalised with the statistics of their time."""
    key: Key
    iterations: Count
    value_scale: ValueScale | None = None
    """What the critic's outputs stand for, with PopArt."""
    reset_cost: Scalar | None = None
    """What a termination costs, if that adapts (units of the reward)."""
    reward_scale: RewardScale | None = None
    """By what rewards are divided, if they are normalised."""
    memory: Float[Array, "envs w"] | None = None
    """What a recurrent policy remembers in each environment; 0 where an episode starts."""


class Rollout(eqx.Module):
    """The collected steps (leading axes: step, environment)."""

    observations: Float[Array, "steps envs n"]
    latents: Shaped[Array, "steps envs m"]
    log_probs: Float[Array, "steps envs"]
    rewards: Float[Array, "steps envs"]
    next_observations: Float[Array, "steps envs n"]
    """Of the state after the step and before any reset."""
    terminated: Bool[Array, "steps envs"]
    truncated: Bool[Array, "steps envs"]
    counted: Float[Array, "steps envs"] | None = None
    """0 for a row in which an environment did nothing but reset itself, else 1; None: all rows count."""
    memory: Float[Array, "envs w"] | None = None
    """Of a recurrent policy, before the first step."""

    @property
    def forgets(self) -> Bool[Array, "steps envs"]:
        """Where the next row starts an episode, and a recurrent policy its memory."""
        ended = self.terminated | self.truncated
        # The row of a reset follows the end of an episode, and precedes the start of the next.
        return ended if self.counted is None else ended | (self.counted == 0.0)


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
    """Mean of V before any centring."""
    entropy_value: Scalar
    """Mean of V_H before any centring."""
    gradient_norm: Scalar
    """Joint norm before clipping."""
    termination_rate: Scalar
    """Terminations a step: resets of the task itself."""
    truncation_rate: Scalar
    """Truncations a step, without those of a step that also terminates: the task would continue."""
    reset_cost: Scalar
    """What a termination costs after the iteration, where it costs something (units of the reward)."""
    losses: LossMetrics

    def as_dict(self) -> dict[str, float]:
        """Flat, as Python floats."""
        own = {
            field.name: getattr(self, field.name) for field in dataclasses.fields(self) if field.name != "losses"
        }
        return {name: float(value) for name, value in (own | vars(self.losses)).items()}


def iteration_metrics(
    rollout: Rollout,
    gains: Gains,
    cost: Scalar,
    value_means: Float[Array, "2"],
    losses: LossMetrics,
    gradient_norm: Scalar,
) -> Metrics:
    """The metrics of one iteration, over the frames that count."""
    return Metrics(
        reward=mean(rollout.rewards, rollout.counted),
        entropy=-mean(rollout.log_probs, rollout.counted),
        gain=gains.reward,
        entropy_gain=gains.entropy,
        value=value_means[0],
        entropy_value=value_means[1],
        gradient_norm=gradient_norm,
        termination_rate=termination_rate(rollout),
        truncation_rate=truncation_rate(rollout),
        reset_cost=cost,
        losses=losses,
    )


def termination_rate(rollout: Rollout) -> Scalar:
    """Terminations a step, over the frames that count."""
    return mean(rollout.terminated.astype(jnp.float32), rollout.counted)


def truncation_rate(rollout: Rollout) -> Scalar:
    """Truncations a step, over the frames that count; where a step is both, the termination decides."""
    return mean((rollout.truncated & ~rollout.terminated).astype(jnp.float32), rollout.counted)


def select(condition: Bool[Array, "envs"], new: Any, old: Any) -> Any:
    """A pytree with the leaves of ``new`` in the environments where the condition holds, else those of ``old``."""

    def choose(one: Array, other: Array) -> Array:
        return jnp.where(condition.reshape(-1, *(1,) * (one.ndim - 1)), one, other)

    return jax.tree.map(choose, new, old)
