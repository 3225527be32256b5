"""AR-EAPO on one screen: ``init``, ``iteration`` (collect, estimate, improve) and ``train`` (many in one call).

Everything is a pure function of a :class:`LearnerState` for one seed; ``vmap`` runs seeds side by side. Source: the
AR-EAPO paper, section III, and the authors' public implementation where the paper is silent.
"""

from dataclasses import replace
from typing import Any

import jax
import jax.numpy as jnp
import optax
from jaxtyping import Array, Float

from ..common.types import Count, Key, Scalar
from ..tasks.task import AbstractTask
from .act import decide, forget, update_statistics
from .advantage import advantages, update_gains
from .config import Config
from .initial import begin_episodes, init_learner
from .keys import IterationKeys, RolloutKeys, initial_keys, iteration_keys, rollout_keys
from .loss import Frames, LossMetrics, loss
from .minibatches import minibatches
from .optimiser import make_optimiser
from .reset_cost import adapt_reset_cost, reset_cost
from .schedule import at_iteration
from .state import LearnerState, Metrics, Rollout, iteration_metrics, select
from .targets import apply_endings, estimate_values, follow_rewards, normalise_returns, over_scale, times_scale

Task = AbstractTask[Any]


def init(key: Key, task: Task, config: Config) -> LearnerState:
    """The state before the first iteration."""
    keys = initial_keys(key)
    task_states = jax.vmap(task.reset)(jax.random.split(keys.reset, config.num_envs))
    state = replace(init_learner(keys, task.spaces, config), task_states=task_states)
    return begin_episodes(state, jax.vmap(task.observe)(task_states), config)


def train(state: LearnerState, task: Task, config: Config, iterations: Count | int) -> tuple[LearnerState, Metrics]:
    """Run a chunk of iterations (at least one); the metrics are their mean."""

    def add_iteration(_: int, carry: tuple[LearnerState, Metrics]) -> tuple[LearnerState, Metrics]:
        state, total = carry
        state, metrics = iteration(state, task, config)
        return state, jax.tree.map(jnp.add, total, metrics)

    # The number of iterations is traced: chunks of any length share one compiled program.
    # Metrics are therefore summed, since stacking them would need a static length.
    shapes = jax.eval_shape(lambda state: iteration(state, task, config)[1], state)
    zeros = jax.tree.map(lambda shape: jnp.zeros(shape.shape, shape.dtype), shapes)
    state, total = jax.lax.fori_loop(0, iterations, add_iteration, (state, zeros))
    return state, jax.tree.map(lambda metric: metric / iterations, total)


def iteration(state: LearnerState, task: Task, config: Config) -> tuple[LearnerState, Metrics]:
    """One iteration: collect a rollout, estimate soft advantages and gains, improve actor and critic."""
    keys = iteration_keys(state.key)
    collected, rollout = collect(state, keys.collect, task, config)
    return update(collected, rollout, keys, config)


def update(
    state: LearnerState, rollout: Rollout, keys: IterationKeys, config: Config
) -> tuple[LearnerState, Metrics]:
    """Learn from a rollout of any back end: estimate, then improve."""
    config = at_iteration(config, state.iterations)
    estimated, frames, value_means = estimate(state, rollout, config)
    improved, losses, gradient_norm = improve(estimated, frames, keys.improve, config)
    metrics = iteration_metrics(
        rollout, improved.gains, reset_cost(improved, rollout, config), value_means, losses, gradient_norm
    )
    return replace(improved, key=keys.following, iterations=state.iterations + 1), metrics


