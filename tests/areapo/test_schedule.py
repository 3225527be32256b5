import dataclasses

import jax
import jax.numpy as jnp
import pytest

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


def test_cycles_are_of_whole_iterations_and_a_constant_schedule_changes_nothing():
    config = dataclasses.replace(CONFIG, schedule_frames=99_001)  # 100 iterations, rounded up
    assert float(scheduled(config, jnp.array(99)).learning_rate) < 2e-4
    config = dataclasses.replace(CONFIG, schedule="constant")
    assert scheduled(config, jnp.array(5)) is config
