"""The checker finds what is wrong with controllers that others plug in, and nothing wrong with good ones."""

import itertools

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

import swingup
from policies import lone_policy
from refusals import refusal
from swingup.controllers.check import call_time, check_controller, slow_call, upright_law
from swingup.controllers.interface import AbstractController, PythonController, checked_torques
from swingup.controllers.registry import get_controller
from swingup.plant.plant import LEADERBOARD, ROBOTS, get_robot
from swingup.policy.numpy_backend import numpy_controller
from swingup.policy.shipped import load_policy
from swingup.runtime import load_controller


class Remembering:
    """A good object with memory, but for what it is made with: ``errors`` are what its attributes raise."""

    def __init__(self, torque=None, errors=(), **attributes):
        self.__dict__.update(torque=torque, errors=dict(errors), **attributes)

    def __getattribute__(self, name):
        errors = object.__getattribute__(self, "__dict__").get("errors", {})
        if name in errors:
            raise errors[name]
        return object.__getattribute__(self, name)

    def init(self):
        self.total = np.zeros(4)

    def get_control_output(self, x, t):
        self.total = self.total + x
        return np.array([0.0, self.total[0]]) if self.torque is None else self.torque


class NeverCleared(Remembering):
    """Memory that init() and reset() leave alone."""

    total = np.zeros(4)
    init = None


class Shared(Remembering):
    """Copies share one list, which init() clears for all of them."""

    calls: list = []  # noqa: RUF012 - the fault that is to be found

    def init(self):
        self.calls.clear()

    def get_control_output(self, x, t):
        self.calls.append(t)
        return [0.0, float(len(self.calls))]


def good(x, t):
    return [0.0, np.sin(x[0]) + t]


def altering(x, t):
    x[:] = 0
    return [0.0, 0.0]


def raising(error):
    def control(x, t):
        raise error

    return control


FAULTY = {
    "clear its memory in reset": NeverCleared(),
    "no independent copies": Shared(),
    "raised ValueError (not today) at t = 0 s": raising(ValueError("not\ntoday")),
    "raised SystemExit (good bye) at t = 0 s": raising(SystemExit("good bye")),
    "not finite at t = 0.004 s": lambda x, t: [0.0, np.nan if t > 0.003 else 0.0],
    "changes the measurement": altering,
    # What an object asks for on the acrobot's passive joint, it has to declare.
    "up to 0.5 N m on the passive joint 1: return 0 there, or declare": lambda x, t: [0.5, 0.0],
    "joint 1, and its passive_limit is 0.4: clip the torque": Remembering([0.5, 0.0], passive_limit=0.4),
    "its arguments are t, x, and a controller is called with (x, t): swap them": lambda t, x: [0.0, x[0]],
    "it answers to (t, x) alone": lambda now_s, angles: [0.0, 0.1 * angles[0] + now_s],
    "up to 600 N m on the driven joint 2, whose motor has 6 N m: clip": lambda x, t: [0.0, -600.0],
}
SOUND = {
    "function": good,
    "keywords": lambda *, t, x: good(x, t),
    "other names": lambda measured, now: good(measured, now),
    "object": Remembering(),
    "declared": Remembering([0.5, 0.0], passive_limit=0.5),
    "robot of another kind": Remembering(robot=3),
}


ANSWERS = [
    [1.0], np.zeros((2, 1)), np.ones(10**6), "two", "a\n\x1b[31m" * 1000, None, np.array([0, 1j]), [0, 10**5000],
    [0.0, [1.0, 2.0]],
]  # fmt: skip
"""The last one refuses to become an array, as a torch tensor that requires a gradient does."""


def test_answers_that_are_not_two_numbers():
    for given in ANSWERS:
        (finding,) = check_controller(lambda x, t, given=given: given, "acrobot")
        assert ("return two real numbers" if given is not ANSWERS[-1] else "raised ValueError (") in finding
        assert finding.isprintable()
        assert len(finding) < 400


