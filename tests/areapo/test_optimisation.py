"""Loss and gains by hand, schedules, and random orders: every frame once, and every order equally often."""

import dataclasses
import types

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from swingup.areapo import algorithm, optimisation
from swingup.areapo.algorithm import lambda_advantages, update_gains
from swingup.areapo.config import Config
from swingup.areapo.initial import init_actor, init_critic
from swingup.areapo.optimisation import scheduled
from swingup.areapo.state import Frames, LearnerState
from swingup.areapo.statistics import standardise

# One program each costs less than compiling operation by operation.
loss, gradient = jax.jit(algorithm.loss), jax.jit(jax.grad(algorithm.loss, has_aux=True))
log_probs = jax.jit(lambda actor, o, z: jax.vmap(lambda o, z: actor(o).log_prob(z))(o, z))
NETWORKS = jax.jit(lambda a, c: (init_actor(a, 3, 1, (8,), -1.0), init_critic(c, 3, (8,))))(
    jax.random.key(0), jax.random.key(1)
)
OBSERVATIONS = jax.random.normal(jax.random.key(2), (4, 3))
LATENTS = jax.random.normal(jax.random.key(3), (4, 1))
LOG_PROBS = log_probs(NETWORKS[0], OBSERVATIONS, LATENTS)
VALUES = jax.jit(lambda critic, o: jax.vmap(critic)(o))(NETWORKS[1], OBSERVATIONS)
CONFIG = Config(num_envs=2, num_steps=2, batch_size=4)


def batch(log_ratios=0.0, advantages=(1.0, -1.0, 1.0, -1.0), errors=0.0):
    """A batch whose probability ratios are e^log_ratios and whose value errors are ``errors``."""
    return Frames(OBSERVATIONS, LATENTS, LOG_PROBS - log_ratios, jnp.array(advantages), VALUES - errors)


def test_loss_by_hand():
    # Errors 2 and 3: 0.25 (2² + 0.5 · 3²) = 2.125; at ratio 1 the normalised advantages average to 0.
    total, metrics = loss(NETWORKS, batch(errors=jnp.array([2.0, 3.0])), CONFIG)
    found = [total, metrics.value_loss, metrics.entropy_value_loss]
    np.testing.assert_allclose(found, [2.125, 4.0, 9.0], rtol=1e-5)
    # ε = 0.05 and ratio 1.2: A = 1 counts 1.05, A = -1 counts -1.2; -mean of (1.05, -1.2, 1.05, -1.2) = 0.075.
    total, metrics = loss(NETWORKS, batch(log_ratios=jnp.log(jnp.full(4, 1.2))), CONFIG)
    assert total == pytest.approx(0.075, rel=1e-4)
    assert metrics.clip_fraction == 1.0
    # mean(r - 1 - log r) = 0.2 - log 1.2
    assert metrics.approximate_kl == pytest.approx(0.2 - np.log(1.2), rel=1e-4)
    # Ratio 0.8: A = 1 counts 0.8, A = -1 counts -0.95; -mean of (0.8, -0.95, 0.8, -0.95) = 0.075.
    assert loss(NETWORKS, batch(log_ratios=jnp.log(jnp.full(4, 0.8))), CONFIG)[0] == pytest.approx(0.075, rel=1e-4)


def test_means_beyond_the_bounds_cost_the_square_of_their_excess():
    """Means of 3, -1.5 and 0.9 lie 2, 0.5 and 0 beyond the bounds of clipped actions: c (2² + 0.5²)."""
    outside = jnp.array([3.0, -1.5, 0.9])
    latents = jnp.broadcast_to(outside, (4, 3))

    def networks(bounds):
        actor = init_actor(jax.random.key(0), 3, 3, (8,), 0.0, bounds=bounds)
        flat = dataclasses.replace(actor.mean_head, weight=jnp.zeros((3, 8)), bias=outside)
        return dataclasses.replace(actor, mean_head=flat), NETWORKS[1]

    def found(coefficient, bounds="clip"):
        pair = networks(bounds)
        frames = dataclasses.replace(batch(), latents=latents, log_probs=log_probs(pair[0], OBSERVATIONS, latents))
        return loss(pair, frames, dataclasses.replace(CONFIG, excess_coefficient=coefficient))[0]

    assert found(0.003) == pytest.approx(0.003 * 4.25, abs=1e-6)
    assert found(0.0) == pytest.approx(0.0, abs=1e-6)
    assert found(0.003, "tanh") == pytest.approx(0.0, abs=1e-6)


