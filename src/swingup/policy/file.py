"""Policy files as NumPy arrays: what a file holds, checked, before JAX or another runtime makes a policy of it.

``docs/policy-format.md`` describes the file.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from ..arrays import load_archive
from ..errors import SwingupError
from ..robots import ROBOTS, Robot, get_robot
from .settings import EstimatorSettings, FrontEndSettings, read_front_end, read_settings

FORMAT = "swingup policy"
FORMAT_VERSION = 1

ANGLES = ("wrapped", "sincos")
"""Encodings of the angles."""
MOST = 100
"""Past torques or earlier states that a policy may be shown."""
COUNTS = ("torques", "history")
"""Settings of a stage that count, and may be 0."""


@dataclass(frozen=True)
class PendulumStage:
    """Scaled angles and velocities of a state."""

    angles: str = "wrapped"
    velocity_scale: float = 20.0
    """Velocities are clipped to ± this and divided by it (rad/s)."""
    torques: int = 0
    """How many past torques follow the state."""
    history: int = 0
    """How many earlier states follow these."""

    def __post_init__(self) -> None:
        """Refuse an unknown encoding, and what the front end cannot remember."""
        for name in COUNTS:
            if not (isinstance(getattr(self, name), int) and 0 <= getattr(self, name) <= MOST):
                raise SwingupError(f"{name} = {getattr(self, name)!r} must be a whole number of 0 to {MOST}")
        if self.angles not in ANGLES:
            raise SwingupError(f"unknown angle encoding {self.angles!r}: use one of {', '.join(ANGLES)}")

    @property
    def input_size(self) -> int:
        """Length of what it is shown: a state, and what is remembered."""
        return 4 * (1 + self.history) + self.torques

    def size(self, before: int) -> int:
        """Length of the result for what is shown, of length ``before``."""
        return before if self.angles == "wrapped" else before + 2 * (1 + self.history)


@dataclass(frozen=True)
class NormaliseStage:
    """(observation - mean) / sqrt(variance + epsilon), clipped to ± clip."""

    mean: np.ndarray
    variance: np.ndarray
    clip: float = 10.0
    epsilon: float = 1e-8

    def size(self, before: int) -> int:
        """Length of the result, that of the observation.

        Raises:
            SwingupError: the arrays do not fit it.
        """
        if not self.mean.shape == self.variance.shape == (before,):
            shapes = f"{self.mean.shape} and {self.variance.shape}"
            raise SwingupError(f"mean and variance have shapes {shapes}, the observation {(before,)}")
        if np.any(self.variance < 0):
            raise SwingupError("a variance is negative")
        return before

    @property
    def deviation(self) -> np.ndarray:
        """What is divided by."""
        return np.sqrt(self.variance + self.epsilon)


Stage = PendulumStage | NormaliseStage

STAGES: dict[str, type[Stage]] = {"pendulum": PendulumStage, "normalise": NormaliseStage}
"""Observation stages by their name in the file. Their fields are what the file holds of them."""


@dataclass(frozen=True)
class Layer:
    """y = weight x + bias, both in float32; weight has the shape (outputs, inputs)."""

    weight: np.ndarray
    bias: np.ndarray


@dataclass(frozen=True)
class PolicyFile:
    """The observation stages, the hidden layers, and the heads."""

    stages: tuple[Stage, ...]
    trunk: tuple[Layer, ...]
    head: Layer
    """Means of continuous actions before tanh, or the logits of discrete ones."""
    std: Layer | None = None
    choices: tuple[int, ...] | None = None
    """Number of alternatives of each discrete action; None if actions are continuous."""

    @property
    def layers(self) -> tuple[Layer, ...]:
        """The layers of the deterministic policy."""
        return (*self.trunk, self.head)


@dataclass(frozen=True)
class PendulumPolicy:
    """A policy file of a pendulum: one torque for a state, perhaps with an estimator before it."""

    file: PolicyFile
    robot: Robot
    torque_limit: float
    """Torque of an action of 1 (N m)."""
    estimator: EstimatorSettings | None
    """What the metadata asks for; None for the policy alone."""
    metadata: Mapping[str, Any]
    front_end: FrontEndSettings | None = None
    """What the metadata asks for: a memory, a filter, friction compensation."""

    @property
    def stage(self) -> PendulumStage:
        """Its first stage."""
        stage = self.file.stages[0]
        assert isinstance(stage, PendulumStage)
        return stage

    @property
    def period(self) -> float | None:
        """Time between calls that its estimator or its front end reckons with (s); None for any."""
        fronts = (self.estimator, self.front_end)
        return next((front.dt for front in fronts if front is not None), None)


def read_policy_file(path: str | Path) -> tuple[PolicyFile, dict[str, Any]]:
    """Read a policy and its metadata; statistics are float64, weights float32.

    Raises:
        SwingupError: the file cannot be read, is truncated, or is not a policy file of this version.
    """
    metadata, arrays = load_archive(path, FORMAT, FORMAT_VERSION)
    try:
        for name, array in arrays.items():
            if array.dtype.kind != "f" or not np.isfinite(array).all():
                raise SwingupError(f"array {name} holds values that are not finite floating-point numbers")
        stages = tuple(_stage(index, entry, arrays) for index, entry in enumerate(metadata["observation"]))
        depth = len([name for name in arrays if name.startswith("network.trunk.") and name.endswith(".weight")])
        choices = _choices(metadata)
        file = PolicyFile(
            stages=stages,
            trunk=tuple(_layer(arrays, f"network.trunk.{index}") for index in range(depth)),
            head=_layer(arrays, "network.mean" if choices is None else "network.logits"),
            std=_layer(arrays, "network.std") if "network.std.weight" in arrays else None,
            choices=choices,
        )
        _check_sizes(file)
    except SwingupError as error:
        raise SwingupError(f"policy file {path}: {error}; see docs/policy-format.md") from error
    except (KeyError, TypeError, AttributeError) as error:
        raise SwingupError(f"policy file {path} lacks or mistakes {error}: see docs/policy-format.md") from error
    return file, metadata


def read_pendulum_policy(path: str | Path, robot: Robot | str | None = None) -> PendulumPolicy:
    """Read a policy file of a pendulum.

    Args:
        path: the policy file.
        robot: the robot that it must be for, if any.

    Raises:
        SwingupError: the file cannot be read, is no policy of a pendulum, asks for an impossible estimator, or is
            for another robot.
    """
    file, metadata = read_policy_file(path)
    missing = [name for name in ("robot", "torque_limit") if name not in metadata]
    if missing or not file.stages or not isinstance(file.stages[0], PendulumStage):
        what = f"metadata {', '.join(missing)}" if missing else "observation stage 'pendulum' at the start"
        raise SwingupError(f"policy file {path} lacks {what}: see docs/policy-format.md")
    name = metadata["robot"]
    if not isinstance(name, str) or name not in ROBOTS:
        raise SwingupError(f"policy file {path} is for robot {name!r}: {' or '.join(ROBOTS)} is needed")
    if robot is not None and name != get_robot(robot).name:
        raise SwingupError(f"policy file {path} is for {name!r}, not the {get_robot(robot).name}")
    if file.choices is not None:
        raise SwingupError(f"policy file {path} has discrete actions: a pendulum needs a torque")
    actions, limit = file.head.weight.shape[0], metadata["torque_limit"]
    if actions != 1:
        raise SwingupError(f"policy file {path} has {actions} actions: one is needed")
    if isinstance(limit, bool) or not isinstance(limit, int | float) or not 0 < limit < 1e9:
        raise SwingupError(f"policy file {path} has torque_limit {limit!r}: a positive number of N m is needed")
    try:
        settings, front_end = read_settings(metadata), read_front_end(metadata)
        if front_end is None and file.stages[0].input_size > 4:
            raise SwingupError("its stage 'pendulum' asks for a memory: name its front_end, {} for the defaults")
    except SwingupError as error:
        raise SwingupError(f"policy file {path}: {error}; see docs/policy-format.md") from error
    return PendulumPolicy(file, ROBOTS[name], float(limit), settings, metadata, front_end)


def _stage(index: int, entry: Mapping[str, Any], arrays: Mapping[str, np.ndarray]) -> Stage:
    prefix = f"observation.{index}."
    state: dict[str, Any] = {
        name.removeprefix(prefix): array.astype(np.float64)
        for name, array in arrays.items()
        if name.startswith(prefix)
    }
    settings = {name: value for name, value in entry.items() if name != "name"}
    for name, value in settings.items():
        number = isinstance(value, int | float) and not isinstance(value, bool)
        if name not in ("angles", *COUNTS) and not (number and 0 < value < 1e9):
            raise SwingupError(f"stage {entry['name']!r} has {name} = {value!r}, not a positive number")
    if entry["name"] not in STAGES:
        raise SwingupError(f"unknown observation stage {entry['name']!r}: this program knows {', '.join(STAGES)}")
    return STAGES[entry["name"]](**settings, **state)


def _layer(arrays: Mapping[str, np.ndarray], name: str) -> Layer:
    weight, bias = arrays[f"{name}.weight"], arrays[f"{name}.bias"]
    if weight.ndim != 2 or bias.shape != weight.shape[:1]:
        raise SwingupError(f"{name} has weight {weight.shape} and bias {bias.shape}: expected (out, in), (out,)")
    # Native single precision, whatever the file has.
    return Layer(weight.astype(np.float32), bias.astype(np.float32))


def _choices(metadata: Mapping[str, Any]) -> tuple[int, ...] | None:
    if "choices" not in metadata:
        return None
    choices = metadata["choices"]
    if not (isinstance(choices, list) and choices and all(type(n) is int and n > 0 for n in choices)):
        raise SwingupError(f"choices = {choices!r} must be a list of whole numbers from 1")
    return tuple(choices)


def _check_sizes(file: PolicyFile) -> None:
    """Follow one observation through the stages and the layers."""
    size = _input_size(file)
    for stage in file.stages:
        size = stage.size(size)
    for layer in file.layers:
        size_out, size_in = layer.weight.shape
        if size != size_in:
            raise SwingupError(f"a layer of {size_in} inputs is fed {size} values")
        size = size_out
    if file.std is not None and file.std.weight.shape != file.head.weight.shape:
        raise SwingupError(f"network.std has shape {file.std.weight.shape}, network.mean {file.head.weight.shape}")
    if file.choices is not None and size != sum(file.choices):
        raise SwingupError(f"network.logits has {size} outputs, choices {file.choices} need their sum")


def _input_size(file: PolicyFile) -> int:
    """Length of what the first stage is shown: a pendulum's state, or what the statistics are of."""
    first = file.stages[0] if file.stages else None
    if isinstance(first, PendulumStage):
        return first.input_size
    return int(first.mean.size if first is not None else file.layers[0].weight.shape[1])
