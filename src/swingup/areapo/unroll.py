"""A recurrent policy along a rollout: what it remembered before and after each step."""

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from ..common.errors import SwingupError
from .networks import AbstractActor

Memories = Float[Array, "steps envs w"] | None
"""None for a policy without memory."""


def unroll(
    actor: AbstractActor,
    memory: Float[Array, "envs w"],
    observations: Float[Array, "steps envs n"],
    forgets: Bool[Array, "steps envs"],
) -> Float[Array, "steps envs w"]:
    """What a recurrent policy remembers after each step, which its heads read.

    Args:
        actor: the policy.
        memory: before the first step.
        observations: normalised.
        forgets: where the next step starts an episode, with a memory of 0.
    """
    gru = actor.gru
    if gru is None:
        raise SwingupError("this policy has no memory: set gru_width")
    steps, envs, _ = observations.shape
    # All products with inputs at once: only those with the memory wait for each other.
    driven = gru.inputs(actor.hidden(observations.reshape(steps * envs, -1).T))
    rows = jnp.moveaxis(driven.reshape(-1, steps, envs), 1, 0)

    def step(
        before: Float[Array, "w envs"], row: tuple[Float[Array, "3w envs"], Bool[Array, "envs"]]
    ) -> tuple[Float[Array, "w envs"], Float[Array, "w envs"]]:
        after = gru.advance(before, row[0])
        return jnp.where(row[1], 0.0, after), after

    _, after = jax.lax.scan(step, memory.T, (rows, forgets))
    return jnp.moveaxis(after, 1, 2)


def memories(
    actor: AbstractActor,
    memory: Float[Array, "envs w"] | None,
    observations: Float[Array, "steps envs n"],
    forgets: Bool[Array, "steps envs"],
) -> tuple[Memories, Memories]:
    """What the policy remembered before and after each step; the arguments are those of ``unroll``."""
    if memory is None:
        return None, None
    after = unroll(actor, memory, observations, forgets)
    kept = jnp.where(forgets[..., None], 0.0, after)
    return jnp.concatenate([memory[None], kept[:-1]]), after
