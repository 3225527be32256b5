"""The interface of a policy's distribution over actions, continuous or discrete."""

import abc

import equinox as eqx
from jaxtyping import Array, Float, Shaped


class AbstractDistribution(eqx.Module):
    """π(·|s) over m entries, independent given the state; batch axes come last.

    A sample is stored as a *latent*, the form in which its probability is exact. ``action`` turns it into the
    task's action.
    """

    @abc.abstractmethod
    def sample(self, noise: Float[Array, "k *batch"]) -> Shaped[Array, "m *batch"]:
        """The latent that standard noise gives (:meth:`swingup.areapo.networks.AbstractActor.noise`)."""

    @abc.abstractmethod
    def log_prob(self, z: Shaped[Array, "m *batch"]) -> Float[Array, "*batch"]:
        """Log density (or log probability) of the action of a latent (nats), summed over the entries."""

    @abc.abstractmethod
    def action(self, z: Shaped[Array, "m *batch"]) -> Shaped[Array, "m *batch"]:
        """The action of a latent."""
