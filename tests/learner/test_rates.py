"""Reward rate and resets per 1,000 steps, and the time of a step."""

import gymnasium
import pytest

from swingup.learner.rates import RESETS, REWARD_RATE, describe_rates, rates, step_time, training_resets

from .environments import Stairs


def test_rates_by_hand():
    assert rates(3.0, 0.002) == {"reward_rate": 3.0, "resets_per_1000_steps": 2.0}
    assert rates(3.0, 0.002, step_time=0.008)["reward_per_second"] == pytest.approx(375.0)


def test_what_was_not_recorded_is_a_dash():
    assert describe_rates({"score": 1.0}) == "reward rate – per step, resets per 1,000 steps –"
    assert describe_rates(dict.fromkeys((REWARD_RATE, RESETS))) == describe_rates({})
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


def test_the_time_of_a_step():
    assert step_time(with_dt(0.01)) == step_time(gymnasium.wrappers.TimeLimit(with_dt(0.01), 9)) == 0.01
    assert step_time(Repeating(with_dt(0.01))) == 0.04
    nonsense = map(with_dt, (0.0, float("inf"), "often", lambda: 0.01))
    assert [step_time(env) for env in (Stairs(), Broken(), *nonsense)] == [None] * 6
