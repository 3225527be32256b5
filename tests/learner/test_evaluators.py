"""A pendulum's evaluator judges on its task's plant, which every policy file carries."""

import equinox as eqx
import jax.numpy as jnp
import pytest

from policies import lone_policy, new_actor
from swingup.controllers.stack.policy import Policy
from swingup.learner.evaluators import SwingUpEvaluator
from swingup.plant.plant import LEADERBOARD, load_plant
from swingup.plant.robots import ROBOTS
from swingup.policy.pendulum import read_pendulum_policy
from swingup.policy.plant_facts import policy_plant
from swingup.refine.recipe import run_recipe
from swingup.tasks.presets import smooth_task


def test_the_swing_up_is_judged_on_the_tasks_plant(either_robot, similar):
    task = smooth_task(either_robot)
    twin = smooth_task(either_robot, similar(task.parameters))
    actor = new_actor(task.observation_size, (4,))
    pushing = eqx.tree_at(lambda a: a.mean_head.bias, actor, jnp.array([20.0]))
    plants = (LEADERBOARD, load_plant(similar(task.parameters)))
    results = [
        SwingUpEvaluator(each, plant).evaluate(Policy((each.observation,), pushing))
        for each, plant in zip((task, twin), plants, strict=True)
    ]
    # A constant torque of 6 N m, and of 0.025 times that: Σ u² Δt over 4,999 rows of 0.002 s.
    costs = [result["torque_cost"] for result in results]
    assert costs == pytest.approx([36 * 9.998, 0.15**2 * 9.998], rel=1e-6)


ACROBOT = ROBOTS["acrobot"]


def written(evaluator, task, path):
    """What the evaluator's file of an untrained policy holds."""
    actor = new_actor(task.observation_size, (4,))
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
