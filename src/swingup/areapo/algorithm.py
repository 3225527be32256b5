"""AR-EAPO on one page, in the order of the paper (section III): ``init``, ``train`` and ``iteration``.

Everything is a pure function of a :class:`LearnerState` for one seed; ``vmap`` runs seeds side by side. Equations
have the paper's numbers; where it is silent, its authors' public implementation decides. Reward and entropy are one
axis of 2: gains, values, discounts, λ and advantages are pairs [reward, entropy].

The objective, the gain ρ + ρ_H (eq. 1 and 3), is in no formula: its policy gradient is that of the advantages. The
soft reward r̃ and the soft value ṽ (eq. 9 and 10) are sums of pairs. Only the sum of the advantages is needed.
"""

from dataclasses import replace
from typing import Any

import jax
import jax.numpy as jnp
import optax
from jaxtyping import Array, Bool, Float

from ..common.types import Count, Key, Scalar
from ..tasks.task import AbstractTask, strongly_typed
from .config import Config
from .initial import begin_episodes, init_learner, wait_for_rewards
from .networks import AnyActor, BoundedGaussian, Critic, sample_actions
from .optimisation import adapted_step, make_optimiser, scheduled, shuffled
from .rewards import charge_resets, scale_rewards, values_after
from .state import (
    COLLECT,
    IMPROVE,
    NEXT,
    Frames,
    LearnerState,
    LossMetrics,
    Metrics,
    Rollout,
    make_metrics,
    no_metrics,
    reset_ended,
)
from .statistics import mean, pair_mean, standardise

Task = AbstractTask[Any]
Pair = Float[Array, "2"]
Pairs = Float[Array, "steps envs 2"]


def init(key: Key, task: Task, config: Config) -> LearnerState:
    """The state before the first iteration."""
    learner_key, reset_key = jax.random.split(key)
    # A resumed run finds its program compiled: no types differ from those that a checkpoint holds.
    task_states = jax.tree.map(strongly_typed, jax.vmap(task.reset)(jax.random.split(reset_key, config.num_envs)))
    state = replace(init_learner(learner_key, task.spaces, config), task_states=task_states)
    return begin_episodes(state, jax.vmap(task.observe)(task_states))


def train(state: LearnerState, task: Task, config: Config, iterations: Count | int) -> tuple[LearnerState, Metrics]:
    """Run a chunk of iterations (at least one); the metrics are their mean."""

    def add_iteration(_: int, carry: tuple[LearnerState, Metrics]) -> tuple[LearnerState, Metrics]:
        state, metrics = iteration(carry[0], task, config)
        return state, jax.tree.map(jnp.add, carry[1], metrics)

    # The number of iterations is traced: all chunks share a program. To stack metrics, it would have to be static.
    state, total = jax.lax.fori_loop(0, iterations, add_iteration, (state, no_metrics()))
    return state, jax.tree.map(lambda metric: metric / iterations, total)


def iteration(state: LearnerState, task: Task, config: Config) -> tuple[LearnerState, Metrics]:
    """One iteration: collect a rollout and learn from it."""
    return update(*collect(state, task, config), config)


def collect(state: LearnerState, task: Task, config: Config) -> tuple[LearnerState, Rollout]:
    """Act for ``num_steps`` in every environment; reset those that ended."""

    def act(carry: tuple[Any, ...], keys: tuple[Key, Key, Key]) -> tuple[tuple[Any, ...], Rollout]:
        (task_states, observations, statistics), (sample_key, step_keys, reset_keys) = carry, keys
        chosen = sample_actions(state.actor, observations, state.actor.noise(sample_key, (config.num_envs,)))
        step = jax.vmap(task.step)(task_states, chosen.actions, step_keys)
        following = reset_ended(task, step.terminated | step.truncated, step.state, reset_keys)
        seen = jax.vmap(task.observe)(following)
        # The statistics take in the states after the resets before they normalise, as in the authors' code.
        statistics = statistics.update(seen)
        normalise = statistics.stage()
        row = (observations, chosen.latents, chosen.log_probs, step.reward, normalise(step.observation))
        return (following, normalise(seen), statistics), Rollout(*row, step.terminated, step.truncated)

    carry = (state.task_states, state.observations, state.statistics)
    # All keys are split at once: in the loop over the steps each split costs as much.
    sample, step, reset = jax.random.split(jax.random.fold_in(state.key, COLLECT), 3)
    steps, each = config.num_steps, (config.num_steps, config.num_envs)
    keys = (jax.random.split(sample, steps), jax.random.split(step, each), jax.random.split(reset, each))
    (task_states, observations, statistics), rollout = jax.lax.scan(act, carry, keys)
    return replace(state, task_states=task_states, observations=observations, statistics=statistics), rollout


