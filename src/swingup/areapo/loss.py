"""The clipped surrogate and the value losses of one minibatch."""

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float

from ..types import Scalar
from .config import Config
from .networks import Actor, Critic


class Batch(eqx.Module):
    """Frames to learn from; every leaf has the same leading axes."""

    observations: Float[Array, "*b n"]
    """Normalised with the statistics of their time."""
    latents: Float[Array, "*b m"]
    """Samples before tanh."""
    log_probs: Float[Array, "*b"]
    """log π(a|s) under the policy that drew them."""
    advantages: Float[Array, "*b"]
    """Soft advantages A + A_H."""
    returns: Float[Array, "*b 2"]
    """λ-returns of the reward and of the entropy objective: the values' targets."""


class LossMetrics(eqx.Module):
    """What a minibatch's loss consists of."""

    policy_loss: Scalar
    value_loss: Scalar
    entropy_value_loss: Scalar
    approximate_kl: Scalar
    clip_fraction: Scalar


def loss(networks: tuple[Actor, Critic], batch: Batch, config: Config) -> tuple[Scalar, LossMetrics]:
    """-L(θ) + c_v (MSE_V + c2 MSE_H) (paper, eq. for L(θ), and Table I).

    L(θ) = mean min(r A, clip(r, 1 - ε, 1 + ε) A), r = π_θ(a|s) / π_old(a|s).
    """
    actor, critic = networks
    observations = batch.observations.T
    log_ratios = actor(observations).log_prob(batch.latents.T) - batch.log_probs
    ratios = jnp.exp(log_ratios)
    soft_advantages = _normalised(batch.advantages) if config.normalise_advantages else batch.advantages
    clipped = jnp.clip(ratios, 1.0 - config.clip_range, 1.0 + config.clip_range)
    policy_loss = -jnp.mean(jnp.minimum(ratios * soft_advantages, clipped * soft_advantages))

    errors = critic(observations) - batch.returns.T
    value_loss, entropy_value_loss = jnp.mean(errors**2, axis=1)
    total = policy_loss + config.value_coefficient * (
        value_loss + config.entropy_value_coefficient * entropy_value_loss
    )
    return total, LossMetrics(
        policy_loss=policy_loss,
        value_loss=value_loss,
        entropy_value_loss=entropy_value_loss,
        approximate_kl=jnp.mean(ratios - 1.0 - log_ratios),
        clip_fraction=jnp.mean(jnp.abs(ratios - 1.0) > config.clip_range),
    )


def _normalised(advantages: Float[Array, "b"]) -> Float[Array, "b"]:
    return (advantages - jnp.mean(advantages)) / (jnp.std(advantages) + 1e-8)
