"""The learner on environments with gymnax's, envelope's or brax's methods."""

import numpy as np
import pytest

from policies import load_any_policy
from refusals import refusal
from swingup import AREAPO

from .contract import TINY
from .corridors import Corridor, Params, Turns
from .halls import Hall
from .test_adapters import Room

BRIEF = Params(max_steps_in_episode=5)
ENVS = {
    "learner.corridors.Corridor": ((Corridor(), BRIEF), (Corridor(), Params(door=0.15))),
    "learner.halls.Hall": (Hall(max_steps=5), Hall(door=0.15)),
}
"""Environments, and others with the same spaces whose door is a step away."""


@pytest.mark.slow  # compiles for seconds
@pytest.mark.parametrize("name", ENVS)
def test_an_environment_trains_saves_and_goes_on(tmp_path, name):
    env, near = ENVS[name]
    model = AREAPO(env, seed=3, **TINY).learn(64)
    assert model.settings.env == f"<{name}>"
    # In the environment's shapes and bounds, [-1, 3].
    observations = np.random.default_rng(0).normal(size=(7, 1, 2))
    actions = model.predict(observations)
    assert actions.shape == (7, 1, 1)
    assert model.predict(observations[0]).shape == (1, 1)
    assert np.all((actions > -1.0) & (actions < 3.0))
    model.save(tmp_path / "model.safetensors")
    model.export_policy(tmp_path / "policy.safetensors")
    facts = load_any_policy(tmp_path / "policy.safetensors")[1]
    assert (facts["action_low"], facts["action_high"]) == ([[-1.0]], [[3.0]])
    assert "pass it again as env" in refusal(AREAPO.load, tmp_path / "model.safetensors")
    other = AREAPO.load(tmp_path / "model.safetensors", env=env)
    np.testing.assert_array_equal(model.learn(64).predict(observations), other.learn(64).predict(observations))
    # Two steps to the door at most speed, and five to the time limit.
    assert 2.0 <= model.evaluate(2)["mean_length"] <= 5.0
    # What a step beyond the door pays does not count.
    found = model.evaluate(2, env=near)
    assert (found["mean_length"], found["resets_per_1000_steps"]) == (1.0, 1000.0)
    assert 0.0 < found["score"] < 3.0
    assert "the environment's are 1 choices of 3" in refusal(model.evaluate, 2, env=Turns())


@pytest.mark.slow
def test_both_kinds_of_actions_learn():
    """Standing still in the corridor costs nothing, going back costs, and running pays: the best is to run."""
    sizes = {"num_envs": 8, "num_steps": 32, "batch_size": 64, "evaluation_episodes": 4, "learning_rate": 3e-3}
    never = Params(door=1e6)
    box = AREAPO((Corridor(), never), preset="ppo", policy_layers=(16,), value_layers=(16,), **sizes).learn(20_000)
    # Six steps of 3.
    assert box.evaluate(4)["score"] > 15.0
    turns = AREAPO((Turns(), never), preset="ppo", policy_layers=(16,), value_layers=(16,), **sizes).learn(20_000)
    # Six steps of 2.
    assert turns.evaluate(4)["score"] == 12.0
    assert turns.predict(np.zeros((1, 2))).tolist() == 2


@pytest.mark.slow
def test_a_learner_takes_brax_s_as_they_are():
    model = AREAPO(Room(), **TINY).learn(32)
    assert np.abs(model.predict([[0.0, 0.0]])).max() <= 1.0
    assert model.evaluate(2)["mean_length"] <= 6
