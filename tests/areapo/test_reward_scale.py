"""Reward scaling: its moments, and that the size of the reward does not matter."""

import dataclasses

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from swingup.areapo import algorithm
from swingup.areapo.config import Config
from swingup.areapo.networks import Critic, Linear
from swingup.areapo.reward_scale import deviation, fading_sums, reward_unit, scale_rewards
from swingup.areapo.state import Rollout
from swingup.areapo.statistics import RunningStatistics, running_statistics

from .probes import Walk

update = jax.jit(RunningStatistics.update)


def test_the_deviation_is_that_of_all_rewards_that_count():
    rewards = np.random.default_rng(0).normal(50.0, 3.0, (3, 8, 2)).astype(np.float32)
    weights = (np.random.default_rng(1).uniform(size=rewards.shape) > 0.3).astype(np.float32)
    scale = running_statistics()
    assert float(deviation(scale)) == 1.0
    for each, counted in zip(rewards, weights, strict=True):
        scale = update(scale, each.ravel(), counted.ravel())
    seen = rewards[weights > 0]
    assert float(scale.count) == seen.size
    assert float(scale.mean) == pytest.approx(seen.mean(), rel=1e-5)
    assert float(deviation(scale)) == pytest.approx(seen.std(), rel=1e-4)
    # A rollout of which no frame counts changes nothing.
    assert float(deviation(update(scale, rewards[0].ravel(), 0 * weights[0].ravel()))) == float(deviation(scale))


@pytest.mark.parametrize("reward", [0.0, 0.7, 1e-6, -987.65, 12345.678])
def test_the_unit_of_constant_rewards_is_their_size(reward):
    scale = running_statistics()
    for _ in range(3):
        scale = update(scale, np.full(16, reward, np.float32), np.ones(16, np.float32))
    assert float(deviation(scale)) == pytest.approx(abs(reward) or 1.0)


def test_the_unit_is_the_deviation_of_fading_sums():
    """λ = 0.5: 1, 1 + 0.5 and, after a reset, -1 and -1 - 0.5; their deviation is √(6.5 / 4), that of a step 1."""
    config = Config(num_envs=1, num_steps=4, batch_size=4, gae_lambda=(0.5, 0.5), normalise_rewards=True)
    state = algorithm.init(
        jax.random.key(0), Walk(), dataclasses.replace(config, policy_layers=(2,), value_layers=(2,))
    )
    nothing, ends = jnp.zeros((4, 1)), jnp.array([[False], [True], [False], [False]])
    rollout = Rollout(*[nothing] * 3, jnp.array([[5.0], [5.0], [3.0], [3.0]]), nothing, ends, ends)
    np.testing.assert_allclose(fading_sums(rollout, config).ravel(), [1.0, 1.5, -1.0, -1.5])
    assert float(reward_unit(scale_rewards(state, rollout, config)[0])) == pytest.approx((6.5 / 4) ** 0.5)


def test_without_gains_rewards_are_centred_and_an_end_has_the_value_of_nothing():
    """Two rollouts of one frame each, γ = 0.5; 1 / (1 - γ) = 2."""
    config = Config(
        num_envs=1, num_steps=2, batch_size=2, gain="none", terminations="end", discount=(0.5, 0.5),
        normalise_rewards=True,
    )  # fmt: skip
    state = algorithm.init(
        jax.random.key(0), Walk(), dataclasses.replace(config, policy_layers=(2,), value_layers=(2,))
    )
    nothing, ends = jnp.zeros((2, 1)), jnp.array([[False], [True]])

    def scaled(state, rewards):
        return scale_rewards(state, Rollout(*[nothing] * 3, jnp.array(rewards), nothing, ends, ends), config)

    # Mean 3 and deviation 1: -1 and 1, and the end is 3 · 0.5 · 2 = 3 deviations worse than to go on for ever.
    state, rollout = scaled(state, [[2.0], [4.0]])
    np.testing.assert_allclose(rollout.rewards, [[-1.0], [1.0 - 3.0]], rtol=1e-6)
    # All four: mean 5, deviation √5. A centred value loses (5 - 3) · 2 / √5.
    after, rollout = scaled(state, [[6.0], [8.0]])
    np.testing.assert_allclose(rollout.rewards, np.array([[1.0], [3.0 - 5.0]]) / 5**0.5, rtol=1e-6)
    before = state.critic.heads.bias / jnp.array([5**0.5, 1.0])
    np.testing.assert_allclose(after.critic.heads.bias, before - np.array([4 / 5**0.5, 0.0]), rtol=1e-6)


def test_a_critic_keeps_its_values_in_other_units():
    heads = Linear(jnp.arange(1.0, 7.0).reshape(2, 3), jnp.array([0.5, -0.5]))
    kept = Critic((), heads).with_values(jnp.array([4.0, 1.0]), jnp.array([0.0, 2.0])).heads
    np.testing.assert_allclose(kept.weight, heads.weight * np.array([[4.0], [1.0]]))
    np.testing.assert_allclose(kept.bias, [2.0, -2.5])


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
    init, advance = jax.jit(algorithm.init), jax.jit(algorithm.train)
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
    assert float(deviation(one.reward_statistics)) > 0.5
