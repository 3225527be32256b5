"""Reward scaling: its moments, and that the size of the reward does not matter."""

import dataclasses

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from swingup.areapo import train
from swingup.areapo.config import Config
from swingup.areapo.networks import Critic, Linear
from swingup.areapo.reward_scale import RewardScale, change, init_reward_scale, keep_values

from .probes import Walk

update = jax.jit(RewardScale.update)


def test_the_deviation_is_that_of_all_rewards_that_count():
    rewards = np.random.default_rng(0).normal(50.0, 3.0, (3, 8, 2)).astype(np.float32)
    weights = (np.random.default_rng(1).uniform(size=rewards.shape) > 0.3).astype(np.float32)
    scale = init_reward_scale()
    assert float(scale.deviation) == 1.0
    for each, counted in zip(rewards, weights, strict=True):
        scale = update(scale, each, counted)
    seen = rewards[weights > 0]
    assert float(scale.count) == seen.size
    assert float(scale.mean) == pytest.approx(seen.mean(), rel=1e-5)
    assert float(scale.deviation) == pytest.approx(seen.std(), rel=1e-4)
    # A rollout of which no frame counts changes nothing.
    assert float(update(scale, rewards[0], 0 * weights[0]).deviation) == float(scale.deviation)


@pytest.mark.parametrize("reward", [0.0, 0.7, -987.65, 12345.678])
def test_constant_rewards_are_not_scaled(reward):
    scale = init_reward_scale()
    for _ in range(3):
        scale = update(scale, np.full((8, 2), reward, np.float32), np.ones((8, 2), np.float32))
    assert float(scale.deviation) == 1.0


def test_a_new_scale_keeps_values_of_rewards_in_the_tasks_units_and_those_of_entropy_in_its_own():
    heads = Linear(jnp.arange(1.0, 7.0).reshape(2, 3), jnp.array([0.5, -0.5]))
    critic = eqx.tree_at(lambda c: c.heads, Critic((), heads), heads)
    old = RewardScale(jnp.zeros(()), jnp.array(4.0), jnp.array(10.0))
    new = RewardScale(jnp.zeros(()), jnp.array(0.25), jnp.array(20.0))
    kept = keep_values(critic, old, new).heads
    # σ falls from 2 to 0.5: the output for rewards is 4 times as large, in the task's units it is the same.
    np.testing.assert_allclose(kept.weight, heads.weight * np.array([[4.0], [1.0]]))
    np.testing.assert_allclose(kept.bias, heads.bias * np.array([4.0, 1.0]))
    assert float(change(old, new)) == 0.25
    assert float(change(init_reward_scale(), new)) == 1.0


class Paid(Walk):
    """Walks whose reward depends on action and place, in units of ``size``; each end costs."""

    size: jax.Array = eqx.field(default_factory=lambda: jnp.ones(()))
    terminates: bool = eqx.field(static=True, default=True)

    def outcome(self, value, action):
        return self.size * (action + value), value + 1.0


@pytest.mark.slow
def test_the_unit_of_the_reward_does_not_matter():
    """In units 1024 times smaller the policy has the same bits, and gains and values are 1024 times larger."""
    config = Config(
        num_envs=4, num_steps=16, num_epochs=2, batch_size=32, policy_layers=(8,), value_layers=(8,),
        temperature=0.1, centre_values=True, normalise_rewards=True,
    )  # fmt: skip
    init, advance = jax.jit(train.init), jax.jit(train.train)
    found = []
    for factor in (1.0, 1024.0):
        task = Paid(size=jnp.array(factor))
        mine = dataclasses.replace(config, reset_cost=2.0 * factor)
        found.append(advance(init(jax.random.key(0), task, mine), task, mine, 5))
    (one, small), (other, large) = found
    jax.tree.map(np.testing.assert_array_equal, one.actor, other.actor)
    jax.tree.map(np.testing.assert_array_equal, one.critic, other.critic)
    for name in ("reward", "gain", "entropy_gain", "value", "entropy_value"):
        assert float(getattr(large, name)) == 1024 * float(getattr(small, name)) != 0
    assert float(small.entropy) == float(large.entropy)
    assert float(one.reward_scale.deviation) > 0.5
