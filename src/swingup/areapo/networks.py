"""The actor's and the critic's networks: separate or shared hidden layers, orthogonal initialisation.

They take one observation, or a batch whose axis comes last. With the features first, all matrix products of an
update have a form for which XLA has a fast CPU kernel. ``vmap`` does not reach that form and is a tenth slower.
"""

import abc

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float, Int, Shaped

from ..common.errors import SwingupError
from ..common.types import Key
from ..policy.network import Activation
from ..tasks.task import Spaces
from .categorical import Categoricals
from .distribution import AbstractDistribution
from .gaussian import SquashedGaussian
from .layers import LayerKind, LayerNorm, Linear, beside, hidden_features, init_norms, init_trunk, orthogonal
from .recurrence import GRU, init_gru

LOG_STD_RANGE = (-20.0, 2.0)
"""Range to which log σ is clamped (authors' code)."""
Memory = Float[Array, "w *batch"] | None
"""What a recurrent policy remembers; None for one without memory."""
PLAIN = LayerKind()
"""ReLU without normalisation, as in the paper."""


class AbstractActor(eqx.Module):
    """π(a|s): hidden layers, then a distribution over actions."""

    trunk: eqx.AbstractVar[tuple[Linear, ...]]
    norms: eqx.AbstractVar[tuple[LayerNorm, ...]]
    """One before the activation of each hidden layer, or none at all."""
    activation: eqx.AbstractVar[Activation]
    gru: eqx.AbstractVar[GRU | None]
    """The recurrent layer after the hidden layers, if there is one."""

    @abc.abstractmethod
    def distribution(self, features: Float[Array, "width *batch"]) -> AbstractDistribution:
        """Distribution of the action for the hidden layers' output."""

    @abc.abstractmethod
    def noise(self, key: Key, batch: tuple[int, ...]) -> Float[Array, "k *batch"]:
        """Standard noise that the distribution makes a sample of; it depends on no observation and no weight."""

    @abc.abstractmethod
    def choose(self, features: Float[Array, "width *batch"]) -> Shaped[Array, "m *batch"]:
        """The deterministic action for the hidden layers' output."""

    def hidden(self, observation: Float[Array, "n *batch"]) -> Float[Array, "width *batch"]:
        """The hidden layers' output for normalised observations, before the recurrent layer."""
        return hidden_features(self.trunk, self.norms, self.activation, observation)

    def features(self, observation: Float[Array, "n *batch"]) -> Float[Array, "width *batch"]:
        """What the heads read, for normalised observations.

        Raises:
            SwingupError: the policy is recurrent.
        """
        if self.gru is not None:
            raise SwingupError("this policy has a memory: pass it with each observation")
        return self.hidden(observation)

    def step(
        self, memory: Memory, observation: Float[Array, "n *batch"]
    ) -> tuple[Memory, Float[Array, "width *batch"]]:
        """The memory after an observation, None without a recurrent layer, and what the heads read."""
        if self.gru is None or memory is None:
            return memory, self.features(observation)
        after = self.gru(memory, self.hidden(observation))
        return after, after

    def __call__(self, observation: Float[Array, "n *batch"]) -> AbstractDistribution:
        """Distribution of the action for normalised observations."""
        return self.distribution(self.features(observation))

    def mode(self, observation: Float[Array, "n *batch"]) -> Shaped[Array, "m *batch"]:
        """The deterministic action for normalised observations."""
        return self.choose(self.features(observation))


class Actor(AbstractActor):
    """π(a|s) of continuous actions: a tanh-squashed Gaussian, whose standard deviation may depend on the state."""

    trunk: tuple[Linear, ...]
    norms: tuple[LayerNorm, ...]
    activation: Activation = eqx.field(static=True)
    gru: GRU | None
    mean_head: Linear
    std_head: Linear | None
    """None in a policy file that holds only the deterministic policy."""
    state_dependent_std: bool = eqx.field(static=True, default=True)
    """Without it the weights of ``std_head`` are 0 and stay so."""

    def distribution(self, features: Float[Array, "width *batch"]) -> SquashedGaussian:
        """Distribution of the action; log σ = log softplus(w·h + b), clamped to [-20, 2] (authors' code).

        Without dependence on the state w is 0.
        """
        if self.std_head is None:
            raise SwingupError("this policy has no standard deviation: ask for its deterministic action")
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

    def choose(self, features: Float[Array, "width *batch"]) -> Float[Array, "m *batch"]:
        """The deterministic action tanh(mean), as the authors use it."""
        return jnp.tanh(self.mean_head(features))


class CategoricalActor(AbstractActor):
    """π(a|s) of discrete actions: a categorical distribution for each of them."""

    trunk: tuple[Linear, ...]
    norms: tuple[LayerNorm, ...]
    activation: Activation = eqx.field(static=True)
    gru: GRU | None
    logits_head: Linear
    choices: tuple[int, ...] = eqx.field(static=True)
    """Number of alternatives of each action."""

    def distribution(self, features: Float[Array, "width *batch"]) -> Categoricals:
        """Distribution of the actions."""
        return Categoricals(self.logits_head(features), self.choices)

    def noise(self, key: Key, batch: tuple[int, ...]) -> Float[Array, "k *batch"]:
        """Gumbel noise for each alternative."""
        keys, dtype = jax.random.split(key, len(self.choices)), self.logits_head.bias.dtype
        drawn = [jax.random.gumbel(k, (size, *batch), dtype) for k, size in zip(keys, self.choices, strict=True)]
        return jnp.concatenate(drawn)

    def choose(self, features: Float[Array, "width *batch"]) -> Int[Array, "m *batch"]:
        """The most probable alternative of each action."""
        return self.distribution(features).mode()


