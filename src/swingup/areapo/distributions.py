"""Distributions of a policy's action: a tanh-squashed Gaussian, or independent discrete alternatives.

A sample is kept as a *latent*, the form in which its probability is exact: recovering a Gaussian's sample with
atanh loses precision near saturation. Batch axes come last.
"""

import abc
import math
from collections.abc import Iterator

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float, Int, Shaped

_LOG_2 = math.log(2.0)
_LOG_SQRT_2PI = 0.5 * math.log(2.0 * math.pi)


class AbstractDistribution(eqx.Module):
    """π(·|s) over m entries, independent given the state."""

    @abc.abstractmethod
    def sample(self, noise: Float[Array, "k *batch"]) -> Shaped[Array, "m *batch"]:
        """The latent that standard noise gives (:meth:`swingup.areapo.networks.AbstractActor.noise`)."""

    @abc.abstractmethod
    def log_prob(self, z: Shaped[Array, "m *batch"]) -> Float[Array, "*batch"]:
        """Log density (or log probability) of the action of a latent (nats), summed over the entries."""

    @abc.abstractmethod
    def action(self, z: Shaped[Array, "m *batch"]) -> Shaped[Array, "m *batch"]:
        """The task's action for a latent."""


class SquashedGaussian(AbstractDistribution):
    """Distribution of a = tanh(z) on [-1, 1], z ~ N(mean, exp(log_std)²), entries independent."""

    mean: Float[Array, "m *batch"]
    log_std: Float[Array, "m *batch"]

    def sample(self, noise: Float[Array, "m *batch"]) -> Float[Array, "m *batch"]:
        """z, the action before tanh, for normal noise."""
        return self.mean + jnp.exp(self.log_std) * noise

    def log_prob(self, z: Float[Array, "m *batch"]) -> Float[Array, "*batch"]:
        """Log density of a = tanh(z) on [-1, 1]: log N(z) - log(1 - tanh(z)²), summed over the entries."""
        standardised = (z - self.mean) * jnp.exp(-self.log_std)
        gaussian = -0.5 * standardised**2 - self.log_std - _LOG_SQRT_2PI
        # 1 - tanh(z)² = 4 / (e^z + e^-z)², which this form evaluates without cancellation for any z.
        log_slope = 2.0 * (_LOG_2 - z - jax.nn.softplus(-2.0 * z))
        return jnp.sum(gaussian - log_slope, axis=0)

    def action(self, z: Float[Array, "m *batch"]) -> Float[Array, "m *batch"]:
        """The action of a sample."""
        return jnp.tanh(z)


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
