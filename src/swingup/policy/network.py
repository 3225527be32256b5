"""A policy's stages and layers as arrays, checked: what all back ends compute with."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields, replace
from typing import Annotated, Any, ClassVar, Literal

import numpy as np

from ..common.checks import LARGEST_NUMBER, one_of
from ..common.errors import SwingupError
from ..common.settings import Range, in_range, read_values, settings_of
from ..plant.base_parameters import BASE
from ..plant.equations import TURN
from ..plant.plant import Plant
from ..plant.units import BASE_UNITS, VELOCITY, arm_scales, scaled

ANGLES = ("wrapped", "sincos")  # Encodings of the angles
MIN_SCALE = 1e-30  # Least scale of a base parameter: single precision can divide by it

Array = Any  # An array of NumPy or JAX
Clip = Annotated[float, Range(1e-6, LARGEST_NUMBER)]  # The result lies within ± this


@dataclass(frozen=True)
class PendulumStage:
    """Scaled angles and velocities of states x = [q1, q2, dq1, dq2] (rad, rad/s); the results lie in [-1, 1].

    ``wrapped`` is the paper's [(q1 mod 2π - π)/π, (q2 mod 2π - π)/π, dq1/s, dq2/s] (after Zhang et al.): upright
    lies on its jump at q2 = 0. ``sincos`` is [sin q1, cos q1, sin q2, cos q2, dq1/s, dq2/s], which has no jump.
    mod is the non-negative remainder.
    """

    PART: ClassVar[str] = "pendulum stage"
    angles: str = "wrapped"
    velocity_scale: Annotated[float, Range(1e-6, LARGEST_NUMBER), VELOCITY] = 20.0
    """s: velocities are clipped to ± this first (rad/s)."""

    def __post_init__(self) -> None:
        one_of("angle encoding", self.angles, ANGLES)

    def size(self, before: int = 4) -> int:
        """Length of the result for a state, of length ``before``."""
        return before if self.angles == "wrapped" else before + 2

    def __call__(self, x: Array, base: Array | None = None) -> Array:
        """What the network sees of a state (4,), or of several with leading axes."""
        xp = x.__array_namespace__()
        q, velocities = x[..., :2], _within(x[..., 2:], self.velocity_scale) / self.velocity_scale
        if self.angles == "wrapped":
            return xp.concatenate([(xp.mod(q, TURN) - math.pi) / math.pi, velocities], axis=-1)
        sines, cosines = xp.sin(q), xp.cos(q)
        parts = [sines[..., :1], cosines[..., :1], sines[..., 1:], cosines[..., 1:], velocities]
        return xp.concatenate(parts, axis=-1)


@dataclass(frozen=True)
class NormaliseStage:
    """(o - mean) / sqrt(variance + ε) within ± clip; an observation o may have leading axes."""

    PART: ClassVar[str] = "normalise stage"
    mean: Array
    variance: Array
    clip: Clip = 10.0
    epsilon: Annotated[float, Range(1e-30, LARGEST_NUMBER)] = 1e-8

    def size(self, before: int) -> int:
        """Length of the result and of the observation."""
        if not self.mean.shape == self.variance.shape == (before,):
            shapes = f"{self.mean.shape} and {self.variance.shape}"
            raise SwingupError(f"mean and variance have shapes {shapes}, the observation {(before,)}")
        if np.any(self.variance < 0):
            raise SwingupError("a variance is negative")
        return before

    @property
    def deviation(self) -> np.ndarray:
        """The divisor."""
        return np.sqrt(self.variance + self.epsilon)

    def __call__(self, observation: Array, base: Array | None = None) -> Array:
        """The observation, normalised."""
        root = observation.__array_namespace__().sqrt(self.variance + self.epsilon)
        return _within((observation - self.mean) / root, self.clip)


@dataclass(frozen=True)
class PlantStage:
    """The observation, then the plant's base parameters θ: (θ - centre) / scale within ± clip.

    It is the last stage of a pendulum's policy. ``plant/base_parameters.py`` says what θ is.
    """

    PART: ClassVar[str] = "plant stage"
    centre: Annotated[Array, *BASE_UNITS]  # One for each base parameter, in its unit; so is the scale
    scale: Annotated[Array, *BASE_UNITS]
    clip: Clip = 10.0

    def size(self, before: int) -> int:
        """Length of the result, that of the observation and the base parameters."""
        if not self.centre.shape == self.scale.shape == (BASE,):
            shapes = f"{self.centre.shape} and {self.scale.shape}"
            raise SwingupError(f"centre and scale have shapes {shapes}, the base parameters {(BASE,)}")
        # Negated, so that a scale of NaN fails as well.
        if not np.all(self.scale >= MIN_SCALE):
            raise SwingupError(f"a scale of stage 'plant' is below {MIN_SCALE:g}")
        return before + BASE

    def inputs(self, base: Array) -> Array:
        """What is appended (9,) for base parameters θ (9,)."""
        with np.errstate(over="ignore"):
            return _within((base - self.centre) / self.scale, self.clip)

    def __call__(self, observation: Array, base: Array | None = None) -> Array:
        """The observation (n,), with the plant appended."""
        if base is None:
            raise SwingupError("the policy sees its plant: use swingup.get_controller")
        return observation.__array_namespace__().concatenate([observation, self.inputs(base)])


@dataclass(frozen=True)
class MagnifyStage:
    """The observation o of two links, then arsinh(k o) and arsinh(K x): logarithmic scales, linear near 0.

    o are the sines, then the cosines of both links' angles, then the joints' velocities; k has a factor for each. x
    are the joints' angles within ± π (rad) and their velocities. An observation may have leading axes.
    """

    PART: ClassVar[str] = "magnify stage"
    factors: Array
    combinations: Array

    def size(self, before: int) -> int:
        """Length of the result: twice that of the observation, and one for each row of K."""
        found = before, self.factors.shape, self.combinations.shape[1:]
        if found != (STATE + 2, (STATE + 2,), (STATE,)):
            shapes = f"{self.factors.shape} and {self.combinations.shape}, the observation {(before,)}"
            raise SwingupError(f"factors and combinations have shapes {shapes}: use (6,), (n, 4) and (6,)")
        return 2 * before + len(self.combinations)

    def __call__(self, observation: Array, base: Array | None = None) -> Array:
        """The observation, with what is magnified behind it."""
        xp = observation.__array_namespace__()
        factors, rows = (xp.asarray(each, dtype=observation.dtype) for each in (self.factors, self.combinations))
        s1, s2, c1, c2, *velocities = xp.moveaxis(observation, -1, 0)
        # The elbow's angle is the difference of the links'.
        joints = [xp.atan2(s1, c1), xp.atan2(s2 * c1 - c2 * s1, c2 * c1 + s2 * s1), *velocities]
        combined = xp.stack(joints, axis=-1) @ rows.T
        return xp.concatenate([observation, xp.asinh(factors * observation), xp.asinh(combined)], axis=-1)


Stage = PendulumStage | MagnifyStage | NormaliseStage | PlantStage

STAGES: dict[str, type[Stage]] = {
    "pendulum": PendulumStage, "magnify": MagnifyStage, "normalise": NormaliseStage, "plant": PlantStage,
}  # fmt: skip
"""Stages by their name in the file."""


def stages_for(stages: Sequence[Stage], made_for: Plant, plant: Plant) -> tuple[Stage, ...]:
    """The stages of a plant's policy for another plant, in that one's units.

    What a rotor's inertia moves grows with the square of its gear ratio.
    """
    scales, found = arm_scales(plant).over(arm_scales(made_for)), []
    rotor = np.append(np.ones(BASE - 1), (made_for.gr / plant.gr) ** 2)
    for stage in stages:
        own = scaled(stage, scales)
        if isinstance(own, PlantStage):
            factors = rotor.astype(own.centre.dtype)
            own = replace(own, centre=own.centre * factors, scale=own.scale * factors)
        found.append(own)
    return tuple(found)


def arrays_of(kind: type[Stage]) -> tuple[str, ...]:
    """Names of a stage's arrays: all that is not a setting."""
    return tuple(field.name for field in fields(kind) if field.name not in settings_of(kind))


