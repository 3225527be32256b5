"""A pendulum's evaluator judges on the plant of its task."""

import equinox as eqx
import jax
import jax.numpy as jnp
import pytest

from swingup.areapo.initial import init_actor
from swingup.controllers.stack.policy import Policy
from swingup.learner.evaluators import SwingUpEvaluator
from swingup.plant.plant import LEADERBOARD, load_plant
from swingup.tasks.presets import smooth_task


def test_the_swing_up_is_judged_on_the_tasks_plant(either_robot, similar):
    task = smooth_task(either_robot)
    twin = smooth_task(either_robot, similar(task.parameters))
    actor = init_actor(jax.random.key(0), task.observation_size, 1, (4,), -1.0)
    pushing = eqx.tree_at(lambda a: a.mean_head.bias, actor, jnp.array([20.0]))
    plants = (LEADERBOARD, load_plant(similar(task.parameters)))
    results = [
        SwingUpEvaluator(each, plant).evaluate(Policy((each.observation,), pushing))
        for each, plant in zip((task, twin), plants, strict=True)
    ]
    # A constant torque of 6 N m, and of 0.025 times that: Σ u² Δt over 4,999 rows of 0.002 s.
    costs = [result["torque_cost"] for result in results]
    assert costs == pytest.approx([36 * 9.998, 0.15**2 * 9.998], rel=1e-6)
