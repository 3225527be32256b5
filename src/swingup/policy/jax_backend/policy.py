"""A policy: observation stages followed by the actor, in one documented file without pickle.

The file is a NumPy ``.npz``: named arrays and JSON metadata; ``docs/policy-format.md`` describes it.
"""

from collections.abc import Mapping
from pathlib import Path
from typing import Any, Generic, TypeVar

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Shaped

from ...areapo.act import decide
from ...areapo.networks import AbstractActor, Actor, CategoricalActor, Linear
from ...arrays import save_archive
from ...types import Action, Key, Observation
from ..file import FORMAT, FORMAT_VERSION, STAGES, Layer, PolicyFile, read_policy_file
from .observation import AbstractStage, Normalise, PendulumObservation

_KINDS: dict[type, type[AbstractStage]] = {
    STAGES["pendulum"]: PendulumObservation,
    STAGES["normalise"]: Normalise,
}
"""From a file's stages to those that compute; both have the same fields."""


ActorT = TypeVar("ActorT", bound=AbstractActor)


class Policy(eqx.Module, Generic[ActorT]):
    """Observation stages, then the actor."""

    stages: tuple[AbstractStage, ...]
    actor: ActorT

    def observe(self, observation: Observation) -> Observation:
        """Apply the stages; their result has the dtype of what they are given."""
        observation = jnp.asarray(observation)
        dtype = observation.dtype
        for stage in self.stages:
            observation = stage(observation)
        return observation.astype(dtype)

    def __call__(self, observation: Observation) -> Action:
        """The deterministic action: each entry in [-1, 1], or a whole number if actions are discrete.

        The network's weights are float32 numbers, its arithmetic has the observation's precision: where that is
        double, as in the judge, every runtime arrives at the same torque, within what short sums in single
        precision are worth (:class:`.networks.Linear`).
        """
        return self.actor.mode(self.observe(observation))


def save_policy(path: str | Path, policy: Policy[Any], metadata: Mapping[str, Any]) -> None:
    """Write a policy atomically; ``metadata`` (JSON values) is kept under its own names.

    Raises:
        SwingupError: the file cannot be written.
    """
    stages: list[dict[str, Any]] = []
    arrays: dict[str, np.ndarray] = {}
    for index, stage in enumerate(policy.stages):
        entry: dict[str, Any] = {"name": _stage_name(stage)}
        for name, value in vars(stage).items():
            if np.ndim(value) == 0:
                entry[name] = np.asarray(value).item()
            else:
                arrays[f"observation.{index}.{name}"] = np.asarray(value, np.float64)
        stages.append(entry)
    arrays |= {f"network.{name}": np.asarray(value) for name, value in _actor_arrays(policy.actor).items()}
    head = {"choices": list(policy.actor.choices)} if isinstance(policy.actor, CategoricalActor) else {}
    save_archive(path, FORMAT, FORMAT_VERSION, {"observation": stages, **head, **metadata}, arrays)


def load_policy(path: str | Path) -> tuple[Policy[Any], dict[str, Any]]:
    """Read a policy and its metadata.

    Raises:
        SwingupError: the file cannot be read, is truncated, or is not a policy file of this version.
    """
    file, metadata = read_policy_file(path)
    return make_policy(file), metadata


def make_policy(file: PolicyFile) -> Policy[Any]:
    """The policy that a file holds."""
    trunk, head, std = tuple(map(_linear, file.trunk)), _linear(file.head), file.std
    stages = tuple(_KINDS[type(stage)](**vars(stage)) for stage in file.stages)
    if file.choices is not None:
        return Policy(stages, CategoricalActor(trunk, head, file.choices))
    return Policy(stages, Actor(trunk, head, None if std is None else _linear(std)))


def _stage_name(stage: AbstractStage) -> str:
    return next(name for name, kind in STAGES.items() if type(stage) is _KINDS[kind])


def _heads(actor: AbstractActor) -> dict[str, Linear]:
    """The output layers by their names in the file."""
    if isinstance(actor, CategoricalActor):
        return {"logits": actor.logits_head}
    assert isinstance(actor, Actor)
    return {"mean": actor.mean_head} | ({} if actor.std_head is None else {"std": actor.std_head})


def _actor_arrays(actor: AbstractActor) -> dict[str, Any]:
    layers = {f"trunk.{index}": layer for index, layer in enumerate(actor.trunk)} | _heads(actor)
    return {f"{name}.{part}": getattr(layer, part) for name, layer in layers.items() for part in ("weight", "bias")}


def _linear(layer: Layer) -> Linear:
    return Linear(layer.weight, layer.bias)  # type: ignore[arg-type]  # JAX takes NumPy's arrays


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
    return decide(policy.actor, jax.vmap(policy.observe)(observations), key).actions
