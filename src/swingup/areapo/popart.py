"""PopArt: values learned on a normalised scale. A change of the scale leaves the values as they are.

Source: van Hasselt et al., "Learning values across many orders of magnitude" (arXiv 1602.07714), as EAPO uses it on
both value heads (arXiv 2407.18143). A head's output n stands for the value σ n + μ; μ and σ follow the λ-returns.
"""

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float

from ..common.types import Scalar
from .networks import Critic

MIN_SCALE = 1e-4
"""Least σ: with constant returns σ would be 0, and the targets would have no bound."""


class ValueScale(eqx.Module):
    """Running first and second moment of the returns of both heads, and the trace of their step size."""

    mean: Float[Array, "2"]
    """μ."""
    square: Float[Array, "2"]
    """ν, the mean square."""
    trace: Scalar
    """Sum of the weights so far: 0 before the first update."""

    @property
    def scale(self) -> Float[Array, "2"]:
        """σ = sqrt(ν - μ²); 1 before the first update."""
        # Rounding can make the difference negative.
        spread = jnp.sqrt(jnp.maximum(self.square - self.mean**2, MIN_SCALE**2))
        return jnp.where(self.trace > 0.0, spread, 1.0)

    def denormalise(self, outputs: Float[Array, "*b 2"]) -> Float[Array, "*b 2"]:
        """The values that the heads' outputs stand for."""
        return self.scale * outputs + self.mean

    def normalise(self, values: Float[Array, "*b 2"]) -> Float[Array, "*b 2"]:
        """The outputs that stand for these values."""
        return (values - self.mean) / self.scale

    def update(self, mean: Float[Array, "2"], square: Float[Array, "2"], step_size: float) -> "ValueScale":
        """Move the moments towards those of a rollout's returns.

        As for the gains, the first update copies them, and later ones form an exponential mean, through the trace:
        trace ← trace + β (1 - trace), μ ← μ + (β / trace) (mean - μ), likewise ν.
        """
        trace = self.trace + step_size * (1.0 - self.trace)
        rate = step_size / trace
        return ValueScale(
            mean=self.mean + rate * (mean - self.mean),
            square=self.square + rate * (square - self.square),
            trace=trace,
        )


def init_value_scale() -> ValueScale:
    """The scale before the first update: outputs are values."""
    return ValueScale(mean=jnp.zeros(2), square=jnp.ones(2), trace=jnp.zeros(()))


def rescale(critic: Critic, old: ValueScale, new: ValueScale) -> Critic:
    """The critic whose values under the new scale are those of the old critic under the old scale.

    W ← (σ / σ') W and b ← (σ b + μ - μ') / σ' (van Hasselt et al., proposition 1).
    """
    ratio = old.scale / new.scale
    weight = critic.heads.weight * ratio[:, None]
    bias = (old.scale * critic.heads.bias + old.mean - new.mean) / new.scale
    return eqx.tree_at(lambda c: (c.heads.weight, c.heads.bias), critic, (weight, bias))
