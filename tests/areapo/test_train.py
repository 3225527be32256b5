"""The parts of an iteration: what is collected, what is bootstrapped, what is centred, what stays as it was."""

import dataclasses
import itertools

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from swingup.areapo import algorithm
from swingup.areapo.algorithm import loss
from swingup.areapo.config import Config
from swingup.areapo.initial import init_learner, wait_for_rewards
from swingup.areapo.optimisation import adapted_step
from swingup.areapo.rewards import BOOTSTRAP_SIZE, charge_resets
from swingup.plant.plant import ROBOTS
from swingup.tasks.presets import smooth_task
from swingup.tasks.task import Spaces

from .probes import Cycle

CONFIG = Config(num_envs=4, num_steps=8, num_epochs=2, batch_size=16, policy_layers=(16,), value_layers=(16,))
PENDULUM = smooth_task(ROBOTS["acrobot"])
init, collect = jax.jit(algorithm.init), jax.jit(algorithm.collect)
improve = jax.jit(algorithm.improve)
advance = jax.jit(algorithm.train)
values_of = jax.jit(lambda critic, observations: jax.vmap(jax.vmap(critic))(observations))
CYCLE = Cycle(max_steps=3)
MANY = dataclasses.replace(CONFIG, num_envs=512, batch_size=1024)
DISCOUNTED = {"gain": "none", "terminations": "end", "discount": (0.9, 0.8)}


@jax.jit
def estimate(state, rollout, config):
    """What is learned of a rollout whose resets cost what this configuration says."""
    state = dataclasses.replace(state, reset_cost=jnp.asarray(config.reset_cost))
    return algorithm.estimate(*charge_resets(state, rollout, config)[:2], config)


@pytest.fixture(scope="module")
def collected():
    """A state after a rollout of a pendulum that is truncated every three steps, and the rollout."""
    task = dataclasses.replace(PENDULUM, max_steps=3)
    state = init(jax.random.key(0), task, CONFIG)
    return collect(state, task, CONFIG)


@pytest.fixture(scope="module")
def resetting():
    """A start in 512 environments, and a state and a rollout in which every step truncates and resets."""
    task = dataclasses.replace(PENDULUM, truncation_probability=1.0)
    start = init(jax.random.key(0), task, MANY)
    return start, *collect(start, task, MANY)


def test_an_iteration_keeps_every_type():
    """And none is weak, as in no checkpoint: otherwise every run, or every resumed one, would compile twice."""
    before = jax.eval_shape(lambda key: algorithm.init(key, PENDULUM, CONFIG), jax.random.key(0))
    after, _ = jax.eval_shape(algorithm.iteration, before, PENDULUM, CONFIG)
    kinds = [[(leaf.shape, leaf.dtype, leaf.weak_type) for leaf in jax.tree.leaves(s)] for s in (before, after)]
    assert kinds[0] == kinds[1]
    assert not any(weak for *_, weak in kinds[0])


def test_truncation_resets_and_keeps_the_true_next_observation(collected):
    state, rollout = collected
    log_prob = jax.jit(jax.vmap(jax.vmap(lambda o, z: state.actor(o).log_prob(z))))
    np.testing.assert_allclose(log_prob(rollout.observations, rollout.latents), rollout.log_probs, atol=1e-5)
    # Three steps after each reset: rows 2 and 5 of 8.
    truncated = np.asarray(rollout.truncated)
    assert np.flatnonzero(truncated.all(axis=1)).tolist() == [2, 5]
    assert truncated.any(axis=1).sum() == 2
    # In between, the next observation is the next row's; at a truncation it is not.
    following = jnp.concatenate([rollout.observations[1:], state.observations[None]])
    for row in range(8):
        same = np.allclose(rollout.next_observations[row], following[row], atol=1e-6)
        assert same == (row not in (2, 5))


def independent_estimate(state, rollout, config):
    """Advantages of both objectives by plain loops over true next observations."""
    values, next_values, last = (
        np.asarray(values_of(state.critic, observations))
        for observations in (rollout.observations, rollout.next_observations, state.observations[None])
    )
    values_after_reset = np.concatenate([values[1:], last])
    ended = np.asarray(rollout.terminated)
    beyond = {"end": 0.0 * values, "reset_cost": values_after_reset, "bootstrap": next_values}[config.terminations]
    next_values = np.where(ended[..., None], beyond, next_values)
    cost = config.reset_cost if config.terminations == "reset_cost" else 0.0
    rewards = np.stack([rollout.rewards - cost * ended, -config.temperature * rollout.log_probs], axis=-1)
    discount, gae_lambda, gains = map(np.asarray, (config.discount, config.gae_lambda, state.gains))
    result, following = np.zeros_like(values), np.zeros((config.num_envs, 2))
    for t in reversed(range(config.num_steps)):
        delta = rewards[t] - gains + discount * next_values[t] - values[t]
        cut = np.asarray(rollout.terminated[t] | rollout.truncated[t])[:, None]
        following = delta + discount * gae_lambda * np.where(cut, 0.0, following)
        result[t] = following
    return result, values


