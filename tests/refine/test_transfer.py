"""Policies for one plant without training."""

import dataclasses

import numpy as np
import pytest

from swingup.plant.files import load_plant
from swingup.plant.plant import ROBOTS
from swingup.policy.guard import GuardSettings
from swingup.policy.shipped import load_pendulum_policy
from swingup.refine.transfer import TransferSettings, best_candidates, draw_candidates

STATES = np.random.default_rng(0).normal(size=(20, 4)) * [2.0, 2.0, 5.0, 5.0]
FEW = TransferSettings(candidates=4)


def test_the_first_candidate_is_the_shipped_policy_and_others_differ(robot):
    plant = load_plant("C.1")
    told, *others = draw_candidates(plant, robot, settings=FEW)
    shipped = load_pendulum_policy("adaptive", robot, plant)
    # The folded network knows the same plant, without friction; the parts around it have the plant's friction.
    np.testing.assert_allclose(told.predict(STATES)[0], shipped.predict(STATES)[0], atol=1e-6)
    assert told.torque_limit == pytest.approx(shipped.torque_limit)
    assert told.parts == ("estimator", "regulator")
    assert told.plant.values() == plant.driven(robot).values()
    motor = plant.limit(robot.joint)
    for other in others:
        assert 0.35 * motor <= other.torque_limit <= motor
        assert np.abs(other.predict(STATES)[0] - told.predict(STATES)[0]).max() > 0.01


@pytest.mark.slow
def test_candidates_that_come_up_are_kept_and_those_beyond_the_guard_are_not():
    robot = ROBOTS["pendubot"]
    candidates = draw_candidates(load_plant("C.1"), robot, settings=FEW)
    idle = dataclasses.replace(candidates[0], torque_limit=1e-3)
    few = dataclasses.replace(FEW, runs=8)
    found = best_candidates([candidates[0], idle], GuardSettings(), settings=few)
    assert found == [candidates[0]]
    assert best_candidates([candidates[0]], GuardSettings(velocity_limit=1.0), settings=few) == []
