"""The values of what follows each step: the next row of a rollout shows it, except where the task was reset."""

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from ..common.types import Count
from .config import Config
from .networks import Critic
from .state import Rollout

BOOTSTRAP_SIZE = 64
"""States whose values are computed at once; a rollout of Table I has about 13 truncated steps."""


def values_after(
    critic: Critic, rollout: Rollout, next_rows: Float[Array, "steps envs 2"], config: Config
) -> Float[Array, "steps envs 2"]:
    """[v, v_H] of what follows each step, from the values of the next rows.

    A truncated step is followed by the state before the reset. After a terminated step ``config.terminations``
    decides: nothing of value follows (``end``), or the state before the reset (``bootstrap``), or the new start,
    for which the reward pays. Where a step is both, the termination decides.
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

    def replace(carry: tuple[Count, Array]) -> tuple[Count, Array]:
        start, flat = carry
        # The last slice is moved back to fit. It then repeats some rows, with the same result.
        rows = jax.lax.dynamic_slice(order, (start,), (min(BOOTSTRAP_SIZE, flags.size),))
        kept = jnp.where(flags[rows, None], jax.vmap(critic)(next_observations[rows]), flat[rows])
        return start + BOOTSTRAP_SIZE, flat.at[rows].set(kept)

    count = jnp.sum(flags)
    start = (jnp.array(0), values.reshape(-1, 2))
    return jax.lax.while_loop(lambda carry: carry[0] < count, replace, start)[1].reshape(values.shape)
