"""The back ends of the conformance table: a new one is one more row in BACK_ENDS."""

import functools
import json
import shutil
from collections.abc import Callable
from typing import NamedTuple

import numpy as np
import pytest

from swingup.controllers.stack.policy import make_controller, policy_alone
from swingup.export.c_header import c_header
from swingup.export.folder import export_folder
from swingup.export.javascript import policy_data
from swingup.export.onnx_graph import onnx_model
from swingup.policy.numpy_backend import numpy_controller
from swingup.policy.self_test import load_tested_policy

from . import compiled
from .references import TOLERANCE, alone, replay


class Jax:
    """The judge's: its wide layers sum 64 products in single precision each."""

    def __init__(self, policy, folder):
        self._whole, self._alone = make_controller(policy), policy_alone(policy)

    def alone(self, states):
        return alone(self._alone, states)

    def run(self, times, states, given=None):
        return replay(self._whole, times, states, given)


class Numpy:
    def __init__(self, policy, folder):
        self.controller = numpy_controller(policy)
        self._alone = self.controller.inner._network

    def alone(self, states):
        return np.array([self._alone(x) for x in states])

    def run(self, times, states, given=None):
        self.controller.reset()
        inner, joint, torques = self.controller.inner, self.controller.robot.joint, []
        for k, (x, t) in enumerate(zip(states, times, strict=True)):
            torques.append(self.controller(x, t))
            if given is not None:
                inner.state.torques[0], inner.state.identifier.torques[0] = given[k, joint], given[k]
        return np.array(torques)


class C:
    def __init__(self, policy, folder):
        if shutil.which("gcc") is None:
            pytest.skip("gcc is not installed")
        self._library = compiled.compile_header(folder, c_header(policy))

    def alone(self, states):
        return compiled.torques(self._library, np.ascontiguousarray(states))

    def run(self, times, states, *given):
        return compiled.watch(self._library, *map(np.ascontiguousarray, (times, states, *given)))[0]


class Onnx:
    def __init__(self, policy, folder):
        pytest.importorskip("onnx", reason="onnx is not installed")
        runtime = pytest.importorskip("onnxruntime", reason="onnxruntime is not installed")
        self._session = runtime.InferenceSession(onnx_model(policy), providers=["CPUExecutionProvider"])
        self._joint = policy.robot.joint

    def alone(self, states):
        u = self._session.run(None, {"state": states})[0]
        assert u.dtype == np.float64
        assert not u[:, 1 - self._joint].any()
        return u[:, self._joint]


class JavaScript:
    """In a browser's ``page`` with the policies' script, which the test gives."""

    def __init__(self, policy, folder):
        self._data, self._joint = policy_data(policy), policy.robot.joint

    def alone(self, states):
        # JSON has no NaN: numbers that are not finite travel as words.
        words = {"nan": "NaN", "inf": "Infinity", "-inf": "-Infinity"}
        rows = [[value if np.isfinite(value) else words[str(value)] for value in x] for x in states.tolist()]
        answer = self.page.evaluate(
            """([spec, driven, states]) => {
                const act = swingup.makePolicy(spec, driven);
                return states.map((x) => act(x.map((v) => (typeof v === "string" ? Number(v) : v))).map(String));
            }""",
            [self._data, self._joint, rows],
        )
        u = np.array(answer, np.float64)
        assert not u[:, 1 - self._joint].any()
        return u[:, self._joint]


class BackEnd(NamedTuple):
    """A row of the table.

    ``run(times, states, given)`` is one whose motors were given these torques, for what has an identifier. In a
    replay, which does not follow the torques, a compensation too strong would look like friction of that strength:
    rounding would grow.
    """

    make: Callable  # from a policy and a folder to what has ``alone(states)`` and, if it is whole, ``run``
    alone_within: float  # distance of the policy's torque from that in double precision (N m)
    whole_within: float = np.nan  # distance of a whole controller's torques over a run (N m)
    stride: int = 1  # the policy alone is asked at every so many states: one that is slow to call gets fewer


BACK_ENDS = {
    "jax": BackEnd(Jax, alone_within=TOLERANCE, whole_within=TOLERANCE),
    "numpy": BackEnd(Numpy, alone_within=1e-11, whole_within=1e-9),
    "c": BackEnd(C, alone_within=1e-11, whole_within=1e-9),
    "onnx": BackEnd(Onnx, alone_within=TOLERANCE),
    "javascript": BackEnd(JavaScript, alone_within=1e-10, stride=5),
}


def numpy_folder(policy, folder):
    """The policy of an exported folder, as its entry loads it."""
    entry = export_folder(policy, folder / "out", "numpy", policy.task)
    found = load_tested_policy(entry.parent / f"{policy.task}_controller")
    return lambda observations: found.predict(observations)[0]


def task_in_c(precision, policy, folder):
    text = c_header(policy, precision=precision)
    library = compiled.compile_header(folder, text, *compiled.CAREFUL, driver=compiled.TASK_DRIVER)
    assert library.self_test() == 0
    shape = policy.action_space.shape

    def act(observations):
        rows, actions = len(observations), np.empty((len(observations), *shape))
        library.act(rows, compiled.pointer(np.ascontiguousarray(observations)), compiled.pointer(actions))
        return actions

    return act


def task_in_onnx(policy, folder):
    pytest.importorskip("onnx", reason="onnx is not installed")
    runtime = pytest.importorskip("onnxruntime", reason="onnxruntime is not installed")
    session = runtime.InferenceSession(onnx_model(policy), providers=["CPUExecutionProvider"])
    seen, space = policy.observation_space, policy.action_space

    def act(observations):
        actions = session.run(None, {"observation": observations.astype(seen.dtype)})[0]
        assert actions.dtype == space.dtype
        return actions

    test = json.loads(session.get_modelmeta().custom_metadata_map["self_test"])
    found = act(np.array(test["observations"]))
    assert np.all(np.abs(found - test["actions"]) <= test["tolerance"])
    return act


TASK_BACK_ENDS = {
    "numpy": (numpy_folder, 1e-6),
    "onnx": (task_in_onnx, 1e-5),
    "c": (functools.partial(task_in_c, "double"), 1e-9),
    "c-single": (functools.partial(task_in_c, "single"), 1e-4),
}
"""What makes each of any task's policies, and how far actions may lie from JAX's, as a share of their range."""