@pytest.mark.parametrize(
    ("changes", "terminating"),
    [
        ({}, 0), ({"centre_values": True}, 0), ({"gae_lambda": (0.0, 1.0)}, 0), (DISCOUNTED, 4),
        ({"reset_cost": 3.0}, 4), ({"terminations": "bootstrap"}, 4),
    ],
    ids=str,
)  # fmt: skip
def test_estimates_equal_plain_loops(collected, changes, terminating):
    """Also as if half of the environments had ended themselves where they were cut short, twice each."""
    state, rollout = collected
    terminated = rollout.truncated & (jnp.arange(CONFIG.num_envs) < terminating / 2)
    rollout = dataclasses.replace(rollout, terminated=terminated, truncated=rollout.truncated & ~terminated)
    assert int(rollout.terminated.sum()) == terminating
    assert rollout.truncated.any()
    config = Config(**(vars(CONFIG) | changes))
    expected, values = independent_estimate(state, rollout, config)
    after, batch, offset = estimate(state, rollout, config)
    np.testing.assert_allclose(batch.advantages, expected.sum(axis=-1), atol=2e-4)
    # λ-returns: advantage plus value, on the centred values if they are centred.
    shift = np.asarray(offset) if config.centre_values else 0.0
    np.testing.assert_allclose(batch.returns, expected + values - shift, atol=2e-4)
    np.testing.assert_allclose(offset, values.mean(axis=(0, 1)), atol=1e-5)
    centred = values_of(after.critic, rollout.observations)
    np.testing.assert_allclose(centred, values - shift, atol=1e-5)


def test_many_truncations_are_all_bootstrapped(resetting):
    """More truncated steps than are evaluated at once: all of 8 x 512, each with a true next state of its own."""
    _, state, rollout = resetting
    assert int(rollout.truncated.sum()) == 8 * 512 > BOOTSTRAP_SIZE
    expected, _ = independent_estimate(state, rollout, MANY)
    _, batch, _ = estimate(state, rollout, MANY)
    np.testing.assert_allclose(batch.advantages, expected.sum(axis=-1), atol=2e-4)


def test_statistics_take_in_the_states_after_resets_and_before_normalising():
    """Three steps to a truncation: the value goes 0, 1, 0, 1 and is reset to 0; all environments in step."""
    start = init(jax.random.key(0), CYCLE, CONFIG)
    state, rollout = collect(start, CYCLE, CONFIG)
    seen = [0.0, 1.0, 0.0, 0.0, 1.0, 0.0, 0.0, 1.0, 0.0]
    after = [1.0, 0.0, 1.0, 1.0, 0.0, 1.0, 1.0, 0.0]  # before a reset

    def normalised(value, count):
        """After ``count`` batches; the start (mean 0, variance 1) weighs 1e-4 against batches of 4."""
        weight, data = 4.0 * count, np.array(seen[:count])
        mean = data.sum() * 4.0 / (weight + 1e-4)
        variance = (4.0 * (data**2).sum() + 1e-4) / (weight + 1e-4) - mean**2
        return np.clip((value - mean) / np.sqrt(variance + 1e-8), -10.0, 10.0)

    both = ((rollout.observations, seen[:8], 1), (rollout.next_observations, after, 2))
    for observations, values, before in both:
        expected = [[normalised(value, t + before)] for t, value in enumerate(values)]
        np.testing.assert_allclose(observations[..., 0], np.tile(expected, 4), rtol=1e-3)
    assert state.statistics.count == pytest.approx(36.0, abs=0.01)


def test_one_step_of_adam_by_hand(collected):
    """With m = v = 0 before, Adam's first step is -lr g / (|g| + ε), after the joint norm of g is clipped."""
    state, rollout = collected
    changes = {"num_epochs": 1, "batch_size": 32, "max_grad_norm": 1e-3}
    config = Config(**(vars(CONFIG) | changes))
    _, batch, _ = estimate(state, rollout, CONFIG)
    after, _, norm = improve(state, batch, config)
    frames = jax.tree.map(lambda leaf: leaf.reshape(-1, *leaf.shape[2:]), batch)
    before = (state.actor, state.critic)
    gradients = jax.jit(jax.grad(lambda networks: loss(networks, frames, config)[0]))(before)
    trees = (before, (after.actor, after.critic), gradients)
    leaves = [[*map(np.asarray, jax.tree.leaves(tree))] for tree in trees]
    size = np.sqrt(sum(np.sum(leaf**2) for leaf in leaves[2]))
    assert float(norm) == pytest.approx(size, rel=1e-4)
    assert size > 1e-2  # clipping matters
    for old, new, gradient in zip(*leaves, strict=True):
        clipped = gradient * (1e-3 / size)
        np.testing.assert_allclose(new - old, -5e-4 * clipped / (np.abs(clipped) + 1e-5), atol=2e-6)


