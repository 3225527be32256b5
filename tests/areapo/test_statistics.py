"""Running statistics: observations and rewards of any size and place are scaled alike; and what a reset costs."""

import dataclasses

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from swingup.areapo import algorithm
from swingup.areapo.config import Config
from swingup.areapo.rewards import (
    COST_STEP,
    TERMINATION_TARGET,
    adapted_cost,
    charge_resets,
    decayed_sums,
    scale_rewards,
)
from swingup.areapo.state import Rollout, reward_unit
from swingup.areapo.statistics import RunningStatistics, deviation, running_statistics

from .probes import Trap, Walk

update = jax.jit(RunningStatistics.update)
init, scale, charge = jax.jit(algorithm.init), jax.jit(scale_rewards), jax.jit(charge_resets)
CONFIG = Config(
    num_envs=2, num_steps=4, batch_size=8, num_epochs=1, policy_layers=(8,), value_layers=(8,), reset_cost=3.0
)  # fmt: skip


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


def test_a_rare_goal_is_seen_beside_a_large_constant():
    """One step of 20,000 earns 1000 where all others earn 999: the deviation is √(p (1 - p)), and not 999."""
    rewards, scale = np.full((10, 2000), 999.0, np.float32), running_statistics()
    rewards[7, 1234] = 1000.0
    for each in rewards:
        scale = update(scale, each, np.ones(2000, np.float32))
    assert float(deviation(scale)) == pytest.approx(np.sqrt(5e-5 * (1.0 - 5e-5)), rel=1e-4)


def test_the_unit_is_the_deviation_of_fading_sums():
    """λ = 0.5: 1, 1 + 0.5 and, after a reset, -1 and -1 - 0.5; their deviation is √(6.5 / 4), that of a step 1."""
    config = dataclasses.replace(CONFIG, num_envs=1, batch_size=4, gae_lambda=(0.5, 0.5), normalise_rewards=True)
    state = init(jax.random.key(0), Walk(), config)
    nothing, ends = np.zeros((4, 1), np.float32), np.array([[False], [True], [False], [False]])
    rollout = Rollout(*[nothing] * 3, np.float32([[5.0], [5.0], [3.0], [3.0]]), nothing, ends, ends)
    np.testing.assert_allclose(jax.jit(decayed_sums)(rollout, config).ravel(), [1.0, 1.5, -1.0, -1.5])
    assert float(reward_unit(scale(state, rollout, config)[0])) == pytest.approx((6.5 / 4) ** 0.5)


def test_without_gains_rewards_are_centred_and_an_end_has_the_value_of_nothing():
    """Two rollouts of two frames each, γ = 0.5, λ = 0.8; 1 / (1 - γ) = 2. The unit counts what an end loses."""
    sizes = {"num_envs": 1, "num_steps": 2, "batch_size": 2, "normalise_rewards": True}
    config = dataclasses.replace(CONFIG, **sizes, gain="none", terminations="end", discount=(0.5, 0.5))
    state = init(jax.random.key(0), Walk(), config)
    nothing, ends = np.zeros((2, 1), np.float32), np.array([[False], [True]])

    def scaled(state, rewards):
        return scale(state, Rollout(*[nothing] * 3, np.float32(rewards), nothing, ends, ends), config)

    # An end at a goal, far above the other step, is as good as to go on.
    np.testing.assert_allclose(scaled(state, [[2.0], [4.0]])[1].rewards, [[-1.0], [1.0]], rtol=1e-6)
    # Mean 3: 1 and -1, and the end is 3 · 0.5 · 2 = 3 worse than to go on for ever. About their mean of -1.5 these
    # are 2.5 and -2.5; their fading sums 2.5 and -2.5 + 0.4 · 2.5 = -1.5 have the deviation 2.
    state, rollout = scaled(state, [[4.0], [2.0]])
    np.testing.assert_allclose(rollout.rewards, np.array([[1.0], [-1.0 - 3.0]]) / 2.0, rtol=1e-6)
    # All four: mean 5. The new sums are 3.5 and -2.1. A centred value loses (5 - 3) · 2.
    after, rollout = scaled(state, [[8.0], [6.0]])
    unit = np.std([2.5, -1.5, 3.5, -2.1])
    np.testing.assert_allclose(rollout.rewards, np.array([[3.0], [1.0 - 5.0]]) / unit, rtol=1e-6)
    heads, units = state.critic.heads, np.array([unit / 2.0, 1.0])
    np.testing.assert_allclose(after.critic.heads.bias, heads.bias / units - np.array([4 / unit, 0.0]), rtol=1e-6)
    np.testing.assert_allclose(after.critic.heads.weight, heads.weight / units[:, None], rtol=1e-6)


