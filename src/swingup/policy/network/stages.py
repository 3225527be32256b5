"""The stages of an observation as a policy file holds them, and as NumPy computes them."""

from collections.abc import Mapping
from dataclasses import dataclass, fields
from typing import Any

import numpy as np

from ...common.checks import finite_number, one_of
from ...common.errors import SwingupError
from ...common.text import quoted
from ...plant.base_parameters import BASE
from .core import normalised, pendulum_features, plant_features

ANGLES = ("wrapped", "sincos")
"""Encodings of the angles."""
SMALLEST_SCALE = 1e-30
"""Of a base parameter: single precision can divide by it."""


@dataclass(frozen=True)
class PendulumStage:
    """Scaled angles and velocities of a state."""

    angles: str = "wrapped"
    velocity_scale: float = 20.0
    """Velocities are clipped to ± this and divided by it (rad/s)."""

    def __post_init__(self) -> None:
        """Refuse what cannot work."""
        one_of("angle encoding", self.angles, ANGLES)
        scale = finite_number("velocity_scale", self.velocity_scale, 1e-6, unit="rad/s")
        # The class is frozen; this keeps the checked value, a float.
        object.__setattr__(self, "velocity_scale", scale)

    def size(self, before: int) -> int:
        """Length of the result for a state, of length ``before``."""
        return before if self.angles == "wrapped" else before + 2

    def __call__(self, x: np.ndarray) -> np.ndarray:
        """What the network sees of a state x (4,)."""
        return pendulum_features(np, x, self.angles, self.velocity_scale)


@dataclass(frozen=True)
class NormaliseStage:
    """(observation - mean) / sqrt(variance + epsilon), clipped to ± clip."""

    mean: np.ndarray
    variance: np.ndarray
    clip: float = 10.0
    epsilon: float = 1e-8

    def __post_init__(self) -> None:
        """Refuse what cannot work, in double or in single precision."""
        object.__setattr__(self, "clip", finite_number("clip", self.clip, 1e-6))
        object.__setattr__(self, "epsilon", finite_number("epsilon", self.epsilon, 1e-30))
        if np.any(self.variance < 0):
            raise SwingupError("a variance is negative")

    def size(self, before: int) -> int:
        """Length of the result, that of the observation."""
        if not self.mean.shape == self.variance.shape == (before,):
            shapes = f"{self.mean.shape} and {self.variance.shape}"
            raise SwingupError(f"mean and variance have shapes {shapes}, the observation {(before,)}")
        return before

    @property
    def deviation(self) -> np.ndarray:
        """The divisor."""
        return np.sqrt(self.variance + self.epsilon)

    def __call__(self, observation: np.ndarray) -> np.ndarray:
        """The observation, normalised."""
        return normalised(np, observation, self.mean, self.variance, self.clip, self.epsilon)


@dataclass(frozen=True)
class PlantStage:
    """The observation, then the plant's base parameters θ: (θ - centre) / scale, clipped to ± clip.

    It is the last stage of a pendulum's policy. ``plant/base_parameters.py`` says what θ is.
    """

    centre: np.ndarray
    """One for each base parameter, in its unit; so is the scale."""
    scale: np.ndarray
    clip: float = 10.0

    def __post_init__(self) -> None:
        """Refuse what cannot work, in double or in single precision."""
        object.__setattr__(self, "clip", finite_number("clip", self.clip, 1e-6))
        if not self.centre.shape == self.scale.shape == (BASE,):
            shapes = f"{self.centre.shape} and {self.scale.shape}"
            raise SwingupError(f"centre and scale have shapes {shapes}, the base parameters {(BASE,)}")
        # Negated, so that a scale of NaN fails as well.
        if not np.all(self.scale >= SMALLEST_SCALE):
            raise SwingupError(f"a scale of stage 'plant' is below {SMALLEST_SCALE:g}")

    def size(self, before: int) -> int:
        """Length of the result, that of the observation and the base parameters."""
        return before + BASE

    def inputs(self, base: np.ndarray) -> np.ndarray:
        """What is appended (9,) for base parameters θ (9,)."""
        with np.errstate(over="ignore"):
            return plant_features(np, base, self.centre, self.scale, self.clip)


Stage = PendulumStage | NormaliseStage | PlantStage

STAGES: dict[str, type[Stage]] = {"pendulum": PendulumStage, "normalise": NormaliseStage, "plant": PlantStage}
"""Stages by their name in the file. Numbers and words among their fields are settings, the others arrays."""

ARRAYS: dict[str, tuple[str, ...]] = {
    "pendulum": (),
    "normalise": ("mean", "variance"),
    "plant": ("centre", "scale"),
}
"""Names of the arrays of a stage."""


def make_stage(entry: Any, arrays: Mapping[str, np.ndarray]) -> Stage:
    """A stage from its entry in the metadata and its arrays, by their names without the prefix."""
    name = entry.get("name") if isinstance(entry, Mapping) else None
    if not isinstance(name, str) or name not in STAGES:
        shown = quoted(entry if name is None else name)
        raise SwingupError(f"unknown observation stage {shown}: this program knows {', '.join(STAGES)}")
    values: dict[str, Any] = {key: value for key, value in entry.items() if key != "name"}
    known = [field.name for field in fields(STAGES[name]) if field.name not in ARRAYS[name]]
    for key in values:
        if key not in known:
            some = ", ".join(known)
            raise SwingupError(f"unknown setting {quoted(key)} of stage {name!r}: use some of {some}")
    for key in ARRAYS[name]:
        if key not in arrays:
            raise SwingupError(f"stage {name!r} lacks its array {key}")
        values[key] = arrays[key]
    return STAGES[name](**values)
