"""A policy in NumPy: from a state to the torque of the driven joint, one call at a time.

The network's weights are the file's float32 numbers; its arithmetic is float64. The order of a sum then changes the
torque by 1e-14 N m. In float32 two libraries differ by up to 6e-5 N m on the shipped policies.
"""

import math
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from ...plant.base_parameters import BASE
from ..network.layers import Activation, Bounds
from ..pendulum import PendulumPolicy

Activate = Callable[[np.ndarray], np.ndarray]


class NumpyNetwork:
    """The deterministic policy: x = [q1, q2, dq1, dq2] (rad, rad/s) to the torque of the driven joint (N m).

    A call works in buffers of its own: use one object in one thread.
    """

    def __init__(self, policy: PendulumPolicy) -> None:
        """Take the arrays of a policy; one that sees its plant runs for its file's until it is told another."""
        network = policy.folded
        self._stages: list[Any] = list(network.stages)
        self._torque_limit = policy.torque_limit
        self._layers = [
            (layer.weight.astype(np.float64), layer.bias.astype(np.float64), np.empty(layer.bias.shape))
            for layer in network.trunk
        ]
        self._activate, self._bound = ACTIVATIONS[network.activation], BOUNDS[network.bounds]
        self._head, self._offset = network.head.weight[0].astype(np.float64), network.head.bias.astype(np.float64)
        # The biases of the first layer, which take up what the plant adds (``network/layers.py: fold``).
        self._plant_bias = self._layers[0][1] if self._layers else self._offset
        self._plant_stage, first = policy.network.plant_stage, policy.network.layers[0]
        self._weight, self._bias = first.weight[:, -BASE:].astype(np.float64), first.bias.astype(np.float64)

    def set_plant(self, base: Sequence[float] | np.ndarray) -> None:
        """Show the policy a plant with base parameters θ (9,) from now on, if it sees its plant."""
        if self._plant_stage is not None:
            self._plant_bias[:] = self._bias + self._weight.dot(self._plant_stage.inputs(np.asarray(base)))

    def __call__(self, x: np.ndarray) -> float:
        """The torque (N m) for a state of shape (4,); NaN where that is not finite."""
        # The clips of the observation would hide it.
        if not all(map(math.isfinite, x.tolist())):
            return math.nan
        features = np.asarray(x, np.float64)
        for stage in self._stages:
            features = stage(features)
        for weight, bias, result in self._layers:
            np.dot(weight, features, out=result)
            np.add(result, bias, out=result)
            features = self._activate(result)
        return self._torque_limit * self._bound(float(np.dot(self._head, features) + self._offset[0]))


def _elu(x: np.ndarray) -> np.ndarray:
    # Clipped, since both branches are computed: of large x the exponential has no number.
    return np.where(x > 0.0, x, np.expm1(np.minimum(x, 0.0)))


def _silu(x: np.ndarray) -> np.ndarray:
    # The logistic function by tanh, which never overflows.
    return 0.5 * x * (1.0 + np.tanh(0.5 * x))


def _gelu(x: np.ndarray) -> np.ndarray:
    return 0.5 * x * (1.0 + np.tanh(math.sqrt(2.0 / math.pi) * (x + 0.044715 * x**3)))


ACTIVATIONS: dict[Activation, Activate] = {
    "relu": lambda x: np.maximum(x, 0.0, out=x),
    "tanh": np.tanh,
    "elu": _elu,
    "silu": _silu,
    "gelu": _gelu,
}
BOUNDS: dict[Bounds, Callable[[float], float]] = {"tanh": math.tanh, "clip": lambda z: max(-1.0, min(1.0, z))}
