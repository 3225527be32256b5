"""Policy files: a network and JSON metadata in one safetensors file, read and written here alone.

``docs/policy-format.md`` describes the file.
"""

import re
from collections.abc import Mapping
from pathlib import Path
from typing import Any, get_args

import numpy as np

from ..common.arrays import load_arrays, save_arrays
from ..common.checks import one_of
from ..common.errors import SwingupError, naming, quoted
from ..common.settings import settings_of
from .network import RELU, STAGES, TANH, Activation, Bounds, Layer, Network, Stage, arrays_of, make_stage

FORMAT = "swingup policy"
FORMAT_VERSION = 1
CHOICES, ACTIVATION, BOUNDS = "choices", "activation", "bounds"
"""Keys of discrete actions' numbers of alternatives, of what follows hidden layers, and of actions' bounds."""
DEFAULTS = {CHOICES: None, ACTIVATION: RELU, BOUNDS: TANH}  # Values of these keys that are left out

MAX_STAGES = 10
KNOWN_ARRAYS = re.compile(
    r"network\.(trunk\.\d{1,2}|mean|std|logits)\.(weight|bias)"
    r"|observation\.\d\.(mean|variance|centre|scale|factors|combinations)"
)
"""Names of the arrays that are read; all others are left alone."""


def read_network(path: str | Path) -> tuple[Network, dict[str, Any]]:
    """Read a policy and its metadata; statistics are float64, weights float32."""
    metadata, found = load_arrays(path, FORMAT, FORMAT_VERSION, lambda name: bool(KNOWN_ARRAYS.fullmatch(name)))
    with naming(f"policy file {path}", "; see docs/policy-format.md"):
        arrays = {name: _checked(name, array) for name, array in found.items()}
        return _network(metadata, arrays), metadata


def read_metadata(path: str | Path) -> dict[str, Any]:
    """Read the metadata of a policy file alone."""
    return load_arrays(path, FORMAT, FORMAT_VERSION, lambda name: False)[0]


def write_network(path: str | Path, network: Network, metadata: Mapping[str, Any]) -> None:
    """Write a policy atomically; ``metadata`` (JSON values) is kept under its own names, but for the network's."""
    arrays: dict[str, np.ndarray] = {}
    stages: list[dict[str, Any]] = []
    for index, stage in enumerate(network.stages):
        name = next(name for name, kind in STAGES.items() if isinstance(stage, kind))
        stages.append({"name": name} | {key: getattr(stage, key) for key in settings_of(type(stage))})
        arrays |= {f"observation.{index}.{key}": getattr(stage, key) for key in arrays_of(type(stage))}
    head = "mean" if network.choices is None else "logits"
    layers: dict[str, Layer] = {f"trunk.{index}": layer for index, layer in enumerate(network.trunk)}
    layers |= {head: network.head}
    layers |= {} if network.std is None else {"std": network.std}
    for name, layer in layers.items():
        arrays |= {f"network.{name}.{key}": getattr(layer, key).astype(np.float32) for key in ("weight", "bias")}
    own = {"observation": stages, CHOICES: network.choices, ACTIVATION: network.activation, BOUNDS: network.bounds}
    written = {key: value for key, value in own.items() if value != DEFAULTS.get(key, ...)}
    # The metadata may be another file's, whose entries of its own network do not fit this one.
    given = {key: value for key, value in metadata.items() if key not in own}
    save_arrays(path, FORMAT, FORMAT_VERSION, written | given, arrays)


def _checked(name: str, array: np.ndarray) -> np.ndarray:
    """The array in the precision that back ends compute with: finite there, too."""
    with np.errstate(over="ignore", under="ignore"):
        # What single precision cannot hold becomes infinite, and is refused.
        single = array.astype(np.float32)
    if array.dtype.kind != "f" or not np.isfinite(single).all():
        raise SwingupError(f"array {name} holds values that are not finite floating-point numbers")
    return single if name.startswith("network.") else array.astype(np.float64)


def _network(metadata: Mapping[str, Any], arrays: Mapping[str, np.ndarray]) -> Network:
    entries = metadata.get("observation")
    if not isinstance(entries, list) or len(entries) > MAX_STAGES:
        raise SwingupError(f"observation {quoted(entries)} is not a list of up to {MAX_STAGES} stages")
    # Counted, so that a gap in the numbers shows as a missing array.
    depth = sum(name.startswith("network.trunk.") and name.endswith(".weight") for name in arrays)
    choices = _choices(metadata)
    activation: Any = one_of(ACTIVATION, metadata.get(ACTIVATION, RELU), get_args(Activation))
    bounds: Any = one_of(BOUNDS, metadata.get(BOUNDS, TANH), get_args(Bounds))
    return Network(
        stages=tuple(_stage(index, entry, arrays) for index, entry in enumerate(entries)),
        trunk=tuple(_layer(arrays, f"network.trunk.{index}") for index in range(depth)),
        head=_layer(arrays, "network.mean" if choices is None else "network.logits"),
        std=_layer(arrays, "network.std") if "network.std.weight" in arrays else None,
        choices=choices,
        activation=activation,
        bounds=bounds,
    )


def _stage(index: int, entry: Any, arrays: Mapping[str, np.ndarray]) -> Stage:
    prefix = f"observation.{index}."
    own = {name.removeprefix(prefix): array for name, array in arrays.items() if name.startswith(prefix)}
    return make_stage(entry, own)


def _layer(arrays: Mapping[str, np.ndarray], name: str) -> Layer:
    missing = [f"{name}.{part}" for part in ("weight", "bias") if f"{name}.{part}" not in arrays]
    if missing:
        raise SwingupError(f"array {missing[0]} is missing")
    weight, bias = arrays[f"{name}.weight"], arrays[f"{name}.bias"]
    if weight.ndim != 2 or bias.shape != weight.shape[:1] or weight.size == 0:
        raise SwingupError(f"{name} has weight {weight.shape} and bias {bias.shape}: expected (out, in), (out,)")
    return Layer(weight, bias)


def _choices(metadata: Mapping[str, Any]) -> tuple[int, ...] | None:
    if CHOICES not in metadata:
        return None
    choices = metadata[CHOICES]
    # The exact type, because isinstance takes true for 1.
    if not (isinstance(choices, list) and choices and all(type(n) is int and n > 0 for n in choices)):
        raise SwingupError(f"choices = {quoted(choices)} must be a list of whole numbers from 1")
    return tuple(choices)
