"""Absurd sizes are refused before anything is allocated."""

import pytest

from swingup.areapo.config import Config
from swingup.learner import memory
from swingup.learner.memory import check_memory, training_bytes
from swingup.tasks.task import Spaces


@pytest.mark.parametrize("preset_size", [Config(), Config(num_envs=8, num_steps=256, batch_size=128)])
def test_usual_sizes_are_no_matter(preset_size):
    weights, rollouts = training_bytes(preset_size, Spaces(6, 1))
    assert weights + rollouts < 200e6
    check_memory(preset_size, Spaces(6, 1), seeds=5)


def test_where_nobody_tells_the_memory_nothing_is_refused(monkeypatch):
    monkeypatch.setattr(memory, "available_bytes", lambda: None)
    check_memory(Config(policy_layers=(10**6, 10**6)), Spaces(6, 1))
