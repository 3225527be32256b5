"""The actor's and the critic's networks: separate ReLU trunks, orthogonal initialisation.

They take one observation, or a batch whose axis comes last. With the features first, all matrix products of an
update have a form for which XLA has a fast CPU kernel. ``vmap`` does not reach that form and is a tenth slower.
"""

import abc

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float, Int, Shaped

from ..errors import SwingupError
from ..policy.network import SUM_GROUP
from ..tasks.task import Spaces
from ..types import Key
from .categorical import Categoricals
from .distribution import AbstractDistribution
from .gaussian import SquashedGaussian

LOG_STD_RANGE = (-20.0, 2.0)
"""Range to which log σ is clamped (authors' code)."""


class Linear(eqx.Module):
    """y = W x + b, in the precision of x.

    Wide layers with float32 weights are an exception where x is float64: their products are summed in single
    precision in groups of inputs, the groups in double. This takes half the time and changes a shipped
    policy's torque by at most 2e-5 N m. Layers with few inputs or few outputs cost little without it.
    """

    weight: Float[Array, "out in"]
    bias: Float[Array, "out"]

    def __call__(self, x: Float[Array, "in *batch"]) -> Float[Array, "out *batch"]:
        """Apply the layer."""
        weight = jnp.asarray(self.weight)
        if (weight.dtype, x.dtype) == (jnp.float32, jnp.float64) and min(weight.shape) >= SUM_GROUP:
            rounded = x.astype(weight.dtype)
            parts = [slice(start, start + SUM_GROUP) for start in range(0, len(x), SUM_GROUP)]
            product = sum((weight[:, part] @ rounded[part]).astype(x.dtype) for part in parts)
        else:
            product = weight @ x
        return product + self.bias.reshape(-1, *(1,) * (x.ndim - 1))


class AbstractActor(eqx.Module):
    """π(a|s): hidden layers, then a distribution over actions."""

    trunk: eqx.AbstractVar[tuple[Linear, ...]]

    @abc.abstractmethod
    def __call__(self, observation: Float[Array, "n *batch"]) -> AbstractDistribution:
        """Distribution of the action for normalised observations."""

    @abc.abstractmethod
    def mode(self, observation: Float[Array, "n *batch"]) -> Shaped[Array, "m *batch"]:
        """The deterministic action."""


class Actor(AbstractActor):
    """π(a|s) of continuous actions: a tanh-squashed Gaussian whose standard deviation depends on the state."""

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


class CategoricalActor(AbstractActor):
    """π(a|s) of discrete actions: a categorical distribution for each of them."""

    trunk: tuple[Linear, ...]
    logits_head: Linear
    choices: tuple[int, ...] = eqx.field(static=True)
    """Number of alternatives of each action."""

    def __call__(self, observation: Float[Array, "n *batch"]) -> Categoricals:
        """Distribution of the actions for normalised observations."""
        return Categoricals(self.logits_head(_features(self.trunk, observation)), self.choices)

    def mode(self, observation: Float[Array, "n *batch"]) -> Int[Array, "m *batch"]:
        """The most probable alternative of each action."""
        return self(observation).mode()


class Critic(eqx.Module):
    """The bias values v and v_H: two linear heads on one trunk."""

    trunk: tuple[Linear, ...]
    heads: Linear

    def __call__(self, observation: Float[Array, "n *batch"]) -> Float[Array, "2 *batch"]:
        """[v(s), v_H(s)] for normalised observations."""
        return self.heads(_features(self.trunk, observation))


def init_policy(key: Key, spaces: Spaces, layers: tuple[int, ...], log_std_init: float) -> AbstractActor:
    """An actor for these spaces; a policy of discrete actions starts almost uniform."""
    if not spaces.choices:
        return init_actor(key, spaces.observation_size, spaces.action_size, layers, log_std_init)
    trunk_key, head_key = jax.random.split(key)
    outputs = sum(spaces.choices)
    return CategoricalActor(
        trunk=_trunk(trunk_key, spaces.observation_size, layers),
        logits_head=Linear(_orthogonal(head_key, layers[-1], outputs, 0.01), jnp.zeros(outputs)),
        choices=spaces.choices,
    )


def init_actor(
    key: Key, observation_size: int, action_size: int, layers: tuple[int, ...], log_std_init: float
) -> Actor:
    """An actor whose mean starts near 0 and whose σ starts at exp(log_std_init)."""
    trunk_key, mean_key, std_key = jax.random.split(key, 3)
    width = layers[-1]
    # The inverse of softplus, so that log softplus(std_bias) = log_std_init.
    std_bias = jnp.log(jnp.expm1(jnp.exp(log_std_init)))
    return Actor(
        trunk=_trunk(trunk_key, observation_size, layers),
        mean_head=Linear(_orthogonal(mean_key, width, action_size, 0.01), jnp.zeros(action_size)),
        # Normal weights instead of orthogonal ones, as in the authors' code.
        std_head=Linear(0.01 * jax.random.normal(std_key, (action_size, width)), jnp.zeros(action_size) + std_bias),
    )


def init_critic(key: Key, observation_size: int, layers: tuple[int, ...]) -> Critic:
    """A critic with orthogonal weights (one by one for the two heads) and zero biases."""
    trunk_key, value_key, entropy_key = jax.random.split(key, 3)
    # Two heads, as in the authors' code: a joint matrix would make their rows orthogonal to each other.
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
        # A gain of √2, since ReLU drops half of the signal; the authors have it, too.
        Linear(_orthogonal(layer_key, size_in, size_out, 2.0**0.5), jnp.zeros(size_out))
        for layer_key, size_in, size_out in zip(keys, sizes[:-1], sizes[1:], strict=True)
    )


def _orthogonal(key: Key, size_in: int, size_out: int, scale: float) -> Float[Array, "out in"]:
    return jax.nn.initializers.orthogonal(scale)(key, (size_out, size_in))