class Critic(eqx.Module):
    """The bias values v and v_H: two linear heads on hidden layers of their own, or on the actor's."""

    trunk: tuple[Linear, ...]
    """Empty if the heads read the actor's features."""
    heads: Linear
    norms: tuple[LayerNorm, ...] = ()
    activation: Activation = eqx.field(static=True, default="relu")
    shared: bool = eqx.field(static=True, default=False)
    """Whether the heads read the actor's features."""

    def __call__(self, observation: Float[Array, "n *batch"]) -> Float[Array, "2 *batch"]:
        """[v(s), v_H(s)] for normalised observations, or for the actor's features if those are shared."""
        return self.heads(hidden_features(self.trunk, self.norms, self.activation, observation))


def values(
    actor: AbstractActor, critic: Critic, observation: Float[Array, "n *batch"], memory: Memory = None
) -> Float[Array, "2 *batch"]:
    """[v(s), v_H(s)] for normalised observations, whether hidden layers are shared or not."""
    return critic(actor.step(memory, observation)[1] if critic.shared else observation)


def init_policy(
    key: Key,
    spaces: Spaces,
    layers: tuple[int, ...],
    log_std_init: float,
    kind: LayerKind = PLAIN,
    state_dependent_std: bool = True,
) -> AbstractActor:
    """An actor for these spaces; a policy of discrete actions starts almost uniform."""
    if not spaces.choices:
        sizes = spaces.observation_size, spaces.action_size
        return init_actor(key, *sizes, layers, log_std_init, kind, state_dependent_std)
    trunk_key, head_key = jax.random.split(key)
    outputs, gru = sum(spaces.choices), _init_gru(key, layers, kind)
    return CategoricalActor(
        trunk=init_trunk(trunk_key, spaces.observation_size, layers),
        norms=init_norms(layers, kind),
        activation=kind.activation,
        gru=gru,
        logits_head=Linear(orthogonal(head_key, kind.width(layers), outputs, 0.01), jnp.zeros(outputs)),
        choices=spaces.choices,
    )


def init_actor(
    key: Key,
    observation_size: int,
    action_size: int,
    layers: tuple[int, ...],
    log_std_init: float,
    kind: LayerKind = PLAIN,
    state_dependent_std: bool = True,
) -> Actor:
    """An actor whose mean starts near 0 and whose σ starts at exp(log_std_init)."""
    trunk_key, mean_key, std_key = jax.random.split(key, 3)
    width = kind.width(layers)
    # The inverse of softplus, so that log softplus(std_bias) = log_std_init.
    std_bias = jnp.log(jnp.expm1(jnp.exp(log_std_init)))
    # Normal weights instead of orthogonal ones, as in the authors' code.
    std_scale = 0.01 if state_dependent_std else 0.0
    return Actor(
        trunk=init_trunk(trunk_key, observation_size, layers),
        norms=init_norms(layers, kind),
        activation=kind.activation,
        gru=_init_gru(key, layers, kind),
        mean_head=Linear(orthogonal(mean_key, width, action_size, 0.01), jnp.zeros(action_size)),
        std_head=Linear(
            std_scale * jax.random.normal(std_key, (action_size, width)), jnp.zeros(action_size) + std_bias
        ),
        state_dependent_std=state_dependent_std,
    )


def _init_gru(key: Key, layers: tuple[int, ...], kind: LayerKind) -> GRU | None:
    # From a key of its own: without it the other layers start as they always did.
    return init_gru(jax.random.fold_in(key, 1), layers[-1], kind.gru_width) if kind.gru_width else None


def init_critic(key: Key, observation_size: int, layers: tuple[int, ...], kind: LayerKind = PLAIN) -> Critic:
    """A critic with orthogonal weights (one by one for the two heads) and zero biases."""
    trunk_key, heads_key = _critic_keys(key)
    return Critic(
        trunk=init_trunk(trunk_key, observation_size, layers),
        heads=_value_heads(heads_key, layers[-1]),
        norms=init_norms(layers, kind),
        activation=kind.activation,
    )


def init_shared_critic(key: Key, width: int) -> Critic:
    """A critic whose heads read the actor's features, of this width."""
    return Critic(trunk=(), heads=_value_heads(_critic_keys(key)[1], width), shared=True)


def _critic_keys(key: Key) -> tuple[Key, tuple[Key, Key]]:
    """The keys of the hidden layers and of the two heads."""
    trunk_key, value_key, entropy_key = jax.random.split(key, 3)
    return trunk_key, (value_key, entropy_key)


def _value_heads(keys: tuple[Key, Key], width: int) -> Linear:
    # Two heads, as in the authors' code: a joint matrix would make their rows orthogonal to each other.
    rows = [orthogonal(head_key, width, 1, 1.0) for head_key in keys]
    return Linear(jnp.concatenate(rows), jnp.zeros(2))
