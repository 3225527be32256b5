"""The plant in policy files of version 2, the estimator's model, and what is said of a plant that differs."""

import dataclasses

import numpy as np
import pytest

from array_files import change_file
from policies import lone_policy
from swingup.common.errors import SwingupError
from swingup.controllers.stack.controller import make_controller, save_controller
from swingup.export.c_backend.header import c_header
from swingup.plant.base_parameters import base_parameters
from swingup.plant.damped import Friction, damped_midpoint_step
from swingup.plant.equations import acceleration, lump
from swingup.plant.maths import NUMPY
from swingup.plant.plant import LEADERBOARD, load_plant
from swingup.plant.robots import get_robot
from swingup.policy.network.stages import PlantStage
from swingup.policy.pendulum import read_pendulum_policy, write_pendulum_policy
from swingup.policy.plant_facts import plant_difference, policy_plant, write_plant

from .references import policy

ACROBOT = get_robot("acrobot")
WIDE = dataclasses.replace(load_plant("C.1"), tl1=10.0, tl2=10.0, name="mine.yml")
MINE = policy_plant(WIDE, ACROBOT)
ARRAYS = NUMPY._replace(sine_cosine=lambda angle: (np.sin(angle), np.cos(angle)), arctan=np.arctan)


def rewritten(path, **changes):
    """A file with other metadata; a value of None removes its key."""
    change_file(path, changes)
    return path


@pytest.fixture
def mine(tmp_path):
    """A policy file for another plant."""
    path = tmp_path / "mine.safetensors"
    write_pendulum_policy(path, dataclasses.replace(policy("acrobot-ar-eapo"), plant=MINE), {"estimator": {}})
    return path


def test_a_file_carries_its_plant(mine, tmp_path):
    found = read_pendulum_policy(mine)
    assert (found.plant, found.plant.name) == (MINE, "mine.yml")
    # The shoulder is passive: its motor has no torque.
    assert (found.plant.tl1, found.torque_limits) == (0.0, (0.0, 10.0))
    # From JAX, with the old metadata as provenance, as refine writes: the plant stays.
    alone, metadata = lone_policy(mine)
    save_controller(tmp_path / "again.safetensors", alone, metadata)
    assert read_pendulum_policy(tmp_path / "again.safetensors").plant == MINE
    assert make_controller(found).plant.values() == MINE.values()


@pytest.mark.parametrize("name", ["acrobot", "pendubot"])
def test_the_shipped_policies_are_for_the_leaderboards_plant(name):
    found, p = policy(f"{name}-estimated"), LEADERBOARD.driven(get_robot(name))
    assert found.plant.values() == p.values()
    assert found.plant.friction is None
    assert "/* The plant is leaderboard. */" in c_header(found)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"plant": "C.1"}, "plant 'C.1' is not an object of parameters"),
        ({"plant": {**write_plant(MINE), "m3": 1.0}}, "unknown plant parameter 'm3': use m1, m2"),
        ({"plant": {**write_plant(MINE), "name": 3}}, "plant name 3 is not a text"),
        ({"plant": {"m1": 0.5}}, "its plant lacks m2, l1, l2"),
        ({"plant": {**write_plant(MINE), "m1": "0.5"}}, "plant parameter m1 = '0.5': use a number from"),
        ({"plant": {**write_plant(MINE), "I2": 0.0001}}, "mass matrix is not positive definite"),
        ({"plant": {**write_plant(MINE), "l1": -0.2}}, "parameter l1 = -0.2 must be positive"),
        ({"plant": {**write_plant(MINE), "tl2": 0.0}}, "tl2 = 0: the acrobot's driven joint needs a torque limit"),
    ],
)
def test_plants_that_cannot_be(mine, changes, message):
    with pytest.raises(SwingupError, match=message) as caught:
        read_pendulum_policy(rewritten(mine, **changes))
    assert str(mine) in str(caught.value)
    assert "\n" not in str(caught.value)


def test_a_file_needs_a_plant(mine):
    with pytest.raises(SwingupError, match="lacks metadata plant"):
        read_pendulum_policy(rewritten(mine, plant=None))


def test_a_name_ends_no_comment_in_c():
    plant = dataclasses.replace(MINE, name="*/ system();\n/*")
    assert "*/ system" not in c_header(dataclasses.replace(policy("acrobot-ar-eapo"), plant=plant))


STATE, TORQUES = (0.4, -0.8, 3.0, -2.0), (1.0, -2.0)


