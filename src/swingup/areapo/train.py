"""AR-EAPO on one screen: ``init``, ``iteration`` (collect, estimate, improve) and ``train`` (many in one call).

Everything is a pure function of a :class:`LearnerState` for one seed; ``vmap`` runs seeds side by side. Source: the
AR-EAPO paper, section III, and the authors' public implementation where the paper is silent.
"""

import dataclasses
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import optax
from jaxtyping import Array, Bool, Float

from ..tasks.task import AbstractTask
from ..types import Count, Key, Scalar
from .advantage import Gains, advantages, init_gains, update_gains
from .config import Config
from .loss import Batch, LossMetrics, loss
from .networks import Actor, Critic, init_actor, init_critic
from .normalise import RunningStatistics, init_statistics

Task = AbstractTask[Any]

BOOTSTRAP_SIZE = 64
"""Truncated states whose values are computed at once; a rollout of Table I holds about 13."""


class LearnerState(eqx.Module):
    """Everything that training needs to go on, bit for bit."""

    actor: Actor
    critic: Critic
    optimiser: optax.OptState
    gains: Gains
    statistics: RunningStatistics
    task_states: Any
    """States of the environments (leading axis: environment)."""
    observations: Float[Array, "envs n"]
    """Their observations, normalised with the statistics of their time."""
    key: Key
    iterations: Count


class Rollout(eqx.Module):
    """What was collected (leading axes: step, environment)."""

    observations: Float[Array, "steps envs n"]
    latents: Float[Array, "steps envs m"]
    log_probs: Float[Array, "steps envs"]
    rewards: Float[Array, "steps envs"]
    next_observations: Float[Array, "steps envs n"]
    """Of the state after the step and before any reset."""
    terminated: Bool[Array, "steps envs"]
    truncated: Bool[Array, "steps envs"]


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
    losses: LossMetrics

    def as_dict(self) -> dict[str, float]:
        """Flat, as Python floats."""
        own = {
            field.name: getattr(self, field.name) for field in dataclasses.fields(self) if field.name != "losses"
        }
        return {name: float(value) for name, value in (own | vars(self.losses)).items()}


def init(key: Key, task: Task, config: Config) -> LearnerState:
    """The state before the first iteration."""
    actor_key, critic_key, reset_key, state_key = jax.random.split(key, 4)
    actor = init_actor(
        actor_key, task.observation_size, task.action_size, config.policy_layers, config.log_std_init
    )
    critic = init_critic(critic_key, task.observation_size, config.value_layers)
    task_states = jax.vmap(task.reset)(jax.random.split(reset_key, config.num_envs))
    observations = jax.vmap(task.observe)(task_states)
    statistics = init_statistics(task.observation_size).update(observations)
    return LearnerState(
        actor=actor,
        critic=critic,
        optimiser=_optimiser(config).init((actor, critic)),
        gains=init_gains(),
        statistics=statistics,
        task_states=task_states,
        observations=statistics.stage(config.observation_clip)(observations),
        key=state_key,
        iterations=jnp.array(0),
    )


def train(state: LearnerState, task: Task, config: Config, iterations: Count | int) -> tuple[LearnerState, Metrics]:
    """Run a chunk of iterations (at least one); the metrics are their mean."""

    def add_iteration(_: int, carry: tuple[LearnerState, Metrics]) -> tuple[LearnerState, Metrics]:
        state, total = carry
        state, metrics = iteration(state, task, config)
        return state, jax.tree.map(jnp.add, total, metrics)

    shapes = jax.eval_shape(lambda state: iteration(state, task, config)[1], state)
    zeros = jax.tree.map(lambda shape: jnp.zeros(shape.shape, shape.dtype), shapes)
    state, total = jax.lax.fori_loop(0, iterations, add_iteration, (state, zeros))
    return state, jax.tree.map(lambda metric: metric / iterations, total)