def make_stage(entry: Any, arrays: Mapping[str, np.ndarray]) -> Stage:
    """A stage from its entry in the metadata and its arrays, by their names without the prefix."""
    name = one_of("observation stage", entry.get("name", entry) if isinstance(entry, Mapping) else [entry], STAGES)
    kind = STAGES[name]
    values = read_values({key: value for key, value in entry.items() if key != "name"}, kind.PART, kind)
    for key in arrays_of(kind):
        if key not in arrays:
            raise SwingupError(f"stage {name!r} lacks its array {key}")
        values[key] = arrays[key]
    return checked(kind(**values))


def checked(stage: Stage) -> Stage:
    """The stage with floats and NumPy's arrays, in double precision; errors name what cannot work."""
    if type(stage) not in STAGES.values():
        known = ", ".join(kind.__name__ for kind in STAGES.values())
        raise SwingupError(f"a policy file has no stage {type(stage).__name__}: use {known}")
    # Training keeps arrays of JAX in single precision; files, C and NumPy compute with these in double.
    values: dict[str, Any] = {name: np.asarray(getattr(stage, name), np.float64) for name in arrays_of(type(stage))}
    for name in settings_of(type(stage)):
        value = getattr(stage, name)
        values[name] = value.item() if hasattr(value, "item") else value
    stage = replace(stage, **values)
    return replace(stage, **in_range(stage))


