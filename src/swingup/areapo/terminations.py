"""What a termination means: what it costs where the task goes on from a new start, and which values follow it.

The cost of a reset is that of ATRPO (arXiv 2106.07329). The values of what follows a step are those of the next row
of the rollout, except where the task was reset.
"""

from dataclasses import replace

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from ..common.types import Count, Scalar
from .config import Config
from .networks import Critic
from .reward_scale import deviation
from .state import LearnerState, Rollout, termination_rate

TERMINATION_TARGET = 1e-3
"""f*: terminations a step that the adaptive cost permits (RVI-SAC, arXiv 2408.01972)."""
COST_STEP = 1.5
"""η_c: what each termination beyond those adds to the adaptive cost (deviations of the rewards)."""
BOOTSTRAP_SIZE = 64
"""States whose values are computed at once; a rollout of Table I has about 13 truncated steps."""


def charge_resets(state: LearnerState, rollout: Rollout, config: Config) -> tuple[LearnerState, Rollout, Scalar]:
    """Subtract the cost of a reset from the rewards of terminated steps; also the cost (units of the reward).

    A fixed cost is in units of the reward, as in arXiv 2501.06937's continuing MuJoCo tasks. An adaptive cost is in
    deviations of the task's rewards so far: neither their unit nor a constant in them changes what it means. With
    any other meaning of a termination nothing changes.
    """
    if config.terminations == "reset_cost":
        cost = state.reset_cost
    elif config.terminations == "adaptive_cost":
        seen = state.task_rewards.update_all(rollout.rewards, rollout.counted)
        cost = state.reset_cost * deviation(seen)
        adapted = adapted_cost(state.reset_cost, termination_rate(rollout), config.rollout_size)
        state = replace(state, reset_cost=adapted, task_rewards=seen)
    else:
        return state, rollout, jnp.zeros(())
    charged = jnp.where(rollout.terminated, rollout.rewards - cost, rollout.rewards)
    return state, replace(rollout, rewards=charged), cost


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
