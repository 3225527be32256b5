"""The checker finds what is wrong with controllers that others plug in, and nothing wrong with good ones."""

import re

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

import swingup
from policies import lone_policy
from swingup.common.errors import SwingupError
from swingup.controllers.interface.check import check_controller
from swingup.controllers.interface.controller import AbstractController
from swingup.controllers.interface.python_controller import PythonController, answer
from swingup.controllers.registry import get_controller
from swingup.plant.robots import get_robot
from swingup.policy.numpy_backend.controller import numpy_controller
from swingup.policy.shipped import load_policy
from swingup.realaigym import load_controller


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


class Compensating(Remembering):
    """A torque on the acrobot's passive joint, and what it declares there."""

    def __init__(self, declared):
        self.passive_limit = declared

    def get_control_output(self, x, t):
        return [0.5, 0.0]


@pytest.mark.parametrize(
    ("declared", "message"),
    [
        (0.5, None),
        (0.4, r"up to 0\.5 N m on the passive joint 1, and its passive_limit is 0\.4: clip the torque"),
        (0, "passive joint 1: return 0 there, or declare"),
        ("much", "its attribute passive_limit = 'much': use a number"),
        (-1.0, r"its attribute passive_limit = -1\.0: use a number"),
        (np.nan, "its attribute passive_limit = nan: use a number"),
    ],
)
def test_torque_on_the_passive_joint_is_declared(declared, message):
    findings = check_controller(Compensating(declared), "acrobot")
    assert len(findings) == (message is not None)
    if message:
        assert re.search(message, findings[0])


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
    assert check_controller(lone_policy("ar-eapo", robot)[0], robot) == []


def test_a_policy_that_compensates_friction_declares_it(robot):
    found = numpy_controller(load_policy("adaptive", robot))
    assert check_controller(found, robot) == []
    assert found.passive_limit == get_controller("adaptive", robot).passive_limit == 0.5
    assert load_controller("adaptive", robot).passive_limit == 0.5
    assert numpy_controller(load_policy("ar-eapo", robot)).passive_limit == 0


@pytest.mark.slow  # JAX compiles identifier and regulator for seconds
def test_in_jax_too(robot):
    assert check_controller(get_controller("adaptive", robot), robot) == []


def test_a_policy_of_the_other_robot():
    findings = check_controller(lone_policy("ar-eapo", "acrobot")[0], get_robot("pendubot"))
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


class EndOfAll(BaseException):
    """No ``Exception``, as SystemExit is none."""


class BadTextError(Exception):
    """An error whose text cannot be had."""

    def __str__(self):
        raise RuntimeError("no text")


class Hostile(Remembering):
    """A good object but for what it is made with: ``Hostile(reset=BadTextError())`` raises in its reset()."""

    def __init__(self, **errors):
        self.errors = errors

    def __getattribute__(self, name):
        errors = object.__getattribute__(self, "__dict__").get("errors", {})
        if name in errors:
            raise errors[name]
        return object.__getattribute__(self, name)


class Unprintable:
    def __repr__(self):
        raise RuntimeError("no repr")


def raising_bad_text(x, t):
    raise BadTextError


def ending(x, t):
    raise EndOfAll("good bye")


HOSTILE = {
    "bad text": (raising_bad_text, "BadTextError whose text raises RuntimeError"),
    "ending": (ending, r"raised EndOfAll \(good bye\) at t = 0 s"),
    "unprintable": (lambda x, t: Unprintable(), "<Unprintable instance at "),
    "huge": (lambda x, t: np.ones(10**14), "MemoryError"),
    "large": (lambda x, t: np.ones(10**6), r"of shape \(1000000,\)"),
    "digits": (lambda x, t: [0, 10**5000], "<list whose repr raises ValueError>|instance|return two real numbers"),
    "text of lines": (lambda x, t: "a\n\x1b[31m" * 1000, r"'a\\n\\x1b\[31m"),
    "limit": (Hostile(passive_limit=BadTextError()), "its attribute passive_limit raised BadTextError"),
    "reset": (Hostile(reset=BadTextError()), "its attribute reset raised BadTextError"),
    "init": (Hostile(init=SystemExit(3)), r"its attribute init raised SystemExit \(3\)"),
}


