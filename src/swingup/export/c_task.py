"""C data of any policy: its layers, its self-test, and a task's spaces; with the comment of a task's header."""

import re

import numpy as np

from ..common import __version__
from ..common.errors import SwingupError
from ..policy.network import Layer, Network, NormaliseStage
from ..policy.policy import TaskPolicy, require_plain
from ..policy.self_test import SelfTest, task_test
from .c_text import Data, Precision, constant_bytes

INT32 = 2**31 - 1  # The largest int of common C compilers

USAGE = """\
/*
 * A policy for {task}, written by swingup {version}.
 *
 * C99 or C++11, in {precision} precision, with <math.h>, <stdint.h> and <string.h>; no allocation, no global state,
 * no other library.
 *
 *     {number} observation[{inputs}];
 *     {action} action[{actions}];
 *     swingup_self_test();                            0, or the number of the observation that fails
 *     swingup_policy(observation, action);            {rate}
 *
 * An observation is {observation}, an action {described}, row by row.
 * swingup_policy returns 1, and leaves the action alone, where the observation is not finite.
{sizes} */
"""
SIZES = """\
 * Flash: {flash} bytes of constants, and {tests} more where swingup_self_test is called; then the code.
 * RAM: {ram}.
"""


def task_usage(policy: TaskPolicy, data: dict[str, Data], precision: Precision) -> str:
    """The comment at the start of a task's header."""
    discrete, widest = bool(policy.action_space.choices), data["the network"]["WIDEST"]
    assert isinstance(widest, int)
    number = "double" if precision == "double" else "float"
    return USAGE.format(
        # A name may be anything: no end of a comment may come from a file.
        task=plain(policy.task),
        version=__version__,
        precision=precision,
        number=number,
        action="int" if discrete else number,
        inputs=policy.observation_space.size,
        actions=policy.action_space.size,
        rate=f"every {policy.period:g} s" if policy.period else "at every step",
        observation=f"of shape {policy.observation_space.shape}",
        described=f"of shape {policy.action_space.shape}",
        sizes=sizes(
            data, precision, f"{2 * widest * (8 if precision == 'double' else 4)} bytes of stack in a call"
        ),
    )


def plain(name: str) -> str:
    """A name for a comment of C, which nothing in it can end."""
    return re.sub(r"[^\w. /-]", "_", name, flags=re.ASCII)[:60]


def sizes(data: dict[str, Data], precision: Precision, ram: str) -> str:
    """What a comment says of flash and RAM."""
    tests = constant_bytes(data["the self-test"], precision)
    flash = sum(constant_bytes(part, precision) for part in data.values()) - tests
    return SIZES.format(flash=flash, tests=tests, ram=ram)


def task_data(policy: TaskPolicy) -> dict[str, Data]:
    """All that the runtime needs, part by part."""
    require_plain(policy, "a header")
    space, network = policy.action_space, policy.network
    data: Data = {"ACTIONS": space.size, "DISCRETE": int(bool(space.choices))}
    if space.choices:
        choices, start = np.array(space.choices), np.ravel(space.low).astype(int)
        if (largest := max(-start.min(), (start + choices - 1).max())) > INT32:
            raise SwingupError(f"an action reaches {largest}, beyond C's 32 bits: export it to numpy or onnx")
        data |= {"choices": choices, "start": start}
    else:
        data |= {name: np.ravel(getattr(space, name)).astype(np.float64) for name in ("low", "high")}
    return {"the task": data, "the network": network_data(network), "the self-test": test_data(task_test(policy))}


def network_data(network: Network) -> Data:
    """The layers of any policy, and the normalisation before them."""
    layers: tuple[Layer, ...] = network.layers
    widths = [layers[0].weight.shape[1], *(len(layer.bias) for layer in layers)]
    shapes = [(index, *layer.weight.T.shape, int(index < len(layers) - 1)) for index, layer in enumerate(layers)]
    normalise = next((stage for stage in network.stages if isinstance(stage, NormaliseStage)), None)
    data: Data = {
        "INPUTS": widths[0],
        "WIDEST": max(widths),
        "ACTIVATION": f"SWINGUP_{network.activation.upper()}",
        "BOUNDS": f"SWINGUP_{network.bounds.upper()}",
        # Index, inputs, outputs, and whether the layer is hidden.
        "LAYERS(APPLY)": " ".join(f"APPLY{shape}" for shape in shapes),
        "NORMALISED": 0 if normalise is None else normalise.mean.size,
    }
    if normalise is not None:
        mean, deviation = normalise.mean, normalise.deviation
        data |= {"INPUT_CLIP": normalise.clip, "input_mean": mean, "input_deviation": deviation}
    for index, layer in enumerate(layers):
        data |= {f"weight_{index}": layer.weight.T, f"bias_{index}": layer.bias.astype(np.float64)}
    return data


def test_data(test: SelfTest) -> Data:
    """The observations and the answers of a self-test."""
    rows = len(test.observations)
    # Discrete actions are compared as numbers, too: they differ by 1 or more.
    tolerance = np.maximum(np.ravel(test.tolerance), 0.0 if test.tolerance.any() else 1e-3)
    return {
        "TESTS": rows,
        "TEST_CALLS": test.calls,
        "TEST_PERIOD": test.period,
        "test_observations": test.observations.reshape(rows, -1).astype(np.float64).ravel(),
        "test_actions": test.actions.reshape(rows, -1).astype(np.float64).ravel(),
        "tolerance": tolerance,
    }