def rates_without_friction(plant, friction, x, u):
    """ẋ with explicit friction, for a fine integration."""
    b, cf = friction
    losses = [b[i] * x[2 + i] + cf[i] * np.arctan(100 * x[2 + i]) for i in (0, 1)]
    sines = np.sin(x[0]), np.sin(x[1]), np.sin(x[0] + x[1])
    return np.array([*x[2:], *acceleration(plant, sines, np.cos(x[1]), x[2:], u, losses)])


def test_the_damped_step_follows_the_equations():
    """Against 2,000 small steps: the error of one step of h falls with its square, where friction is smooth."""
    plant, friction = lump(MINE), Friction((0.05, 0.02), (0.1, 0.1))
    errors = []
    for h in (0.008, 0.004):
        x, small = np.array(STATE), h / 2000
        for _ in range(2000):
            k1 = rates_without_friction(plant, friction, x, TORQUES)
            k2 = rates_without_friction(plant, friction, x + small / 2 * k1, TORQUES)
            x = x + small * k2
        found = damped_midpoint_step(plant, friction, STATE, TORQUES, h, ARRAYS)
        errors.append(np.abs(np.array(found) - x).max())
    assert errors[0] < 4e-3
    assert errors[0] / errors[1] > 3.5


def test_without_friction_the_step_is_the_midpoint_rules():
    plant = lump(LEADERBOARD.driven(ACROBOT))
    found = damped_midpoint_step(plant, Friction((0.0, 0.0), (0.0, 0.0)), STATE, TORQUES, 0.01, ARRAYS)
    assert found == damped_midpoint_step(plant, None, STATE, TORQUES, 0.01, ARRAYS)
    x, none = np.array(STATE), Friction((0.0, 0.0), (0.0, 0.0))
    middle = x + 0.005 * rates_without_friction(plant, none, x, TORQUES)
    np.testing.assert_allclose(found, x + 0.01 * rates_without_friction(plant, none, middle, TORQUES), rtol=1e-14)


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


@pytest.mark.parametrize(
    ("plant", "said"),
    [
        (MINE, None),
        (scaled(r2=1.08), None),
        # m2 r2 alone: m2 and r2 act as a product, and as m2 l1 and m2 l1².
        (scaled(r2=1.3), "with m2 r2 = 0.16, here it is 0.2079 (+30 % of it)"),
        (scaled(tl2=0.5), "with the torque limit = 10, here it is 5 (-50 % of it)"),
        (scaled(cf1=6.0), "friction of the shoulder = 0.2507, here it is 1.499 (+12 % of the torque limit)"),
        # m1 r1 + m2 l1 = 0.105 + 0.125; a link of half the length changes it, I1 + m2 l1² and l1 itself, most.
        (scaled(l1=0.5), "with l1 = 0.2, here it is 0.1 (-50 % of it; 2 more differ by over 10 %)"),
    ],
)
def test_what_differs(plant, said):
    found = plant_difference(MINE, plant, ACROBOT)
    if said is None:
        assert found is None
    else:
        assert found.startswith("the policy was made for a plant 'mine.yml' with ")
        assert said in found
        assert found.endswith(": train or refine it on this plant")


def test_the_leaderboards_policies_on_the_identified_plant():
    """Its frictions are below 10 % of 6 N m, and its motors' limit of 10 N m is said."""
    made_for = LEADERBOARD.driven(ACROBOT)
    assert "the torque limit = 6, here it is 10" in plant_difference(made_for, WIDE, ACROBOT)
    assert plant_difference(made_for, load_plant("C.1"), ACROBOT) is None


@pytest.mark.parametrize(
    ("plant", "said"),
    [
        (scaled(r2=1.3, cf1=20.0), None),
        # Bounds: 10 times 0.15 of the own value away.
        (scaled(I2=2.6), "a base parameter B from 0 to 0.127, here it is 0.132: train or refine another"),
        (scaled(tl2=0.5), "with the torque limit = 10, here it is 5 (-50 % of it): train or refine"),
        (scaled(l1=0.5), "with l1 = 0.2, here it is 0.1 (-50 % of it): train or refine"),
    ],
)
def test_a_policy_that_is_told_its_plant_is_for_many(plant, said):
    base = base_parameters(MINE)
    stage = PlantStage(base, np.where(base > 0, 0.15 * base, 1.0))
    found = plant_difference(MINE, plant, ACROBOT, stage)
    assert found is None if said is None else said in found
