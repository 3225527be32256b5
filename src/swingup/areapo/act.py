"""One step of acting, the same on every back end: update the observation statistics, then sample actions."""

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Shaped

from ..tasks.observation import Normalise
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
    noise: Float[Array, "k envs"],
    memory: Float[Array, "envs w"] | None = None,
) -> Decisions:
    """The action that the actor's noise gives in each environment, for normalised observations."""
    after, features = actor.step(None if memory is None else memory.T, observations.T)
    policy = actor.distribution(features)
    latents = policy.sample(noise)
    # The density of the latent: from the action, atanh would lose precision near saturation.
    log_probs, actions = policy.log_prob(latents), policy.action(latents).T
    return Decisions(latents.T, log_probs, actions, None if after is None else after.T)


def forget(memory: Float[Array, "envs w"] | None, where: Bool[Array, "envs"]) -> Float[Array, "envs w"] | None:
    """The memory with 0 where an episode starts."""
    return None if memory is None else jnp.where(where[:, None], 0.0, memory)


def update_statistics(
    statistics: RunningStatistics, following: Float[Array, "envs n"], clip: float
) -> tuple[RunningStatistics, Normalise]:
    """Update the observation statistics; returns also the normalisation with them.

    The update uses the states after the resets and before normalisation, as in the authors' code.

    Args:
        statistics: of all observations before.
        following: observations to act on next, after the resets.
        clip: normalised observations are clipped to ± this.
    """
    statistics = statistics.update(following)
    return statistics, statistics.stage(clip)
