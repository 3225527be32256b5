"""The estimator's model with friction, what is said of a plant that differs, and similar plants' policies."""

import dataclasses
import re

import numpy as np
import pytest

from refusals import refusal
from swingup.controllers.registry import get_controller
from swingup.controllers.stack.policy import policy_alone
from swingup.loop.resolve import resolve
from swingup.plant.base_parameters import base_parameters
from swingup.plant.equations import NUMPY, Friction, damped_midpoint_step
from swingup.plant.files import load_plant
from swingup.plant.plant import LEADERBOARD, get_robot, lump
from swingup.plant.units import Scales, arm_scales, scales_of, similar_plant
from swingup.policy.network import PlantStage
from swingup.policy.pendulum import for_plant, plant_difference, policy_plant, write_pendulum_policy
from swingup.policy.shipped import load_policy
from swingup.refine.adapt import shipped_for
from swingup.refine.recipe import for_similar_plant, wrapped_policy

from .backends import C, Numpy
from .backends import Jax as InJax
from .references import policy

ACROBOT = get_robot("acrobot")
WIDE = dataclasses.replace(load_plant("C.1"), tl1=10.0, tl2=10.0, name="mine.yml")
MINE = policy_plant(WIDE, ACROBOT)


def test_stiff_friction_brings_to_rest():
    """λ h is at least 100 · 0.002 / 1e-4 · 0.004 = 8 for a 5 cm link, where the explicit rule diverges above 2."""
    rods = {"m1": 0.1, "m2": 0.1, "l1": 0.05, "l2": 0.05, "r1": 0.025, "r2": 0.025, "I1": 1e-4, "I2": 1e-4}
    plant = lump(dataclasses.replace(MINE, **rods, Ir=0.0, gr=1.0))
    x, friction = (0.0, 0.0, 0.3, -0.3), Friction((0.0, 0.0), (0.002, 0.002))
    for _ in range(100):
        x = damped_midpoint_step(plant, friction, x, (0.0, 0.0), 0.004, NUMPY)
        assert np.abs(x[2:]).max() < 0.3
    # The rest is gravity's: friction as smooth as this creeps.
    assert np.abs(x[2:]).max() < 0.01


def scaled(**factors):
    return dataclasses.replace(MINE, **{name: getattr(MINE, name) * factor for name, factor in factors.items()})


DIFFERENCES = [
    (MINE, None),
    (scaled(r2=1.08), None),
    # m2 r2 alone: m2 and r2 act as a product, and as m2 l1 and m2 l1².
    (scaled(r2=1.3), "with m2 r2 = 0.16, here it is 0.2079 (+30 % of it)"),
    (scaled(tl2=0.5), "with the torque limit = 10, here it is 5 (-50 % of it)"),
    (scaled(cf1=6.0), "friction of the shoulder = 0.2507, here it is 1.499 (+12 % of the torque limit)"),
    # m1 r1 + m2 l1 = 0.105 + 0.125; a link of half the length changes it, I1 + m2 l1² and l1 itself, most.
    (scaled(l1=0.5), "with l1 = 0.2, here it is 0.1 (-50 % of it; 2 more differ by over 10 %)"),
]
BASE = base_parameters(MINE)
FOR_MANY = PlantStage(BASE, np.where(BASE > 0, 0.15 * BASE, 1.0))
"""A policy that is told its plant, 10 times 0.15 of the own value away."""
DIFFERENCES_FOR_MANY = [
    (scaled(r2=1.3, cf1=20.0), None),
    (scaled(I2=2.6), "a base parameter B from 0 to 0.127, here it is 0.132: train or refine another"),
]


@pytest.mark.parametrize(
    ("plant", "said", "stage"),
    [*((*each, None) for each in DIFFERENCES), *((*each, FOR_MANY) for each in DIFFERENCES_FOR_MANY)],
)
def test_what_differs(plant, said, stage):
    found = plant_difference(MINE, plant, ACROBOT, stage)
    assert found is None if said is None else said in found
    # The shipped policies are for the leaderboards' plant. C.1's frictions are below 10 % of 6 N m.
    made_for = policy("acrobot-ar-eapo").plant
    assert made_for.values() == LEADERBOARD.driven(ACROBOT).values()
    assert "the torque limit = 6, here it is 10" in plant_difference(made_for, WIDE, ACROBOT)
    assert plant_difference(made_for, load_plant("C.1"), ACROBOT) is None


SCALES = Scales(time=0.5, torque=0.02, length=0.25)
"""Half of C.1's time, a fiftieth of its torque, and a quarter of its lengths."""


@pytest.fixture(scope="module")
def pair():
    """The shipped policy, and that of a similar plant."""
    one = load_policy("adaptive", "acrobot")
    other = for_plant(one, similar_plant(LEADERBOARD, Scales(2.0, 50.0, 4.0)))
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
    back = for_plant(other, LEADERBOARD)
    assert back.plant.values() == pytest.approx(one.plant.values())
    assert back.torque_limit == one.torque_limit
    # What a recipe makes of the network has the same around it.
    made = wrapped_policy(for_similar_plant(policy_alone(one), other.plant))
    assert (made.identifier, made.regulator) == (other.identifier, other.regulator)
    for noise in ("velocity_noise", "acceleration_noise"):
        assert getattr(made.estimator, noise) == getattr(other.estimator, noise)


def test_the_shipped_policy_is_for_similar_pendulums_of_any_size(either_robot, similar):
    plants = "C.1", similar(load_plant("C.1")), "A.0"
    own, small, other = (shipped_for(resolve(plant, share=0.1), either_robot) for plant in plants)
    assert small.plant.values() == pytest.approx(similar(own.plant).values())
    assert other is None
    named = refusal(get_controller, "adaptive", either_robot, plant="A.0")
    assert re.match("policy 'adaptive': the policy can be told a base parameter B from .* train or refine", named)
    told = get_controller("adaptive", either_robot, plant="C.0")
    assert told.plant == load_plant("C.0").frictionless().driven(either_robot)


def test_a_plant_that_is_given_counts_and_the_policys_own_without(tmp_path):
    """The leaderboards' as well, though baselines are designed for it by default."""
    file = str(tmp_path / "policy.safetensors")
    write_pendulum_policy(file, load_policy("adaptive", ACROBOT, "C.0"), {})
    own, other = load_plant("C.0").frictionless().driven(ACROBOT), LEADERBOARD.driven(ACROBOT)
    for plant, expected in ((None, own), ("leaderboard", other), (LEADERBOARD, other)):
        assert get_controller(file, ACROBOT, plant=plant).plant.values() == pytest.approx(expected.values())
    assert get_controller(file, ACROBOT, design=LEADERBOARD).plant.values() == pytest.approx(own.values())


@pytest.mark.parametrize("kind", [Numpy, C, pytest.param(InJax, marks=pytest.mark.slow)])
def test_it_gives_the_same_torques_in_its_units(pair, kind, tmp_path):
    (one, other), (times, states) = pair, a_run(600)
    similar = states * [1.0, 1.0, 1.0 / SCALES.time, 1.0 / SCALES.time]
    (tmp_path / "other").mkdir()
    expected = kind(one, tmp_path).run(times, states)
    found = kind(other, tmp_path / "other").run(SCALES.time * times, similar)
    assert 1.0 < np.abs(expected).max() <= 6.0
    np.testing.assert_allclose(found / SCALES.torque, expected, atol=2e-5)