def update(state: LearnerState, rollout: Rollout, config: Config) -> tuple[LearnerState, Metrics]:
    """Learn from a rollout of any back end: estimate soft advantages and gains, then improve actor and critic.

    Options that the paper lacks stand around these two steps. Before them, ``charge_resets`` and ``scale_rewards``
    change the rewards to learn from, then ``scheduled`` changes hyperparameters. After them, ``wait_for_rewards``
    keeps the policy where there is nothing to learn, and once lowers initial noise that costs much. The metrics are
    those of the rewards as they were collected.
    """
    state, charged, cost = charge_resets(state, rollout, config)
    state, scaled = scale_rewards(state, charged, config)
    # After the scaling: a λ that falls leaves the rewards' unit as it is.
    now = scheduled(config, state.iterations)
    state, frames, value_means = estimate(state, scaled, now)
    improved, losses, gradient_norm = improve(state, frames, now)
    state = wait_for_rewards(state, improved, rollout, now)
    metrics = make_metrics(state, rollout, cost, value_means, losses, gradient_norm)
    return replace(state, key=jax.random.fold_in(state.key, NEXT), iterations=state.iterations + 1), metrics


def estimate(state: LearnerState, rollout: Rollout, config: Config) -> tuple[LearnerState, Frames, Pair]:
    """Soft advantages (eq. 6 to 8), λ-returns and gains of a rollout; also the mean of each value."""
    values, next_values = bias_values(state, rollout, config)
    means = pair_mean(values, rollout.counted)
    if config.centre_values:
        # Eq. 2 and 5 leave a constant free, on which no advantage depends with γ = 1, and which would drift.
        state = replace(state, critic=state.critic.with_values(jnp.ones(2), means))
        values, next_values = values - means, next_values - means
    # The entropy reward of eq. 4. τ enters here, so that v_H and ρ_H are in units of the reward.
    rewards = jnp.stack([rollout.rewards, -config.temperature * rollout.log_probs], axis=-1)
    # δ + ρ of eq. 11 and 12. Without temperature there is no entropy objective, whatever an untrained v_H says.
    errors = rewards + jnp.asarray(config.discount) * next_values - values
    errors = jnp.where(jnp.asarray([1.0, config.temperature]) > 0.0, errors, 0.0)
    if config.gain == "td":
        # An untrained critic says nothing: ρ starts at the mean reward.
        state = update_gains(state, jnp.where(state.iterations > 0, errors, rewards) - state.gains, rollout, config)
    advantages = lambda_advantages(errors - state.gains, rollout.terminated | rollout.truncated, config)
    if config.gain == "advantage":
        state = update_gains(state, advantages, rollout, config)
    soft_advantages, returns = jnp.sum(advantages, axis=-1), advantages + values
    actions = (rollout.observations, rollout.latents, rollout.log_probs)
    return state, Frames(*actions, soft_advantages, returns, rollout.counted), means


def bias_values(state: LearnerState, rollout: Rollout, config: Config) -> tuple[Pairs, Pairs]:
    """[v, v_H] of the states before and after each step (eq. 2 and 5)."""
    values = jax.vmap(jax.vmap(state.critic))(rollout.observations)
    last = jax.vmap(state.critic)(state.observations)
    return values, values_after(state.critic, rollout, jnp.concatenate([values[1:], last[None]]), config)


def lambda_advantages(deltas: Pairs, cuts: Bool[Array, "steps envs"], config: Config) -> Pairs:
    """Estimates of A and A_H (eq. 11 and 12), A_t = δ_t + γ λ (1 - cut_t) A_{t+1} (GAE, arXiv 1506.02438).

    δ_t is r_t - ρ + γ v(s'_t) - v(s_t), with s'_t the state after the step and before any reset. A cut is true
    where s_{t+1} is not s'_t, because the task was reset.
    """
    # v(s') counts at a cut, too: a truncation does not end the process, only the recursion stops.
    decays = jnp.asarray(config.discount) * jnp.asarray(config.gae_lambda) * (1.0 - cuts[..., None])

    def backwards(following: Array, step: tuple[Array, Array]) -> tuple[Array, Array]:
        advantage = step[0] + step[1] * following
        return advantage, advantage

    # The sum starts at 0: what follows the rollout is in v(s') of the last δ.
    return jax.lax.scan(backwards, jnp.zeros_like(deltas[0]), (deltas, decays), reverse=True)[1]