def collect(state: LearnerState, key: Key, task: Task, config: Config) -> tuple[LearnerState, Rollout]:
    """Act for ``num_steps`` in every environment; reset those that ended."""

    def act(carry: tuple[Any, ...], keys: RolloutKeys) -> tuple[tuple[Any, ...], Rollout]:
        task_states, observations, statistics, memory = carry
        chosen = decide(state.actor, observations, state.actor.noise(keys.sample, (config.num_envs,)), memory)
        step = jax.vmap(task.step)(task_states, chosen.actions, keys.step)
        ended = step.terminated | step.truncated
        # Few steps have a reset. All environments draw one then, and always where seeds run side by side.
        following = jax.lax.cond(
            jnp.any(ended),
            lambda: select(ended, jax.vmap(task.reset)(keys.reset), step.state),
            lambda: step.state,
        )
        seen = jax.vmap(task.observe)(following)
        statistics, normalise = update_statistics(statistics, seen, config.observation_clip)
        true_next = normalise(step.observation)
        return (following, normalise(seen), statistics, forget(chosen.memory, ended)), Rollout(
            observations, chosen.latents, chosen.log_probs, step.reward, true_next, step.terminated, step.truncated
        )

    carry = (state.task_states, state.observations, state.statistics, state.memory)
    keys = rollout_keys(key, config.num_steps, config.num_envs)
    (task_states, observations, statistics, memory), rollout = jax.lax.scan(act, carry, keys)
    after = replace(state, task_states=task_states, observations=observations, statistics=statistics, memory=memory)
    return after, replace(rollout, memory=state.memory)


def estimate(
    state: LearnerState, rollout: Rollout, config: Config
) -> tuple[LearnerState, Frames, Float[Array, "2"]]:
    """Soft advantages and λ-returns of a rollout, then the gains and the reset cost; also the means of both values.

    A truncated step bootstraps from the state before the reset. After a terminated step ``config.terminations``
    decides: the value beyond is 0, or that of the state before the reset, or the step pays a cost and the value of
    the state after the reset follows. All of them cut the recursion. The entropy reward is -τ log π(a|s).
    """
    paid = reset_cost(state, rollout, config)
    state = follow_rewards(state, rollout, paid, config)
    state, (values, next_values, value_means) = estimate_values(state, rollout, config)
    rewards, next_values = apply_endings(rollout, next_values, paid, config)
    cuts = rollout.terminated | rollout.truncated
    # τ enters here, so that V_H and ρ_H are in units of the reward.
    entropy_rewards = -times_scale(state, config.temperature) * rollout.log_probs
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
    state, targets = normalise_returns(state, returns, rollout, config)
    # After the advantages, which use the old gains, as in the authors' code.
    gains = update_gains(state.gains, reward_advantages, entropy_advantages, config, rollout.counted)
    soft_advantages = over_scale(state, reward_advantages + entropy_advantages)
    frames = Frames(
        rollout.observations, rollout.latents, rollout.log_probs, soft_advantages, targets, rollout.counted,
        rollout.memory, None if rollout.memory is None else rollout.forgets,
    )  # fmt: skip
    cost = adapt_reset_cost(state.reset_cost, rollout, config)
    return replace(state, gains=gains, reset_cost=cost), frames, value_means


def improve(
    state: LearnerState, frames: Frames, key: Key, config: Config
) -> tuple[LearnerState, LossMetrics, Scalar]:
    """Several epochs of minibatch gradient steps on actor and critic with one Adam; ``target_kl`` may end them."""
    optimiser = make_optimiser(config)
    orders, pick = minibatches(key, frames, config)

    def step(carry: tuple[Any, ...], indices: Array) -> tuple[tuple[Any, ...], tuple[LossMetrics, Scalar]]:
        networks, optimiser_state, ended = carry
        gradients, metrics = jax.grad(loss, has_aux=True)(networks, pick(indices), config)
        updates, following = optimiser.update(gradients, optimiser_state)
        after = (optax.apply_updates(networks, updates), following)
        if config.target_kl:
            ended |= metrics.approximate_kl > config.target_kl
            after = jax.tree.map(lambda old, new: jnp.where(ended, old, new), (networks, optimiser_state), after)
        return (*after, ended), (metrics, optax.tree.norm(gradients))

    carry = ((state.actor, state.critic), state.optimiser, jnp.array(False))
    ((actor, critic), optimiser_state, _), (losses, norms) = jax.lax.scan(step, carry, orders)
    improved = replace(state, actor=actor, critic=critic, optimiser=optimiser_state)
    return improved, jax.tree.map(jnp.mean, losses), jnp.mean(norms)