def test_the_learning_rate_follows_the_kl_divergence(collected):
    state, rollout = collected
    _, batch, _ = estimate(state, rollout, CONFIG)
    free, losses, _ = improve(state, batch, CONFIG)
    assert float(free.step_scale) == 1.0
    divergence = losses.approximate_kl
    target = 1.21 * float(divergence)  # compiled in: others are tried without improve()
    after, _, _ = improve(state, batch, dataclasses.replace(CONFIG, target_kl=target))
    assert jax.tree.all(jax.tree.map(np.array_equal, after.actor, free.actor))  # it changes after the rollout
    assert float(after.step_scale) == pytest.approx(1.1, rel=1e-3)
    steps = [adapted_step(state.step_scale, divergence, target) for target in (target, 1e-9, 1e3)]
    np.testing.assert_allclose(steps, [1.1, 1 / 1.5, 1.5], rtol=1e-3)
    halved = improve(dataclasses.replace(state, step_scale=state.step_scale / 2), batch, CONFIG)[0]
    same = improve(state, batch, dataclasses.replace(CONFIG, learning_rate=CONFIG.learning_rate / 2))[0]
    assert jax.tree.all(jax.tree.map(np.allclose, halved.actor, same.actor))


@pytest.mark.parametrize(
    ("cost", "done", "expected"), [(0.5, 0, 0.15), (5e5, 0, 0.15), (0.5, 1, 1.0), (0.0, 0, 1.0), (-0.5, 0, 1.0)]
)
def test_noise_that_costs_much_reward_is_lowered_after_the_first_rollout(collected, cost, done, expected):
    rng = np.random.default_rng(0)
    latents = rng.normal(size=(64, 8, 4))
    rewards = max(abs(cost), 1.0) * rng.normal(size=(64, 8)) - cost * np.sum(np.clip(latents, -1, 1) ** 2, axis=-1)
    fitted = after_rewards(collected, rewards, latents, informed=bool(done))
    np.testing.assert_allclose(np.exp(fitted.actor(jnp.zeros(3)).log_std), expected, rtol=1e-5)


@pytest.mark.parametrize("offset", [0.0, 1000.0])
def test_a_rollout_that_tells_only_the_price_of_actions_leaves_the_policy(collected, offset):
    latents = np.random.default_rng(0).normal(size=(64, 8, 4)).astype(np.float32)
    price = -0.1 * np.sum(np.clip(latents, -1, 1) ** 2, axis=-1) + offset
    goal = price.copy()
    goal[5, 3] += 100.0
    alike = np.full_like(price, offset - 1.0)
    for informed, (rewards, learns) in itertools.product(
        (False, True), ((price, False), (alike, False), (goal, True))
    ):
        after = after_rewards(collected, rewards, latents, informed)
        assert bool(after.informed) == (informed or learns)
        assert float(after.step_scale) == (2.0 if learns else 1.0)
        moved = np.asarray(after.actor.mean_head.bias)
        np.testing.assert_array_equal(moved, np.full(4, float(learns)))
        np.testing.assert_array_equal(after.actor(jnp.zeros(3)).log_std, 0.0)  # not even then is noise too dear
    ended = np.zeros((64, 8), bool)
    ended[5, 3] = True
    assert after_rewards(collected, np.ones_like(price), latents, terminated=ended).informed


def after_rewards(collected, rewards, latents, informed=False, **changes):
    """The learner after a rollout of such rewards; training moved the biases of its policy's mean to 1."""
    config = dataclasses.replace(CONFIG, log_std_init=0.0, deviation="fitted")
    state = init_learner(jax.random.key(0), Spaces(3, 4), config)
    state = dataclasses.replace(state, informed=jnp.asarray(informed))
    head = dataclasses.replace(state.actor.mean_head, bias=jnp.ones(4))
    actor = dataclasses.replace(state.actor, mean_head=head)
    improved = dataclasses.replace(state, actor=actor, step_scale=jnp.asarray(2.0))
    rollout = dataclasses.replace(collected[1], latents=latents, rewards=np.float32(rewards), **changes)
    return wait_for_rewards(state, improved, rollout, config)


def test_every_environment_draws_its_own_truncations_and_resets(resetting):
    """In 512 environments; ``tasks/test_pendulum.py`` has their distributions."""
    _, rollout = collect(resetting[0], dataclasses.replace(PENDULUM, truncation_probability=0.1), MANY)
    # Binomial: at each step a mean of 51.2 and a deviation of 6.8.
    assert np.abs(np.asarray(rollout.truncated).sum(axis=1) - 51.2).max() < 5 * 6.8
    both = np.concatenate([np.asarray(state.task_states.x) for state in resetting[:2]])
    assert len(np.unique(both, axis=0)) == len(both) == 1024