@pytest.mark.parametrize("offset", [-1.0, 999.0])
def test_the_first_goal_after_equal_rewards_leaves_an_untaught_critic(offset):
    """σ falls from the constant's size to the goal's deviation; a critic's noise must not grow by their ratio."""
    sizes = {"num_envs": 1, "num_steps": 2, "batch_size": 2, "normalise_rewards": True}
    config = dataclasses.replace(CONFIG, **sizes, gain="none", terminations="end", discount=(0.5, 0.5))
    begun, nothing = init(jax.random.key(0), Walk(), config), np.zeros((2, 1), np.float32)
    state = begun
    for rewards, ends in (([[0.0], [0.0]], [[False], [False]]), ([[0.0], [1.0]], [[False], [True]])):
        rollout = Rollout(*[nothing] * 3, np.float32(rewards) + np.float32(offset), nothing, *[np.array(ends)] * 2)
        after, _ = scale(state, rollout, config)
        np.testing.assert_array_equal(after.critic.heads.weight, state.critic.heads.weight)
        state = after
    # Four rewards with one goal: m rises by 1/4, and 2/4 of σ is what going on for ever is now worth less.
    bias, unit = (each.critic.heads.bias for each in (begun, state)), float(reward_unit(state))
    np.testing.assert_allclose(np.subtract(*bias), [0.5 / unit, 0.0], rtol=1e-5)


class Paid(Walk):
    """Walks whose reward depends on action and place, in units of ``size``; each end costs."""

    size: jax.Array = eqx.field(default_factory=lambda: jnp.ones(()))
    terminates: bool = eqx.field(static=True, default=True)

    def outcome(self, value, action):
        return self.size * (action + value), value + 1.0


@pytest.mark.slow
def test_the_unit_of_the_reward_does_not_matter():
    """In units 1024 times smaller the policy has the same bits, and gains and values are 1024 times larger."""
    changes = {"num_steps": 16, "num_epochs": 2, "centre_values": True, "normalise_rewards": True}
    advance, found = jax.jit(algorithm.train), []
    for factor in (1.0, 1024.0):
        task = Paid(size=jnp.array(factor))
        mine = dataclasses.replace(CONFIG, **changes, temperature=0.1, reset_cost=2.0 * factor)
        found.append(advance(init(jax.random.key(0), task, mine), task, mine, 5))
    (one, small), (other, large) = found
    jax.tree.map(np.testing.assert_array_equal, one.actor, other.actor)
    jax.tree.map(np.testing.assert_array_equal, one.critic, other.critic)
    for name in ("reward", "gain", "entropy_gain", "value", "entropy_value"):
        assert float(getattr(large, name)) == 1024 * float(getattr(small, name)) != 0
    assert float(small.entropy) == float(large.entropy)
    assert float(deviation(one.reward_statistics)) > 0.5


def test_observations_of_any_size_and_place_are_normalised():
    """In single precision, which has steps of 0.06 near 1e6; constant ones become 0."""
    sizes, places = np.array([1e-6, 1e6, 1.0, 0.0]), np.array([0.0, 0.0, 1e6, 0.1])
    plain = np.random.default_rng(0).normal(size=(2000, 4, 4))
    statistics = running_statistics(4)
    for batch in plain:
        statistics = update(statistics, (places + sizes * batch).astype(np.float32))
    assert statistics.count == 8000.0
    found = statistics.stage()((places + sizes * plain[-1]).astype(np.float32))
    expected = np.where(sizes, (plain[-1] - plain.mean((0, 1))) / plain.std((0, 1)), 0.0)
    assert np.all(np.abs(found - expected) < [1e-3, 1e-3, 0.1, 1e-3])


