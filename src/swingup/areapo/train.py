"""AR-EAPO on one screen: ``init``, ``iteration`` (collect, estimate, improve) and ``train`` (many in one call).

Everything is a pure function of a :class:`LearnerState` for one seed; ``vmap`` runs seeds side by side. Source: the
AR-EAPO paper, section III, and the authors' public implementation where the paper is silent.
"""

from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import optax
from jaxtyping import Array, Bool, Float

from ..tasks.task import AbstractTask, Spaces
from ..types import Count, Key, Scalar
from .act import decide, over_envs, take_in
from .advantage import advantages, init_gains, update_gains
from .average import mean
from .config import Config
from .loss import Batch, LossMetrics, loss
from .networks import Critic, init_critic, init_policy
from .normalise import init_statistics
from .popart import init_value_scale, rescale
from .state import LearnerState, Metrics, Rollout

Task = AbstractTask[Any]

BOOTSTRAP_SIZE = 64
"""Truncated states whose values are computed at once; a rollout of Table I holds about 13."""


def init(key: Key, task: Task, config: Config) -> LearnerState:
    """The state before the first iteration."""
    state = init_learner(key, task.spaces, config)
    reset_key = jax.random.split(key, 4)[2]
    task_states = jax.vmap(task.reset)(jax.random.split(reset_key, config.num_envs))
    state = eqx.tree_at(lambda s: s.task_states, state, task_states, is_leaf=lambda leaf: leaf is None)
    return restarted(state, jax.vmap(task.observe)(task_states), config)


def init_learner(key: Key, spaces: Spaces, config: Config) -> LearnerState:
    """The state of a learner that has seen no environment yet."""
    actor_key, critic_key, _, state_key = jax.random.split(key, 4)
    actor = init_policy(actor_key, spaces, config.policy_layers, config.log_std_init)
    critic = init_critic(critic_key, spaces.observation_size, config.value_layers)
    return LearnerState(
        actor=actor,
        critic=critic,
        optimiser=_optimiser(config).init((actor, critic)),
        gains=init_gains(),
        statistics=init_statistics(spaces.observation_size),
        task_states=None,
        observations=jnp.zeros((config.num_envs, spaces.observation_size)),
        key=state_key,
        iterations=jnp.array(0),
        value_scale=init_value_scale() if config.popart else None,
    )


def restarted(state: LearnerState, observations: Float[Array, "envs n"], config: Config) -> LearnerState:
    """The learner at the start of new episodes, of which it sees these first observations (not normalised)."""
    statistics, seen, _ = take_in(state.statistics, observations, observations, config.observation_clip)
    return eqx.tree_at(lambda s: (s.statistics, s.observations), state, (statistics, seen))


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
    return update(collected, rollout, improve_key, next_key, config)


