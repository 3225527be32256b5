"""The actor's and the critic's networks: separate ReLU trunks, orthogonal initialisation.

They take one observation, or a batch whose axis comes last. With the features first, all matrix products of an
update have a form for which XLA has a fast CPU kernel; ``vmap`` does not arrive at it, and is a tenth slower.
"""

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from ..errors import SwingupError
from ..types import Key
from .gaussian import SquashedGaussian

LOG_STD_RANGE = (-20.0, 2.0)
"""Range to which log σ is clamped (authors' code)."""


class Linear(eqx.Module):
    """y = W x + b."""

    weight: Float[Array, "out in"]
    bias: Float[Array, "out"]

    def __call__(self, x: Float[Array, "in *batch"]) -> Float[Array, "out *batch"]:
        """Apply the layer."""
        return self.weight @ x + self.bias.reshape(-1, *(1,) * (x.ndim - 1))


class Actor(eqx.Module):
    """π(a|s): a tanh-squashed Gaussian whose standard deviation depends on the state."""

    trunk: tuple[Linear, ...]
    mean_head: Linear
    std_head: Linear | None
    """None in a policy file that holds only the deterministic policy."""

    def __call__(self, observation: Float[Array, "n *batch"]) -> SquashedGaussian:
        """Distribution of the action for normalised observations.

        log σ = log softplus(w·h + b), clamped to [-20, 2] (authors' code).
        """
        if self.std_head is None:
            raise SwingupError("this policy has no standard deviation: ask for its deterministic action")
        features = _features(self.trunk, observation)
        log_std = jnp.log(jax.nn.softplus(self.std_head(features)))
        return SquashedGaussian(self.mean_head(features), jnp.clip(log_std, *LOG_STD_RANGE))

    def mode(self, observation: Float[Array, "n *batch"]) -> Float[Array, "m *batch"]:
        """The deterministic action tanh(mean), as the authors use it."""
        return jnp.tanh(self.mean_head(_features(self.trunk, observation)))


class Critic(eqx.Module):
    """The bias values v and v_H: two linear heads on one trunk."""

    trunk: tuple[Linear, ...]
    heads: Linear

    def __call__(self, observation: Float[Array, "n *batch"]) -> Float[Array, "2 *batch"]:
        """[v(s), v_H(s)] for normalised observations."""
        return self.heads(_features(self.trunk, observation))


def init_actor(
    key: Key, observation_size: int, action_size: int, layers: tuple[int, ...], log_std_init: float
) -> Actor:
    """An actor whose mean starts near 0 and whose σ starts at exp(log_std_init)."""
    trunk_key, mean_key, std_key = jax.random.split(key, 3)
    width = layers[-1]
    std_bias = jnp.log(jnp.expm1(jnp.exp(log_std_init)))
    return Actor(
        trunk=_trunk(trunk_key, observation_size, layers),
        mean_head=Linear(_orthogonal(mean_key, width, action_size, 0.01), jnp.zeros(action_size)),
        std_head=Linear(0.01 * jax.random.normal(std_key, (action_size, width)), jnp.zeros(action_size) + std_bias),
    )


def init_critic(key: Key, observation_size: int, layers: tuple[int, ...]) -> Critic:
    """A critic with orthogonal weights (one by one for the two heads) and zero biases."""
    trunk_key, value_key, entropy_key = jax.random.split(key, 3)
    rows = [_orthogonal(head_key, layers[-1], 1, 1.0) for head_key in (value_key, entropy_key)]
    return Critic(
        trunk=_trunk(trunk_key, observation_size, layers), heads=Linear(jnp.concatenate(rows), jnp.zeros(2))
    )


def _features(trunk: tuple[Linear, ...], observation: Float[Array, "n *batch"]) -> Float[Array, "width *batch"]:
    features = observation
    for layer in trunk:
        features = jax.nn.relu(layer(features))
    return features


def _trunk(key: Key, observation_size: int, layers: tuple[int, ...]) -> tuple[Linear, ...]:
    sizes = (observation_size, *layers)
    keys = jax.random.split(key, len(layers))
    return tuple(
        Linear(_orthogonal(layer_key, size_in, size_out, 2.0**0.5), jnp.zeros(size_out))
        for layer_key, size_in, size_out in zip(keys, sizes[:-1], sizes[1:], strict=True)
    )


def _orthogonal(key: Key, size_in: int, size_out: int, scale: float) -> Float[Array, "out in"]:
    return jax.nn.initializers.orthogonal(scale)(key, (size_out, size_in))
