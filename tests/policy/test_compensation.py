"""Compensation of the friction found: by hand, and with the offsets and the gain found on moving plants."""

import dataclasses

import numpy as np
import pytest

from swingup.plant.base_parameters import base_parameters
from swingup.plant.damped import Friction
from swingup.plant.plant import LEADERBOARD
from swingup.policy.identifier.compensation import Load, compensation
from swingup.policy.identifier.settings import GAIN, IdentifierSettings, offsets

from .test_identifier import DT, LOADED, moved

FOUND = Friction((0.02, 0.1), (0.3, -0.06))
"""The elbow's Coulomb friction is negative."""


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


def test_offsets_are_bounded():
    """κ1 = k o1 and κ2 = m2 r2 (o1 + o2), with k = 0.5 and m2 r2 = 0.2."""
    theta = [0.0, 0.0, 0.2, 0.5]
    assert offsets(0.015, 0.002, theta, np.clip) == pytest.approx((0.03, -0.02))
    # Neither o1 nor o1 + o2 is believed beyond 0.1 rad.
    assert offsets(1.0, -1.0, theta, np.clip) == pytest.approx((0.1, -0.2))


def finding(robot, passive, **given):
    """A plant with a heavy second link and Coulomb friction of the passive joint (N m), and what is found of it."""
    plant = LEADERBOARD.driven(robot)
    cf1, cf2 = (0.1, passive) if robot.joint == 0 else (passive, 0.1)
    plant = dataclasses.replace(plant, m2=1.1 * plant.m2, cf1=cf1, cf2=cf2, b1=0.02, b2=0.01)
    return plant, moved(
        plant, **{"settings": IdentifierSettings(), "robot": robot, "periods": np.full(1200, DT), **given}
    )


def test_it_finds_the_offsets(either_robot):
    wrong = np.array([0.03, -0.02])
    plant, (_, _, found, *_) = finding(either_robot, 0.15, change=lambda step, q: q + wrong)
    np.testing.assert_allclose(found.offsets, wrong, rtol=0, atol=0.002)
    np.testing.assert_allclose(found.theta[:4], base_parameters(plant)[:4], rtol=0.01)


def test_it_finds_springs_and_constant_torques(either_robot):
    """A motor carries all of its own joint's load; a compensating one carries it as the driven one would."""
    load = Load((0.05, -0.03), (0.03, 0.02))
    _, (_, _, found, *_) = finding(either_robot, 0.15, load=load, settings=LOADED)
    np.testing.assert_allclose(found.commanded_load.constant, load.constant, rtol=0, atol=0.01)
    # About hanging a spring at the shoulder looks like a little more of gravity.
    np.testing.assert_allclose(found.commanded_load.spring, load.spring, rtol=0, atol=0.02)
    left = found.load.at(1.0, 1.0)
    assert left[either_robot.joint] == sum(pair[either_robot.joint] for pair in found.commanded_load)
    assert left[1 - either_robot.joint] == pytest.approx(0.0, abs=1e-12)


@pytest.mark.parametrize("gain", [0.85, 0.0])
def test_it_finds_the_gain_of_the_undriven_joints_motor(either_robot, gain):
    """A dead motor leaves all friction, a live one none: policy and regulator are told so."""
    passive, (_, (_, state, found, *_)) = 1 - either_robot.joint, finding(either_robot, 0.3, gain=gain)
    assert state.unknowns[GAIN] == pytest.approx(gain, abs=0.05)
    assert found.theta[6 + passive] == pytest.approx(0.3, abs=0.015)
    told, remaining = found.residual_base, found.friction
    assert told[6 + passive] == pytest.approx(0.0 if gain else 0.3, abs=0.02)
    assert told[7 - passive] == pytest.approx(0.0, abs=1e-12)
    assert remaining.coulomb[passive] == pytest.approx(told[6 + passive], abs=1e-12)
    assert remaining.coulomb[1 - passive] == pytest.approx(0.1, abs=0.01)
