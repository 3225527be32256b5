"""Schedules, and random orders: every frame once, and every order equally often."""

import dataclasses

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from swingup.areapo import optimisation
from swingup.areapo.config import Config
from swingup.areapo.optimisation import scheduled

CONFIG = Config(
    num_envs=8, num_steps=125, batch_size=1000, learning_rate=1e-3, clip_range=0.2, temperature=2.0,
    schedule="anneal", schedule_frames=100_000,
)  # fmt: skip
"""A cycle has 100 iterations."""


@pytest.mark.parametrize("start", [0, 100, 10**6])
@pytest.mark.parametrize(
    ("done", "rate", "clip"),
    [(0, 1.0, 1.0), (50, 1.0, 1.0), (75, 0.1**0.5, 0.15**0.5), (99, 0.1**0.98, 0.15**0.98)],
)
def test_learning_rate_and_clip_range_fall_by_the_same_factor_in_equal_times(start, done, rate, clip):
    found = jax.jit(scheduled)(CONFIG, jnp.array(start + done))
    assert float(found.learning_rate) == pytest.approx(1e-3 * rate, rel=1e-4)
    assert float(found.clip_range) == pytest.approx(0.2 * clip, rel=1e-4)
    assert float(found.temperature) == 2.0


@pytest.mark.parametrize(
    ("done", "factor"), [(0, 1.0), (15, 0.55), (40, 0.55), (52.5, 0.775), (65, 1.0), (99, 1.0)]
)
def test_the_temperature_is_lower_for_a_while(done, factor):
    config = dataclasses.replace(CONFIG, schedule="anneal_entropy", schedule_frames=200_000)
    found = jax.jit(scheduled)(config, jnp.array(int(2 * done)))
    assert float(found.temperature) == pytest.approx(2.0 * factor, rel=1e-4)


@pytest.mark.parametrize(
    ("done", "most"), [(0, 0.98), (100, 0.98), (200, 1 - 0.002**0.5), (300, 0.9), (10**6, 0.9)]
)
def test_lambda_falls_once_after_a_third_of_the_schedule(done, most):
    config = dataclasses.replace(CONFIG, schedule="anneal_lambda", schedule_frames=300_000, gae_lambda=(0.98, 0.93))
    found = jax.jit(scheduled)(config, jnp.array(done))
    np.testing.assert_allclose(found.gae_lambda, (most, min(most, 0.93)), rtol=1e-6)


def test_cycles_are_of_whole_iterations_and_a_constant_schedule_changes_nothing():
    config = dataclasses.replace(CONFIG, schedule_frames=99_001)  # 100 iterations, rounded up
    assert float(scheduled(config, jnp.array(99)).learning_rate) < 2e-4
    config = dataclasses.replace(CONFIG, schedule="constant")
    assert scheduled(config, jnp.array(5)) is config


# With so few random bits wanted frames' numbers share a word with them; with so many they do not.
LEAST = {"tagged": optimisation.LEAST_RANDOM, "sorted by bits": optimisation.WORD + 1}


@pytest.fixture(params=LEAST.values(), ids=LEAST)
def orders(request, monkeypatch):
    monkeypatch.setattr(optimisation, "LEAST_RANDOM", request.param)

    def draw(epochs, size):
        return np.asarray(jax.jit(lambda key: optimisation.shuffled(key, epochs, size))(jax.random.key(0)))

    return draw


@pytest.mark.parametrize("size", [1, 24, 1024, 1025])
def test_an_order_has_every_frame_once(orders, size):
    drawn = orders(3, size)
    assert drawn.dtype == np.int32
    np.testing.assert_array_equal(np.sort(drawn, axis=-1), np.tile(np.arange(size), (3, 1)))


def test_all_orders_come_equally_often(orders):
    """Each of the 3! orders of three frames comes 1000 times in 6000 epochs, with a deviation of 29."""
    _, counts = np.unique(orders(6000, 3), axis=0, return_counts=True)
    assert counts.size == 6
    assert np.abs(counts - 1000).max() < 5 * 29


def test_a_frame_is_in_every_minibatch_equally_often(orders):
    """A rollout of Table I's size: a frame's place is even, also for the first and the last frames."""
    drawn = orders(200, 8192)
    # Binomial, 200 draws of probability 1/8: mean 25, deviation 4.7.
    for frame in (0, 1, 8190, 8191):
        minibatches = np.argmax(drawn == frame, axis=-1) // 1024
        assert np.abs(np.bincount(minibatches, minlength=8) - 25).max() < 5 * 4.7
