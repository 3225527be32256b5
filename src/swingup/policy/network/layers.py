"""A policy's stages and layers as arrays, checked: what all back ends compute with."""

from dataclasses import dataclass
from typing import Literal

import numpy as np

from ...common.errors import SwingupError
from .stages import NormaliseStage, PendulumStage, PlantStage, Stage

SUM_GROUP = 64
"""Inputs of a wide layer whose products are summed in single precision; the groups are summed in double."""
STATE = 4
"""Length of a pendulum's state."""
LARGEST_FEATURE = 1e30
"""No layer may reach more, for any observation: single precision ends at 3e38, and ∞ times 0 is no torque."""

Activation = Literal["relu", "tanh", "elu", "silu", "gelu"]
"""What follows a hidden layer; gelu is x (1 + tanh(√(2/π) (x + 0.044715 x³))) / 2, silu x / (1 + e^-x)."""
RELU: Activation = "relu"


@dataclass(frozen=True)
class Norm:
    """y = weight (x - mean) / sqrt(variance + 1e-5) + bias, moments over the features; both vectors are float32."""

    weight: np.ndarray
    bias: np.ndarray


@dataclass(frozen=True)
class Layer:
    """y = weight x + bias, in float32; weight has the shape (outputs, inputs).

    The bias that ``fold.py`` makes is float64, as the sums that it replaces.
    """

    weight: np.ndarray
    bias: np.ndarray


@dataclass(frozen=True)
class Recurrence:
    """A GRU after the hidden layers; both layers have three rows for each number that is remembered.

    h ← (1 - z) n + z h with r, z = σ(...), n = tanh(W_n x + b_n + r (U_n h + c_n)); r, z and n one above the other.
    """

    inputs: Layer
    hidden: Layer

    @property
    def width(self) -> int:
        """Numbers that are remembered."""
        return int(self.hidden.weight.shape[1])

    def size(self, inputs: int) -> int:
        """The output's size."""
        wanted = (3 * self.width, inputs), (3 * self.width, self.width)
        if (self.inputs.weight.shape, self.hidden.weight.shape) != wanted:
            shapes = f"{self.inputs.weight.shape} and {self.hidden.weight.shape}"
            raise SwingupError(f"a GRU of {self.width} after {inputs} values has weights {shapes}")
        return self.width


@dataclass(frozen=True)
class Network:
    """The observation stages, the hidden layers, and the heads."""

    stages: tuple[Stage, ...]
    trunk: tuple[Layer, ...]
    head: Layer
    """Means of continuous actions before tanh, or the logits of discrete ones."""
    std: Layer | None = None
    choices: tuple[int, ...] | None = None
    """Number of alternatives of each discrete action; None if actions are continuous."""
    activation: Activation = RELU
    """After each hidden layer."""
    norms: tuple[Norm, ...] = ()
    """Before each activation, or nowhere."""
    gru: Recurrence | None = None
    """After the hidden layers, if the policy has a memory."""

    def __post_init__(self) -> None:
        """Follow one observation through the stages and the layers."""
        _check_order(self.stages)
        size = _input_size(self)
        for stage in self.stages:
            size = stage.size(size)
        for layer in self.layers:
            if layer is self.head and self.gru is not None:
                size = self.gru.size(size)
            size_out, size_in = layer.weight.shape
            if size != size_in:
                raise SwingupError(f"a layer of {size_in} inputs is fed {size} values")
            size = size_out
        self._check_norms()
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

    def _check_norms(self) -> None:
        if self.norms and len(self.norms) != len(self.trunk):
            raise SwingupError(f"{len(self.norms)} norms and {len(self.trunk)} hidden layers: one each is needed")
        for norm, layer in zip(self.norms, self.trunk, strict=False):
            if not norm.weight.shape == norm.bias.shape == layer.bias.shape:
                shapes = f"{norm.weight.shape} and {norm.bias.shape}"
                raise SwingupError(f"a norm has shapes {shapes}, its layer {layer.bias.shape}")

    @property
    def plant_stage(self) -> PlantStage | None:
        """The stage that shows the plant; None for a policy that sees the state alone."""
        last = self.stages[-1] if self.stages else None
        return last if isinstance(last, PlantStage) else None

    @property
    def layers(self) -> tuple[Layer, ...]:
        """The layers of the deterministic policy."""
        return (*self.trunk, self.head)


def largest_feature(network: Network) -> float:
    """A bound of what a layer gives, for observations of up to 1 or what a stage clips to."""
    clips = [stage.clip for stage in network.stages if not isinstance(stage, PendulumStage)]
    most = largest = max([1.0, *clips])
    heads = [network.head, *([] if network.std is None else [network.std])]
    with np.errstate(over="ignore"):
        for index, layer in enumerate(network.trunk):
            most = _reach(layer, most)
            largest = max(largest, most)
            most = _reach_of_norm(network.norms[index]) if network.norms else most
            # No activation gives more than it is given, or than 1.
            most = most if network.activation == RELU else max(most, 1.0)
            largest = max(largest, most)
        if network.gru is not None:
            # What is remembered lies between -1 and 1.
            largest, most = max(largest, _reach(network.gru.inputs, most), _reach(network.gru.hidden, 1.0)), 1.0
        return max(largest, *(_reach(head, most) for head in heads))


def _reach(layer: Layer, most: float) -> float:
    """The largest output for inputs of up to ``most``."""
    sums = np.abs(layer.weight).sum(axis=1, dtype=np.float64)
    return float(np.max(sums * most + np.abs(layer.bias), initial=0.0))


def _check_order(stages: tuple[Stage, ...]) -> None:
    shows_plant = [isinstance(stage, PlantStage) for stage in stages]
    # No stage after it: what it appends keeps the meaning that its centre and scale give it.
    if any(shows_plant) and (any(shows_plant[:-1]) or not isinstance(stages[0], PendulumStage)):
        raise SwingupError("observation stage 'plant' must be the last one, and 'pendulum' the first")


def _reach_of_norm(norm: Norm) -> float:
    """The largest output: a normalised feature is at most the root of their number."""
    most = np.abs(norm.weight).astype(np.float64) * np.sqrt(norm.weight.size) + np.abs(norm.bias)
    return float(np.max(most, initial=0.0))


def check_plain(network: Network, program: str) -> None:
    """Refuse hidden layers that a program does not run.

    Args:
        network: the policy's.
        program: what runs ReLU alone, as the start of a sentence.
    """
    if network.activation == RELU and not network.norms:
        return
    found = [] if network.activation == RELU else [f"activation = {network.activation!r}"]
    found += ["layer_norm"] if network.norms else []
    raise SwingupError(
        f"{program} runs hidden layers of ReLU, not {' with '.join(found)}: run the policy in Python, as an export "
        f"to realaigym does, or train with activation = 'relu' and without layer_norm"
    )


def _input_size(network: Network) -> int:
    """Length of the observation before the first stage: a pendulum's state, or as many as the statistics are of."""
    first = network.stages[0] if network.stages else None
    if isinstance(first, PendulumStage):
        return STATE
    if isinstance(first, NormaliseStage):
        return int(first.mean.size)
    return int(network.layers[0].weight.shape[1])
