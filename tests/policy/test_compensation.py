"""Compensation of the friction found: by hand, and with the offsets and the gain found on moving plants."""

import dataclasses
import math
from types import SimpleNamespace

import numpy as np
import pytest

from refusals import refusal
from swingup.plant.base_parameters import base_parameters
from swingup.plant.damped import Friction, damped_midpoint_step
from swingup.plant.equations import friction, lump
from swingup.plant.maths import NUMPY
from swingup.plant.plant import load_plant
from swingup.policy.identifier import core
from swingup.policy.identifier.compensation import Load, compensation
from swingup.policy.identifier.settings import GAIN, IdentifierSettings, offsets, prior
from swingup.policy.identifier.state import make_loop
from swingup.policy.plant_facts import policy_plant

DT, FINE = 0.002, 4
FOUND = Friction((0.02, 0.1), (0.3, -0.06))
"""The elbow's Coulomb friction is negative."""
LOADED = IdentifierSettings(load_deviation=0.05, spring_deviation=0.02)
"""Expects springs and constant torques."""


@pytest.mark.parametrize(
    ("gain", "limit", "asks", "delivered"),
    [
        (1.0, 0.5, 1.0, 1.0),
        # In units of the driven joint's motor, which may deliver less.
        (2.0, 0.5, 0.5, 2.0),
        (0.8, 0.5, 1.25, 0.8),
        # Of a weak one 1/0.6 of the friction is asked, and half of the friction remains.
        (0.3, 0.5, 1 / 0.6, 0.3),
        (-0.2, 0.5, 1 / 0.6, 0.0),
        (1.0, 0.0, 0.0, 1.0),
    ],
)
def test_compensation_by_hand(gain, limit, asks, delivered):
    """Asked, left and predicted with: (b1, b2), (cf1, cf2). No motor is asked for negative friction."""
    rest = 1 - asks * delivered
    acrobots = [
        ((0.02 * asks, 0.1), (0.3 * asks, 0.0)),
        ((0.02 * rest, 0.0), (0.3 * rest, -0.06)),
        # The driven motor's torque is counted: all of that joint's friction is predicted with.
        ((0.02 * rest, 0.1), (0.3 * rest, 0.0)),
    ]
    pendubots = [
        ((0.02, 0.1 * asks), (0.3, 0.0)),
        ((0.0, 0.1 * rest), (0.0, -0.06)),
        ((0.02, 0.1 * rest), (0.3, 0.0)),
    ]
    for joint, expected in enumerate((pendubots, acrobots)):
        np.testing.assert_allclose(compensation(FOUND, gain, joint, limit, max), expected, rtol=1e-9, atol=1e-15)


def test_negative_friction_of_the_undriven_joint_stays():
    found = compensation(Friction((-0.02, 0.1), (-0.3, 0.06)), 1.0, 1, 0.5, max)
    assert found[:2] == (((0.0, 0.1), (0.0, 0.06)), ((-0.02, 0.0), (-0.3, 0.0)))


def test_offsets_are_bounded():
    """κ1 = k o1 and κ2 = m2 r2 (o1 + o2), with k = 0.5 and m2 r2 = 0.2."""
    theta = [0.0, 0.0, 0.2, 0.5]
    assert offsets(0.015, 0.002, theta, np.clip) == pytest.approx((0.03, -0.02))
    # Neither o1 nor o1 + o2 is believed beyond 0.1 rad.
    assert offsets(1.0, -1.0, theta, np.clip) == pytest.approx((0.1, -0.2))


def test_gravity_on_no_link_tells_no_offset():
    plant = load_plant("C.1").values()
    for name, value in (("r2", 0.0), ("r1", -plant["m2"] * plant["l1"] / plant["m1"])):
        named = "gives an identifier nothing to find the offsets by"
        assert named in refusal(prior, SimpleNamespace(**{**plant, name: value}))


