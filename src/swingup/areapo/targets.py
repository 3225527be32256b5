"""The critic's targets from a rollout: bootstrapped values, the meaning of an ending, PopArt's rescaling."""

import dataclasses
from collections.abc import Callable
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from ..common.types import Count, Scalar
from .average import mean
from .config import Config
from .networks import values as network_values
from .popart import rescale
from .reward_scale import change, keep_values
from .state import LearnerState, Rollout
from .unroll import Memories, memories

BOOTSTRAP_SIZE = 64
"""Truncated states whose values are computed at once; a rollout of Table I holds about 13."""


class ValueEstimates(NamedTuple):
    """[V, V_H] along a rollout."""

    values: Float[Array, "steps envs 2"]
    """Of the state before each step."""
    next_values: Float[Array, "steps envs 2"]
    """Of the state after each step; where an episode was truncated, of the state before the reset."""
    means: Float[Array, "2"]
    """Means of ``values`` before any centring."""


def estimate_values(state: LearnerState, rollout: Rollout, config: Config) -> tuple[LearnerState, ValueEstimates]:
    """Bootstrapped values along a rollout; ``centre_values`` subtracts their means from the critic."""
    before, after = memories(state.actor, rollout.memory, rollout.observations, rollout.forgets)

    def output(observation: Float[Array, "n"], memory: Float[Array, "w"] | None) -> Float[Array, "2"]:
        return network_values(state.actor, state.critic, observation, memory)

    outputs = jax.vmap(jax.vmap(output))(rollout.observations, before)
    last = jax.vmap(output)(state.observations, state.memory)
    # The next row holds the next state, except after a reset; _bootstrap corrects those rows.
    next_outputs = jnp.concatenate([outputs[1:], last[None]])
    next_outputs = _bootstrap(output, rollout, after, next_outputs, config)
    values, next_values = _denormalise(state, outputs), _denormalise(state, next_outputs)
    means = _mean_of_both(values, rollout)
    if not config.centre_values:
        return state, ValueEstimates(values, next_values, means)
    # The mean leaves the biases, too, or the next rollout would have it again.
    shift = over_scale(state, means)
    critic = eqx.tree_at(lambda c: c.heads.bias, state.critic, replace_fn=lambda bias: bias - shift)
    centred = dataclasses.replace(state, critic=critic)
    # Both shift alike, so that with γ = 1 no advantage changes.
    return centred, ValueEstimates(values - means, next_values - means, means)


def apply_endings(
    rollout: Rollout, next_values: Float[Array, "steps envs 2"], cost: Scalar, config: Config
) -> tuple[Float[Array, "steps envs"], Float[Array, "steps envs 2"]]:
    """Rewards and next values with terminations as ``Config.terminations`` says, at this cost of a reset."""
    rewards = charged_rewards(rollout, cost, config)
    if config.ending == "end":
        return rewards, jnp.where(rollout.terminated[..., None], 0.0, next_values)
    # next_values are those of the new start: _bootstrap replaced only truncated steps.
    return rewards, next_values


def charged_rewards(rollout: Rollout, cost: Scalar, config: Config) -> Float[Array, "steps envs"]:
    """Rewards less the cost of a reset, where there is one."""
    if config.ending != "reset_cost":
        return rollout.rewards
    return jnp.where(rollout.terminated, rollout.rewards - cost, rollout.rewards)


def follow_rewards(state: LearnerState, rollout: Rollout, cost: Scalar, config: Config) -> LearnerState:
    """The state whose reward scale has seen a rollout; values of rewards stay. Without a scale all stays."""
    if state.reward_scale is None:
        return state
    scale = state.reward_scale.update(charged_rewards(rollout, cost, config), rollout.counted)
    critic = keep_values(state.critic, state.reward_scale, scale)
    # The reward of entropy grows with σ, and with it its gain.
    entropy = state.gains.entropy * change(state.reward_scale, scale)
    gains = dataclasses.replace(state.gains, entropy=entropy)
    return dataclasses.replace(state, critic=critic, gains=gains, reward_scale=scale)


def times_scale(state: LearnerState, values: Any) -> Any:
    """Values in the task's units, for values on the learner's scale of rewards."""
    return values if state.reward_scale is None else values * state.reward_scale.deviation


def over_scale(state: LearnerState, values: Any) -> Any:
    """Values on the learner's scale of rewards, for values in the task's units."""
    return values if state.reward_scale is None else values / state.reward_scale.deviation


def normalise_returns(
    state: LearnerState, returns: Float[Array, "steps envs 2"], rollout: Rollout, config: Config
) -> tuple[LearnerState, Float[Array, "steps envs 2"]]:
    """The critic's targets: the returns on the scale of the rewards, or of PopArt, which first follows them."""
    if state.value_scale is None:
        return state, over_scale(state, returns)
    first, second = _mean_of_both(returns, rollout), _mean_of_both(returns**2, rollout)
    scale = state.value_scale.update(first, second, config.popart_step_size)
    critic = rescale(state.critic, state.value_scale, scale)
    return dataclasses.replace(state, critic=critic, value_scale=scale), scale.normalise(returns)


def _denormalise(state: LearnerState, outputs: Float[Array, "steps envs 2"]) -> Float[Array, "steps envs 2"]:
    return times_scale(state, outputs) if state.value_scale is None else state.value_scale.denormalise(outputs)


def _mean_of_both(values: Float[Array, "steps envs 2"], rollout: Rollout) -> Float[Array, "2"]:
    weights = None if rollout.counted is None else rollout.counted[..., None]
    return mean(values, weights, axis=(0, 1))


def _bootstrap(
    output: Callable[..., Array],
    rollout: Rollout,
    memory: Memories,
    next_values: Float[Array, "steps envs 2"],
    config: Config,
) -> Float[Array, "steps envs 2"]:
    """Replace the next values of truncated steps by those of the true next states, a few at a time.

    Few steps are truncated: evaluating the critic on all true next states would cost as much as on the rollout.
    """
    # Where a step is both, the termination decides.
    cut_short = rollout.truncated & ~rollout.terminated
    if config.ending == "bootstrap":
        cut_short = rollout.truncated | rollout.terminated
    truncated = cut_short.reshape(-1)
    seen = jax.tree.map(lambda leaf: leaf.reshape(truncated.size, -1), (rollout.next_observations, memory))
    # Those to replace first; one array of integers sorts far faster than argsort(~truncated).
    order = jnp.sort(jnp.arange(truncated.size) + jnp.where(truncated, 0, truncated.size)) % truncated.size

    def replace(carry: tuple[Count, Array]) -> tuple[Count, Array]:
        start, flat = carry
        # The last slice is moved back to fit. It then repeats some rows, with the same result.
        indices = jax.lax.dynamic_slice(order, (start,), (min(BOOTSTRAP_SIZE, truncated.size),))
        fixed = jax.vmap(output)(*jax.tree.map(lambda leaf: leaf[indices], seen))
        kept = jnp.where(truncated[indices, None], fixed, flat[indices])
        return start + BOOTSTRAP_SIZE, flat.at[indices].set(kept)

    flat = next_values.reshape(-1, 2)
    count = jnp.sum(truncated)
    _, flat = jax.lax.while_loop(lambda carry: carry[0] < count, replace, (jnp.array(0), flat))
    return flat.reshape(next_values.shape)
