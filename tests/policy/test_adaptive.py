"""The shipped adaptive controllers: what their files hold, their scores, and what an exported folder says."""

import dataclasses

import pytest

import swingup
from swingup.benchmark.boards import PERFORMANCE
from swingup.controllers.registry import get_controller
from swingup.policy.shipped import ADAPTIVE, AR_EAPO
from swingup.runtime import load_controller

SCORES = {"acrobot": 0.699, "pendubot": 0.694}
"""The performance board's (rules v2), at least."""


@pytest.mark.slow  # JAX compiles identifier and regulator for seconds
@pytest.mark.parametrize(("policy", "within"), [(ADAPTIVE, 1e-2), (AR_EAPO, 1e-4)])
def test_scores(either_robot, policy, within):
    name = either_robot.name
    score = swingup.judge(get_controller(policy, name), name).criteria.score
    assert score > (SCORES[name] if policy == ADAPTIVE else 0.3)
    in_numpy = swingup.judge(load_controller(policy, name), name).criteria.score
    assert in_numpy == pytest.approx(score, abs=within)


@pytest.mark.slow
def test_a_brief_run_without_the_estimator_is_for_the_plant_of_the_file(either_robot):
    """On that plant the identifier changes little."""
    name, rules = either_robot.name, dataclasses.replace(PERFORMANCE, duration=4.0)
    both = [
        swingup.judge(load_controller(ADAPTIVE, name, estimator=wanted), name, rules).criteria
        for wanted in (None, False)
    ]
    assert both[0].score == pytest.approx(both[1].score, abs=0.05)
