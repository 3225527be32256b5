"""The actor's and the critic's networks: separate hidden layers, orthogonal initialisation.

They take one observation, or a batch whose axis comes last. With the features first, all matrix products of an
update have a form for which XLA has a fast CPU kernel. ``vmap`` does not reach that form and is a tenth slower.
"""

import abc
from collections.abc import Callable
from dataclasses import replace

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float, Int, Shaped

from ..common.errors import SwingupError
from ..common.types import Key
from ..policy.network.layers import RELU, SUM_GROUP, Activation
from ..tasks.task import Spaces
from .distributions import AbstractDistribution, Categoricals, SquashedGaussian

LOG_STD_RANGE = (-20.0, 2.0)
"""Range to which log σ is clamped (authors' code)."""
ACTIVATIONS: dict[Activation, Callable[[Array], Array]] = {
    "relu": jax.nn.relu,
    "tanh": jnp.tanh,
    "elu": jax.nn.elu,
    "silu": jax.nn.silu,
    "gelu": jax.nn.gelu,
}
"""By their names in policy files; ``gelu`` is the approximation by tanh, which needs no error function."""


class Linear(eqx.Module):
    """y = W x + b, in the precision of x."""

    weight: Float[Array, "out in"]
    bias: Float[Array, "out"]

    def __call__(self, x: Float[Array, "in *batch"]) -> Float[Array, "out *batch"]:
        """Apply the layer."""
        return product(jnp.asarray(self.weight), x) + beside(self.bias, x)


class AbstractActor(eqx.Module):
    """π(a|s): hidden layers, then a distribution over actions."""

    trunk: eqx.AbstractVar[tuple[Linear, ...]]
    activation: eqx.AbstractVar[Activation]

    @abc.abstractmethod
    def __call__(self, observation: Float[Array, "n *batch"]) -> AbstractDistribution:
        """Distribution of the action for normalised observations."""

    @abc.abstractmethod
    def noise(self, key: Key, batch: tuple[int, ...]) -> Float[Array, "k *batch"]:
        """Standard noise that the distribution makes a sample of; it depends on no observation and no weight."""

    @abc.abstractmethod
    def mode(self, observation: Float[Array, "n *batch"]) -> Shaped[Array, "m *batch"]:
        """The deterministic action for normalised observations."""


class Actor(AbstractActor):
    """π(a|s) of continuous actions: a tanh-squashed Gaussian, whose standard deviation may depend on the state."""

    trunk: tuple[Linear, ...]
    activation: Activation = eqx.field(static=True)
    mean_head: Linear
    std_head: Linear | None
    """None in a policy file that holds only the deterministic policy."""
    state_dependent_std: bool = eqx.field(static=True, default=True)
    """Without it the weights of ``std_head`` are 0 and stay so."""

    def __call__(self, observation: Float[Array, "n *batch"]) -> SquashedGaussian:
        """Distribution of the action; log σ = log softplus(w·h + b), clamped to [-20, 2] (authors' code).

        Without dependence on the state w is 0.
        """
        if self.std_head is None:
            raise SwingupError("this policy has no standard deviation: ask for its deterministic action")
        features = hidden_features(self.trunk, self.activation, observation)
        mean = self.mean_head(features)
        if self.state_dependent_std:
            outputs = self.std_head(features)
        else:
            outputs = jnp.broadcast_to(beside(self.std_head.bias, mean), mean.shape)
        return SquashedGaussian(mean, jnp.clip(jnp.log(jax.nn.softplus(outputs)), *LOG_STD_RANGE))

    def noise(self, key: Key, batch: tuple[int, ...]) -> Float[Array, "m *batch"]:
        """Normal noise."""
        bias = self.mean_head.bias
        return jax.random.normal(key, (*bias.shape, *batch), bias.dtype)

    def mode(self, observation: Float[Array, "n *batch"]) -> Float[Array, "m *batch"]:
        """The deterministic action tanh(mean), as the authors use it."""
        return jnp.tanh(self.mean_head(hidden_features(self.trunk, self.activation, observation)))


class CategoricalActor(AbstractActor):
    """π(a|s) of discrete actions: a categorical distribution for each of them."""

    trunk: tuple[Linear, ...]
    activation: Activation = eqx.field(static=True)
    logits_head: Linear
    choices: tuple[int, ...] = eqx.field(static=True)
    """Number of alternatives of each action."""

    def __call__(self, observation: Float[Array, "n *batch"]) -> Categoricals:
        """Distribution of the actions."""
        features = hidden_features(self.trunk, self.activation, observation)
        return Categoricals(self.logits_head(features), self.choices)

    def noise(self, key: Key, batch: tuple[int, ...]) -> Float[Array, "k *batch"]:
        """Gumbel noise for each alternative."""
        bias = self.logits_head.bias
        return jax.random.gumbel(key, (*bias.shape, *batch), bias.dtype)

    def mode(self, observation: Float[Array, "n *batch"]) -> Int[Array, "m *batch"]:
        """The most probable alternative of each action."""
        return self(observation).mode()


class Critic(eqx.Module):
    """The bias values v and v_H: two linear heads on hidden layers of their own."""

    trunk: tuple[Linear, ...]
    heads: Linear
    activation: Activation = eqx.field(static=True, default=RELU)

    def __call__(self, observation: Float[Array, "n *batch"]) -> Float[Array, "2 *batch"]:
        """[v(s), v_H(s)] for normalised observations."""
        return self.heads(hidden_features(self.trunk, self.activation, observation))

    def with_values(self, scale: Float[Array, "2"], shift: Float[Array, "2"]) -> "Critic":
        """The critic whose values are ``scale`` times these, less ``shift``."""
        heads = Linear(self.heads.weight * scale[:, None], self.heads.bias * scale - shift)
        return replace(self, heads=heads)


