"""A policy: observation stages followed by the actor, in one documented file without pickle.

The file is a NumPy ``.npz``: named arrays and JSON metadata; ``docs/policy-format.md`` describes it.
"""

from collections.abc import Mapping
from pathlib import Path
from typing import Any, Generic, TypeVar

import equinox as eqx
import jax
import numpy as np

from ..arrays import load_archive, save_archive
from ..errors import SwingupError
from ..tasks.observation import AbstractStage, PendulumObservation
from ..types import Action, Observation
from .networks import AbstractActor, Actor, CategoricalActor, Linear
from .normalise import Normalise

FORMAT = "swingup policy"
FORMAT_VERSION = 1

STAGES: dict[str, type[AbstractStage]] = {"pendulum": PendulumObservation, "normalise": Normalise}
"""Observation stages by their name in the file. Their fields are what the file holds of them."""


ActorT = TypeVar("ActorT", bound=AbstractActor)


class Policy(eqx.Module, Generic[ActorT]):
    """Observation stages, then the actor."""

    stages: tuple[AbstractStage, ...]
    actor: ActorT

    def observe(self, observation: Observation) -> Observation:
        """Apply the stages; their result has the dtype of the actor's weights."""
        for stage in self.stages:
            observation = stage(observation)
        return observation.astype(self.actor.trunk[0].weight.dtype)

    def __call__(self, observation: Observation) -> Action:
        """The deterministic action: each entry in [-1, 1], or a whole number if actions are discrete."""
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
    """Read a policy and its metadata; arrays keep the file's precision.

    Raises:
        SwingupError: the file cannot be read, is truncated, or is not a policy file of this version.
    """
    metadata, arrays = load_archive(path, FORMAT, FORMAT_VERSION)
    try:
        for name, array in arrays.items():
            if array.dtype.kind != "f" or not np.isfinite(array).all():
                raise SwingupError(f"array {name} holds values that are not finite floating-point numbers")
        stages = tuple(_stage(index, entry, arrays) for index, entry in enumerate(metadata["observation"]))
        policy = Policy(stages=stages, actor=_actor(arrays, metadata))
        _check_sizes(policy)
    except SwingupError as error:
        raise SwingupError(f"policy file {path}: {error}; see docs/policy-format.md") from error
    except (KeyError, TypeError, AttributeError) as error:
        raise SwingupError(f"policy file {path} lacks or mistakes {error}: see docs/policy-format.md") from error
    return policy, metadata


def _stage(index: int, entry: Mapping[str, Any], arrays: Mapping[str, Any]) -> AbstractStage:
    prefix = f"observation.{index}."
    state = {
        name.removeprefix(prefix): array.astype(np.float64)
        for name, array in arrays.items()
        if name.startswith(prefix)
    }
    settings = {name: value for name, value in entry.items() if name != "name"}
    for name, value in settings.items():
        number = isinstance(value, int | float) and not isinstance(value, bool)
        if name != "angles" and not (number and 0 < value < 1e9):
            raise SwingupError(f"stage {entry['name']!r} has {name} = {value!r}, not a positive number")
    if entry["name"] not in STAGES:
        raise SwingupError(f"unknown observation stage {entry['name']!r}: this program knows {', '.join(STAGES)}")
    return STAGES[entry["name"]](**settings, **state)


def _stage_name(stage: AbstractStage) -> str:
    return next(name for name, kind in STAGES.items() if type(stage) is kind)


def _heads(actor: AbstractActor) -> dict[str, Linear]:
    """The output layers by their names in the file."""
    if isinstance(actor, CategoricalActor):
        return {"logits": actor.logits_head}
    assert isinstance(actor, Actor)
    return {"mean": actor.mean_head} | ({} if actor.std_head is None else {"std": actor.std_head})


def _actor_arrays(actor: AbstractActor) -> dict[str, Any]:
    layers = {f"trunk.{index}": layer for index, layer in enumerate(actor.trunk)} | _heads(actor)
    return {f"{name}.{part}": getattr(layer, part) for name, layer in layers.items() for part in ("weight", "bias")}


def _actor(arrays: Mapping[str, Any], metadata: Mapping[str, Any]) -> AbstractActor:
    depth = len([name for name in arrays if name.startswith("network.trunk.") and name.endswith(".weight")])
    trunk = tuple(_layer(arrays, f"network.trunk.{index}") for index in range(depth))
    if "choices" in metadata:
        choices = metadata["choices"]
        if not (isinstance(choices, list) and choices and all(type(n) is int and n > 0 for n in choices)):
            raise SwingupError(f"choices = {choices!r} must be a list of whole numbers from 1")
        return CategoricalActor(trunk, _layer(arrays, "network.logits"), tuple(choices))
    return Actor(
        trunk=trunk,
        mean_head=_layer(arrays, "network.mean"),
        std_head=_layer(arrays, "network.std") if "network.std.weight" in arrays else None,
    )


def _layer(arrays: Mapping[str, Any], name: str) -> Linear:
    weight, bias = arrays[f"{name}.weight"], arrays[f"{name}.bias"]
    if weight.ndim != 2 or bias.shape != weight.shape[:1]:
        raise SwingupError(f"{name} has weight {weight.shape} and bias {bias.shape}: expected (out, in), (out,)")
    # Native single precision, whatever the file has: the network's own precision.
    return Linear(weight.astype(np.float32), bias.astype(np.float32))


def _check_sizes(policy: Policy[AbstractActor]) -> None:
    """Follow one observation through the stages and the layers."""
    seen = jax.ShapeDtypeStruct((_input_size(policy),), np.float32)
    for stage in policy.stages:
        if isinstance(stage, Normalise):
            if not np.shape(stage.mean) == np.shape(stage.variance) == seen.shape:
                shapes = f"{np.shape(stage.mean)} and {np.shape(stage.variance)}"
                raise SwingupError(f"mean and variance have shapes {shapes}, the observation {seen.shape}")
            if np.any(np.asarray(stage.variance) < 0):
                raise SwingupError("a variance is negative")
        seen = jax.eval_shape(stage, seen)
    size = seen.shape[0]
    heads = _heads(policy.actor)
    for layer in (*policy.actor.trunk, next(iter(heads.values()))):
        size_out, size_in = layer.weight.shape
        if size != size_in:
            raise SwingupError(f"a layer of {size_in} inputs is fed {size} values")
        size = size_out
    if "std" in heads and heads["std"].weight.shape != heads["mean"].weight.shape:
        std, mean = heads["std"].weight.shape, heads["mean"].weight.shape
        raise SwingupError(f"network.std has shape {std}, network.mean {mean}")
    if isinstance(policy.actor, CategoricalActor) and size != sum(policy.actor.choices):
        raise SwingupError(f"network.logits has {size} outputs, choices {policy.actor.choices} need their sum")


def _input_size(policy: Policy[AbstractActor]) -> int:
    """Length of what the first stage is shown: a pendulum's state, or what the statistics are of."""
    first = policy.stages[0] if policy.stages else None
    if isinstance(first, PendulumObservation):
        return 4
    return int(np.size(first.mean) if isinstance(first, Normalise) else policy.actor.trunk[0].weight.shape[1])
