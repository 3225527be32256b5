"""Reward rate and resets per 1,000 steps: numbers, words, and the time of a step."""

import gymnasium
import pytest

from swingup.learner.rates import describe_rates, rates, training_resets, unknown_rates
from swingup.learner.step_time import step_time

from .environments import Stairs


def test_rates_by_hand():
    assert rates(3.0, 0.002) == {"reward_rate": 3.0, "resets_per_1000_steps": 2.0}
    timed = rates(3.0, 0.002, step_time=0.008)
    assert timed["reward_per_second"] == pytest.approx(375.0)
    assert describe_rates(timed) == "reward rate 3 per step (375 per second), resets per 1,000 steps 2"


def test_what_was_not_recorded_is_a_dash():
    assert describe_rates({"score": 1.0}) == "reward rate – per step, resets per 1,000 steps –"
    assert describe_rates(unknown_rates()) == describe_rates({})
    assert training_resets({"seed": 0, "frames": 1}) is None
    assert training_resets({"termination_rate": 0.0}) == 0.0


class Repeating(gymnasium.Wrapper):
    """Repeats actions, and says so."""

    dt = 0.04


class Broken(Stairs):
    @property
    def dt(self):
        raise ZeroDivisionError


def with_dt(value):
    env = Stairs()
    env.dt = value
    return env


@pytest.mark.parametrize(
    ("env", "seconds"),
    [
        (with_dt(0.01), 0.01),
        (gymnasium.wrappers.TimeLimit(with_dt(0.01), 9), 0.01),
        (Repeating(with_dt(0.01)), 0.04),
        (Stairs(), None),
        (Broken(), None),
        (with_dt(0.0), None),
        (with_dt(float("inf")), None),
        (with_dt("often"), None),
        (with_dt(lambda: 0.01), None),
    ],
)
def test_the_time_of_a_step(env, seconds):
    assert step_time(env) == seconds
