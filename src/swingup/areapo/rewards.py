"""What a termination means, and the unit of the rewards.

A reset may cost reward where the task goes on from a new start (ATRPO, arXiv 2106.07329).

The unit is the standard deviation of Σ (γλ)^k (r - mean r), which decays by γλ a step as a δ does in an advantage:
values are near 1. In units of one step's deviation values are in the tens: their loss rules the gradients' joint
norm, and the policy hardly moves. Gains, values and temperature are in this unit, metrics in the task's.
"""

from dataclasses import replace

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from ..common.types import Count, Scalar
from .config import Config
from .networks import Critic
from .state import LearnerState, Rollout, reward_unit, termination_rate
from .statistics import MIN_RELATIVE_DEVIATION, deviation, mean, varies

TERMINATION_TARGET = 1e-3  # f*: target of the adaptive cost, in terminations a step (RVI-SAC, arXiv 2408.01972)
COST_STEP = 1.5
"""η_c: increase of the adaptive cost for each termination above the target (standard deviations of the reward)."""
GOAL_DEVIATIONS = 5.0
"""An end whose reward is this many deviations above the mean of the other steps is a success. With random actions
no fall of Hopper, Walker2d, Ant or Humanoid is above 1.2."""
BOOTSTRAP_SIZE = 64
"""States whose values are computed at once; a rollout of Table I has about 13 truncated steps."""


def charge_resets(state: LearnerState, rollout: Rollout, config: Config) -> tuple[LearnerState, Rollout, Scalar]:
    """Subtract the cost of a reset from the rewards of terminated steps; also the cost (units of the reward).

    A fixed cost is in units of the reward, as in arXiv 2501.06937's continuing MuJoCo tasks. An adaptive cost is in
    deviations of the task's rewards so far: neither their unit nor a constant in them changes what it means. It
    falls due for failures alone: a goal that cost something would not be reached. A fixed one spares the goals that
    the environment names. With any other meaning of a termination nothing changes.
    """
    goals, free = reached_goals(rollout)
    if config.terminations == "reset_cost":
        cost, goals = state.reset_cost, jnp.zeros_like(goals) if rollout.goals is None else goals
    elif config.terminations == "adaptive_cost":
        seen = state.task_rewards.update_all(rollout.rewards, rollout.counted)
        cost = state.reset_cost * deviation(seen)
        failures = termination_rate(replace(rollout, terminated=rollout.terminated & ~goals))
        adapted = adapted_cost(state.reset_cost, failures, config.rollout_size)
        state = replace(state, reset_cost=adapted, task_rewards=seen)
    else:
        return state, rollout, jnp.zeros(())
    charged = jnp.where(rollout.terminated & ~goals, rollout.rewards - cost, rollout.rewards)
    return state, replace(rollout, rewards=jnp.where(goals, free, charged)), cost


def reached_goals(rollout: Rollout) -> tuple[Bool[Array, "steps envs"], Float[Array, "steps envs"]]:
    """Which terminations are a success, and the reward that each then has.

    The environment says so; or else a success earns far more than the other steps, of which there must be some. Or
    every step costs the same, also the last one: then an end saves what further steps would cost, and to say so,
    the last one is made free.
    """
    counted = jnp.ones_like(rollout.rewards) if rollout.counted is None else rollout.counted
    others = counted * (1.0 - rollout.terminated)
    typical = mean(rollout.rewards, others)
    gains = rollout.rewards - typical
    rounding = MIN_RELATIVE_DEVIATION * jnp.abs(typical)
    higher = (gains > GOAL_DEVIATIONS * jnp.sqrt(mean(gains**2, others)) + rounding) & jnp.any(others > 0.0)
    alike = (typical < 0.0) & jnp.all(counted * jnp.abs(gains) <= rounding)
    goals = higher | alike if rollout.goals is None else rollout.goals
    return rollout.terminated & goals, jnp.where(alike, 0.0, rollout.rewards)


def adapted_cost(cost: Scalar, rate: Scalar, frames: int) -> Scalar:
    """The cost after N frames with f terminations a step, c ← max(0, c + η_c min(N (f - f*), max(N f*, 1))).

    The cost is the multiplier of the constraint f ≤ f* (after RVI-SAC), and follows it at the same rate for every
    length of a rollout. No more terminations count than are permitted, or one: a policy that has learnt nothing yet
    falls a hundred times too often, and would make the cost so high that it stands still.
    """
    permitted = TERMINATION_TARGET * frames
    excess = jnp.minimum(rate * frames - permitted, max(permitted, 1.0))
    return jnp.maximum(0.0, cost + COST_STEP * excess)


def values_after(
    critic: Critic, rollout: Rollout, next_rows: Float[Array, "steps envs 2"], config: Config
) -> Float[Array, "steps envs 2"]:
    """[v, v_H] of what follows each step, from the values of the next rows.

    A truncated step is followed by the state before the reset. After a terminated step ``config.terminations``
    decides: nothing of value follows (``end``), or the state before the reset (``bootstrap``), or the new start,
    for which the reward pays. If a step is both terminated and truncated, it counts as terminated.
    """
    if config.terminations == "bootstrap":
        return _replaced(critic, rollout, rollout.truncated | rollout.terminated, next_rows)
    values = _replaced(critic, rollout, rollout.truncated & ~rollout.terminated, next_rows)
    return jnp.where(rollout.terminated[..., None], 0.0, values) if config.terminations == "end" else values


