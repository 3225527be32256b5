"""The safety guard: broken sensors, clocks and loops, in NumPy and in C, and who has a guard."""

import dataclasses

import numpy as np
import pytest

from swingup.controllers.interface import loop_controller
from swingup.controllers.registry import get_controller
from swingup.export.c_header import c_header
from swingup.export.realaigym import RealAIGymController
from swingup.policy.estimator import EstimatorSettings
from swingup.policy.guard import REASON_TEXTS, GuardSettings, Reason, choose_guard
from swingup.policy.numpy_backend import numpy_controller
from swingup.runtime import load_controller

from . import compiled
from .references import DT, policy

STEPS, AT = 160, 40
"""Calls of a run, and that at which a fault is injected."""


def calm(entries=(), value=None, calls=1, pause=0.0):
    """Times (n,) and measurements (n, 4) of a slow motion that no guard minds, but for a fault.

    Entries of the state have a value, or stay as they are, in some calls. The clock pauses (in DT).
    """
    clock, wave = np.arange(float(STEPS)), np.array([1.0, -0.7])
    phase = 5 * DT * clock[:, None]
    states, entries = np.concatenate([0.4 * np.sin(phase) * wave, 2 * np.cos(phase) * wave], axis=1), list(entries)
    states[AT : AT + calls, entries] = states[AT, entries] if value is None else value
    clock[AT:] += pause
    return DT * clock, states


# What is done to the calm motion; the reason, the joint and the call of the stop. A gap ends when its time exceeds
# 0.021 s, in the 11th call that is not finite or repeats.
FAULTS = {
    "nothing": ((), Reason.NONE, -1, None),
    "rest": ((range(4), 0.0, STEPS), Reason.NONE, -1, None),
    "NaN": (([0], np.nan), Reason.NONE, -1, None),
    "NaN for long": (([0], np.nan, 11), Reason.NOT_FINITE, 0, AT + 10),
    "infinite velocity": (([3], -np.inf, 11), Reason.NOT_FINITE, 1, AT + 10),
    "angle": (([1], 12.6), Reason.ANGLE, 1, AT),
    "negative angle": (([0], -12.6), Reason.ANGLE, 0, AT),
    "angle at its limit": (([1], -12.566), Reason.NONE, -1, None),
    "velocity": (([2], -20.001), Reason.VELOCITY, 0, AT),
    "velocity at its limit": (([2], 20.0), Reason.NONE, -1, None),
    "enormous velocity": (([3], 1e200), Reason.VELOCITY, 1, AT),
    "elbow repeated": (([1, 3], None, STEPS), Reason.STALE, 1, AT + 11),
    "all repeated": ((range(4), None, STEPS), Reason.STALE, 0, AT + 11),
    "angles alone repeated": (([0, 1], None, STEPS), Reason.NONE, -1, None),
    "jump": (([0], 1.5), Reason.JUMP, 0, AT),
    "elbow between two counts": (
        (range(4), [[0.15, 0.05 * (-1) ** call, 0, 0] for call in range(60)], 60),
        Reason.NONE,
        -1,
        None,
    ),
    "a whole turn": (([0], 2 * np.pi + 0.4 * np.sin(5 * DT * AT)), Reason.NONE, -1, None),
    "pause": (((), None, 0, 9.75), Reason.LATE, -1, AT),
    "short pause": (((), None, 0, 8.5), Reason.NONE, -1, None),
    "clock backward": (((), None, 0, -5.0), Reason.CLOCK, -1, AT),
    "clock stops": (((), None, 0, -np.arange(STEPS - AT)), Reason.CLOCK, -1, AT + 11),
    "NaN of the clock": (((), None, 0, np.nan), Reason.CLOCK, -1, AT),
}


def guarded(name="pendubot-ar-eapo", **settings):
    return dataclasses.replace(policy(name), guard=GuardSettings(watched=0.0, **settings))


def run(controller, times, states):
    """Torques (n, 2), and the call at which the guard stopped the controller."""
    controller.reset()
    torques, stop = [], None
    for call, (t, x) in enumerate(zip(times, states, strict=True)):
        torques.append(controller(x, t))
        stop = call if stop is None and controller.guard.fault else stop
    return np.array(torques), stop


@pytest.mark.parametrize("name", ["pendubot-ar-eapo", "acrobot-estimated"])
@pytest.mark.parametrize("fault", FAULTS)
def test_faults(fault, name):
    """The guard stops the controller at the call of the fault, for good; before, it changes no finite torque."""
    change, reason, joint, expected = FAULTS[fault]
    times, states = calm(*change)
    controller, plain = numpy_controller(guarded(name, longest_gap=0.021)), numpy_controller(policy(name))
    torques, stop = run(controller, times, states)
    found = controller.guard.fault
    assert stop == expected
    assert (found.reason, found.joint) == (reason, joint) if found else reason == Reason.NONE
    acting = slice(None, stop)
    unwatched = np.array([plain(x, t) for x, t in zip(states[acting], times[acting], strict=True)])
    silent = np.isnan(unwatched).any(axis=1)
    assert silent.any() == (not np.isfinite(states[acting]).all() and name == "pendubot-ar-eapo")
    expected = np.where(silent[:, None], torques[AT - 1], unwatched)
    np.testing.assert_array_equal(torques[acting], expected)
    if stop is not None:
        assert not torques[stop:].any()
        # reset() lets it act again, and the first run repeats bit for bit.
        again, _ = run(controller, times, states)
        np.testing.assert_array_equal(again, torques)