def _within(values: Array, limit: float) -> Array:
    """Values within ± limit; NaN stays."""
    xp = values.__array_namespace__()
    return xp.minimum(xp.maximum(values, -limit), limit)


FLOAT32_SUM_WIDTH = 64
"""Inputs of a wide layer whose products are summed in single precision; the groups are summed in double."""
STATE = 4  # Length of a pendulum's state
MAX_FEATURE = 1e30
"""No layer may reach more, for any observation: single precision ends at 3e38, and ∞ times 0 is not a torque."""

Activation = Literal["relu", "tanh", "elu", "silu", "gelu"]
"""What follows a hidden layer; gelu is x (1 + tanh(√(2/π) (x + 0.044715 x³))) / 2, silu x / (1 + e^-x)."""
RELU: Activation = "relu"
Bounds = Literal["tanh", "clip"]  # What brings a continuous action into [-1, 1]
TANH: Bounds = "tanh"
LOG_STD_RANGE = (-20.0, 2.0)  # Range to which log σ is clamped (authors' code)
STD_OUTPUT_RANGE = (math.log(math.expm1(math.exp(-20.0))), math.log(math.expm1(math.exp(2.0))))
"""The same for the output of which σ is the softplus: finite where log σ is not."""


@dataclass(frozen=True)
class Layer:
    """y = weight x + bias, in float32; weight has the shape (outputs, inputs).

    The bias that :func:`fold` makes is float64, as the sums that it replaces.
    """

    weight: np.ndarray
    bias: np.ndarray


