"""A policy's stages and layers as arrays, checked: what all back ends compute with."""

from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from ...common.errors import SwingupError
from ...plant.base_parameters import BASE
from .stages import NormaliseStage, PendulumStage, PlantStage, Stage, checked

FLOAT32_SUM_WIDTH = 64
"""Inputs of a wide layer whose products are summed in single precision; the groups are summed in double."""
STATE = 4
"""Length of a pendulum's state."""
LARGEST_FEATURE = 1e30
"""No layer may reach more, for any observation: single precision ends at 3e38, and ∞ times 0 is not a torque."""

Activation = Literal["relu", "tanh", "elu", "silu", "gelu"]
"""What follows a hidden layer; gelu is x (1 + tanh(√(2/π) (x + 0.044715 x³))) / 2, silu x / (1 + e^-x)."""
RELU: Activation = "relu"
Bounds = Literal["tanh", "clip"]
"""What brings a continuous action into [-1, 1]."""
TANH: Bounds = "tanh"


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
    head: Layer
    """Means of continuous actions before their bounds, or the logits of discrete ones."""
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
        size = _input_size(self)
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
        if not largest_feature(self) < LARGEST_FEATURE:
            raise SwingupError(
                f"its weights are not finite, or a layer may reach {LARGEST_FEATURE:g}: train another"
            )

    @property
    def plant_stage(self) -> PlantStage | None:
        """The stage that shows the plant; None for a policy that sees the state alone."""
        last = self.stages[-1] if self.stages else None
        return last if isinstance(last, PlantStage) else None

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


def largest_feature(network: Network) -> float:
    """A bound of what a layer gives, for observations of up to 1 or what a stage clips to."""
    clips = [stage.clip for stage in network.stages if not isinstance(stage, PendulumStage)]
    most = largest = max([1.0, *clips])
    heads = [network.head, *([] if network.std is None else [network.std])]
    with np.errstate(over="ignore"):
        for layer in network.trunk:
            most = _reach(layer, most)
            # No activation gives more than it is given, or than 1.
            most = most if network.activation == RELU else max(most, 1.0)
            largest = max(largest, most)
        return max(largest, *(_reach(head, most) for head in heads))


def _reach(layer: Layer, most: float) -> float:
    """The largest output for inputs of up to ``most``."""
    sums = np.abs(layer.weight).sum(axis=1, dtype=np.float64)
    return float(np.max(sums * most + np.abs(layer.bias), initial=0.0))


def require_portable(network: Network, program: str) -> None:
    """Refuse a network that a program, whose name starts the sentence, does not run: all run ReLU and tanh."""
    if network.activation != RELU:
        raise SwingupError(
            f"{program} runs hidden layers of ReLU, not activation = {network.activation!r}: run the policy in "
            f"Python, as an export to realaigym does, or train with activation = 'relu'"
        )
    if network.bounds != TANH:
        raise SwingupError(
            f"{program} bounds actions by tanh, not by {network.bounds!r}: run the policy in Python, as an export "
            f"to realaigym does, or train with deviation = 'state'"
        )


def _input_size(network: Network) -> int:
    """Length of the observation before the first stage: a pendulum's state, or as many as the statistics are of."""
    first = network.stages[0] if network.stages else None
    if isinstance(first, PendulumStage):
        return STATE
    if isinstance(first, NormaliseStage):
        return int(first.mean.size)
    return int(network.layers[0].weight.shape[1])