def moved(robot, plant, gain=1.0, wrong=(0.0, 0.0), steps=1200, load=None):
    """What an identifier finds on a plant that swings under torques.

    The undriven joint's motor has the compensation's commands and some gain. Measured angles are wrong by offsets
    (rad). Springs and cables may load the joints.
    """
    nominal = policy_plant(load_plant("C.1"), robot)
    loop = make_loop(nominal, robot.joint, DT, 25, IdentifierSettings() if load is None else LOADED)
    lumped, x, passive, limit = lump(plant), (0.0,) * 4, 1 - robot.joint, loop.passive_limit
    state = core.begin(NUMPY, loop)
    for step in range(steps):
        t, u = step * DT, np.zeros(2)
        state = core.observe(NUMPY, loop, state, np.add(x[:2], wrong), 0, DT)
        u[robot.joint] = 1.5 * math.sin(6.5 * t) + math.sin(15 * t + 1)
        b, cf = (pair[passive] for pair in core.found(NUMPY, loop, state).commanded_friction)
        u[passive] = np.clip(friction(b, cf, x[2 + passive], math.atan), -limit, limit)
        state = core.remember(NUMPY, state, u.copy())
        u[passive] *= gain
        applied = u
        for _ in range(FINE):
            if load is not None:
                u = applied - load.at(*x[:2])
            x = damped_midpoint_step(lumped, plant.friction, x, u.tolist(), DT / FINE, NUMPY)
    return state, core.found(NUMPY, loop, state)


def changed(robot, passive):
    """C.1 with a heavier second link, and Coulomb friction of the passive joint (N m)."""
    plant = policy_plant(load_plant("C.1"), robot)
    cf1, cf2 = (0.1, passive) if robot.joint == 0 else (passive, 0.1)
    return dataclasses.replace(plant, m2=1.1 * plant.m2, cf1=cf1, cf2=cf2, b1=0.02, b2=0.01)


def test_it_finds_the_offsets(either_robot):
    plant, wrong = changed(either_robot, 0.15), (0.03, -0.02)
    _, found = moved(either_robot, plant, wrong=wrong)
    np.testing.assert_allclose(found.offsets, wrong, rtol=0, atol=0.002)
    np.testing.assert_allclose(found.theta[:4], base_parameters(plant)[:4], rtol=0.01)


def test_it_finds_springs_and_constant_torques(either_robot):
    """A motor carries all of its own joint's load; a compensating one carries it as the driven one would."""
    load = Load((0.05, -0.03), (0.03, 0.02))
    _, found = moved(either_robot, changed(either_robot, 0.15), load=load)
    np.testing.assert_allclose(found.commanded_load.constant, load.constant, rtol=0, atol=0.01)
    # About hanging a spring at the shoulder looks like a little more of gravity.
    np.testing.assert_allclose(found.commanded_load.spring, load.spring, rtol=0, atol=0.02)
    left = found.load.at(1.0, 1.0)
    assert left[either_robot.joint] == sum(pair[either_robot.joint] for pair in found.commanded_load)
    assert left[1 - either_robot.joint] == pytest.approx(0.0, abs=1e-12)


@pytest.mark.parametrize("gain", [0.85, 0.0])
def test_it_finds_the_gain_of_the_undriven_joints_motor(either_robot, gain):
    """A dead motor leaves all friction, a live one none: policy and regulator are told so."""
    plant, passive = changed(either_robot, 0.3), 1 - either_robot.joint
    state, found = moved(either_robot, plant, gain)
    assert state.unknowns[GAIN] == pytest.approx(gain, abs=0.05)
    assert found.theta[6 + passive] == pytest.approx(0.3, abs=0.015)
    told, remaining = found.residual_base, found.friction
    assert told[6 + passive] == pytest.approx(0.0 if gain else 0.3, abs=0.02)
    assert told[7 - passive] == pytest.approx(0.0, abs=1e-12)
    assert remaining.coulomb[passive] == pytest.approx(told[6 + passive], abs=1e-12)
    assert remaining.coulomb[1 - passive] == pytest.approx(0.1, abs=0.01)
