"""A policy as an ONNX graph: observations in, actions out; of a pendulum, states in, torques out.

A pendulum's states are float64, and so is every graph up to the network: in float32 an angle after many turns, or
near a wrap, is another angle. The hidden layers compute in float32, in groups of inputs whose products are summed
one group after the other: one long float32 sum differs from the judge's by up to 6e-5 N m on the shipped policies,
and a whole float64 network takes ONNX Runtime twice as long. The last layer, of a few rows, is float64 again.
"""

import math
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np

from ..common import __version__
from ..common.errors import needing
from ..policy.network import FLOAT32_SUM_WIDTH, TANH, Activation, Layer, Network, NormaliseStage, PendulumStage
from ..policy.pendulum import PendulumPolicy
from ..policy.policy import TaskPolicy, require_plain
from ..policy.self_test import loop_test, task_test
from ..policy.spaces import Space

OPSET = 17
IR_VERSION = 8  # What every ONNX Runtime since 1.12 reads


def onnx_model(policy: TaskPolicy | PendulumPolicy) -> bytes:
    """The model: a batch of observations in, actions of the environment out, in the spaces' types and shapes.

    A pendulum's has the input ``state`` (batch, 4) in rad and rad/s and the output ``torque`` (batch, 2) in N m,
    both float64. It is the network alone, folded for the policy's plant: estimator, identifier, regulator and guard
    would need a memory. The metadata's entry ``self_test`` is an object of observations and their actions.
    """
    with needing("the package onnx", "onnx", "an ONNX graph"):
        import onnx
    require_plain(policy, "an ONNX graph")
    graph, seen = _Graph(onnx.helper, onnx.numpy_helper), policy.observation_space
    given = _Value("state" if isinstance(policy, PendulumPolicy) else "observation", seen.shape, seen.dtype)
    flat = given.name if len(seen.shape) == 1 else graph.add("Flatten", given.name, axis=1)
    observed = graph.cast(flat, "float64")
    if isinstance(policy, PendulumPolicy):
        observed = graph.add("Sub", observed, graph.constant(np.array([*policy.plant.zeros, 0.0, 0.0])))
    outputs = _outputs(graph, policy.folded, observed)
    if isinstance(policy, PendulumPolicy):
        driven = graph.add("Mul", outputs, graph.constant(policy.torque_limit))
        # The passive joint's torque is a zero before or behind the driven one's.
        before, behind = policy.robot.joint, 1 - policy.robot.joint
        graph.add("Pad", driven, graph.constant(np.array([0, before, 0, behind])), outputs=["torque"])
        result, about = (
            _Value("torque", (2,), "float64"),
            f"policy of the {policy.robot.name}, N m for rad and rad/s",
        )
        test = loop_test(replace(policy, estimator=None, identifier=None, regulator=None, guard=None))
    else:
        space = policy.action_space
        _act(graph, space, outputs)
        result, about = _Value("action", space.shape, space.dtype), f"policy of {policy.task}"
        test = task_test(policy)
    model = graph.finish(given, result, about, {"self_test": test.to_json()})
    onnx.checker.check_model(model)
    return bytes(model.SerializeToString())


def _outputs(graph: "_Graph", network: Network, observation: str) -> str:
    """Actions in [-1, 1], or logits, of observations in double precision; in double precision, too."""
    features = observation
    for stage in network.stages:
        observe: Any = _pendulum if isinstance(stage, PendulumStage) else _normalise
        features = observe(graph, stage, features)
    features = graph.cast(features, "float32")
    for layer in network.trunk:
        features = _activated(graph, network.activation, _hidden(graph, layer, features))
    # A few rows in double precision cost little, and the actions keep their digits.
    head = network.head
    weight, bias = head.weight.astype(np.float64), graph.constant(head.bias.astype(np.float64))
    outputs = graph.gemm(graph.cast(features, "float64"), weight, bias)
    if network.choices is not None:
        return outputs
    bounded = graph.add("Tanh", outputs) if network.bounds == TANH else graph.clip(outputs, 1.0)
    # Zero times what is not finite is NaN: what is clipped must not hide it.
    unsound = graph.add("MatMul", observation, graph.constant(np.zeros((network.input_size, 1))))
    return graph.add("Add", bounded, unsound)


def _act(graph: "_Graph", space: Space, outputs: str) -> None:
    """Actions of the environment: choices from the first, or numbers in [-1, 1] scaled to the bounds."""
    if space.choices:
        best = [graph.add("ArgMax", each, axis=1) for each in graph.split(outputs, list(space.choices))]
        flat = graph.add("Add", graph.add("Concat", *best, axis=1), graph.constant(np.ravel(space.low)))
    else:
        low, high = (np.ravel(bound).astype(np.float64) for bound in (space.low, space.high))
        share = graph.add("Add", outputs, graph.constant(1.0))
        scaled = graph.add("Add", graph.add("Mul", share, graph.constant(0.5 * (high - low))), graph.constant(low))
        # Rounding may carry it beyond a bound.
        flat = graph.add("Min", graph.add("Max", scaled, graph.constant(low)), graph.constant(high))
    # The first axis, which stays, is the batch's.
    kind, size = ("Reshape", [0, *space.shape]) if space.shape else ("Squeeze", [1])
    graph.cast(graph.add(kind, flat, graph.constant(np.array(size))), space.dtype, ["action"])


