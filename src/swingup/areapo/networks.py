"""The actor's and the critic's networks, with separate hidden layers, and the distributions of the actor's actions.

A sample is kept as a *latent*, whose probability is exact: atanh of an action loses precision near saturation.
Networks take one observation, or a batch whose axis comes last: XLA then has fast CPU kernels for the matrix
products of an update. ``vmap`` does not reach them and is a tenth slower.
"""

import itertools
import math
from collections.abc import Callable
from dataclasses import replace

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float, Int, Shaped

from ..common.errors import SwingupError
from ..common.types import Key
from ..policy.network import FLOAT32_SUM_WIDTH, LOG_STD_RANGE, STD_OUTPUT_RANGE, TANH, Activation, Bounds

ACTIVATIONS: dict[Activation, Callable[[Array], Array]] = {
    "relu": jax.nn.relu,
    "tanh": jnp.tanh,
    "elu": jax.nn.elu,
    "silu": jax.nn.silu,
    "gelu": jax.nn.gelu,
}
"""By their names in policy files; ``gelu`` is the approximation by tanh, which needs no error function."""
BOUNDS: dict[Bounds, Callable[[Array], Array]] = {"tanh": jnp.tanh, "clip": lambda z: jnp.clip(z, -1.0, 1.0)}

_LOG_2 = math.log(2.0)
_LOG_SQRT_2PI = 0.5 * math.log(2.0 * math.pi)


class BoundedGaussian(eqx.Module):
    """Distribution of a = tanh(z) or clip(z) in [-1, 1], z ~ N(mean, exp(log_std)²), entries independent."""

    mean: Float[Array, "m *batch"]
    log_std: Float[Array, "m *batch"]
    bounds: Bounds = eqx.field(static=True, default=TANH)

    def sample(self, noise: Float[Array, "m *batch"]) -> Float[Array, "m *batch"]:
        """z, the action before its bounds, for normal noise."""
        return self.mean + jnp.exp(self.log_std) * noise

    def log_prob(self, z: Float[Array, "m *batch"]) -> Float[Array, "*batch"]:
        """Log density (nats): the sum of log N(z) with clip, of log N(z) - log(1 - tanh(z)²) for a = tanh(z)."""
        standardised = (z - self.mean) * jnp.exp(-self.log_std)
        terms = -0.5 * standardised**2 - self.log_std - _LOG_SQRT_2PI
        if self.bounds == TANH:
            # 1 - tanh(z)² = 4 / (e^z + e^-z)², which this form evaluates without cancellation for any z.
            terms = terms - 2.0 * (_LOG_2 - z - jax.nn.softplus(-2.0 * z))
        return jnp.sum(terms, axis=0)

    def excess(self) -> Float[Array, "*batch"]:
        """Squared distance of the mean beyond [-1, 1]: clipped samples are alike there, no gradient leads back."""
        return jnp.sum(jax.nn.relu(jnp.abs(self.mean) - 1.0) ** 2, axis=0)

    def action(self, z: Float[Array, "m *batch"]) -> Float[Array, "m *batch"]:
        """The action of a sample."""
        return BOUNDS[self.bounds](z)


class Categoricals(eqx.Module):
    """Distribution of m actions, the i-th one of 0 … choices[i] - 1; a latent is the action itself."""

    logits: Float[Array, "k *batch"]
    """Unnormalised log probabilities of all alternatives, one action's after the other's; k = sum(choices)."""
    # Static, since slices of the logits need sizes that are known when they are compiled.
    choices: tuple[int, ...] = eqx.field(static=True)  # Number of alternatives of each action

    def _each(self, values: Float[Array, "k *batch"]) -> list[Float[Array, "n *batch"]]:
        """The values of each action's alternatives in turn."""
        return jnp.split(values, list(itertools.accumulate(self.choices[:-1])))

    def sample(self, noise: Float[Array, "k *batch"]) -> Int[Array, "m *batch"]:
        """The actions for Gumbel noise: the most probable alternative after its addition (the Gumbel-max trick)."""
        return jnp.stack([jnp.argmax(each, axis=0) for each in self._each(self.logits + noise)])

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


class Linear(eqx.Module):
    """y = W x + b, in the precision of x."""

    weight: Float[Array, "out in"]
    bias: Float[Array, "out"]

    def __call__(self, x: Float[Array, "in *batch"]) -> Float[Array, "out *batch"]:
        """Apply the layer."""
        return product(jnp.asarray(self.weight), x) + batched(self.bias, x)


class AbstractNetwork(eqx.Module):
    """Hidden layers, on which an actor or a critic has its heads."""

    trunk: tuple[Linear, ...]
    activation: Activation = eqx.field(static=True)

    def features(self, observation: Float[Array, "n *batch"]) -> Float[Array, "width *batch"]:
        """The output of the last hidden layer; without layers the normalised observation itself."""
        for layer in self.trunk:
            observation = ACTIVATIONS[self.activation](layer(observation))
        return observation


