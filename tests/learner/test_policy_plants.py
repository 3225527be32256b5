"""What writes a policy file writes the plant that the policy was trained or refined on."""

import jax
import pytest

from policies import lone_policy
from swingup.areapo.initial import init_actor
from swingup.controllers.stack.policy import Policy
from swingup.learner.evaluators import SwingUpEvaluator
from swingup.plant.plant import LEADERBOARD, load_plant
from swingup.plant.robots import ROBOTS
from swingup.policy.pendulum import read_pendulum_policy
from swingup.policy.plant_facts import policy_plant
from swingup.refine.recipe import run_recipe
from swingup.tasks.presets import smooth_task

ACROBOT = ROBOTS["acrobot"]


def written(evaluator, task, path):
    """What the evaluator's file of an untrained policy holds."""
    actor = init_actor(jax.random.key(0), task.observation_size, 1, (4,), -1.0)
    evaluator.save(path, Policy((task.observation,), actor), {})
    return read_pendulum_policy(path)


def test_training(tmp_path):
    plant = load_plant("C.0")
    task = smooth_task(ACROBOT, plant)
    found = written(SwingUpEvaluator(task, plant), task, tmp_path / "p.safetensors")
    assert found.plant == policy_plant(plant, ACROBOT)
    assert (found.plant.name, found.torque_limit) == ("C.0", 6.0)
    assert found.plant.cf1 == plant.cf1 > 0
    task = smooth_task(ACROBOT)
    assert written(SwingUpEvaluator(task), task, tmp_path / "p.safetensors").plant == LEADERBOARD.driven(ACROBOT)


@pytest.mark.parametrize("plant", ["leaderboard", "C.0"])
def test_refining(plant):
    """Without stages nothing is refined, but the plant is named."""
    found = run_recipe(lone_policy("ar-eapo", "acrobot")[0], ACROBOT, (), plant=plant).plant
    assert found == policy_plant(load_plant(plant), ACROBOT)
