"""What writes a policy file writes the plant that the policy was trained or refined on."""

import jax
import pytest

from swingup.areapo.networks import init_actor
from swingup.learner.evaluators import Sim2RealEvaluator, SwingUpEvaluator
from swingup.physics.parameters import ROBOTS, identified_parameters
from swingup.plants.domain import make_domain
from swingup.plants.plant import load_plant
from swingup.policy.jax_backend.controller import shipped_policy
from swingup.policy.jax_backend.policy import Policy
from swingup.policy.pendulum import read_pendulum_policy
from swingup.policy.plant_facts import leaderboard_plant, policy_plant
from swingup.refine.recipe import run_recipe
from swingup.tasks.presets import sim2real_task, smooth_task

ACROBOT = ROBOTS["acrobot"]


def written(evaluator, task, path):
    """What the evaluator's file of an untrained policy holds."""
    actor = init_actor(jax.random.key(0), task.observation_size, 1, (4,), -1.0)
    evaluator.save(path, Policy((task.observation,), actor), {})
    return read_pendulum_policy(path)


def test_training_on_a_plant(tmp_path):
    plant = load_plant("C.0")
    task = smooth_task(ACROBOT, plant)
    found = written(SwingUpEvaluator(task, plant), task, tmp_path / "p.npz")
    assert found.plant == policy_plant(plant.parameters, ACROBOT)
    assert (found.plant.name, found.torque_limit) == ("C.0", 6.0)
    assert found.plant.cf1 == plant.parameters.cf1 > 0


def test_training_on_the_leaderboards_plant(tmp_path):
    task = smooth_task(ACROBOT)
    assert written(SwingUpEvaluator(task), task, tmp_path / "p.npz").plant == leaderboard_plant(ACROBOT)


@pytest.mark.parametrize("plant", [None, "C.1"])
def test_training_on_a_domain(tmp_path, plant):
    """Of a domain around a plant, the middle; the shipped ones keep the estimator of the leaderboards' plant."""
    ranges = {"m2": [0.6, 0.7], "cf1": [0.1, 0.3], "torque_limit": 5.0}
    domain = make_domain(ranges if plant is None else {"plant": plant, **ranges})
    task = sim2real_task(ACROBOT, domain)
    found = written(Sim2RealEvaluator(task, seed=0), task, tmp_path / "p.npz").plant
    if plant is None:
        assert found == leaderboard_plant(ACROBOT)
    else:
        assert (found.m2, found.cf1, found.tl2, found.tl1) == (pytest.approx(0.65), pytest.approx(0.2), 5.0, 0.0)
        assert (found.m1, found.name) == (identified_parameters().m1, "C.1")


@pytest.mark.parametrize("plant", [None, "C.0"])
def test_refining(plant):
    """Without stages nothing is refined, but the plant is named."""
    found = run_recipe(shipped_policy("acrobot")[0], ACROBOT, (), plant=plant).plant
    assert found == (None if plant is None else policy_plant(load_plant(plant).parameters, ACROBOT))
