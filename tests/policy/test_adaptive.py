"""The shipped adaptive controllers: what their files hold, their scores, and what an exported folder says."""

import dataclasses

import pytest

import swingup
from refusals import refusal
from swingup.benchmark.boards import PERFORMANCE
from swingup.controllers.registry import get_controller
from swingup.export.folder import readme_values
from swingup.policy.network.stages import PlantStage
from swingup.policy.shipped import ADAPTIVE, AR_EAPO, load_policy
from swingup.runtime import load_controller

SCORES = {"acrobot": 0.699, "pendubot": 0.694}
"""The performance board's (rules v2), at least."""


def test_files_ask_for_all_that_makes_them_adapt(robot):
    policy = load_policy(ADAPTIVE, robot)
    assert isinstance(policy.network.stages[-1], PlantStage)
    assert policy.plant.name == "leaderboard"
    for part in (policy.estimator, policy.identifier, policy.regulator):
        assert part is not None


def test_the_folders_readme_names_the_regulator_and_the_teachers():
    values = {name: readme_values(load_policy(name, "acrobot"), "entry") for name in (ADAPTIVE, "ar-eapo")}
    assert "regulator takes over" in values[ADAPTIVE]["SWITCHED"]
    assert "base parameters" in values[ADAPTIVE]["ESTIMATOR"]
    assert values["ar-eapo"]["SWITCHED"] == "nothing is switched, tracked or planned"
    assert "distilled from teachers, one of which is a policy by AR-EAPO" in values[ADAPTIVE]["KIND"]
    assert values["ar-eapo"]["KIND"].startswith("A policy by AR-EAPO")


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


@pytest.mark.parametrize(
    ("source", "robot", "named"),
    [
        ("ar-eapo", None, "shipped for both robots: name acrobot or pendubot"),
        ("ar-eapo", "cartpole", "unknown robot 'cartpole'"),
        ("tvlqr", "acrobot", "unknown policy 'tvlqr': use one of adaptive, ar-eapo, global or a policy file"),
        ("globel", "acrobot", "did you mean global?"),
        ("nothing.safetensors", "acrobot", "no such file: nothing.safetensors"),
    ],
)
def test_names_that_no_policy_has(source, robot, named):
    assert named in refusal(load_policy, source, robot)
