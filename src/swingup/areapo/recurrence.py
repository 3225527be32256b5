"""A gated recurrent unit after the hidden layers: the policy's memory, which is 0 at the start of an episode.

The learner updates on whole rollouts of some environments. The memory at a rollout's start is the one that was
collected, under earlier weights; gradients end there.
"""

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from ..common.types import Key
from .layers import Linear, orthogonal


class GRU(eqx.Module):
    """h' = (1 - z) n + z h (Cho et al., arXiv 1406.1078, in the form of cuDNN and PyTorch).

    r = σ(W_r x + U_r h), z = σ(W_z x + U_z h) and n = tanh(W_n x + r U_n h), each product with its bias.
    """

    inputs: Linear
    """W_r, W_z and W_n, one above the other."""
    hidden: Linear
    """U_r, U_z and U_n."""

    @property
    def width(self) -> int:
        """Numbers that are remembered."""
        return self.hidden.weight.shape[1]

    def __call__(self, memory: Float[Array, "w *batch"], x: Float[Array, "in *batch"]) -> Float[Array, "w *batch"]:
        """The memory after one more input; it is the output, too."""
        return self.advance(memory, self.inputs(x))

    def advance(
        self, memory: Float[Array, "w *batch"], driven: Float[Array, "3w *batch"]
    ) -> Float[Array, "w *batch"]:
        """The memory after one more input x, given W x."""
        (r, z, n), (by_r, by_z, by_n) = (jnp.split(each, 3) for each in (driven, self.hidden(memory)))
        reset, keep = jax.nn.sigmoid(r + by_r), jax.nn.sigmoid(z + by_z)
        return (1.0 - keep) * jnp.tanh(n + reset * by_n) + keep * memory


def init_gru(key: Key, size_in: int, width: int) -> GRU:
    """A unit whose matrices are orthogonal, each by itself, and whose biases are 0."""
    keys = jax.random.split(key, 6)
    inputs, hidden = (
        Linear(jnp.concatenate([orthogonal(each, size, width, 1.0) for each in part]), jnp.zeros(3 * width))
        for part, size in ((keys[:3], size_in), (keys[3:], width))
    )
    return GRU(inputs, hidden)
