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
    config = jax.jit(scheduled)(dataclasses.replace(CONFIG, **changes), jnp.array(done))
    found = (config.learning_rate, config.clip_range, config.temperature, *config.gae_lambda)
    for value, right in zip(found, expected, strict=True):
        assert right is None or float(value) == pytest.approx(right, rel=1e-5)


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