BRAKING = {"torque_rate": 400.0, "braking": 0.3, "longest_gap": 0.021}
"""Settings with which all of the guard has an effect."""


@compiled.needs_gcc
@pytest.mark.parametrize("name", ["pendubot-ar-eapo", pytest.param("acrobot-global", marks=pytest.mark.slow)])
@pytest.mark.parametrize("fault", FAULTS)
def test_c_does_the_same(tmp_path, name, fault):
    times, states = calm(*FAULTS[fault][0])
    controller = numpy_controller(guarded(name, **BRAKING))
    torques, stop = run(controller, times, states)
    library = compiled.compile_header(tmp_path, c_header(guarded(name, **BRAKING)))
    found, reasons, last, said = compiled.watch(library, times, states)
    np.testing.assert_allclose(found, torques, rtol=0, atol=1e-9)
    expected = np.zeros(STEPS, int)
    if stop is not None:
        expected[stop:] = controller.guard.fault.reason
        first = controller.guard.fault
        np.testing.assert_array_equal(last, [first.joint, first.time, first.value])
    np.testing.assert_array_equal(reasons, expected)
    assert said == REASON_TEXTS[int(expected[-1])]


def test_a_joint_that_stands_still_under_a_large_torque():
    """A broken encoder may show rest: the torque tells. 0.2 s are exceeded in the 101st repeated call."""
    controller = numpy_controller(guarded())
    controller.inner._network = lambda x: 3.1  # above half of 6 N m
    for call in range(102):
        assert controller.guard.fault is None, call
        u = controller(np.array([0.1, 0.2, 0.0, 0.0]), DT * call)
    assert not u.any()
    assert (controller.guard.fault.reason, controller.guard.fault.joint) == (Reason.STALE, 0)
    controller.inner._network = lambda x: 2.9
    controller.reset()
    assert all(controller(np.array([0.1, 0.2, 0.0, 0.0]), DT * call).any() for call in range(200))


@pytest.mark.parametrize("back_end", ["numpy", pytest.param("c", marks=compiled.needs_gcc)])
def test_a_dead_encoder_shows_the_same_while_the_other_joint_moves(tmp_path, back_end):
    """5 rad/s for 1.5 rad: after 0.3 s, in the 151st call with an elbow that stays."""
    states = np.array([[5.0 * DT * call, 0.2, 5.0, 0.0] for call in range(160)])
    times, own = DT * np.arange(len(states)), guarded()
    if back_end == "numpy":
        controller = numpy_controller(own)
        _, stop = run(controller, times, states)
        found = controller.guard.fault.reason, controller.guard.fault.joint
    else:
        _, reasons, fault, _ = compiled.watch(compiled.compile_header(tmp_path, c_header(own)), times, states)
        stop, found = int(reasons.argmax()), (reasons[-1], fault[0])
    assert found == (Reason.DEAD, 1)
    assert stop == pytest.approx(151, abs=1)


def test_the_torque_changes_no_faster_than_allowed_and_must_be_finite():
    """150 N m/s for 2 ms are 0.3 N m; a call after 4 ms may change it by 0.6 N m. The estimator knows it."""
    controller = numpy_controller(guarded("acrobot-estimated", torque_rate=150.0))
    controller.inner._network = lambda x: wanted.pop(0)
    wanted = [1.0, 1.0, 1.0, 1.0, -9.0, -9.0, np.nan]
    for t, torque in zip([0.0, 0.002, 0.004, 0.006, 0.008, 0.012], [0.3, 0.6, 0.9, 1.0, 0.7, 0.1], strict=True):
        u = controller(np.array([0.1 + t, 0.0, 1.0, 0.0]), t)
        np.testing.assert_allclose(u, [0.0, torque], atol=1e-12)
        assert controller.inner.state.torques[0] == u[1]
    assert controller.guard.fault is None
    assert not controller(np.array([0.2, 0.0, 1.0, 0.0]), 0.014).any()
    assert controller.guard.fault.reason == Reason.TORQUE