@dataclass(frozen=True)
class Network:
    """The observation stages, the hidden layers, and the heads."""

    stages: tuple[Stage, ...]
    trunk: tuple[Layer, ...]
    head: Layer  # Means of continuous actions before their bounds, or the logits of discrete ones
    std: Layer | None = None
    choices: tuple[int, ...] | None = None
    """Number of alternatives of each discrete action; None if actions are continuous."""
    activation: Activation = RELU
    bounds: Bounds = TANH

    def __post_init__(self) -> None:
        """Follow one observation through the stages and the layers."""
        # The dataclass is frozen for its users; here it is still being made.
        object.__setattr__(self, "stages", tuple(map(checked, self.stages)))
        shows_plant = [isinstance(stage, PlantStage) for stage in self.stages]
        # No stage after it: what it appends keeps the meaning that its centre and scale give it.
        if any(shows_plant) and (any(shows_plant[:-1]) or not isinstance(self.stages[0], PendulumStage)):
            raise SwingupError("observation stage 'plant' must be the last one, and 'pendulum' the first")
        size = self.input_size
        for stage in self.stages:
            size = stage.size(size)
        for layer in self.layers:
            size_out, size_in = layer.weight.shape
            if size != size_in:
                raise SwingupError(f"a layer of {size_in} inputs is fed {size} values")
            size = size_out
        if self.std is not None and self.std.weight.shape != self.head.weight.shape:
            shapes = f"{self.std.weight.shape}, network.mean {self.head.weight.shape}"
            raise SwingupError(f"network.std has shape {shapes}")
        if self.choices is not None and size != sum(self.choices):
            raise SwingupError(f"network.logits has {size} outputs, choices {self.choices} need their sum")
        # Negated, so that weights that are NaN fail as well.
        if not max_feature(self) < MAX_FEATURE:
            raise SwingupError(f"its weights are not finite, or a layer may reach {MAX_FEATURE:g}: train another")

    @property
    def plant_stage(self) -> PlantStage | None:
        """The stage that shows the plant; None for a policy that sees the state alone."""
        last = self.stages[-1] if self.stages else None
        return last if isinstance(last, PlantStage) else None

    @property
    def input_size(self) -> int:
        """Length of the observation before the first stage: a pendulum's state, or as the statistics have it."""
        first = self.stages[0] if self.stages else None
        if isinstance(first, PendulumStage):
            return STATE
        if isinstance(first, MagnifyStage):
            return int(first.factors.size)
        return int(first.mean.size if isinstance(first, NormaliseStage) else self.layers[0].weight.shape[1])

    @property
    def layers(self) -> tuple[Layer, ...]:
        """The layers of the deterministic policy."""
        return (*self.trunk, self.head)


def fold(network: Network, base: np.ndarray) -> Network:
    """The network of the state alone that gives the same actions for one plant, with base parameters θ (9,).

    The plant's inputs are constants then: the first layer's bias takes up what they add. Without an identifier, all
    back ends but JAX's run this network, and know nothing of the stage ``plant``. Other networks stay as they are.

    Raises:
        SwingupError: a base parameter is NaN.
    """
    stage = network.plant_stage
    if stage is None:
        return network
    inputs, stages = stage.inputs(base), network.stages[:-1]
    if network.trunk:
        first, *others = network.trunk
        return replace(network, stages=stages, trunk=(_absorb(first, inputs), *others))
    std = None if network.std is None else _absorb(network.std, inputs)
    return replace(network, stages=stages, head=_absorb(network.head, inputs), std=std)


def _absorb(layer: Layer, inputs: np.ndarray) -> Layer:
    """The layer without its last inputs, which are constant."""
    # In double precision, in which a policy that is told its plant adds the same.
    added = layer.weight[:, -BASE:].astype(np.float64) @ inputs
    return Layer(layer.weight[:, :-BASE], layer.bias + added)


def max_feature(network: Network) -> float:
    """A bound of what a layer gives, for observations of up to 1 or what a stage clips to."""
    clips = [stage.clip for stage in network.stages if isinstance(stage, NormaliseStage | PlantStage)]
    most = largest = max([1.0, *clips])
    heads = [network.head, *([] if network.std is None else [network.std])]
    with np.errstate(over="ignore"):
        for layer in network.trunk:
            most = _max_output(layer, most)
            # No activation gives more than it is given, or than 1.
            most = most if network.activation == RELU else max(most, 1.0)
            largest = max(largest, most)
        return max(largest, *(_max_output(head, most) for head in heads))


def _max_output(layer: Layer, max_input: float) -> float:
    """The maximum output for inputs of up to ``max_input``."""
    sums = np.abs(layer.weight).sum(axis=1, dtype=np.float64)
    return float(np.max(sums * max_input + np.abs(layer.bias), initial=0.0))
