"""Policies for one plant without training."""

import dataclasses

import numpy as np
import pytest

from swingup.plant.files import load_plant
from swingup.policy.guard import GuardSettings
from swingup.policy.shipped import load_pendulum_policy
from swingup.refine.transfer import SearchSettings, Trial, tell

STATES = np.random.default_rng(0).normal(size=(20, 4)) * [2.0, 2.0, 5.0, 5.0]


def test_a_policy_that_is_told_its_own_plant_is_the_shipped_one(robot):
    plant = load_plant("C.1").driven(robot)
    shipped = load_pendulum_policy("adaptive", robot)
    own, expected = tell(shipped, plant, np.zeros(5)), load_pendulum_policy("adaptive", robot, plant)
    np.testing.assert_allclose(own.predict(STATES)[0], expected.predict(STATES)[0], atol=1e-6)
    # The parts around the network have the plant with its friction.
    assert (own.torque_limit, own.parts) == (expected.torque_limit, ("estimator", "regulator"))
    assert own.plant.values() == plant.values()
    other = tell(shipped, plant, np.array([0.2, -0.1, 0.0, 0.1, np.log(0.5)]))
    assert other.torque_limit == pytest.approx(0.5 * own.torque_limit)
    assert np.abs(other.predict(STATES)[0] - own.predict(STATES)[0]).max() > 0.01


@pytest.mark.slow
def test_a_trial_tells_what_holds_and_what_a_guard_would_stop():
    shipped = load_pendulum_policy("adaptive", "pendubot")
    good = tell(shipped, load_plant("leaderboard"), np.zeros(5))
    candidates = [(np.zeros(5), good), (np.zeros(5), dataclasses.replace(good, torque_limit=1e-3))]
    few = SearchSettings(runs=4)
    up, idle = Trial(good, GuardSettings(), few)(candidates, np.random.default_rng(0))
    assert (up.held, idle.held) == (1.0, 0.0)
    assert up.height > 0.7
    assert idle.height == pytest.approx(-1.0, abs=0.01)
    (stopped,) = Trial(good, GuardSettings(velocity_limit=3.0), few)(candidates[:1], np.random.default_rng(0))
    assert stopped.held == 0.0
    assert -1.0 < stopped.height < -0.8
