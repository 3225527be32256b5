"""One step of acting, the same on every back end: update the observation statistics, then sample actions."""

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Shaped

from ..types import Key
from .networks import AbstractActor
from .normalise import RunningStatistics


class Decisions(eqx.Module):
    """What a policy chose in each environment."""

    latents: Shaped[Array, "envs m"]
    log_probs: Float[Array, "envs"]
    actions: Shaped[Array, "envs m"]
    """In [-1, 1], or integers if they are discrete."""
    memory: Float[Array, "envs w"] | None = None
    """Of a recurrent policy, after the observation."""


def decide(
    actor: AbstractActor,
    observations: Float[Array, "envs n"],
    key: Key,
    memory: Float[Array, "envs w"] | None = None,
) -> Decisions:
    """Sample an action in each environment, for normalised observations."""
    after, features = actor.step(None if memory is None else memory.T, observations.T)
    policy = actor.distribution(features)
    latents = policy.sample(key)
    # The density of the latent: from the action, atanh would lose precision near saturation.
    log_probs, actions = policy.log_prob(latents), policy.action(latents).T
    return Decisions(latents.T, log_probs, actions, None if after is None else after.T)


def forget(memory: Float[Array, "envs w"] | None, where: Bool[Array, "envs"]) -> Float[Array, "envs w"] | None:
    """The memory with 0 where an episode starts."""
    return None if memory is None else jnp.where(where[:, None], 0.0, memory)


def update_statistics(
    statistics: RunningStatistics,
    following: Float[Array, "envs n"],
    true_next: Float[Array, "envs n"],
    clip: float,
) -> tuple[RunningStatistics, Float[Array, "envs n"], Float[Array, "envs n"]]:
    """Update the observation statistics and normalise the observations with them.

    The update uses the states after the resets and before normalisation, as in the authors' code.

    Args:
        statistics: of all observations before.
        following: observations to act on next, after the resets.
        true_next: observations of the states after the step, before any reset.
        clip: normalised observations are clipped to ± this.
    """
    statistics = statistics.update(following)
    normalise = statistics.stage(clip)
    return statistics, normalise(following), normalise(true_next)
