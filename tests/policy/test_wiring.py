"""The guard's look at the first second, in NumPy and in C: what is wired wrongly is named, and nothing else."""

import dataclasses

import numpy as np
import pytest

from swingup.export.c_header import c_header
from swingup.plant.equations import NUMPY, Friction, damped_midpoint_step
from swingup.plant.files import load_plant
from swingup.plant.plant import ROBOTS, lump
from swingup.policy.guard import GuardSettings, Reason, choose_guard
from swingup.policy.numpy_backend import numpy_controller
from swingup.policy.shipped import load_pendulum_policy

from . import compiled

SAME, REVERSED, SWAPPED = np.eye(2), -np.eye(2), np.eye(2)[::-1]
CASES = {
    "right": (SAME, SAME, {Reason.NONE}),
    "encoder 1": (np.diag([-1.0, 1.0]), SAME, {Reason.ENCODER}),
    "encoder 2": (np.diag([1.0, -1.0]), SAME, {Reason.ENCODER}),
    "encoders": (SWAPPED, SAME, {Reason.SWAPPED, Reason.MOTOR}),
    "motors reversed": (SAME, REVERSED, {Reason.SWAPPED, Reason.MOTOR}),
    "motors": (SAME, SWAPPED, {Reason.UNDRIVEN}),
    "no torque": (SAME, np.zeros((2, 2)), {Reason.UNDRIVEN}),
    "joints": (SWAPPED, SWAPPED, {Reason.UNDRIVEN}),
}
"""From true angles to measured ones, from commanded torques to those that act, and the reasons of the stop.

Motors that turn the other way race: few blocks are slow enough to tell them from joints that are swapped.
"""
PASSIVE_LIMIT = 0.5  # Of the motor at the joint that the robot does not drive (N m)


def closed_loop(controller, angles, torques, seconds=1.0, period=0.002, driven=None):
    """Times and measured states of a run on C.1 with half more friction, 4 ms late.

    With the driven joint, the other's motor has its limit.
    """
    plant = load_plant("C.1")
    friction = Friction((1.5 * plant.b1, 1.5 * plant.b2), (1.5 * plant.cf1, 1.5 * plant.cf2))
    x, late, times, states = (0.01, -0.01, 0.0, 0.0), [np.zeros(2)] * 2, [], []
    for t in period * np.arange(round(seconds / period)):
        q, v = np.round(angles @ x[:2] / 3.81e-4) * 3.81e-4, angles @ x[2:]
        times.append(float(t))
        states.append(np.array([*q, *v]))
        late.append(controller(states[-1], float(t)))
        u = torques @ late.pop(0)
        if driven is not None:
            u[1 - driven] = np.clip(u[1 - driven], -PASSIVE_LIMIT, PASSIVE_LIMIT)
        for _ in range(4):
            x = damped_midpoint_step(lump(plant), friction, x, (u[0], u[1]), period / 4, NUMPY)
    return np.array(times), np.array(states)


@pytest.mark.parametrize("robot", ROBOTS)
@pytest.mark.parametrize("case", CASES)
def test_what_is_wired_wrongly_is_named(case, robot):
    angles, torques, reasons = CASES[case]
    policy = load_pendulum_policy("ar-eapo", robot)
    controller = numpy_controller(policy, guard=True)
    closed_loop(controller, angles, torques, driven=ROBOTS[robot].joint)
    assert (controller.fault.reason if controller.fault else Reason.NONE) in reasons
    unwatched = numpy_controller(policy, guard=GuardSettings(velocity_limit=1e3, watched=0.0))
    closed_loop(unwatched, angles, torques, driven=ROBOTS[robot].joint)
    assert unwatched.fault is None


def test_a_period_that_the_estimator_does_not_bear():
    policy = load_pendulum_policy("adaptive", "acrobot")
    for period, reason in ((0.005, Reason.NONE), (0.001, Reason.NONE), (0.0075, Reason.PERIOD)):
        controller = numpy_controller(policy, guard=True)
        closed_loop(controller, np.eye(2), np.eye(2), 0.7, period)
        assert (controller.fault.reason if controller.fault else Reason.NONE) == reason


@compiled.needs_gcc
@pytest.mark.parametrize("robot", ROBOTS)
@pytest.mark.parametrize("case", [*CASES, "period"])
def test_c_does_the_same(case, robot, tmp_path):
    angles, torques, _ = CASES.get(case, CASES["right"])
    name, period, given = (
        ("adaptive", 0.0075, True) if case == "period" else ("ar-eapo", 0.002, {"velocity_limit": 1e3})
    )
    policy = load_pendulum_policy(name, robot)
    policy = dataclasses.replace(policy, guard=choose_guard(given, policy.guard, policy.period, policy.plant))
    controller = numpy_controller(policy)
    times, states = closed_loop(controller, angles, torques, period=period, driven=ROBOTS[robot].joint)
    _, reasons, last, _ = compiled.watch(compiled.compile_header(tmp_path, c_header(policy)), times, states)
    fault = controller.fault
    assert reasons[-1] == (fault.reason if fault else 0)
    assert (fault is None) == (case == "right")
    if fault:
        np.testing.assert_allclose(last, [fault.joint, fault.time, fault.value], rtol=1e-9)
