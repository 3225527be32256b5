import dataclasses

import jax
import numpy as np
import pytest

from refusals import refusal
from swingup.benchmark.boards import ROBUSTNESS
from swingup.benchmark.robustness_board import upright
from swingup.benchmark.rollout import Scenario
from swingup.benchmark.runner import run_one
from swingup.controllers.baselines import continuation
from swingup.controllers.baselines.baselines import shipped_reference
from swingup.controllers.baselines.continuation import accepted, continue_swingups, nominal_swingups
from swingup.controllers.baselines.continuation_settings import ContinuationSettings
from swingup.controllers.baselines.dry_friction import linear_friction
from swingup.dynamics.angles import UPRIGHT
from swingup.plant.plant import LEADERBOARD, NAMES
from swingup.plant.robots import ROBOTS

SETTINGS = ContinuationSettings()
LONG_STEPS = dataclasses.replace(SETTINGS, first_step=0.2, largest_step=0.4)
"""Longer than the default ones, for which all steps are of one length."""


def stacked(*plants):
    return jax.tree.map(lambda *values: np.array(values, float), *plants)


def test_nominal_swing_ups_are_the_shipped_one_and_then_rest(robot):
    found, shipped = nominal_swingups(robot, 3, SETTINGS), shipped_reference(robot, "score")[0]
    rows = len(shipped.torque) + 100  # 0.2 s of 2 ms
    shapes = found.states.shape, found.torque.shape, found.gains.shape
    assert shapes == ((3, rows + 1, 4), (3, rows), (3, rows, 4))
    np.testing.assert_array_equal(found.states[1, :-101], shipped.states)
    np.testing.assert_array_equal(found.states[2, -101:], np.tile(UPRIGHT, (101, 1)))
    np.testing.assert_array_equal(found.torque[0, -100:], 0.0)
    np.testing.assert_array_equal(found.reached, 0.0)
    follow = found.reference(1)
    assert (follow.states.shape, follow.gains.shape, follow.dt) == ((rows, 4), (rows, 4), shipped.dt)


def test_a_swing_up_counts_if_it_is_cheap_slow_upright_finite_and_within_the_motors_torque():
    nominal = nominal_swingups(ROBOTS["acrobot"], 7, SETTINGS)
    states, torque, gains = nominal.states.copy(), nominal.torque.copy(), nominal.gains.copy()
    states[1, -1, 0] += 0.16
    states[2, -1, 3] = np.nan
    torque[3, 100] = -6.1
    gains[4, 0, 0] = np.inf
    states[6, 100, 3] = 14.1
    cost = np.array([0.24, 0.24, 0.24, 0.24, 0.24, 0.26, 0.24])
    tried = dataclasses.replace(nominal, states=states, torque=torque, gains=gains, cost=cost)
    np.testing.assert_array_equal(accepted(tried, SETTINGS), [True, *[False] * 6])


def test_what_is_no_batch_of_pendulums():
    nominal = LEADERBOARD.driven(ROBOTS["acrobot"])
    plants = stacked(nominal, nominal)
    for shape in ((), (0,), (3,), (2, 1)):
        named = f"parameter b1 has shape {shape}: give every parameter one value for each plant"
        assert refusal(continue_swingups, "acrobot", dataclasses.replace(plants, b1=np.zeros(shape))) == named
    assert "m2" in refusal(continue_swingups, "acrobot", stacked(nominal, dataclasses.replace(nominal, m2=-1.0)))


def test_plants_move_by_steps_of_their_own(monkeypatch):
    """With an optimiser that fails above the nominal mass: one plant arrives, the other is given up."""
    nominal, called = LEADERBOARD.driven(ROBOTS["acrobot"]), []

    def optimised(swingups, settings):
        called.append(len(swingups.reached))
        failed = swingups.plants.m2 > nominal.m2 + 0.06
        return dataclasses.replace(swingups, cost=np.where(failed, np.nan, 0.16))

    monkeypatch.setattr(continuation, "_optimised", optimised)
    targets = stacked(*(dataclasses.replace(nominal, m2=nominal.m2 + more) for more in (-0.1, 0.1)))
    told = []
    settings = dataclasses.replace(LONG_STEPS, batch=3)
    found = continue_swingups("acrobot", targets, settings, lambda done, total: told.append((done, total)))
    assert found.reached[0] == 1.0
    # All parameters are the target's to the last bit.
    assert all(getattr(found.plants, name)[0] == getattr(targets, name)[0] for name in NAMES)
    # The plant fails above λ = 0.6. It is given up within a step below 0.01 / 0.4 of that.
    assert 0.6 - 0.025 < found.reached[1] <= 0.6
    assert found.plants.m2[1] == pytest.approx(nominal.m2 + 0.1 * found.reached[1])
    # Two plants fill a batch of three. 0.2 + 0.3 + 0.4 + 0.1 are four rounds.
    assert set(called) == {3}
    assert told[:5] == [(0, 2), (0, 2), (0, 2), (0, 2), (1, 2)]


def test_coulomb_friction_becomes_damping():
    plant = dataclasses.replace(LEADERBOARD.driven(ROBOTS["acrobot"]), b1=0.01, cf1=0.1, b2=0.02, cf2=-0.05)
    found = linear_friction(plant)
    assert (found.b1, found.b2) == pytest.approx((0.11, -0.03))
    assert dataclasses.replace(found, b1=0.01, cf1=0.1, b2=0.02, cf2=-0.05) == plant


@pytest.mark.slow
def test_three_plants_are_continued_and_end_upright_on_their_plant():
    robot = ROBOTS["acrobot"]
    nominal = LEADERBOARD.driven(robot)
    heavy = dataclasses.replace(nominal, m2=1.1 * nominal.m2)
    rough = dataclasses.replace(nominal, b1=0.03, cf2=0.02, Ir=3e-5)
    settings = dataclasses.replace(SETTINGS, batch=16)
    found = continue_swingups(robot, stacked(nominal, heavy, rough), settings)
    np.testing.assert_array_equal(found.reached, 1.0)
    # With more time and a softer end the optimum takes the shipped swing-up's path, and comes to rest later.
    shipped = shipped_reference(robot, "score")[0].states[:, None, :2]
    distance = np.abs(shipped - found.states[0, :, :2]).max(axis=2).min(axis=1)
    assert distance.max() < 0.1
    for index, plant in enumerate((nominal, heavy, rough)):
        controller = found.controller(index, plant)
        rows = run_one(controller, Scenario(plant), ROBUSTNESS.dt, ROBUSTNESS.steps)
        assert upright(rows.x[-1:], ROBUSTNESS.tolerance).all()