def _activated(graph: "_Graph", activation: Activation, x: str) -> str:
    """What follows a hidden layer, in its precision."""
    if activation == "silu":
        return graph.add("Mul", x, graph.add("Sigmoid", x))
    if activation == "gelu":
        cubic, root, half, one = (
            graph.constant(np.array(each, np.float32)) for each in (0.044715, math.sqrt(2 / math.pi), 0.5, 1.0)
        )
        cube = graph.add("Mul", cubic, graph.add("Mul", x, graph.add("Mul", x, x)))
        share = graph.add("Tanh", graph.add("Mul", root, graph.add("Add", x, cube)))
        return graph.add("Mul", graph.add("Mul", half, x), graph.add("Add", share, one))
    return graph.add({"relu": "Relu", "tanh": "Tanh", "elu": "Elu"}[activation], x)


def _pendulum(graph: "_Graph", stage: PendulumStage, state: str) -> str:
    scale = stage.velocity_scale
    angles, rates = graph.split(state, [2, 2])
    velocities = graph.add("Div", graph.clip(rates, scale), graph.constant(scale))
    if stage.angles == "wrapped":
        # ONNX's Mod of floats has the dividend's sign: the non-negative remainder is written out.
        turns = graph.add("Floor", graph.add("Div", angles, graph.constant(2 * math.pi)))
        wrapped = graph.add("Sub", angles, graph.add("Mul", turns, graph.constant(2 * math.pi)))
        centred = graph.add("Sub", wrapped, graph.constant(math.pi))
        return graph.add("Concat", graph.add("Div", centred, graph.constant(math.pi)), velocities, axis=1)
    mixed = graph.add("Concat", graph.add("Sin", angles), graph.add("Cos", angles), velocities, axis=1)
    order = graph.constant(np.array([0, 2, 1, 3, 4, 5]))  # sine and cosine of q1, then those of q2
    return graph.add("Gather", mixed, order, axis=1)


def _normalise(graph: "_Graph", stage: NormaliseStage, observation: str) -> str:
    centred = graph.add("Sub", observation, graph.constant(stage.mean))
    return graph.clip(graph.add("Div", centred, graph.constant(stage.deviation)), stage.clip)


def _hidden(graph: "_Graph", layer: Layer, features: str) -> str:
    """W · features + bias, group by group of the inputs."""
    inputs = layer.weight.shape[1]
    starts = range(0, inputs, FLOAT32_SUM_WIDTH)
    groups = graph.split(features, [min(FLOAT32_SUM_WIDTH, inputs - start) for start in starts])
    total = graph.constant(layer.bias.astype(np.float32))
    for start, group in zip(starts, groups, strict=True):
        total = graph.gemm(group, layer.weight[:, start : start + FLOAT32_SUM_WIDTH], total)
    return total


class _Value(NamedTuple):
    """An input or an output."""

    name: str
    shape: tuple[int, ...]  # Behind the batch's axis
    dtype: str


class _Graph:
    """Nodes and constants, in the order in which they are added."""

    def __init__(self, helper: Any, numpy_helper: Any) -> None:
        self._helper, self._numpy_helper = helper, numpy_helper
        self._nodes: list[Any] = []
        self._constants: list[Any] = []

    def add(self, kind: str, *inputs: str, outputs: list[str] | None = None, **attributes: Any) -> str:
        """A node; the name of its first output."""
        names = outputs or [f"{kind.lower()}_{len(self._nodes)}"]
        self._nodes.append(self._helper.make_node(kind, list(inputs), names, **attributes))
        return names[0]

    def constant(self, values: np.ndarray | float) -> str:
        name = f"constant_{len(self._constants)}"
        self._constants.append(self._numpy_helper.from_array(np.array(values, order="C"), name))
        return name

    def clip(self, values: str, limit: float) -> str:
        return self.add("Clip", values, self.constant(-limit), self.constant(limit))

    def cast(self, values: str, dtype: str, outputs: list[str] | None = None) -> str:
        return self.add("Cast", values, outputs=outputs, to=self._kind(dtype))

    def _kind(self, dtype: str) -> int:
        return int(self._helper.np_dtype_to_tensor_dtype(np.dtype(dtype)))

    def gemm(self, features: str, weight: np.ndarray, added: str) -> str:
        return self.add("Gemm", features, self.constant(weight.T), added)

    def split(self, values: str, sizes: list[int]) -> list[str]:
        """Parts of the last axis; a single part is the whole."""
        if len(sizes) == 1:
            return [values]
        names = [f"part_{len(self._nodes)}_{index}" for index in range(len(sizes))]
        self.add("Split", values, self.constant(np.array(sizes)), outputs=names, axis=1)
        return names

    def finish(self, given: _Value, result: _Value, about: str, metadata: dict[str, str]) -> Any:
        """The model, whose input and output have a name, a shape behind the batch's axis and a type."""
        inputs, outputs = (
            [self._helper.make_tensor_value_info(each.name, self._kind(each.dtype), ["batch", *each.shape])]
            for each in (given, result)
        )
        graph = self._helper.make_graph(self._nodes, "policy", inputs, outputs, self._constants, about)
        model = self._helper.make_model(
            graph,
            opset_imports=[self._helper.make_opsetid("", OPSET)],
            ir_version=IR_VERSION,
            producer_name="swingup",
            producer_version=__version__,
        )
        self._helper.set_model_props(model, metadata)
        return model