def test_gradient_at_ratio_one_is_the_policy_gradient():
    advantages = jnp.array([0.3, -1.0, 2.0, 0.7])

    def reinforce(actor):
        return -jnp.mean(log_probs(actor, OBSERVATIONS, LATENTS) * standardise(advantages))

    expected = jax.jit(jax.grad(reinforce))(NETWORKS[0])
    frames = batch(advantages=advantages)
    actual = gradient(NETWORKS, frames, CONFIG)[0][0]
    jax.tree.map(lambda a, b: np.testing.assert_allclose(a, b, atol=1e-6), actual, expected)


GAINS = {"gains": jnp.zeros(2), "gain_trace": jnp.zeros(())}
START = LearnerState(**dict.fromkeys(LearnerState.__dataclass_fields__) | GAINS)
"""Only the gains matter."""


@jax.jit
def history(rewards, config):
    """ρ after rollouts of one constant reward each, for values that stay at 0."""

    def learn(state, reward):
        deltas = jnp.full((config.num_steps, 1, 2), reward) - state.gains
        if config.gain == "advantage":
            deltas = lambda_advantages(deltas, jnp.zeros(deltas.shape[:2], bool), config)
        after = update_gains(state, deltas, types.SimpleNamespace(counted=None), config)
        return after, after.gains[0]

    return jax.lax.scan(learn, START, rewards)[1]


def test_the_authors_gain_starts_at_full_step():
    # Over 128 steps mean(Σ 0.8^k) = 4.844: ρ_1 = 4.84, ρ_2 = 4.84 + 0.5025 · 4.84 (1 - 4.84) = -4.51, and so on.
    found = history(jnp.ones(200), Config())
    np.testing.assert_allclose(found[:5], [4.84, -4.51, 4.48, 0.20, 0.99], atol=0.01)
    assert found[-1] == pytest.approx(1.0, abs=1e-4)


@pytest.mark.parametrize("gae_lambda", [0.0, 0.8, 0.98, 1.0])
def test_the_gain_of_errors_is_the_mean_reward(gae_lambda):
    """In each rollout, for every λ: mean(δ) = r - ρ with values that stay at 0."""
    found = history(jnp.array([0.0, 3.0, -9.0, 1009.0]), Config(gain="td", gae_lambda=(gae_lambda, 0.6)))
    np.testing.assert_allclose(found, [0.0, 3.0, -9.0, 1009.0], atol=1e-6)


def test_rows_that_do_not_count_move_no_gain():
    errors = jnp.array([[[1.0, 1.0]], [[100.0, 100.0]]])
    rollout = types.SimpleNamespace(counted=jnp.array([[1.0], [0.0]]))
    np.testing.assert_allclose(update_gains(START, errors, rollout, Config()).gains, 1.0, rtol=1e-6)


SCHEDULE = Config(
    num_envs=8, num_steps=125, batch_size=1000, learning_rate=1e-3, clip_range=0.2, temperature=2.0,
    schedule="anneal", schedule_frames=100_000,
)  # fmt: skip
"""A cycle has 100 iterations."""


