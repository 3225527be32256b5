"""One step of acting, the same on every back end: update the observation statistics, then sample actions."""

from typing import Any

import equinox as eqx
import jax
from jaxtyping import Array, Float, Shaped

from ..types import Key
from .networks import AbstractActor
from .normalise import RunningStatistics


class Decisions(eqx.Module):
    """What a policy chose in each environment."""

    latents: Shaped[Array, "envs m"]
    log_probs: Float[Array, "envs"]
    actions: Shaped[Array, "envs m"]
    """In [-1, 1], or integers if they are discrete."""


def decide(actor: AbstractActor, observations: Float[Array, "envs n"], key: Key) -> Decisions:
    """Sample an action in each environment, for normalised observations."""
    policy = jax.vmap(actor)(observations)
    latents = vmap_with_keys(lambda p, k: p.sample(k), key, policy)
    # The density of the latent: from the action, atanh would lose precision near saturation.
    log_probs = jax.vmap(lambda p, z: p.log_prob(z))(policy, latents)
    return Decisions(latents, log_probs, jax.vmap(lambda p, z: p.action(z))(policy, latents))


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


def vmap_with_keys(function: Any, key: Key, *arguments: Any) -> Any:
    """Map over environments with a key for each."""
    size = jax.tree.leaves(arguments[0])[0].shape[0]
    return jax.vmap(function)(*arguments, jax.random.split(key, size))