@pytest.mark.parametrize("name", SOUND)
def test_good_plain_python(name):
    assert check_controller(SOUND[name], "acrobot") == []
    # RealAIGym calls get_control_output(x=x, t=t).
    if name in ("function", "keywords", "other names"):
        u = checked_torques(PythonController(SOUND[name]).start(), np.array([0.5, 0.0, 0.0, 0.0]), 0.25)
        assert u.tolist() == [0.0, np.sin(0.5) + 0.25]


NO_CONTROLLER = {
    "3 is not a controller: pass a function": 3,
    " is not a controller: pass": Remembering(get_control_output=[0.0, 1.0]),
    "attribute robot raised ValueError (no): correct": Remembering(errors={"robot": ValueError("no")}),
}


@pytest.mark.parametrize("named", NO_CONTROLLER)
def test_what_cannot_even_be_wrapped(named):
    assert named in refusal(check_controller, NO_CONTROLLER[named], "acrobot")
    assert named in refusal(swingup.judge, NO_CONTROLLER[named], "acrobot")


def test_copies_run_side_by_side_only_without_a_common_memory():
    ending = Remembering(errors={"__deepcopy__": SystemExit()})
    assert [len(PythonController(source).copies(5)) for source in (Remembering(), Shared(), ending)] == [5, 1, 1]


class Jax(AbstractController):
    """A controller in JAX, good or with one fault; its label tells one compiled program from another."""

    fault: str = "none"
    label: object = eqx.field(static=True, default=0)

    def init(self):
        return {"calls": jnp.zeros((), int)}

    def __call__(self, carry, t, x):
        calls, u = carry["calls"] + (1.5 if self.fault == "memory" else 1), jnp.array([0.0, 1.0]) * x[0]
        if self.fault == "raising":
            raise RuntimeError("no")
        if self.fault == "callback":
            u = jax.pure_callback(raising(ValueError("host\nfailed")), jax.ShapeDtypeStruct((2,), x.dtype), x, t)
        u = {
            "nan": u / x[3] * x[3],  # 0 / 0 at rest
            "shape": jnp.zeros(3),
            "passive": u[::-1],
            "complex": u * 1j,
            "strong": u * 100,
        }.get(self.fault, u)
        return u if self.fault == "alone" else ({"calls": calls}, u)


class Swapped(Jax):
    def __call__(self, carry, x, t):
        return carry, jnp.array([0.0, 1.0]) * x


IN_JAX = {
    "its arguments are x, t, and a controller is called with (memory, t, x): swap them": Swapped(),
    "memory changes shape or dtype": Jax("memory"),
    "tracing it raised RuntimeError (no)": Jax("raising"),
    "running it raised JaxRuntimeError (ValueError: host failed): correct it there": Jax("callback"),
    "not finite for x = [0.0, 0.0, 0.0, 0.0]": Jax("nan"),
    "its torque is complex128: return real numbers": Jax("complex"),
    "must return two things": Jax("alone"),
    "hashing its fields raised TypeError (unhashable type: 'set'": Jax(label={"a"}),
}


@pytest.mark.parametrize("named", [*FAULTY, *IN_JAX])
def test_a_fault_in_plain_python_or_jax(named):
    (finding,) = check_controller((FAULTY | IN_JAX)[named], "acrobot")
    assert named in finding
    assert finding.isprintable()
    assert len(finding) < 400


def test_a_controller_that_fails_when_it_runs_is_named():
    assert "controller 'controller': running it raised " in refusal(swingup.judge, Jax("callback"), "acrobot")


def test_good_controllers_in_jax(robot):
    assert check_controller(Jax(), "acrobot") == []
    policy, (other,) = lone_policy("ar-eapo", robot)[0], {*ROBOTS.values()} - {robot}
    assert check_controller(policy, robot) == []
    assert f"it is for the {robot.name}, not the {other.name}" in check_controller(policy, other)[0]


def test_a_policy_that_compensates_friction_declares_it(robot):
    found = numpy_controller(load_policy("adaptive", robot))
    assert check_controller(found, robot) == []
    made = found, get_controller("adaptive", robot), load_controller("adaptive", robot)
    assert [each.passive_limit for each in made] == [0.5] * 3
    assert numpy_controller(load_policy("ar-eapo", robot)).passive_limit == 0


