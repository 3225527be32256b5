"""A policy in JAX: observation stages followed by the actor, from a file's arrays and back."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any, Generic, TypeVar

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Shaped

from ...areapo.networks import Actor, AnyActor, CategoricalActor, Linear, sample_actions
from ...common.types import Action, Key, Observation
from ...policy.file import write_network
from ...policy.network.layers import Layer, Network
from ...tasks.observation import PlantStage, Stage

ActorT = TypeVar("ActorT", bound=AnyActor)


class Policy(eqx.Module, Generic[ActorT]):
    """Observation stages, then the actor."""

    stages: tuple[Stage, ...]
    actor: ActorT

    @property
    def sees_plant(self) -> bool:
        """Whether it depends on its plant."""
        return any(isinstance(stage, PlantStage) for stage in self.stages)

    def observe(self, observation: Observation, base: Float[Any, "9"] | None = None) -> Observation:
        """Apply the stages, with θ of the plant where they show it; the result has the observation's dtype."""
        observation = jnp.asarray(observation)
        dtype = observation.dtype
        for stage in self.stages:
            observation = stage(observation, base)
        # Statistics in double precision would raise the precision of the network's input.
        return observation.astype(dtype)

    def __call__(self, observation: Observation, base: Float[Any, "9"] | None = None) -> Action:
        """The deterministic action: each entry in [-1, 1], or a whole number if actions are discrete.

        The network's weights are float32 numbers; its arithmetic has the observation's precision. In double
        precision, as in the judge, all back ends give the same torque, except for the rounding of short sums in
        single precision (:func:`swingup.areapo.networks.product`).
        """
        return self.actor.mode(self.observe(observation, base))


def save_policy(path: str | Path, policy: Policy[Any], metadata: Mapping[str, Any]) -> None:
    """Write a policy atomically; ``metadata`` (JSON values) is kept under its own names."""
    write_network(path, network_of(policy), metadata)


def make_policy(network: Network) -> Policy[Any]:
    """The policy that a file holds."""
    stages, std = network.stages, network.std
    trunk, head = tuple(map(_linear, network.trunk)), _linear(network.head)
    if network.choices is not None:
        return Policy(stages, CategoricalActor(trunk, network.activation, head, network.choices))
    deviation = None if std is None else _linear(std)
    return Policy(stages, Actor(trunk, network.activation, head, deviation, network.bounds))


def network_of(policy: Policy[Any]) -> Network:
    """What a file holds of a policy."""
    actor = policy.actor
    trunk = tuple(map(_layer_of, actor.trunk))
    if isinstance(actor, CategoricalActor):
        logits = _layer_of(actor.logits_head)
        return Network(policy.stages, trunk, logits, choices=actor.choices, activation=actor.activation)
    std = None if actor.std_head is None else _layer_of(actor.std_head)
    head, bounds = _layer_of(actor.mean_head), actor.bounds
    return Network(policy.stages, trunk, head, std, activation=actor.activation, bounds=bounds)


def act(
    policy: Policy[Any], observations: Float[np.ndarray, "b n"], key: Key | None = None
) -> Shaped[np.ndarray, "b m"]:
    """A policy's actions for a batch of observations: its mode, or samples if there is a key."""
    return np.asarray(_modes(policy, observations) if key is None else _samples(policy, observations, key))


@jax.jit
def _modes(policy: Policy[Any], observations: Float[Array, "b n"]) -> Shaped[Array, "b m"]:
    return jax.vmap(policy)(observations)


@jax.jit
def _samples(policy: Policy[Any], observations: Float[Array, "b n"], key: Key) -> Shaped[Array, "b m"]:
    noise = policy.actor.noise(key, observations.shape[:1])
    return sample_actions(policy.actor, jax.vmap(policy.observe)(observations), noise).actions


def _linear(layer: Layer) -> Linear:
    return Linear(layer.weight, layer.bias)  # type: ignore[arg-type]  # JAX takes NumPy's arrays


def _layer_of(linear: Linear) -> Layer:
    return Layer(np.asarray(linear.weight), np.asarray(linear.bias))