@pytest.mark.parametrize(("ends", "frames", "steps"), [(6, 4000, 2), (36, 4000, 4), (3, 500, 1), (0, 4000, -4)])
def test_the_cost_follows_the_terminations_of_a_rollout(ends, frames, steps):
    """In 4000 frames 4 are permitted, and no more count than are permitted, or one; it never falls below zero."""
    assert TERMINATION_TARGET == 1e-3
    for cost, expected in ((30.0, 30.0 + steps * COST_STEP), (0.1, max(0.0, 0.1 + steps * COST_STEP))):
        found = adapted_cost(jnp.array(cost), jnp.array(ends / frames), frames)
        assert float(found) == pytest.approx(expected, rel=1e-5)


@pytest.mark.parametrize("offset", [0.0, -1000.0])
def test_an_adaptive_reset_costs_three_deviations(offset):
    """The fixed cost and the bootstrap are in ``test_train.py``'s plain loops."""
    config = dataclasses.replace(CONFIG, terminations="adaptive_cost")
    state = init(jax.random.key(0), Trap(), config)
    nothing, ended = np.zeros((4, 2), np.float32), np.zeros((4, 2), bool)
    ended[1, 0] = True
    # The row of a reset is not a step: its reward of 0 does not enter the deviation.
    counted = np.float32([[1.0], [1.0], [0.0], [1.0]]) * np.ones((4, 2), np.float32)
    rewards = (offset + np.float32([0.5, -0.5])) * counted
    rollout = Rollout(nothing, nothing, nothing, rewards, nothing, ended, nothing > 0, counted)
    after, charged, found = charge(state, rollout, config)
    assert float(found) == pytest.approx(1.5)
    np.testing.assert_allclose(charged.rewards, rewards - 1.5 * ended, rtol=1e-5)
    assert float(after.reset_cost) != 3.0


@pytest.mark.parametrize(
    ("steps", "last", "free"),
    [
        (-1.0, 0.0, 0.0), (999.0, 1000.0, 1000.0), (-1e-3, 0.0, 0.0),  # each step costs the same, the last less
        (-1.0, -1.0, 0.0),  # nor does the last cost less: made free, an end is worth as much as it saves
        (1.0, 1.0, None), (0.0, 0.0, None), (0.0, -1.0, None),  # a pole that fell
        (np.float32([0.0, 1.0, 2.0, 1.0]), 3.0, None), (np.float32([0.0, 1.0, 2.0, 1.0]), 10.0, 10.0),
    ],
)  # fmt: skip
def test_an_end_at_a_goal_costs_nothing(steps, last, free):
    config = dataclasses.replace(CONFIG, terminations="adaptive_cost")
    state = init(jax.random.key(0), Trap(), config)
    nothing, ended, counted = np.zeros((4, 2), np.float32), np.zeros((4, 2), bool), np.ones((4, 2), np.float32)
    ended[3, 0], counted[2, 1] = True, 0.0
    rewards = np.float32(np.broadcast_to(np.reshape(steps, (-1, 1)), (4, 2))).copy()
    rewards[3, 0], rewards[2, 1] = last, 0.0
    rollout = Rollout(nothing, nothing, nothing, rewards, nothing, ended, nothing > 0, counted)
    after, charged, cost = charge(state, rollout, config)
    expected = rewards - cost * ended if free is None else np.where(ended, free, rewards)
    np.testing.assert_allclose(charged.rewards, expected, rtol=1e-6)
    assert (float(after.reset_cost) < 3.0) == (free is not None)  # only failures raise the cost of the next


@pytest.mark.parametrize("terminations", ["adaptive_cost", "reset_cost"])
def test_a_goal_is_what_the_environment_calls_one(terminations):
    """Of two ends, one at a high reward that would be taken for a goal, only the other is a success."""
    config = dataclasses.replace(CONFIG, terminations=terminations)
    state = init(jax.random.key(0), Trap(), config)
    nothing, ended, goals = np.zeros((4, 2), np.float32), np.zeros((4, 2), bool), np.zeros((4, 2), bool)
    ended[3] = goals[3, 1] = True
    rewards = np.float32([[0.0, 1.0], [2.0, 1.0], [0.0, 1.0], [50.0, 1.0]])
    rollout = Rollout(nothing, nothing, nothing, rewards, nothing, ended, nothing > 0, goals=goals)
    _, charged, cost = charge(state, rollout, config)
    assert float(cost) > 1.0
    np.testing.assert_allclose(charged.rewards, rewards - cost * (ended & ~goals), rtol=1e-6)
