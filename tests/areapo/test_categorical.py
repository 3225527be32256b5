"""Discrete actions: probabilities, samples, policies and their files."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from array_files import change_file
from policies import load_any_policy
from refusals import refusal
from swingup.areapo.initial import init_categorical_actor
from swingup.areapo.networks import Categoricals
from swingup.controllers.stack.policy import Policy, save_policy
from swingup.tasks.observation import NormaliseStage

# Probabilities 0.2, 0.3, 0.5 of the first action and 0.9, 0.1 of the second; logits are free up to a constant.
PAIR = Categoricals(
    jnp.concatenate([jnp.log(jnp.array([0.2, 0.3, 0.5])) + 4.0, jnp.log(jnp.array([0.9, 0.1])) - 2.0]), (3, 2)
)


def test_log_prob_by_hand():
    # P(2, 0) = 0.5 · 0.9
    assert PAIR.log_prob(jnp.array([2, 0])) == pytest.approx(np.log(0.45), rel=1e-5)
    assert PAIR.log_prob(jnp.array([0, 1])) == pytest.approx(np.log(0.02), rel=1e-5)


def test_probabilities_sum_to_one():
    actions = jnp.array([[i, j] for i in range(3) for j in range(2)])
    assert jnp.sum(jnp.exp(jax.vmap(PAIR.log_prob)(actions))) == pytest.approx(1.0, abs=1e-6)


def test_samples_follow_the_probabilities():
    actor = init_categorical_actor(jax.random.key(1), 3, PAIR.choices, (8,))
    drawn = np.asarray(jax.vmap(PAIR.sample, 1)(actor.noise(jax.random.key(0), (100_000,))))
    # Standard deviation of a share: at most 0.5 / sqrt(100,000) = 0.0016.
    np.testing.assert_allclose(np.bincount(drawn[:, 0]) / 1e5, [0.2, 0.3, 0.5], atol=0.007)
    np.testing.assert_allclose(np.bincount(drawn[:, 1]) / 1e5, [0.9, 0.1], atol=0.007)
    # The actions are drawn apart: P(2, 1) = 0.5 · 0.1.
    assert np.mean((drawn == [2, 1]).all(axis=1)) == pytest.approx(0.05, abs=0.005)


def test_batch_axes_come_last():
    logits = jax.random.normal(jax.random.key(1), (5, 7))
    drawn = jax.random.randint(jax.random.key(2), (2, 7), 0, 2)
    together = Categoricals(logits, (3, 2))
    for column in range(7):
        alone = Categoricals(logits[:, column], (3, 2))
        np.testing.assert_allclose(together.log_prob(drawn)[column], alone.log_prob(drawn[:, column]), rtol=1e-5)
        np.testing.assert_array_equal(together.mode()[:, column], alone.mode())


def test_a_new_policy_is_next_to_uniform():
    actor = init_categorical_actor(jax.random.key(0), 3, (3, 2), (32, 32))
    distribution = actor(jax.random.normal(jax.random.key(1), (3, 20)))
    for pair in np.ndindex(3, 2):
        log_probs = distribution.log_prob(jnp.tile(jnp.array(pair)[:, None], 20))
        np.testing.assert_allclose(jnp.exp(log_probs), 1 / 6, atol=0.007)


def test_the_policy_file_keeps_the_policy_and_its_choices(tmp_path):
    actor = init_categorical_actor(jax.random.key(0), 4, (3, 2), (8,))
    actor = jax.tree.map(lambda leaf: leaf + jax.random.normal(jax.random.key(5), leaf.shape), actor)
    policy = Policy((NormaliseStage(np.linspace(-1, 1, 4), np.linspace(0.5, 2, 4)),), actor)
    save_policy(tmp_path / "p.safetensors", policy, {"env": "Task-v0"})
    loaded, metadata = load_any_policy(tmp_path / "p.safetensors")
    assert (metadata["choices"], metadata["env"]) == ([3, 2], "Task-v0")
    for observation in np.random.default_rng(0).normal(size=(20, 4)):
        np.testing.assert_array_equal(loaded(observation), policy(observation))
    for choices in ([3, 3], [], [3.5], "32"):
        change_file(tmp_path / "p.safetensors", {"choices": choices})
        refusal(load_any_policy, tmp_path / "p.safetensors")
