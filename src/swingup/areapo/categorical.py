"""Independent categorical distributions over one or several discrete actions."""

from collections.abc import Iterator

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float, Int

from .distribution import AbstractDistribution


class Categoricals(AbstractDistribution):
    """Distribution of m actions, the i-th one of 0 … choices[i] - 1; a latent is the action itself."""

    logits: Float[Array, "k *batch"]
    """Unnormalised log probabilities of all alternatives, one action's after the other's; k = sum(choices)."""
    # Static, since slices of the logits need sizes that are known when they are compiled.
    choices: tuple[int, ...] = eqx.field(static=True)
    """Number of alternatives of each action."""

    def _each(self, values: Float[Array, "k *batch"]) -> Iterator[Float[Array, "n *batch"]]:
        """The values of each action's alternatives in turn."""
        start = 0
        for size in self.choices:
            yield values[start : start + size]
            start += size

    def sample(self, noise: Float[Array, "k *batch"]) -> Int[Array, "m *batch"]:
        """The actions for Gumbel noise: the most probable alternative after its addition (the Gumbel-max trick)."""
        return self._most(self.logits + noise)

    def _most(self, values: Float[Array, "k *batch"]) -> Int[Array, "m *batch"]:
        """The alternative of each action with the largest value."""
        return jnp.stack([jnp.argmax(each, axis=0) for each in self._each(values)])

    def log_prob(self, z: Int[Array, "m *batch"]) -> Float[Array, "*batch"]:
        """Log probability of actions (nats): the sum of log softmax over the m actions."""
        chosen = [
            jnp.take_along_axis(jax.nn.log_softmax(logits, axis=0), index[None], axis=0)[0]
            for logits, index in zip(self._each(self.logits), z, strict=True)
        ]
        return jnp.sum(jnp.stack(chosen), axis=0)

    def action(self, z: Int[Array, "m *batch"]) -> Int[Array, "m *batch"]:
        """The actions as they are."""
        return z

    def mode(self) -> Int[Array, "m *batch"]:
        """The most probable alternative of each action."""
        return self._most(self.logits)