def _replaced(
    critic: Critic, rollout: Rollout, chosen: Bool[Array, "steps envs"], values: Float[Array, "steps envs 2"]
) -> Float[Array, "steps envs 2"]:
    """The values with those of the true next states in the chosen rows, a few of them at a time.

    Few steps have a reset: the critic on all true next states would cost as much as on the whole rollout.
    """
    flags = chosen.reshape(-1)
    next_observations = rollout.next_observations.reshape(flags.size, -1)
    # Those to replace first; one array of integers sorts far faster than argsort(~flags).
    order = jnp.sort(jnp.arange(flags.size) + jnp.where(flags, 0, flags.size)) % flags.size

    def put(carry: tuple[Count, Array]) -> tuple[Count, Array]:
        start, flat = carry
        # The last slice is moved back to fit. It then repeats some rows, with the same result.
        rows = jax.lax.dynamic_slice(order, (start,), (min(BOOTSTRAP_SIZE, flags.size),))
        kept = jnp.where(flags[rows, None], jax.vmap(critic)(next_observations[rows]), flat[rows])
        return start + BOOTSTRAP_SIZE, flat.at[rows].set(kept)

    count = jnp.sum(flags)
    start = (jnp.array(0), values.reshape(-1, 2))
    return jax.lax.while_loop(lambda carry: carry[0] < count, put, start)[1].reshape(values.shape)


def scale_rewards(state: LearnerState, rollout: Rollout, config: Config) -> tuple[LearnerState, Rollout]:
    """Divide a rollout's rewards by the unit σ of all rewards so far; without gains, less their mean m.

    Without gains discounted values would have to reach m / (1 - γ) (reward centring, arXiv 2405.09999). ρ and v
    change with σ and m, so that they stay what they were in the task's units; v does so once rewards have differed.
    ρ_H and v_H are in units of σ, as the temperature is. Beside centred values an end of the task has the value
    -m / (1 - γ), which counts in σ: in units of a reward's deviation it was a hundred times larger, and its loss
    ruled the gradients' joint norm.
    """
    if not config.normalise_rewards:
        return state, rollout
    old, old_sums, former = state.reward_statistics, state.sum_statistics, reward_unit(state)
    new = old.update_all(rollout.rewards, rollout.counted)
    if without_gain := config.gain == "none":
        forever = 1.0 / (1.0 - jnp.asarray(config.discount[0]))
        # Less the first reward before: single precision would lose small differences of large rewards.
        rewards = rollout.rewards - new.origin - new.difference
        if config.terminations == "end":
            # Where rewards have a positive mean, to end at a goal is as good as to go on: its constant is no loss.
            lost = rollout.terminated & ~(reached_goals(rollout)[0] & (new.mean > 0.0))
            rewards = rewards - lost * (forever - 1.0) * new.mean  # γ / (1 - γ) = 1 / (1 - γ) - 1
        rollout = replace(rollout, rewards=rewards)
    sums = old_sums.update_all(decayed_sums(rollout, config), rollout.counted)
    state = replace(state, reward_statistics=new, sum_statistics=sums)
    unit, known = reward_unit(state), old.count > 0
    ratio, difference = jnp.where(known, former / unit, 1.0), jnp.where(known, new.difference - old.difference, 0.0)
    # Before rewards vary a critic's values are noise, in units of σ, whatever that will be.
    taught = varies(old) | (old_sums.variance > 0.0)
    factors = jnp.stack([jnp.where(taught, ratio, 1.0), jnp.ones(())])
    shift = forever * difference / unit if without_gain else jnp.zeros(())
    critic = state.critic.with_values(factors, jnp.stack([shift, jnp.zeros(())]))
    state = replace(state, critic=critic, gains=state.gains * jnp.stack([ratio, jnp.ones(())]))
    return state, replace(rollout, rewards=rollout.rewards / unit)


def decayed_sums(rollout: Rollout, config: Config) -> Float[Array, "steps envs"]:
    """Σ (γλ)^k (r_{t-k} - m) over the steps of a rollout until each step, from 0 after a reset.

    m is the rollout's mean. Beside the mean of all rewards so far, what the policy gained by learning would add up:
    the unit would grow, and the temperature with it.
    """
    # Less the first reward, so that single precision keeps small differences of large rewards.
    differences = rollout.rewards - rollout.rewards[0, 0]
    centred = differences - mean(differences, rollout.counted)
    if rollout.counted is not None:
        centred = centred * rollout.counted  # the row of a reset pays nothing, which is not a reward of -m
    fading = config.discount[0] * config.gae_lambda[0] * (1.0 - (rollout.terminated | rollout.truncated))

    def add(before: Array, step: tuple[Array, Array]) -> tuple[Array, Array]:
        total = before + step[0]
        return total * step[1], total

    return jax.lax.scan(add, jnp.zeros_like(centred[0]), (centred, fading))[1]