SCHEDULED = [
    # In each cycle learning rate and clip range fall by the same factor in equal times, after half of it.
    *(("anneal", 1, start + done, (1e-3 * 0.1**fall, 0.2 * 0.15**fall, 2.0, 0.98, 0.93))
      for start in (0, 100, 10**6) for done, fall in ((0, 0.0), (50, 0.0), (75, 0.5), (99, 0.98))),
    # The temperature is lower for a while.
    *(("anneal_entropy", 2, done, (None, None, 2.0 * factor, 0.98, 0.93))
      for done, factor in ((0, 1.0), (30, 0.55), (80, 0.55), (105, 0.775), (130, 1.0), (198, 1.0))),
    # λ falls once, after a third of the schedule.
    *(("anneal_lambda", 3, done, (1e-3, 0.2, 2.0, most, min(most, 0.93)))
      for done, most in ((0, 0.98), (100, 0.98), (200, 1 - 0.002**0.5), (300, 0.9), (10**6, 0.9))),
]  # fmt: skip
"""A schedule, of so many cycles, and after some iterations learning rate, clip range, temperature and both λ."""


@pytest.mark.parametrize(("schedule", "cycles", "done", "expected"), SCHEDULED)
def test_what_a_schedule_changes_and_leaves(schedule, cycles, done, expected):
    changes = {"schedule": schedule, "schedule_frames": cycles * 100_000, "gae_lambda": (0.98, 0.93)}
    config = jax.jit(scheduled)(dataclasses.replace(SCHEDULE, **changes), jnp.array(done))
    found = (config.learning_rate, config.clip_range, config.temperature, *config.gae_lambda)
    for value, right in zip(found, expected, strict=True):
        assert right is None or float(value) == pytest.approx(right, rel=1e-5)


@pytest.mark.parametrize("before", [(1.0, 1.0), (0.8, 0.95), (0.9, 0.98)])
def test_no_lambda_rises_or_jumps(before):
    config = dataclasses.replace(SCHEDULE, schedule="anneal_lambda", gae_lambda=before)
    found = jax.jit(jax.vmap(lambda done: jnp.stack(scheduled(config, done).gae_lambda)))(jnp.arange(102))
    np.testing.assert_allclose(found[0], before, atol=0.0011)
    np.testing.assert_allclose(found[-1], np.minimum(before, 0.9), rtol=1e-6)
    steps = np.diff(found, axis=0)
    assert steps.max() <= 0.0
    assert steps.min() > -0.01


def test_cycles_are_of_whole_iterations_and_a_constant_schedule_changes_nothing():
    config = dataclasses.replace(SCHEDULE, schedule_frames=99_001)  # 100 iterations, rounded up
    assert float(scheduled(config, jnp.array(99)).learning_rate) < 2e-4
    config = dataclasses.replace(SCHEDULE, schedule="constant")
    assert scheduled(config, jnp.array(5)) is config


# With so few random bits wanted frames' numbers share a word with them; with so many they do not.
LEAST = {"tagged": optimisation.MIN_RANDOM_BITS, "sorted by bits": optimisation.WORD_BITS + 1}


@pytest.fixture(params=LEAST.values(), ids=LEAST)
def orders(request, monkeypatch):
    monkeypatch.setattr(optimisation, "MIN_RANDOM_BITS", request.param)

    def draw(epochs, size):
        return np.asarray(jax.jit(lambda key: optimisation.shuffled(key, epochs, size))(jax.random.key(0)))

    return draw


@pytest.mark.parametrize("size", [1, 24, 1024, 1025])
def test_an_order_has_every_frame_once(orders, size):
    drawn = orders(3, size)
    assert drawn.dtype == np.int32
    np.testing.assert_array_equal(np.sort(drawn, axis=-1), np.tile(np.arange(size), (3, 1)))


def test_all_orders_come_and_all_minibatches_have_a_frame_equally_often(orders):
    """Each of the 3! orders of three frames comes 1000 times in 6000 epochs, with a deviation of 29."""
    _, counts = np.unique(orders(6000, 3), axis=0, return_counts=True)
    assert counts.size == 6
    assert np.abs(counts - 1000).max() < 5 * 29
    # A rollout of Table I's size: binomial, 200 draws of probability 1/8: mean 25, deviation 4.7.
    drawn = orders(200, 8192)
    for frame in (0, 1, 8190, 8191):
        minibatches = np.argmax(drawn == frame, axis=-1) // 1024
        assert np.abs(np.bincount(minibatches, minlength=8) - 25).max() < 5 * 4.7
