import jax
import jax.numpy as jnp
import pytest

from swingup.areapo.anneal import annealed
from swingup.areapo.config import Config
from swingup.errors import SwingupError

CONFIG = Config(
    num_envs=8, num_steps=128, batch_size=1024, learning_rate=1e-3, clip_range=0.2, temperature=2.0,
    anneal_begin=2048, anneal_end=6144, learning_rate_end=0.01, clip_range_end=0.25, temperature_end=0.5,
)  # fmt: skip


@pytest.mark.parametrize(
    ("iterations", "learning_rate", "clip_range", "temperature"),
    [
        (0, 1e-3, 0.2, 2.0),
        (2, 1e-3, 0.2, 2.0),
        (4, 1e-4, 0.1, 1.5),
        (6, 1e-5, 0.05, 1.0),
        (3_000_000, 1e-5, 0.05, 1.0),
    ],
)
def test_rates_fall_geometrically_and_the_temperature_linearly(iterations, learning_rate, clip_range, temperature):
    found = jax.jit(annealed)(CONFIG, jnp.array(iterations))
    assert float(found.learning_rate) == pytest.approx(learning_rate, rel=1e-5)
    assert float(found.clip_range) == pytest.approx(clip_range, rel=1e-5)
    assert float(found.temperature) == pytest.approx(temperature, rel=1e-5)
    assert (found.gae_lambda, found.num_epochs) == (CONFIG.gae_lambda, CONFIG.num_epochs)


def test_without_an_end_nothing_changes():
    config = Config()
    assert annealed(config, jnp.array(5)) is config


@pytest.mark.parametrize("begin", [10, 20])
def test_a_begin_that_is_not_before_the_end_is_refused(begin):
    with pytest.raises(SwingupError, match=f"anneal_begin = {begin} is not before anneal_end = 10: lower it"):
        Config(anneal_begin=begin, anneal_end=10)
