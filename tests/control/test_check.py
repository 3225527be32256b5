"""The checker finds what is wrong with controllers that others plug in, and nothing wrong with good ones."""

import jax.numpy as jnp
import numpy as np
import pytest

import swingup
from swingup.control.check import check_controller
from swingup.control.controller import AbstractController
from swingup.control.python_controller import PythonController, answer
from swingup.errors import SwingupError
from swingup.physics.parameters import get_robot


def good(x, t):
    return [0.0, np.sin(x[0]) + t]


class Remembering:
    """A good object with memory."""

    def init(self):
        self.total = np.zeros(4)

    def get_control_output(self, x, t):
        self.total = self.total + x
        return np.array([0.0, self.total[0]])


class NeverCleared(Remembering):
    """Memory that init() and reset() leave alone."""

    def __init__(self):
        self.total = np.zeros(4)

    def init(self):
        pass


class Shared:
    """Copies share one list, which init() clears for all of them."""

    calls: list = []  # noqa: RUF012 - the fault that is to be found

    def init(self):
        self.calls.clear()

    def get_control_output(self, x, t):
        self.calls.append(t)
        return [0.0, float(len(self.calls))]


class Uncopyable(Remembering):
    def __deepcopy__(self, memo):
        raise TypeError("no copies")


class Initialising(Remembering):
    def init(self):
        raise RuntimeError("not yet")


class Tensor:
    """As a torch tensor that requires a gradient: it refuses to become an array."""

    def __array__(self, dtype=None, copy=None):
        raise RuntimeError("call detach() first")


def altering(x, t):
    x[:] = 0
    return [0.0, 0.0]


def raising(x, t):
    raise ValueError("not\ntoday")


FAULTY = {
    "memory": (NeverCleared(), "clear its memory in reset"),
    "shared": (Shared(), "no independent copies"),
    "uncopyable": (Uncopyable(), "no independent copies"),
    "altering": (altering, "changes the measurement"),
    "raising": (raising, r"raised ValueError \(not today\) at t = 0 s"),
    "passive": (lambda x, t: [0.5, 0.0], r"up to 0\.5 N m on the passive joint 1"),
    "nan": (lambda x, t: [0.0, np.nan if t > 0.003 else 0.0], r"not finite at t = 0\.004 s"),
    "short": (lambda x, t: [1.0], r"of shape \(1,\): return two real numbers"),
    "matrix": (lambda x, t: np.zeros((2, 1)), r"of shape \(2, 1\)"),
    "text": (lambda x, t: "two", "'two': return two real numbers"),
    "tensor": (lambda x, t: Tensor(), r"RuntimeError \(call detach\(\) first\)"),
    "none": (lambda x, t: None, "is None: return two real numbers"),
    "complex": (lambda x, t: np.array([0, 1j]), "return two real numbers"),
    "initialising": (Initialising(), r"init\(\) raised RuntimeError \(not yet\)"),
}


@pytest.mark.parametrize("name", FAULTY)
def test_plain_python_with_a_fault(name):
    source, message = FAULTY[name]
    findings = check_controller(source, "acrobot")
    assert len(findings) == 1
    with pytest.raises(AssertionError, match=message):
        raise AssertionError(findings[0])


@pytest.mark.parametrize("source", [good, Remembering()], ids=["function", "object"])
def test_good_plain_python(source):
    assert check_controller(source, "acrobot") == []


class Jax(AbstractController):
    """A controller in JAX, good or with one fault."""

    fault: str = "none"

    def init(self):
        return {"calls": jnp.zeros((), int)}

    def __call__(self, carry, t, x):
        calls = carry["calls"] + 1
        if self.fault == "memory":
            calls = calls + 0.5
        if self.fault == "raising":
            raise RuntimeError("no")
        u = jnp.array([0.0, 1.0]) * x[0]
        if self.fault == "nan":
            u = u / x[3] * x[3]  # 0 / 0 at rest
        if self.fault == "shape":
            u = jnp.zeros(3)
        if self.fault == "scalar":
            u = u[1]
        if self.fault == "alone":
            return u
        if self.fault == "passive":
            u = u[::-1]
        return {"calls": calls}, u


@pytest.mark.parametrize(
    ("fault", "message"),
    [
        ("memory", "memory changes shape or dtype"),
        ("raising", "tracing it raised RuntimeError: no"),
        ("nan", r"not finite for x = \[0\.0, 0\.0, 0\.0, 0\.0\]"),
        ("shape", r"shape \(3,\)"),
        ("scalar", r"shape \(\)"),
        ("alone", "must return two things"),
        ("passive", "passive joint 1"),
    ],
)
def test_jax_with_a_fault(fault, message):
    findings = check_controller(Jax(fault), "acrobot")
    assert len(findings) == 1
    with pytest.raises(AssertionError, match=message):
        raise AssertionError(findings[0])


def test_good_controllers_in_jax(robot):
    assert check_controller(Jax(), "acrobot") == []
    assert check_controller(swingup.shipped_policy(robot)[0], robot) == []


def test_a_policy_of_the_other_robot():
    findings = check_controller(swingup.shipped_policy("acrobot")[0], get_robot("pendubot"))
    assert findings == ["it is for the acrobot, not the pendubot: judge it there"]


def test_what_is_no_controller():
    for source in (3, Remembering):
        with pytest.raises(SwingupError, match="is no controller: pass a function"):
            check_controller(source, "acrobot")


def keywords_only(*, t, x):
    return [0.0, float(x[0] + t)]


def other_names(measured, now):
    return [0.0, float(measured[0] + now)]


@pytest.mark.parametrize("source", [keywords_only, other_names])
def test_calls_by_name_or_in_order(source):
    # RealAIGym calls get_control_output(x=x, t=t).
    x = np.array([0.5, 0.0, 0.0, 0.0])
    assert answer(PythonController(source).start(), x, 0.25).tolist() == [0.0, 0.75]
    assert check_controller(source, "acrobot") == []


@pytest.mark.parametrize("robot", ["acrobot", None, 3])
def test_a_robot_of_another_kind_is_not_ours(robot):
    source = Remembering()
    source.robot = robot
    assert check_controller(source, "acrobot") == []


def test_copies_that_share_a_memory_do_not_run_side_by_side():
    assert len(PythonController(Shared()).copies(5)) == 1
    assert len(PythonController(Remembering()).copies(5)) == 5
