"""The clipped surrogate and the value losses of one minibatch."""

from dataclasses import replace

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Shaped

from ..common.types import Scalar
from .average import mean, standardise
from .config import Config
from .networks import AbstractActor, Critic
from .unroll import unroll


class Frames(eqx.Module):
    """Frames to learn from; every leaf has the same leading axes."""

    observations: Float[Array, "*b n"]
    """Normalised with the statistics of their time."""
    latents: Shaped[Array, "*b m"]
    """Samples, before tanh if they are continuous."""
    log_probs: Float[Array, "*b"]
    """log π(a|s) under the policy that drew them."""
    advantages: Float[Array, "*b"]
    """Soft advantages A + A_H."""
    returns: Float[Array, "*b 2"]
    """λ-returns of the reward and of the entropy objective, on the scale of the critic's outputs: its targets."""
    weights: Float[Array, "*b"] | None = None
    """1 for a frame that counts, 0 for one that does not; None: all count."""
    memory: Float[Array, "envs w"] | None = None
    """Of a recurrent policy before the first step; the other leaves then have the axes step and environment."""
    forgets: Bool[Array, "steps envs"] | None = None
    """Where the next row starts an episode."""


class LossMetrics(eqx.Module):
    """The terms of a minibatch's loss, and how far the policy moved."""

    policy_loss: Scalar
    value_loss: Scalar
    entropy_value_loss: Scalar
    approximate_kl: Scalar
    clip_fraction: Scalar


def loss(networks: tuple[AbstractActor, Critic], frames: Frames, config: Config) -> tuple[Scalar, LossMetrics]:
    """-L(θ) + c_v (MSE_V + c2 MSE_H) (paper, eq. for L(θ), and Table I).

    L(θ) = mean min(r A, clip(r, 1 - ε, 1 + ε) A), r = π_θ(a|s) / π_old(a|s).
    """
    actor, critic = networks
    if frames.memory is None or frames.forgets is None:
        # Features first: XLA has fast CPU kernels for the products of this form (see networks).
        observations = frames.observations.T
        features = actor.features(observations)
    else:
        along = unroll(actor, frames.memory, frames.observations, frames.forgets)
        features = along.reshape(-1, along.shape[-1]).T
        frames = jax.tree.map(
            lambda leaf: leaf.reshape(-1, *leaf.shape[2:]), replace(frames, memory=None, forgets=None)
        )
        observations = frames.observations.T
    log_ratios = actor.distribution(features).log_prob(frames.latents.T) - frames.log_probs
    ratios = jnp.exp(log_ratios)
    soft_advantages = frames.advantages
    if config.normalise_advantages:
        # After the sum of both objectives and in each minibatch, as in the authors' code.
        soft_advantages = standardise(soft_advantages, frames.weights)
    clipped = jnp.clip(ratios, 1.0 - config.clip_range, 1.0 + config.clip_range)
    policy_loss = -mean(jnp.minimum(ratios * soft_advantages, clipped * soft_advantages), frames.weights)

    errors = critic(features if critic.shared else observations) - frames.returns.T
    value_loss, entropy_value_loss = mean(errors**2, frames.weights, axis=1)
    # No entropy bonus: the entropy is in the advantages. Values are not clipped, as in the authors' code.
    total = policy_loss + config.value_coefficient * (
        value_loss + config.entropy_value_coefficient * entropy_value_loss
    )
    return total, LossMetrics(
        policy_loss=policy_loss,
        value_loss=value_loss,
        entropy_value_loss=entropy_value_loss,
        # Its mean under π_old is KL(π_old, π_θ), and no sample is negative, unlike -log r.
        approximate_kl=mean(ratios - 1.0 - log_ratios, frames.weights),
        clip_fraction=mean(jnp.abs(ratios - 1.0) > config.clip_range, frames.weights),
    )
