"""A policy: observation stages followed by the actor, in one documented file without pickle.

The file is a NumPy ``.npz``: named arrays and JSON metadata; ``docs/policy-format.md`` describes it.
"""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import equinox as eqx
import jax
import numpy as np

from ..arrays import load_archive, save_archive
from ..errors import SwingupError
from ..tasks.observation import AbstractStage, PendulumObservation
from ..types import Action, Observation
from .networks import Actor, Linear
from .normalise import Normalise

FORMAT = "swingup policy"
FORMAT_VERSION = 1

STAGES: dict[str, type[AbstractStage]] = {"pendulum": PendulumObservation, "normalise": Normalise}
"""Observation stages by their name in the file. Their fields are what the file holds of them."""


class Policy(eqx.Module):
    """Observation stages, then the actor."""

    stages: tuple[AbstractStage, ...]
    actor: Actor

    def observe(self, observation: Observation) -> Observation:
        """Apply the stages; their result has the dtype of the actor's weights."""
        for stage in self.stages:
            observation = stage(observation)
        return observation.astype(self.actor.mean_head.weight.dtype)

    def __call__(self, observation: Observation) -> Action:
        """The deterministic action, each entry in [-1, 1]."""
        return self.actor.mode(self.observe(observation))


def save_policy(path: str | Path, policy: Policy, metadata: Mapping[str, Any]) -> None:
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
    save_archive(path, FORMAT, FORMAT_VERSION, {"observation": stages, **metadata}, arrays)


def load_policy(path: str | Path) -> tuple[Policy, dict[str, Any]]:
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
        policy = Policy(stages=stages, actor=_actor(arrays))
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


def _actor_arrays(actor: Actor) -> dict[str, Any]:
    layers = {f"trunk.{index}": layer for index, layer in enumerate(actor.trunk)}
    layers |= {"mean": actor.mean_head} | ({} if actor.std_head is None else {"std": actor.std_head})
    return {f"{name}.{part}": getattr(layer, part) for name, layer in layers.items() for part in ("weight", "bias")}


def _actor(arrays: Mapping[str, Any]) -> Actor:
    depth = len([name for name in arrays if name.startswith("network.trunk.") and name.endswith(".weight")])
    return Actor(
        trunk=tuple(_layer(arrays, f"network.trunk.{index}") for index in range(depth)),
        mean_head=_layer(arrays, "network.mean"),
        std_head=_layer(arrays, "network.std") if "network.std.weight" in arrays else None,
    )


def _layer(arrays: Mapping[str, Any], name: str) -> Linear:
    weight, bias = arrays[f"{name}.weight"], arrays[f"{name}.bias"]
    if weight.ndim != 2 or bias.shape != weight.shape[:1]:
        raise SwingupError(f"{name} has weight {weight.shape} and bias {bias.shape}: expected (out, in), (out,)")
    # Native single precision, whatever the file has: the network's own precision.
    return Linear(weight.astype(np.float32), bias.astype(np.float32))


def _check_sizes(policy: Policy) -> None:
    """Follow one observation through the stages and the layers."""
    seen = jax.ShapeDtypeStruct((4,), np.float32)
    for stage in policy.stages:
        if isinstance(stage, Normalise):
            if not np.shape(stage.mean) == np.shape(stage.variance) == seen.shape:
                shapes = f"{np.shape(stage.mean)} and {np.shape(stage.variance)}"
                raise SwingupError(f"mean and variance have shapes {shapes}, the observation {seen.shape}")
            if np.any(np.asarray(stage.variance) < 0):
                raise SwingupError("a variance is negative")
        seen = jax.eval_shape(stage, seen)
    size = seen.shape[0]
    for layer in (*policy.actor.trunk, policy.actor.mean_head):
        size_out, size_in = layer.weight.shape
        if size != size_in:
            raise SwingupError(f"a layer of {size_in} inputs is fed {size} values")
        size = size_out
    std_head, mean_head = policy.actor.std_head, policy.actor.mean_head
    if std_head is not None and std_head.weight.shape != mean_head.weight.shape:
        raise SwingupError(f"network.std has shape {std_head.weight.shape}, network.mean {mean_head.weight.shape}")
