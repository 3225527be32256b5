import dataclasses

import jax
import jax.numpy as jnp
import pytest

from swingup.areapo.config import Config, config_from_dict
from swingup.areapo.schedule import at_iteration
from swingup.areapo.words import format_value, parse_value
from swingup.common.errors import SwingupError

CONFIG = Config(
    num_envs=8, num_steps=128, batch_size=1024, learning_rate=1e-3, clip_range=0.2, temperature=2.0,
    schedule_frames=8192, learning_rate_schedule=(0.25, 1.0, 0.75, 0.1), temperature_schedule=(0.5, 0.5),
)  # fmt: skip


@pytest.mark.parametrize(
    ("iterations", "learning_rate"), [(0, 1e-3), (2, 1e-3), (3, 0.775e-3), (5, 0.325e-3), (6, 1e-4), (10**6, 1e-4)]
)
def test_a_schedule_is_a_line_through_its_pairs(iterations, learning_rate):
    found = jax.jit(at_iteration)(CONFIG, jnp.array(iterations))
    assert float(found.learning_rate) == pytest.approx(learning_rate, rel=1e-5)
    assert float(found.temperature) == pytest.approx(1.0)
    assert (found.clip_range, found.gae_lambda, found.num_epochs) == (0.2, CONFIG.gae_lambda, CONFIG.num_epochs)


@pytest.mark.parametrize(
    ("iterations", "learning_rate"), [(3, 0.775e-3), (7, 1e-4), (8, 1e-3), (11, 0.775e-3), (8003, 0.775e-3)]
)
def test_a_schedule_begins_anew(iterations, learning_rate):
    found = jax.jit(at_iteration)(dataclasses.replace(CONFIG, schedule_repeats=True), jnp.array(iterations))
    assert float(found.learning_rate) == pytest.approx(learning_rate, rel=1e-5)


def test_without_frames_nothing_changes():
    config = Config(learning_rate_schedule=(0.0, 0.5))
    assert at_iteration(config, jnp.array(5)) is config


@pytest.mark.parametrize(
    ("pairs", "message"),
    [
        ((0.5,), "has a part without a factor"),
        ((0.5, 1.0, 0.5, 2.0), "its parts must rise"),
        ((-0.1, 1.0), "a part in clip_range_schedule"),
        ((0.1, -1.0), "a factor in clip_range_schedule"),
        ((0.1, float("nan")), "a factor in clip_range_schedule"),
        ((0.1, True), "use pairs of numbers such as 0.5 1 1 0.1"),
        (0.1, "use pairs of numbers such as 0.5 1 1 0.1"),
    ],
)
def test_a_schedule_that_cannot_work_is_refused(pairs, message):
    with pytest.raises(SwingupError, match=message):
        Config(clip_range_schedule=pairs)


def test_a_schedule_as_text_and_from_json():
    pairs = (0.5, 1.0, 1.0, 0.1)
    assert parse_value("temperature_schedule", "0.5 1 1 0.1") == pairs
    assert parse_value("temperature_schedule", format_value(pairs)) == pairs
    assert config_from_dict({"temperature_schedule": list(pairs)}).temperature_schedule == pairs
