"""A policy for a page: the script that computes it, and the data that the script takes."""

import base64
from importlib import resources
from typing import Any

import numpy as np

from ..policy.network import Layer, NormaliseStage, PendulumStage, Stage
from ..policy.pendulum import PendulumPolicy


def policy_script() -> str:
    """JavaScript that defines ``swingup.makePolicy(data, driven)``, for a classic script element."""
    return (resources.files(__package__) / "policy.js").read_text(encoding="utf-8")


def policy_data(policy: PendulumPolicy) -> dict[str, Any]:
    """A policy's network alone, folded for its plant, as JSON values: its stages, and its layers up to the mean."""
    network = policy.folded
    return {
        "torque_limit": policy.torque_limit,
        "activation": network.activation,
        "bounds": network.bounds,
        "stages": [_stage(stage) for stage in network.stages],
        "layers": [{"weight": _base64(layer.weight), "bias": _bias(layer)} for layer in network.layers],
    }


def _stage(stage: Stage) -> dict[str, Any]:
    if isinstance(stage, PendulumStage):
        return {"name": "pendulum", "angles": stage.angles, "velocity_scale": stage.velocity_scale}
    assert isinstance(stage, NormaliseStage)  # the network is folded
    # In double precision, as the stages are applied.
    vectors = {"mean": stage.mean.tolist(), "variance": stage.variance.tolist()}
    return {"name": "normalise", **vectors, "clip": stage.clip, "epsilon": stage.epsilon}


def _bias(layer: Layer) -> str | list[float]:
    # That of a folded layer has more digits than single precision.
    return layer.bias.tolist() if layer.bias.dtype == np.float64 else _base64(layer.bias)


def _base64(array: np.ndarray) -> str:
    # The script reads the bytes as a Float32Array, which is little-endian on all common machines.
    return base64.b64encode(np.ascontiguousarray(array, "<f4").tobytes()).decode("ascii")