class Actor(AbstractNetwork):
    """π(a|s) of continuous actions, a bounded Gaussian: by tanh if σ depends on the state, else by clipping."""

    mean_head: Linear
    std_head: Linear | None
    """None in a policy file that holds only the deterministic policy."""
    bounds: Bounds = eqx.field(static=True, default=TANH)
    """With clip the weights of ``std_head`` are 0 and stay so."""

    def __call__(self, observation: Float[Array, "n *batch"]) -> BoundedGaussian:
        """Distribution of the action; log σ in [-20, 2] is log softplus(w·h + b) (authors' code), or b alone."""
        if self.std_head is None:
            raise SwingupError("this policy has no standard deviation: ask for its deterministic action")
        features = self.features(observation)
        mean = self.mean_head(features)
        if self.bounds == TANH:
            log_std = jnp.log(jax.nn.softplus(_clamped(self.std_head(features), *STD_OUTPUT_RANGE)))
        else:
            biases = _clamped(self.std_head.bias, *LOG_STD_RANGE)
            log_std = jnp.broadcast_to(batched(biases, mean), mean.shape)
        return BoundedGaussian(mean, log_std, self.bounds)

    def noise(self, key: Key, batch: tuple[int, ...]) -> Float[Array, "m *batch"]:
        """Normal noise, of which the distribution makes a sample; it depends on no observation and no weight."""
        bias = self.mean_head.bias
        return jax.random.normal(key, (*bias.shape, *batch), bias.dtype)

    def mode(self, observation: Float[Array, "n *batch"]) -> Float[Array, "m *batch"]:
        """The deterministic action, that of the mean, as the authors use it."""
        return BOUNDS[self.bounds](self.mean_head(self.features(observation)))


class CategoricalActor(AbstractNetwork):
    """π(a|s) of discrete actions: a categorical distribution for each of them."""

    logits_head: Linear
    choices: tuple[int, ...] = eqx.field(static=True)  # Number of alternatives of each action

    def __call__(self, observation: Float[Array, "n *batch"]) -> Categoricals:
        """Distribution of the actions."""
        return Categoricals(self.logits_head(self.features(observation)), self.choices)

    def noise(self, key: Key, batch: tuple[int, ...]) -> Float[Array, "k *batch"]:
        """Gumbel noise for each alternative."""
        bias = self.logits_head.bias
        return jax.random.gumbel(key, (*bias.shape, *batch), bias.dtype)

    def mode(self, observation: Float[Array, "n *batch"]) -> Int[Array, "m *batch"]:
        """The most probable alternative of each action."""
        return self(observation).sample(jnp.zeros(()))


AnyActor = Actor | CategoricalActor


class Critic(AbstractNetwork):
    """The bias values v and v_H: two linear heads on hidden layers of their own."""

    heads: Linear

    def __call__(self, observation: Float[Array, "n *batch"]) -> Float[Array, "2 *batch"]:
        """[v(s), v_H(s)] for normalised observations."""
        return self.heads(self.features(observation))

    def with_values(self, scale: Float[Array, "2"], shift: Float[Array, "2"]) -> "Critic":
        """The critic whose values are ``scale`` times these, less ``shift``."""
        heads = Linear(self.heads.weight * scale[:, None], self.heads.bias * scale - shift)
        return replace(self, heads=heads)


class ActionSample(eqx.Module):
    """What a policy chose in each environment."""

    latents: Shaped[Array, "envs m"]
    log_probs: Float[Array, "envs"]
    actions: Shaped[Array, "envs m"]  # In [-1, 1], or integers if they are discrete


def sample_actions(
    actor: AnyActor, observations: Float[Array, "envs n"], noise: Float[Array, "k envs"]
) -> ActionSample:
    """The action that the actor's noise gives in each environment, for normalised observations."""
    policy = actor(observations.T)
    latents = policy.sample(noise)
    return ActionSample(latents.T, policy.log_prob(latents), policy.action(latents).T)


def _clamped(x: Float[Array, "..."], low: float, high: float) -> Float[Array, "..."]:
    """Values within bounds, with gradient 1 outside as well: a policy that a rare state drives there can return."""
    return x + jax.lax.stop_gradient(jnp.clip(x, low, high) - x)


def product(weight: Float[Array, "out in"], x: Float[Array, "in *batch"]) -> Float[Array, "out *batch"]:
    """W x in the precision of x.

    Only the judge has float32 weights and a float64 x. Wide layers then sum their products in single precision in
    groups of inputs, and the groups in double, in half the time; a shipped policy's torque changes by at most
    2e-5 N m. Layers with few inputs or few outputs cost little without it.
    """
    mixed = weight.dtype == jnp.dtype(jnp.float32) and x.dtype == jnp.dtype(jnp.float64)
    if not mixed or min(weight.shape) < FLOAT32_SUM_WIDTH:
        return weight @ x
    rounded = x.astype(weight.dtype)
    parts = [slice(start, start + FLOAT32_SUM_WIDTH) for start in range(0, len(x), FLOAT32_SUM_WIDTH)]
    return sum((weight[:, part] @ rounded[part]).astype(x.dtype) for part in parts)  # type: ignore[return-value]


def batched(vector: Float[Array, "n"], x: Float[Array, "n *batch"]) -> Float[Array, "n *ones"]:
    """A vector with an axis of length 1 for each axis of the batch."""
    return vector.reshape(-1, *(1,) * (x.ndim - 1))
