"""A policy in NumPy: from a state to the torque of the driven joint, one call at a time.

The network's weights are the file's float32 numbers; its arithmetic is float64. The order of a sum then changes the
torque by 1e-14 N m. In float32 two libraries differ by up to 6e-5 N m on the shipped policies.
"""

import math
from collections.abc import Callable, Sequence

import numpy as np

from ...plant.base_parameters import BASE
from ...plant.maths import TURN
from ..network import NORM_EPSILON, Activation, Network, Norm
from ..pendulum import PendulumPolicy
from ..stages import NormaliseStage, PendulumStage, Stage

Observe = Callable[[np.ndarray], np.ndarray]
Activate = Callable[[np.ndarray], np.ndarray]


class NumpyNetwork:
    """The deterministic policy: x = [q1, q2, dq1, dq2] (rad, rad/s) to the torque of the driven joint (N m).

    A call works in buffers of its own: use one object in one thread.
    """

    def __init__(self, policy: PendulumPolicy) -> None:
        """Take the arrays of a policy."""
        network = policy.folded
        self._stages = [_observer(stage) for stage in network.stages]
        self._layers = [
            (layer.weight.astype(np.float64), layer.bias.astype(np.float64), np.empty(layer.bias.shape))
            for layer in network.trunk
        ]
        self._activate = [_after(network.activation, norm) for norm in _norms(network)]
        self._head = network.head.weight[0].astype(np.float64)
        self._offset = float(network.head.bias[0])
        self._torque_limit = policy.torque_limit
        self._sight = Sight(policy.network) if policy.network.plant_stage is not None else None

    def tell(self, base: Sequence[float]) -> None:
        """Show the policy a plant with base parameters θ (9,) from now on, if it sees its plant.

        Before, it runs for the plant of its file.
        """
        if self._sight is None:
            return
        bias = self._sight.bias(base)
        if self._layers:
            self._layers[0][1][:] = bias
        else:
            self._offset = float(bias[0])

    def __call__(self, x: np.ndarray) -> float:
        """The torque (N m) for a state of shape (4,); NaN where that is not finite."""
        features = np.asarray(x, np.float64)
        for observe in self._stages:
            features = observe(features)
        for (weight, bias, result), activate in zip(self._layers, self._activate, strict=True):
            np.dot(weight, features, out=result)
            np.add(result, bias, out=result)
            features = activate(result)
        return self._torque_limit * math.tanh(float(np.dot(self._head, features)) + self._offset)


class Sight:
    """What the first layer makes of the plant: its bias, as in ``policy/fold.py``, for one plant after another."""

    def __init__(self, network: Network) -> None:
        """Take the stage and the layer of a network that sees its plant."""
        stage, first = network.plant_stage, network.layers[0]
        assert stage is not None  # the caller has looked
        self._centre, self._scale, self._clip = stage.centre.tolist(), stage.scale.tolist(), stage.clip
        self._weight, self._bias = first.weight[:, -BASE:].astype(np.float64), first.bias.astype(np.float64)

    def bias(self, base: Sequence[float]) -> np.ndarray:
        """The bias (outputs,) for base parameters θ (9,)."""
        clip, seen = self._clip, zip(base, self._centre, self._scale, strict=True)
        # For nine numbers Python's floats are faster than NumPy's arrays.
        inputs = [max(-clip, min(clip, (value - centre) / scale)) for value, centre, scale in seen]
        return self._bias + self._weight @ np.array(inputs)


def _norms(network: Network) -> list[Norm | None]:
    """The normalisation of each hidden layer."""
    return list(network.norms) or [None] * len(network.trunk)


def _after(name: Activation, norm: Norm | None) -> Activate:
    """What follows the linear map of a hidden layer."""
    activate = ACTIVATIONS[name]
    if norm is None:
        return activate
    scale, shift = norm.weight.astype(np.float64), norm.bias.astype(np.float64)

    def normalised(x: np.ndarray) -> np.ndarray:
        centred = x - x.mean()
        return activate(scale * (centred / np.sqrt((centred**2).mean() + NORM_EPSILON)) + shift)

    return normalised


def _relu(x: np.ndarray) -> np.ndarray:
    return np.maximum(x, 0.0, out=x)


def _elu(x: np.ndarray) -> np.ndarray:
    # Clipped, since both branches are computed: of large x the exponential has no number.
    return np.where(x > 0.0, x, np.expm1(np.minimum(x, 0.0)))


def _silu(x: np.ndarray) -> np.ndarray:
    # The logistic function by tanh, which never overflows.
    return 0.5 * x * (1.0 + np.tanh(0.5 * x))


def _gelu(x: np.ndarray) -> np.ndarray:
    return 0.5 * x * (1.0 + np.tanh(math.sqrt(2.0 / math.pi) * (x + 0.044715 * x**3)))


ACTIVATIONS: dict[Activation, Activate] = {
    "relu": _relu,
    "tanh": np.tanh,
    "elu": _elu,
    "silu": _silu,
    "gelu": _gelu,
}


def _observer(stage: Stage) -> Observe:
    """The function of a stage."""
    if isinstance(stage, PendulumStage):
        return _pendulum(stage)
    assert isinstance(stage, NormaliseStage)  # the network is folded
    return _normalise(stage)


def _pendulum(stage: PendulumStage) -> Observe:
    scale, wrapped = stage.velocity_scale, stage.angles == "wrapped"

    def observe(x: np.ndarray) -> np.ndarray:
        # For four numbers Python's floats are faster than NumPy's arrays.
        q1, q2, dq1, dq2 = x.tolist()
        # Clipping would hide a velocity that is not finite.
        if not math.isfinite(q1 + q2 + dq1 + dq2):
            return np.full(4 if wrapped else 6, np.nan)
        v1, v2 = max(-scale, min(scale, dq1)) / scale, max(-scale, min(scale, dq2)) / scale
        if wrapped:
            return np.array([(q1 % TURN - math.pi) / math.pi, (q2 % TURN - math.pi) / math.pi, v1, v2])
        return np.array([math.sin(q1), math.cos(q1), math.sin(q2), math.cos(q2), v1, v2])

    return observe


def _normalise(stage: NormaliseStage) -> Observe:
    mean, deviation, clip = stage.mean, stage.deviation, stage.clip

    def observe(observation: np.ndarray) -> np.ndarray:
        scaled = observation - mean
        scaled /= deviation
        np.minimum(scaled, clip, out=scaled)
        return np.maximum(scaled, -clip, out=scaled)

    return observe