def update(
    state: LearnerState, rollout: Rollout, improve_key: Key, next_key: Key, config: Config
) -> tuple[LearnerState, Metrics]:
    """Learn from a rollout, wherever it was collected: estimate, then improve."""
    estimated, batch, offset = estimate(state, rollout, config)
    improved, losses, gradient_norm = improve(estimated, batch, improve_key, config)
    metrics = Metrics(
        reward=mean(rollout.rewards, rollout.counted),
        entropy=-mean(rollout.log_probs, rollout.counted),
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
    """Act for ``num_steps`` in every environment; reset those that ended."""

    def act(carry: tuple[Any, ...], key: Key) -> tuple[tuple[Any, ...], Rollout]:
        task_states, observations, statistics = carry
        sample_key, step_key, reset_key = jax.random.split(key, 3)
        chosen = decide(state.actor, observations, sample_key)
        step = over_envs(lambda s, a, k: task.step(s, a, k), step_key, task_states, chosen.actions)
        ended = step.terminated | step.truncated
        fresh = jax.vmap(task.reset)(jax.random.split(reset_key, config.num_envs))
        following = jax.tree.map(lambda new, old: _where(ended, new, old), fresh, step.state)
        statistics, seen, true_next = take_in(
            statistics, jax.vmap(task.observe)(following), step.observation, config.observation_clip
        )
        return (following, seen, statistics), Rollout(
            observations=observations,
            latents=chosen.latents,
            log_probs=chosen.log_probs,
            rewards=step.reward,
            next_observations=true_next,
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

    A truncated step bootstraps from the state before the reset. A terminated one has, by ``config.terminations``,
    no value beyond it, or that of the state before the reset, or it pays a cost and goes on from the state after
    the reset. All cut the recursion. The entropy reward is -τ log π(a|s), τ included.
    """
    outputs = jax.vmap(jax.vmap(state.critic))(rollout.observations)
    last = jax.vmap(state.critic)(state.observations)
    next_outputs = jnp.concatenate([outputs[1:], last[None]])
    next_outputs = _bootstrapped(state.critic, rollout, next_outputs, config)
    values, next_values = _values(state, outputs), _values(state, next_outputs)
    offset = _mean_of_both(values, rollout)
    if config.centre_values:
        critic = eqx.tree_at(lambda c: c.heads.bias, state.critic, replace_fn=lambda bias: bias - offset)
        state = eqx.tree_at(lambda s: s.critic, state, critic)
        values, next_values = values - offset, next_values - offset
    rewards, next_values = _ended(rollout, next_values, config)

    cuts = rollout.terminated | rollout.truncated
    entropy_rewards = -config.temperature * rollout.log_probs
    reward_advantages = advantages(
        rewards, values[..., 0], next_values[..., 0], cuts,
        state.gains.reward, config.discount, config.gae_lambda,
    )  # fmt: skip
    entropy_advantages = advantages(
        entropy_rewards, values[..., 1], next_values[..., 1], cuts,
        state.gains.entropy, config.entropy_discount, config.entropy_gae_lambda,
    )  # fmt: skip
    # Without temperature there is no entropy objective, whatever an untrained V_H says.
    entropy_advantages = jnp.where(config.temperature > 0.0, entropy_advantages, 0.0)
    returns = jnp.stack([reward_advantages, entropy_advantages], axis=-1) + values
    state, targets = _rescaled(state, returns, rollout, config)
    batch = Batch(
        observations=rollout.observations,
        latents=rollout.latents,
        log_probs=rollout.log_probs,
        advantages=reward_advantages + entropy_advantages,
        returns=targets,
        weights=rollout.counted,
    )
    gains = update_gains(state.gains, reward_advantages, entropy_advantages, config, rollout.counted)
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


def _values(state: LearnerState, outputs: Float[Array, "steps envs 2"]) -> Float[Array, "steps envs 2"]:
    return outputs if state.value_scale is None else state.value_scale.denormalise(outputs)


def _mean_of_both(values: Float[Array, "steps envs 2"], rollout: Rollout) -> Float[Array, "2"]:
    weights = None if rollout.counted is None else rollout.counted[..., None]
    return mean(values, weights, axis=(0, 1))


def _rescaled(
    state: LearnerState, returns: Float[Array, "steps envs 2"], rollout: Rollout, config: Config
) -> tuple[LearnerState, Float[Array, "steps envs 2"]]:
    """PopArt's scale moved towards the returns, all values kept; and what the critic shall put out."""
    if state.value_scale is None:
        return state, returns
    first, second = _mean_of_both(returns, rollout), _mean_of_both(returns**2, rollout)
    scale = state.value_scale.update(first, second, config.popart_step_size)
    critic = rescale(state.critic, state.value_scale, scale)
    rescaled = eqx.tree_at(lambda s: (s.critic, s.value_scale), state, (critic, scale))
    return rescaled, scale.normalise(returns)


def _ended(
    rollout: Rollout, next_values: Float[Array, "steps envs 2"], config: Config
) -> tuple[Float[Array, "steps envs"], Float[Array, "steps envs 2"]]:
    """Rewards and next values, with what a termination means."""
    if config.ending == "end":
        return rollout.rewards, jnp.where(rollout.terminated[..., None], 0.0, next_values)
    if config.ending == "reset_cost":
        return jnp.where(rollout.terminated, rollout.rewards - config.reset_cost, rollout.rewards), next_values
    return rollout.rewards, next_values


def _bootstrapped(
    critic: Critic, rollout: Rollout, next_values: Float[Array, "steps envs 2"], config: Config
) -> Float[Array, "steps envs 2"]:
    """Replace next values where the task was cut short by those of the true next states, a few at a time."""
    cut_short = rollout.truncated & ~rollout.terminated
    if config.ending == "bootstrap":
        cut_short = rollout.truncated | rollout.terminated
    truncated = cut_short.reshape(-1)
    observations = rollout.next_observations.reshape(truncated.size, -1)
    order = jnp.argsort(~truncated)  # those to replace first

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


def _where(condition: Bool[Array, "envs"], new: Array, old: Array) -> Array:
    return jnp.where(condition.reshape(-1, *(1,) * (new.ndim - 1)), new, old)