def update_gains(state: LearnerState, errors: Pairs, rollout: Rollout, config: Config) -> LearnerState:
    """Move both gains by the mean error of a rollout's N frames (eq. 13 and 14).

    ``td``: by all of the mean δ, to ρ = mean(r + v(s') - v(s)). By eq. 2 the bias is mean(e(s') - e(s)), e being
    the error of v: at most 2 max|e| / T for resets every T frames. The variance is var(δ) / N. No former ρ enters:
    nothing lags or overshoots. ``advantage`` (authors' code): by λ-advantages, up to 1 / (1 - λ) times as large,
    with the step η / z, at first 1, of a trace z.
    """
    trace, step = state.gain_trace, jnp.ones(())
    if config.gain == "advantage":
        trace = trace + config.gain_step_size * (1.0 - trace)
        step = config.gain_step_size / trace
    return replace(state, gains=state.gains + step * pair_mean(errors, rollout.counted), gain_trace=trace)


def improve(state: LearnerState, frames: Frames, config: Config) -> tuple[LearnerState, LossMetrics, Scalar]:
    """Epochs of minibatch gradient steps on actor and critic with one Adam, whose step ``target_kl`` adapts."""
    optimiser = make_optimiser(config, state.step_scale)
    flat = jax.tree.map(lambda leaf: leaf.reshape(-1, *leaf.shape[2:]), frames)

    def step(carry: tuple[Any, ...], rows: Array) -> tuple[tuple[Any, ...], tuple[LossMetrics, Scalar]]:
        networks, optimiser_state = carry
        minibatch = jax.tree.map(lambda leaf: leaf[rows], flat)
        gradients, metrics = jax.grad(loss, has_aux=True)(networks, minibatch, config)
        updates, following = optimiser.update(gradients, optimiser_state)
        return (optax.apply_updates(networks, updates), following), (metrics, optax.tree.norm(gradients))

    # The batch size divides the rollout: no minibatch has frames of two epochs.
    orders = shuffled(jax.random.fold_in(state.key, IMPROVE), config.num_epochs, config.rollout_size)
    carry = ((state.actor, state.critic), state.optimiser)
    ((actor, critic), optimiser_state), found = jax.lax.scan(step, carry, orders.reshape(-1, config.batch_size))
    losses, gradient_norm = jax.tree.map(jnp.mean, found)
    if config.target_kl:
        state = replace(state, step_scale=adapted_step(state.step_scale, losses.approximate_kl, config.target_kl))
    return replace(state, actor=actor, critic=critic, optimiser=optimiser_state), losses, gradient_norm


def loss(networks: tuple[AnyActor, Critic], frames: Frames, config: Config) -> tuple[Scalar, LossMetrics]:
    """-L(θ) + c · [MSE_v, MSE_vH], with L(θ) = mean min(r A, clip(r, 1 - ε, 1 + ε) A) (eq. 15), A the soft ones."""
    actor, critic = networks
    # Features first: XLA has fast CPU kernels for the products of this form (see networks).
    observations = frames.observations.T
    policy = actor(observations)
    log_ratios = policy.log_prob(frames.latents.T) - frames.log_probs
    ratios = jnp.exp(log_ratios)
    # Normalised after the sum of both objectives and in each minibatch, as in the authors' code.
    soft_advantages = standardise(frames.advantages, frames.weights)
    clipped = jnp.clip(ratios, 1.0 - config.clip_range, 1.0 + config.clip_range)
    policy_loss = -mean(jnp.minimum(ratios * soft_advantages, clipped * soft_advantages), frames.weights)
    # No entropy bonus: the entropy is in the advantages. Values are not clipped, as in the authors' code.
    value_losses = mean((critic(observations) - frames.returns.T) ** 2, frames.weights, axis=1)
    # The mean of r - 1 - log r under π_old is KL(π_old, π_θ), and no sample is negative, unlike -log r.
    kl = mean(ratios - 1.0 - log_ratios, frames.weights)
    clip_fraction = mean(jnp.abs(ratios - 1.0) > config.clip_range, frames.weights)
    total = policy_loss + jnp.asarray(config.value_coefficient) @ value_losses
    if config.excess_coefficient and isinstance(policy, BoundedGaussian) and policy.bounds == "clip":
        total += config.excess_coefficient * mean(policy.excess(), frames.weights)
    return total, LossMetrics(policy_loss, value_losses[0], value_losses[1], kl, clip_fraction)
