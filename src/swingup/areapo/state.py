"""The state between iterations, the rollout of one iteration, and the frames to learn from."""

from enum import IntEnum
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import optax
from jaxtyping import Array, Bool, Float, Shaped

from ..common.types import Count, Flag, Key, Scalar
from ..tasks.task import AbstractTask
from .networks import AnyActor, Critic
from .statistics import RunningStatistics, deviation, mean

COLLECT, IMPROVE, NEXT = range(3)
"""Purposes of the key of an iteration; the last one gives the key of the next iteration."""


class Purpose(IntEnum):
    """The consumers of a seed, each with a root of its own."""

    TRAINING = 0
    EVALUATION = 1
    FAULT_SEARCH = 3


def root_key(seed: int, purpose: Purpose) -> Key:
    """The key from which all randomness of a consumer follows."""
    return jax.random.fold_in(jax.random.key(seed), purpose)


class LearnerState(eqx.Module):
    """Everything that training needs to continue bit for bit."""

    actor: AnyActor
    critic: Critic
    optimiser: optax.OptState
    gains: Float[Array, "2"]
    """The reward gain ρ and the entropy gain ρ_H."""
    gain_trace: Scalar
    """z, by which the step size of gains that follow advantages is divided."""
    statistics: RunningStatistics
    """Running statistics of the observations."""
    task_states: Any
    """States of the environments (leading axis: environment); None where the host steps them."""
    observations: Float[Array, "envs n"]
    """Their observations, normalised with the statistics of their time."""
    key: Key
    iterations: Count
    reset_cost: Scalar
    """Cost of a termination, if it has one (units of the reward, or its standard deviations if the cost adapts)."""
    task_rewards: RunningStatistics
    """Statistics of the task's rewards, if the cost of a reset is in units of their deviation."""
    reward_statistics: RunningStatistics
    """Statistics of the rewards with the cost of a reset, if they are normalised."""
    step_scale: Scalar
    """Factor of the learning rate, if it adapts."""
    sum_statistics: RunningStatistics
    """Statistics of the decayed sums of these rewards, whose standard deviation is their unit."""
    informed: Flag
    """Whether a rollout had ends, or rewards that vary by more than the price of actions."""


class Rollout(eqx.Module):
    """The collected steps (leading axes: step, environment)."""

    observations: Float[Array, "steps envs n"]
    latents: Shaped[Array, "steps envs m"]
    log_probs: Float[Array, "steps envs"]
    rewards: Float[Array, "steps envs"]
    next_observations: Float[Array, "steps envs n"]
    """Observations of the states after the steps and before any reset."""
    terminated: Bool[Array, "steps envs"]
    truncated: Bool[Array, "steps envs"]
    counted: Float[Array, "steps envs"] | None = None
    """0 for a row in which an environment only reset itself, or an action came late, else 1; None: all count."""
    goals: Bool[Array, "steps envs"] | None = None
    """Ends that the environments themselves call a success; None where they do not say."""


class Frames(eqx.Module):
    """Frames to learn from; every leaf has the same leading axes."""

    observations: Float[Array, "*b n"]  # Normalised with the statistics of their time
    latents: Shaped[Array, "*b m"]  # Samples, before tanh if they are continuous
    log_probs: Float[Array, "*b"]  # log π(a|s) under the policy that drew them
    advantages: Float[Array, "*b"]  # Soft advantages A + A_H
    returns: Float[Array, "*b 2"]  # λ-returns of both objectives: the critic's targets
    weights: Float[Array, "*b"] | None = None
    """1 for a frame that counts, 0 for one that does not; None: all count."""


def termination_rate(rollout: Rollout) -> Scalar:
    """Terminations a step, over the frames that count."""
    return mean(rollout.terminated.astype(jnp.float32), rollout.counted)


def reset_ended(task: AbstractTask[Any], ended: Bool[Array, "envs"], states: Any, keys: Key) -> Any:
    """The states with new starts in the environments that ended; there is a key for each environment."""

    def choose(start: Array, state: Array) -> Array:
        return jnp.where(ended.reshape(-1, *(1,) * (state.ndim - 1)), start, state)

    # Few steps have a reset. All environments draw one then, and always where seeds run side by side.
    return jax.lax.cond(
        jnp.any(ended), lambda: jax.tree.map(choose, jax.vmap(task.reset)(keys), states), lambda: states
    )


def reward_unit(state: LearnerState) -> Scalar:
    """σ, the deviation of the sums, or of single rewards where it is greater: constant rewards have a σ, too."""
    return jnp.maximum(deviation(state.reward_statistics), jnp.sqrt(state.sum_statistics.variance))


class LossMetrics(eqx.Module):
    """The terms of a minibatch's loss, and how far the policy moved."""

    policy_loss: Scalar
    value_loss: Scalar
    entropy_value_loss: Scalar
    approximate_kl: Scalar
    clip_fraction: Scalar


class Metrics(eqx.Module):
    """Means over the frames of an iteration."""

    reward: Scalar  # Reward of a step
    entropy: Scalar  # -log π of the sampled actions (nats)
    gain: Scalar  # ρ after its update
    entropy_gain: Scalar  # ρ_H after its update, in units of the reward
    value: Scalar  # Mean of v before any centring
    entropy_value: Scalar  # Mean of v_H before any centring
    gradient_norm: Scalar  # Joint norm before clipping
    termination_rate: Scalar  # Terminations a step: resets of the task itself
    truncation_rate: Scalar
    """Truncations a step, not counting steps that also terminate: the task would continue."""
    reset_cost: Scalar  # Cost of a termination, if it has one (units of the reward)
    losses: LossMetrics

    def as_dict(self) -> dict[str, float]:
        """Flat, as Python floats."""
        values = vars(self) | vars(self.losses)
        return {name: float(value) for name, value in values.items() if name != "losses"}


def no_metrics() -> Metrics:
    """Zeros, to which the metrics of iterations are added."""
    zero = jnp.zeros(())
    return Metrics(
        reward=zero, entropy=zero, gain=zero, entropy_gain=zero, value=zero, entropy_value=zero,
        gradient_norm=zero, termination_rate=zero, truncation_rate=zero, reset_cost=zero,
        losses=LossMetrics(zero, zero, zero, zero, zero),
    )  # fmt: skip


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
