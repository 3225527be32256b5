"""A policy in JAX: observation stages followed by the actor, from a file's arrays and back."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any, Generic, TypeVar

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Shaped

from ...areapo.networks import Actor, AnyActor, CategoricalActor, Linear
from ...common.errors import SwingupError
from ...common.types import Action, Observation, Scalar, State, Torque
from ...plant.base_parameters import base_parameters
from ...plant.plant import LEADERBOARD, Plant, Robot
from ...policy.file import write_network
from ...policy.network import Layer, Network
from ...policy.pendulum import PARTS, PendulumPolicy, write_pendulum_policy
from ...tasks.task import PlantStage, Stage
from ..interface import AbstractController, AbstractPlantController, from_zeros
from .estimator import with_estimator
from .regulator import RegulatingController, with_regulator

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
        """Apply the stages, with θ of the plant where they show it; the result has the observation's precision."""
        observation = jnp.asarray(observation)
        if not jnp.issubdtype(observation.dtype, jnp.floating):  # its normalised values are no whole numbers
            observation = observation.astype(jnp.float32)
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


@jax.jit
def _modes(policy: Policy[Any], observations: Float[Array, "b n"]) -> Shaped[Array, "b m"]:
    return jax.vmap(policy)(observations)


def act(policy: Policy[Any], observations: Float[np.ndarray, "b n"]) -> Shaped[np.ndarray, "b m"]:
    """A policy's deterministic actions for a batch of observations."""
    return np.asarray(_modes(policy, observations))


def _linear(layer: Layer) -> Linear:
    return Linear(layer.weight, layer.bias)  # type: ignore[arg-type]  # JAX takes NumPy's arrays


def _layer_of(linear: Linear) -> Layer:
    return Layer(np.asarray(linear.weight), np.asarray(linear.bias))


class PolicyController(AbstractPlantController[None]):
    """The deterministic policy, called at whatever rate the loop runs."""

    policy: Policy[Actor]  # From a state [q1, q2, dq1, dq2] to an action in [-1, 1]
    torque_limit: float  # Torque of an action of 1 (N m)
    robot: Robot = eqx.field(static=True)  # Which joint is driven
    plant: Plant = eqx.field(static=True, default=LEADERBOARD)  # The plant that the policy was made for
    base: Float[Any, "9"] | None = None
    """θ of the plant that it sees where a call does not say; None for that of ``plant``."""

    def init(self) -> None:
        """It remembers nothing."""

    def control(self, carry: None, t: Scalar, x: State, base: Float[Any, "9"] | None) -> tuple[None, Torque]:
        """The policy's torque on the driven joint, NaN if anything seen is not finite."""
        if x.shape != (4,):  # indices beyond an end would be clipped in silence
            raise SwingupError(f"x has shape {x.shape}: pass four numbers, [q1, q2, dq1, dq2] (rad, rad/s)")
        x = jnp.asarray(x, jnp.result_type(x, 0.0))  # of whole numbers, too
        own = base_parameters(self.plant) if self.base is None else self.base
        torque = self.torque_limit * self.policy(x, own if base is None else base).astype(x.dtype)[0]
        # The clips of the observation must not hide it.
        torque = jnp.where(jnp.isfinite(x).all(), torque, jnp.nan)
        # Selected, not multiplied: a NaN is the driven joint's alone.
        return None, jnp.where(jnp.array(self.robot.actuation) > 0, torque, 0.0)


def make_controller(policy: PendulumPolicy, estimator: bool | None = None) -> AbstractController[Any]:
    """Make a controller of a policy, with its regulator if the file has one.

    An estimator stands before it where the file has one (None), never (False) or always (True). Settings that the
    file lacks have their defaults. Its model is the policy's plant, or what the identifier in the file finds.
    """
    robot, plant = policy.robot, policy.plant.driven(policy.robot)
    acting: PolicyController | RegulatingController = policy_alone(policy)
    if policy.regulator is not None:
        acting = with_regulator(acting, robot, plant, policy.regulator, float(policy.torque_limit))
    if not (policy.estimator is not None if estimator is None else estimator):
        return from_zeros(acting, plant)
    return from_zeros(with_estimator(acting, robot, plant, policy.estimator, policy.identifier), plant)


def policy_alone(policy: PendulumPolicy) -> PolicyController:
    """A policy without what stands around it; one that sees its plant is for the plant of its file."""
    return PolicyController(make_policy(policy.network), policy.torque_limit, policy.robot, policy.plant)


def plant_of(controller: PolicyController) -> Plant:
    """The plant that a policy was made for."""
    return controller.plant.driven(controller.robot)


def policy_of(controller: PolicyController) -> PendulumPolicy:
    """What a file holds of a controller, without what stands around it."""
    network, limit = network_of(controller.policy), float(controller.torque_limit)
    return PendulumPolicy(network, controller.robot, limit, plant_of(controller))


def save_controller(path: str | Path, controller: PolicyController, provenance: Mapping[str, Any]) -> None:
    """Write a controller as a policy file, with the robot, the torque limit and where it comes from.

    An ``estimator`` in the provenance holds the settings of an estimator before the policy, an ``identifier`` those
    of an identifier in it, a ``regulator`` those of a regulator that takes over near the top.
    """
    parts = {name: provenance[name] for name in PARTS if name in provenance}
    write_pendulum_policy(path, policy_of(controller), provenance, parts)
