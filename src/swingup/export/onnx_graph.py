"""A policy as an ONNX graph: states in, torques out.

States are float64, and so is the graph up to the observation: in float32 an angle after many turns, or near a wrap,
is another angle. The hidden layers compute in float32, in groups of inputs whose products are summed one group
after the other: one long float32 sum differs from the judge's by up to 6e-5 N m on the shipped policies, and a
whole float64 network takes ONNX Runtime twice as long. The last layer, a single row, is float64 again.
"""

import math
from typing import Any

import numpy as np

from ..common import __version__
from ..common.errors import needing
from ..policy.network import FLOAT32_SUM_WIDTH, STATE, Layer, NormaliseStage, PendulumStage, require_portable
from ..policy.pendulum import PendulumPolicy

OPSET = 17
IR_VERSION = 8  # What every ONNX Runtime since 1.12 reads


def onnx_model(policy: PendulumPolicy) -> bytes:
    """The model: input ``state`` (batch, 4) in rad and rad/s, output ``torque`` (batch, 2) in N m, both float64.

    It is the network alone, folded for the policy's plant: estimator, identifier, regulator and guard would need a
    memory.
    """
    require_portable(policy.network, "an ONNX graph")
    with needing("the package onnx", "onnx", "an ONNX graph"):
        import onnx
    graph = _Graph(onnx.helper, onnx.numpy_helper)
    network, features = policy.folded, "state"
    for stage in network.stages:
        observe: Any = _pendulum if isinstance(stage, PendulumStage) else _normalise
        features = observe(graph, stage, features)
    features = graph.cast(features, onnx.TensorProto.FLOAT)
    for layer in network.trunk:
        features = graph.add("Relu", _hidden(graph, layer, features))
    # A single row in double precision costs little, and the torque keeps its digits.
    head, features = network.head, graph.cast(features, onnx.TensorProto.DOUBLE)
    action = graph.add(
        "Tanh", graph.gemm(features, head.weight.astype(float), graph.constant(head.bias.astype(float)))
    )
    # Zero times what is not finite is NaN: what is clipped must not hide it.
    unsound = graph.add("MatMul", "state", graph.constant(np.zeros((STATE, 1))))
    driven = graph.add("Add", graph.add("Mul", action, graph.constant(policy.torque_limit)), unsound)
    # The passive joint's torque is a zero before or behind the driven one's.
    before, behind = policy.robot.joint, 1 - policy.robot.joint
    graph.add("Pad", driven, graph.constant(np.array([0, before, 0, behind])), outputs=["torque"])
    model = graph.finish(onnx.TensorProto.DOUBLE, f"policy of the {policy.robot.name}, N m for rad and rad/s")
    onnx.checker.check_model(model)
    return bytes(model.SerializeToString())


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

    def cast(self, values: str, kind: int) -> str:
        return self.add("Cast", values, to=kind)

    def gemm(self, features: str, weight: np.ndarray, added: str) -> str:
        return self.add("Gemm", features, self.constant(weight.T), added)

    def split(self, values: str, sizes: list[int]) -> list[str]:
        """Parts of the last axis; a single part is the whole."""
        if len(sizes) == 1:
            return [values]
        names = [f"part_{len(self._nodes)}_{index}" for index in range(len(sizes))]
        self.add("Split", values, self.constant(np.array(sizes)), outputs=names, axis=1)
        return names

    def finish(self, kind: int, about: str) -> Any:
        """The model."""
        make = self._helper.make_tensor_value_info
        states, torques = make("state", kind, ["batch", STATE]), make("torque", kind, ["batch", 2])
        graph = self._helper.make_graph(self._nodes, "policy", [states], [torques], self._constants, about)
        return self._helper.make_model(
            graph,
            opset_imports=[self._helper.make_opsetid("", OPSET)],
            ir_version=IR_VERSION,
            producer_name="swingup",
            producer_version=__version__,
        )