@pytest.mark.slow  # JAX compiles identifier and regulator for seconds
def test_in_jax_too(robot):
    assert check_controller(get_controller("adaptive", robot), get_robot(robot)) == []


SPONGS = LEADERBOARD.changed(
    m1=1.0, m2=1.0, l1=1.0, l2=2.0, r1=0.5, r2=1.0, I1=0.083 + 0.25, I2=0.33 + 1.0, tl1=0.0, tl2=1000.0
)
"""Links of 1 and 2 m and 1 kg each, with inertias about their centres of 0.083 and 0.33 kg m²."""
CLASSIC = np.array([-246.481, -98.690, -106.464, -50.138])
"""K of u = -K [q1 - π/2, q2, q̇1, q̇2], with q1 from the horizontal (Spong, IEEE Control Systems 15, 1995)."""


@pytest.mark.parametrize(
    ("sign", "upright", "named"),
    [
        (1.0, np.pi, None),
        (-1.0, np.pi, "its torque at the top has the wrong sign"),
        (1.0, np.pi / 2, "it takes q1 = 1.571 for upright, counted from horizontal"),
        (-1.0, 0.0, "give it q1 - 3.142 and change its torque's sign"),
    ],
)
def test_the_sign_and_the_zero_of_a_law_at_the_top(sign, upright, named):
    findings, notes = upright_law(
        lambda x, t: [0.0, -sign * CLASSIC @ (x - [upright, 0, 0, 0])], get_robot("acrobot"), SPONGS
    )
    assert len(findings) == (named is not None)
    assert named is None or named in findings[0]
    # Far from its own zero it has the same gains.
    assert "K = [-246.481" in notes[0] or sign < 0
    assert "poles" in notes[0]


def test_a_law_subtracts_the_encoders_zeros():
    findings, _ = upright_law(
        lambda x, t: [0.0, -CLASSIC @ (x - [np.pi + 0.5, 0, 0, 0])], get_robot("acrobot"), SPONGS.changed(zero1=0.5)
    )
    assert findings == []


@pytest.mark.parametrize(("strength", "stable"), [(1.0, True), (0.2, False)])
def test_friction_is_named_where_a_pole_is_not_stable(strength, stable):
    """A law that is too weak has one; dry friction may hold it all the same."""
    findings, notes = upright_law(
        lambda x, t: [0.0, -strength * CLASSIC @ (x - [np.pi, 0, 0, 0])], get_robot("acrobot"), SPONGS
    )
    assert findings == []
    assert ("leave out Coulomb friction" in notes[-1]) != stable


class RootedAtTheTop(AbstractController):
    """A law that is not finite on one side of upright."""

    def init(self):
        return None

    def __call__(self, carry, t, x):
        return None, jnp.stack([0.0 * t, jnp.sqrt(np.pi - x[0])])


def test_a_torque_that_is_not_finite_at_the_top():
    found, _ = upright_law(RootedAtTheTop(), get_robot("acrobot"), LEADERBOARD)
    assert found == ["its torque is not finite for x = [3.1417, 0.0, 0.0, 0.0]: correct it there"]


def test_a_solver_that_is_slow_at_times_is_told(monkeypatch):
    """Every tenth call takes 13 ms, of a clock that stands still otherwise."""
    calls, passed = itertools.count(), [0.0]

    def act(x, t):
        passed[0] += 0.013 if next(calls) % 10 == 0 else 1e-5
        return [0.0, 0.0]

    monkeypatch.setattr("swingup.controllers.check.time.perf_counter", lambda: passed[0])
    took = call_time(PythonController(act), 0.002)
    assert took == pytest.approx((1e-5, 0.013, 0.013))
    assert slow_call(took, 0.002).startswith(
        "one call takes 0.01 ms (median; 99 % 13, longest 13 ms) on this machine"
    )
    assert slow_call(took, 0.02) is None