def iteration(state: LearnerState, task: Task, config: Config) -> tuple[LearnerState, Metrics]:
    """One iteration: collect a rollout, estimate soft advantages and gains, improve actor and critic."""
    collect_key, improve_key, next_key = jax.random.split(state.key, 3)
    collected, rollout = collect(state, collect_key, task, config)
    estimated, batch, offset = estimate(collected, rollout, config)
    improved, losses, gradient_norm = improve(estimated, batch, improve_key, config)
    metrics = Metrics(
        reward=jnp.mean(rollout.rewards),
        entropy=-jnp.mean(rollout.log_probs),
        gain=improved.gains.reward,
        entropy_gain=improved.gains.entropy,
        value=offset[0],
        entropy_value=offset[1],
        gradient_norm=gradient_norm,
        losses=losses,
    )
    following = eqx.tree_at(lambda s: (s.key, s.iterations), improved, (next_key, state.iterations + 1))
    return following, metrics


def collect(state: LearnerState, key: Key, task: Task, config: Config) -> tuple[LearnerState, Rollout]:
    """Act for ``num_steps`` in every environment; reset those that ended.

    The observation statistics take in the states after the resets and before they are normalised, as in the
    authors' code.
    """

    def act(carry: tuple[Any, ...], key: Key) -> tuple[tuple[Any, ...], Rollout]:
        task_states, observations, statistics = carry
        sample_key, step_key, reset_key = jax.random.split(key, 3)
        policy = jax.vmap(state.actor)(observations)
        latents = _over_envs(lambda p, k: p.sample(k), sample_key, policy)
        log_probs = jax.vmap(lambda p, z: p.log_prob(z))(policy, latents)
        actions = jax.vmap(lambda p, z: p.action(z))(policy, latents)
        step = _over_envs(lambda s, a, k: task.step(s, a, k), step_key, task_states, actions)
        ended = step.terminated | step.truncated
        fresh = jax.vmap(task.reset)(jax.random.split(reset_key, config.num_envs))
        following = jax.tree.map(lambda new, old: _where(ended, new, old), fresh, step.state)
        raw = jax.vmap(task.observe)(following)
        statistics = statistics.update(raw)
        normalise = statistics.stage(config.observation_clip)
        return (following, normalise(raw), statistics), Rollout(
            observations=observations,
            latents=latents,
            log_probs=log_probs,
            rewards=step.reward,
            next_observations=normalise(step.observation),
            terminated=step.terminated,
            truncated=step.truncated,
        )

    carry = (state.task_states, state.observations, state.statistics)
    (task_states, observations, statistics), rollout = jax.lax.scan(
        act, carry, jax.random.split(key, config.num_steps)
    )
    collected = eqx.tree_at(
        lambda s: (s.task_states, s.observations, s.statistics),
        state,
        (task_states, observations, statistics),
    )
    return collected, rollout


def estimate(
    state: LearnerState, rollout: Rollout, config: Config
) -> tuple[LearnerState, Batch, Float[Array, "2"]]:
    """Soft advantages and λ-returns of a rollout, then the gains; also the means of both values.

    A truncated step bootstraps from the state before the reset; a terminated one has no value beyond it; both cut
    the recursion. The entropy reward is -τ log π(a|s), τ included.
    """
    values = jax.vmap(jax.vmap(state.critic))(rollout.observations)
    last = jax.vmap(state.critic)(state.observations)
    next_values = jnp.concatenate([values[1:], last[None]])
    next_values = _bootstrapped(state.critic, rollout, next_values)
    offset = jnp.mean(values, axis=(0, 1))
    if config.centre_values:
        critic = eqx.tree_at(lambda c: c.heads.bias, state.critic, replace_fn=lambda bias: bias - offset)
        state = eqx.tree_at(lambda s: s.critic, state, critic)
        values, next_values = values - offset, next_values - offset
    next_values = jnp.where(rollout.terminated[..., None], 0.0, next_values)

    cuts = rollout.terminated | rollout.truncated
    entropy_rewards = -config.temperature * rollout.log_probs
    reward_advantages = advantages(
        rollout.rewards, values[..., 0], next_values[..., 0], cuts,
        state.gains.reward, config.discount, config.gae_lambda,
    )  # fmt: skip
    entropy_advantages = advantages(
        entropy_rewards, values[..., 1], next_values[..., 1], cuts,
        state.gains.entropy, config.entropy_discount, config.entropy_gae_lambda,
    )  # fmt: skip
    # Without temperature there is no entropy objective, whatever an untrained V_H says.
    entropy_advantages = jnp.where(config.temperature > 0.0, entropy_advantages, 0.0)
    batch = Batch(
        observations=rollout.observations,
        latents=rollout.latents,
        log_probs=rollout.log_probs,
        advantages=reward_advantages + entropy_advantages,
        returns=jnp.stack([reward_advantages, entropy_advantages], axis=-1) + values,
    )
    gains = update_gains(state.gains, reward_advantages, entropy_advantages, config)
    return eqx.tree_at(lambda s: s.gains, state, gains), batch, offset


