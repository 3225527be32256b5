"""Generalised advantage estimates with a gain, and the gains' updates (paper, section III)."""

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from ..common.types import Scalar
from .average import Weights, mean
from .config import Config

Sequence = Float[Array, "steps *envs"]


class Gains(eqx.Module):
    """The reward gain ρ, the entropy gain ρ_H, and the trace of their step size."""

    reward: Scalar
    entropy: Scalar
    trace: Scalar


def init_gains() -> Gains:
    """All start at 0."""
    return Gains(reward=jnp.zeros(()), entropy=jnp.zeros(()), trace=jnp.zeros(()))


def advantages(
    rewards: Sequence,
    values: Sequence,
    next_values: Sequence,
    cuts: Bool[Array, "steps *envs"],
    gain: Scalar,
    discount: float,
    gae_lambda: float,
) -> Sequence:
    """GAE for one objective, with its gain.

    A_t = δ_t + γ λ (1 - cut_t) A_{t+1} with δ_t = r_t - ρ + γ V(s'_t) - V(s_t); s'_t is the state before a reset.

    Args:
        rewards: r_t of each step.
        values: V(s_t) of the state before each step.
        next_values: V(s'_t) of the state after each step and before any reset; 0 where the process ended.
        cuts: true where s_{t+1} is not s'_t, because the task was reset.
        gain: ρ, or 0 without average reward.
        discount: γ.
        gae_lambda: λ.
    """
    # next_values count at a cut, too: a truncation does not end the process, only the recursion stops.
    deltas = rewards - gain + discount * next_values - values
    decays = discount * gae_lambda * (1.0 - cuts)

    def backwards(following: Sequence, step: tuple[Sequence, Sequence]) -> tuple[Sequence, Sequence]:
        delta, decay = step
        advantage = delta + decay * following
        return advantage, advantage

    # The sum starts at 0: what follows the rollout is in V(s') of the last delta.
    _, result = jax.lax.scan(backwards, jnp.zeros_like(deltas[0]), (deltas, decays), reverse=True)
    return result


def update_gains(
    gains: Gains,
    reward_advantages: Sequence,
    entropy_advantages: Sequence,
    config: Config,
    weights: Weights = None,
) -> Gains:
    """ρ ← ρ + η' mean(A) and ρ_H ← ρ_H + η' mean(A_H), after the advantages are computed.

    Without the trace η' = η, as in the paper. With it trace ← trace + η (1 - trace), then η' = η / trace: the
    estimate starts as a plain mean and ends as an exponential one (authors' code).
    """
    if not config.average_reward:
        return gains
    trace = gains.trace + config.gain_step_size * (1.0 - gains.trace)
    # λ-advantages scale the step by about 1 / (1 - λ), in the authors' code as well.
    step_size = config.gain_step_size / trace if config.gain_trace else config.gain_step_size
    return Gains(
        reward=gains.reward + step_size * mean(reward_advantages, weights),
        entropy=gains.entropy + step_size * mean(entropy_advantages, weights),
        trace=trace,
    )