class ActionSample(eqx.Module):
    """What a policy chose in each environment."""

    latents: Shaped[Array, "envs m"]
    log_probs: Float[Array, "envs"]
    actions: Shaped[Array, "envs m"]
    """In [-1, 1], or integers if they are discrete."""


def sample_actions(
    actor: AbstractActor, observations: Float[Array, "envs n"], noise: Float[Array, "k envs"]
) -> ActionSample:
    """The action that the actor's noise gives in each environment, for normalised observations."""
    policy = actor(observations.T)
    latents = policy.sample(noise)
    return ActionSample(latents.T, policy.log_prob(latents), policy.action(latents).T)


def hidden_features(
    trunk: tuple[Linear, ...], activation: Activation, observation: Float[Array, "n *batch"]
) -> Float[Array, "width *batch"]:
    """The output of the last hidden layer; without layers the observation itself."""
    for layer in trunk:
        observation = ACTIVATIONS[activation](layer(observation))
    return observation


def product(weight: Float[Array, "out in"], x: Float[Array, "in *batch"]) -> Float[Array, "out *batch"]:
    """W x in the precision of x.

    Only the judge has float32 weights and a float64 x. Wide layers then sum their products in single precision in
    groups of inputs, and the groups in double, in half the time; a shipped policy's torque changes by at most
    2e-5 N m. Layers with few inputs or few outputs cost little without it.
    """
    if (weight.dtype, x.dtype) != (jnp.float32, jnp.float64) or min(weight.shape) < SUM_GROUP:
        return weight @ x
    rounded = x.astype(weight.dtype)
    parts = [slice(start, start + SUM_GROUP) for start in range(0, len(x), SUM_GROUP)]
    return sum((weight[:, part] @ rounded[part]).astype(x.dtype) for part in parts)  # type: ignore[return-value]


def beside(vector: Float[Array, "n"], x: Float[Array, "n *batch"]) -> Float[Array, "n *ones"]:
    """A vector with an axis of length 1 for each axis of the batch."""
    return vector.reshape(-1, *(1,) * (x.ndim - 1))


def init_policy(
    key: Key,
    spaces: Spaces,
    layers: tuple[int, ...],
    log_std_init: float,
    activation: Activation = RELU,
    state_dependent_std: bool = True,
) -> AbstractActor:
    """An actor for these spaces; a policy of discrete actions starts almost uniform."""
    if not spaces.choices:
        sizes = spaces.observation_size, spaces.action_size
        return init_actor(key, *sizes, layers, log_std_init, activation, state_dependent_std)
    trunk_key, head_key = jax.random.split(key)
    outputs = sum(spaces.choices)
    return CategoricalActor(
        trunk=_init_trunk(trunk_key, spaces.observation_size, layers),
        activation=activation,
        logits_head=_init_linear(head_key, layers[-1], outputs, 0.01),
        choices=spaces.choices,
    )


def init_actor(
    key: Key,
    observation_size: int,
    action_size: int,
    layers: tuple[int, ...],
    log_std_init: float,
    activation: Activation = RELU,
    state_dependent_std: bool = True,
) -> Actor:
    """An actor whose mean starts near 0 and whose σ starts at exp(log_std_init)."""
    trunk_key, mean_key, std_key = jax.random.split(key, 3)
    # The inverse of softplus, so that log softplus(std_bias) = log_std_init.
    std_bias = jnp.log(jnp.expm1(jnp.exp(log_std_init)))
    # Normal weights instead of orthogonal ones, as in the authors' code.
    std_scale = 0.01 if state_dependent_std else 0.0
    std_weight = std_scale * jax.random.normal(std_key, (action_size, layers[-1]))
    return Actor(
        trunk=_init_trunk(trunk_key, observation_size, layers),
        activation=activation,
        mean_head=_init_linear(mean_key, layers[-1], action_size, 0.01),
        std_head=Linear(std_weight, jnp.zeros(action_size) + std_bias),
        state_dependent_std=state_dependent_std,
    )


def init_critic(key: Key, observation_size: int, layers: tuple[int, ...], activation: Activation = RELU) -> Critic:
    """A critic with orthogonal weights (one by one for the two heads) and zero biases."""
    trunk_key, *head_keys = jax.random.split(key, 3)
    # Two heads, as in the authors' code: a joint matrix would make their rows orthogonal to each other.
    rows = [_init_linear(head_key, layers[-1], 1, 1.0).weight for head_key in head_keys]
    heads = Linear(jnp.concatenate(rows), jnp.zeros(2))
    return Critic(_init_trunk(trunk_key, observation_size, layers), heads, activation)


def _init_trunk(key: Key, observation_size: int, layers: tuple[int, ...]) -> tuple[Linear, ...]:
    sizes, keys = (observation_size, *layers), jax.random.split(key, len(layers))
    # A gain of √2, since ReLU drops half of the signal; the authors have it, too. Stable-Baselines3 and CleanRL
    # have it with tanh as well.
    return tuple(_init_linear(*each, 2.0**0.5) for each in zip(keys, sizes[:-1], sizes[1:], strict=True))


def _init_linear(key: Key, size_in: int, size_out: int, scale: float) -> Linear:
    """A layer whose rows or columns are orthogonal, of norm ``scale``, and whose biases are 0."""
    weight = jax.nn.initializers.orthogonal(scale)(key, (size_out, size_in))
    return Linear(weight, jnp.zeros(size_out))
