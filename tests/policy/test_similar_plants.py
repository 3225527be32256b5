"""Plants that move alike get the same controller: all around the network computes in C.1's units."""

import dataclasses
import re

import numpy as np
import pytest

from refusals import refusal
from swingup.controllers.registry import get_controller
from swingup.controllers.stack.controller import policy_alone
from swingup.loop.on_plant import drawn_around
from swingup.plant.plant import load_plant
from swingup.plant.units import Scales, arm_scales, scales_of, similar_plant
from swingup.policy.pendulum import for_plant
from swingup.policy.shipped import load_policy
from swingup.refine.recipe import on_plant, shipped_for, wrapped_policy

from .backends import C, Numpy
from .backends import Jax as InJax

SCALES = Scales(time=0.5, torque=0.02, length=0.25)
"""Half of C.1's time, a fiftieth of its torque, and a quarter of its lengths."""


@pytest.fixture(scope="module")
def pair():
    """The shipped policy, and that of a similar plant."""
    one = load_policy("adaptive", "acrobot")
    other = for_plant(one, similar_plant(one.plant, Scales(2.0, 50.0, 4.0)))
    # The loop's period is no property of the plant: alike is a loop of twice the rate.
    return one, dataclasses.replace(
        other, estimator=dataclasses.replace(other.estimator, dt=0.001, longest_gap=0.025)
    )


def a_run(rows):
    """Times (s) and states of C.1: it swings, falls and comes near upright."""
    time = 0.002 * np.arange(rows)
    angles = np.stack([np.pi * (1 - np.cos(4 * time)), 0.4 * np.sin(9 * time)])
    rates = np.stack([4 * np.pi * np.sin(4 * time), 3.6 * np.cos(9 * time)])
    return time, np.concatenate([angles, rates]).T


def test_a_similar_plants_policy_is_the_same_in_its_units(pair):
    one, other = pair
    for scales in (scales_of(other.plant), arm_scales(other.plant)):
        assert tuple(scales) == pytest.approx(tuple(SCALES))
    assert other.identifier.passive_limit == pytest.approx(0.01)
    back = for_plant(other, one.plant)
    assert back.plant.values() == pytest.approx(one.plant.values())
    assert back.torque_limit == one.torque_limit
    # What a recipe makes of the network has the same around it.
    made = wrapped_policy(on_plant(policy_alone(one), other.plant))
    assert (made.identifier, made.regulator) == (other.identifier, other.regulator)
    assert made.estimator.acceleration_noise == other.estimator.acceleration_noise


def test_the_shipped_policy_is_for_similar_pendulums_of_any_size(either_robot, similar):
    plants = "C.1", similar(load_plant("C.1")), "A.0"
    own, small, other = (shipped_for(drawn_around(plant), either_robot) for plant in plants)
    assert small.plant.values() == pytest.approx(similar(own.plant).values())
    assert other is None
    named = refusal(get_controller, "adaptive", either_robot, plant="A.0")
    assert re.match("policy 'adaptive': the policy can be told a base parameter B from .* train or refine", named)
    told = get_controller("adaptive", either_robot, plant="C.0")
    assert told.plant == load_plant("C.0").frictionless().driven(either_robot)


@pytest.mark.parametrize("kind", [Numpy, C, pytest.param(InJax, marks=pytest.mark.slow)])
def test_it_gives_the_same_torques_in_its_units(pair, kind, tmp_path):
    (one, other), (times, states) = pair, a_run(600)
    similar = states * [1.0, 1.0, 1.0 / SCALES.time, 1.0 / SCALES.time]
    (tmp_path / "other").mkdir()
    expected = kind(one, tmp_path).run(times, states)
    found = kind(other, tmp_path / "other").run(SCALES.time * times, similar)
    assert 1.0 < np.abs(expected).max() <= 6.0
    np.testing.assert_allclose(found / SCALES.torque, expected, atol=2e-5)