@pytest.mark.parametrize(
    "guard", [True, False, GuardSettings(braking=5.0, watched=0.0)], ids=["guard", "none", "braking"]
)
@pytest.mark.parametrize(
    "name", ["acrobot-adaptive", pytest.param("pendubot-adaptive", marks=pytest.mark.slow), "acrobot-estimated"]
)
def test_no_torque_of_a_wrapped_controller_is_beyond_its_motors_limit(name, guard):
    """Whatever is measured, filtered, compensated and called: by RealAIGym's interface and by CloudPendulum's."""
    found = numpy_controller(policy(name), guard=guard)
    random, limits = np.random.default_rng(0), np.array(policy(name).torque_limits)
    wrapped = RealAIGymController(found)
    wrapped.set_friction_compensation(damping=[5.0, -5.0], coulomb_fric=[20.0, 30.0])
    broken, acted = [0.0, 1e6, -1e9, 1e300, np.nan, np.inf], 0
    for call in range(600):
        if call % 50 == 0:
            wrapped.init()
            wrapped.set_filter(random.choice([None, lambda x, u: 3 * x, lambda x, u: x - u[0]]))
        x = random.normal(size=4) * [3.0, 3.0, 30.0, 30.0]
        if random.uniform() < 0.05:
            x[random.integers(4)] = random.choice(broken)
        with np.errstate(all="ignore"):
            u = wrapped.get_control_output(x, call * DT)
        # NaN is for a broken measurement without a guard alone.
        assert (np.abs(u) <= limits).all() or (not guard and np.isnan(u).any() and not (np.abs(u) > limits).any())
        acted += np.abs(u).max() == limits.max()
    assert acted > 10 or guard


def test_a_measurement_whose_square_overflows_is_no_error():
    """Python's own floats raise OverflowError where NumPy's become infinite."""
    controller = load_controller("adaptive", "acrobot")
    for call in range(60):
        x = [1.3e154, 1e154, 0.0, 0.0] if call == 30 else [0.01 * call, 0.1, 1.0, 0.0]
        assert not (np.abs(controller(x, DT * call)) > controller.torque_limits).any()


def test_braking():
    """-kd q̇ on the driven joint within its limit, until the measurement is unsound; then nothing, for good."""
    controller = numpy_controller(guarded(braking=0.2, velocity_limit=10.0))
    # (velocity of the shoulder, torque): 0.2 · 11 = 2.2; 20 is still believed, 20.1 is beyond twice the limit.
    rows = [(11.0, -2.2), (-8.0, 1.6), (20.0, -4.0), (20.1, 0.0), (5.0, -1.0), (np.nan, 0.0), (5.0, 0.0)]
    for call, (rate, torque) in enumerate(rows):
        u = controller(np.array([0.1 * call, 0.0, rate, -rate]), DT * call)
        np.testing.assert_allclose(u, [torque, 0.0], atol=1e-12)
    assert controller.guard.fault.reason == Reason.VELOCITY
    controller.reset()
    # Braked after a broken measurement: never.
    assert not any(controller(np.array([np.nan, 0.0, 1.0, 1.0]), DT * call).any() for call in range(30))
    assert not controller(np.array([0.1, 0.0, 1.0, 1.0]), 30 * DT).any()


@pytest.mark.parametrize("name", ["ar-eapo", pytest.param("tvlqr", marks=pytest.mark.slow)])
def test_realaigym_controllers(name):
    """The guard looks at the measurement before a filter; stopped, no friction is compensated either."""
    guard = {"velocity_limit": 9.0}
    if name == "ar-eapo":
        controller = RealAIGymController(load_controller(name, "acrobot", guard=guard))
    else:
        controller = RealAIGymController(loop_controller(get_controller(name, "acrobot"), "acrobot", guard))
    controller.set_filter(lambda x, u: 0.0 * x)
    controller.init()
    controller.set_friction_compensation([0.1, 0.1], [0.1, 0.1])
    assert controller.get_control_output([0.1, 0.1, 0.0, 8.0], 0.0).shape == (2,)
    assert controller.fault is None
    assert not controller.get_control_output([0.1, 0.1, 0.0, 9.1], 0.002).any()
    assert not controller.get_control_output([0.1, 0.1, 0.1, 0.1], 0.004).any()
    assert controller.fault.reason == Reason.VELOCITY
    controller.reset()
    assert controller.fault is None


def test_who_has_a_guard():
    plain, estimator = policy("acrobot-ar-eapo"), EstimatorSettings(dt=0.005)
    assert numpy_controller(guarded(velocity_limit=50.0), guard=False).guard is None
    assert RealAIGymController(numpy_controller(plain)).fault is None
    behind = dataclasses.replace(plain, estimator=estimator)
    scaled = GuardSettings(dt=0.005, longest_gap=0.05, stuck_time=0.5)
    assert choose_guard(True, None, behind.period) == scaled
    assert choose_guard(True, None, DT) == choose_guard(True, None, plain.period) == GuardSettings()
    # A mapping changes some settings of the guard that is there.
    own = dataclasses.replace(scaled, velocity_limit=9.0)
    assert choose_guard({"braking": 0.1}, own, None) == dataclasses.replace(own, braking=0.1)
    assert choose_guard({"braking": 0.1}, None, 0.06).longest_gap == 0.6
    # The period that is watched is that of the estimator that is there.
    for estimated, file in ((True, plain), (False, behind)):
        watch = numpy_controller(file, estimated, guard=True).guard._watch
        assert watch._period == (DT if estimated else None)
    # Without times, RealAIGym's calls are counted by the same period.
    counted, timed = (RealAIGymController(numpy_controller(behind)) for _ in range(2))
    for step in range(5):
        x = np.full(4, 0.1 * step)
        np.testing.assert_array_equal(counted.get_control_output(x), timed.get_control_output(x, 0.005 * step))