@pytest.mark.parametrize("name", HOSTILE)
def test_hostile_plain_python(name):
    source, message = HOSTILE[name]
    findings = check_controller(source, "acrobot")
    assert len(findings) == 1
    assert findings[0].isprintable()
    assert len(findings[0]) < 400
    with pytest.raises(AssertionError, match=message):
        raise AssertionError(findings[0])


@pytest.mark.parametrize(
    ("source", "message"),
    [
        (
            Hostile(robot=ValueError("secret\nplace")),
            r"attribute robot raised ValueError \(secret place\): correct",
        ),
        (Hostile(get_control_output=EndOfAll()), "its attribute get_control_output raised EndOfAll"),
        (Unprintable(), "<Unprintable instance at .* is no controller"),
    ],
    ids=["robot", "get_control_output", "repr"],
)
def test_objects_that_cannot_even_be_wrapped(source, message):
    with pytest.raises(SwingupError, match=message):
        check_controller(source, "acrobot")
    with pytest.raises(SwingupError, match=message):
        swingup.judge(source, "acrobot")


def test_an_object_whose_copying_ends_the_process():
    source = Hostile(__deepcopy__=EndOfAll())
    assert len(PythonController(source).copies(3)) == 1


def not_callable():
    source = Remembering()
    source.get_control_output = [0.0, 1.0]
    return source


def test_an_output_that_is_no_method():
    with pytest.raises(SwingupError, match="is no controller"):
        check_controller(not_callable(), "acrobot")


class Static(AbstractController):
    """Its label tells one compiled program from another."""

    label: object = eqx.field(static=True)

    def init(self):
        return None

    def __call__(self, carry, t, x):
        return None, jnp.array([0.0, 1.0])


class Labelled(Static):
    """The same with a field that is no static one."""

    label: object


class Failing(AbstractController):
    """Traces well, and fails when it runs."""

    text: str = eqx.field(static=True, default="host\nfailed")

    def init(self):
        return None

    def __call__(self, carry, t, x):
        def fail(_):
            raise ValueError(self.text)

        return None, jax.pure_callback(fail, jax.ShapeDtypeStruct((2,), x.dtype), t)


@pytest.mark.filterwarnings("ignore:A JAX array is being set as static")
@pytest.mark.parametrize("kind", [Static, Labelled])
@pytest.mark.parametrize("label", [{"a"}, [{}], np.ones(3)], ids=["set", "list", "array"])
def test_fields_that_cannot_be_compiled(kind, label):
    if kind is Labelled and isinstance(label, np.ndarray):
        assert check_controller(kind(label), "acrobot") == []  # numbers may be of any kind where they are arguments
        return
    (finding,) = check_controller(kind(label), "acrobot")
    assert finding.startswith("hashing its fields raised TypeError (")
    assert finding.endswith("make lists and sets tuples, and keep arrays in fields that are not static")
    with pytest.raises(SwingupError, match="controller 'controller': hashing its fields raised TypeError"):
        swingup.judge(kind(label), "acrobot")


def test_a_controller_that_fails_when_it_runs():
    (finding,) = check_controller(Failing(), "acrobot")
    assert finding == "running it raised JaxRuntimeError (ValueError: host failed): correct it there"
    with pytest.raises(SwingupError, match="controller 'controller': running it raised "):
        swingup.judge(Failing(), "acrobot")


class Complex(Static):
    def __call__(self, carry, t, x):
        return None, jnp.array([0.0, 1.0j])


def test_complex_torques():
    assert check_controller(Complex(0), "acrobot") == [
        "its torque is complex128: return real numbers [u1, u2] in N m"
    ]