def improve(
    state: LearnerState, batch: Batch, key: Key, config: Config
) -> tuple[LearnerState, LossMetrics, Scalar]:
    """Several epochs of minibatch gradient steps on actor and critic with one Adam."""
    optimiser = _optimiser(config)
    frames = jax.tree.map(lambda leaf: leaf.reshape(-1, *leaf.shape[2:]), batch)

    def step(carry: tuple[Any, ...], indices: Array) -> tuple[tuple[Any, ...], tuple[LossMetrics, Scalar]]:
        networks, optimiser_state = carry
        minibatch = jax.tree.map(lambda leaf: leaf[indices], frames)
        gradients, metrics = jax.grad(loss, has_aux=True)(networks, minibatch, config)
        updates, optimiser_state = optimiser.update(gradients, optimiser_state)
        return (optax.apply_updates(networks, updates), optimiser_state), (
            metrics,
            optax.tree.norm(gradients),
        )

    # Sorting random bits once shuffles well enough (ties are rare) and costs a third of jax.random.permutation.
    orders = jnp.argsort(jax.random.bits(key, (config.num_epochs, config.rollout_size)), axis=-1)
    carry = ((state.actor, state.critic), state.optimiser)
    ((actor, critic), optimiser_state), (metrics, norms) = jax.lax.scan(
        step, carry, orders.reshape(-1, config.batch_size)
    )
    improved = eqx.tree_at(lambda s: (s.actor, s.critic, s.optimiser), state, (actor, critic, optimiser_state))
    return improved, jax.tree.map(jnp.mean, metrics), jnp.mean(norms)


def _optimiser(config: Config) -> optax.GradientTransformation:
    return optax.chain(
        optax.clip_by_global_norm(config.max_grad_norm),
        optax.scale_by_adam(eps=config.adam_epsilon),
        optax.scale(-config.learning_rate),
    )


def _bootstrapped(
    critic: Critic, rollout: Rollout, next_values: Float[Array, "steps envs 2"]
) -> Float[Array, "steps envs 2"]:
    """Replace the next values at truncated steps by those of the true next states, a few at a time."""
    truncated = rollout.truncated.reshape(-1)
    observations = rollout.next_observations.reshape(truncated.size, -1)
    order = jnp.argsort(~truncated)  # the truncated steps first

    def replace(carry: tuple[Count, Array]) -> tuple[Count, Array]:
        start, flat = carry
        indices = jax.lax.dynamic_slice(order, (start,), (min(BOOTSTRAP_SIZE, truncated.size),))
        fixed = jax.vmap(critic)(observations[indices])
        kept = jnp.where(truncated[indices, None], fixed, flat[indices])
        return start + BOOTSTRAP_SIZE, flat.at[indices].set(kept)

    flat = next_values.reshape(-1, 2)
    count = jnp.sum(truncated)
    _, flat = jax.lax.while_loop(lambda carry: carry[0] < count, replace, (jnp.array(0), flat))
    return flat.reshape(next_values.shape)


def _over_envs(function: Any, key: Key, *arguments: Any) -> Any:
    """Map over environments with a key for each."""
    size = jax.tree.leaves(arguments[0])[0].shape[0]
    return jax.vmap(function)(*arguments, jax.random.split(key, size))


def _where(condition: Bool[Array, "envs"], new: Array, old: Array) -> Array:
    return jnp.where(condition.reshape(-1, *(1,) * (new.ndim - 1)), new, old)
