"""Absurd sizes are refused before anything is allocated."""

import pytest

from swingup.areapo.config import Config
from swingup.cli import main
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


def test_the_command_refuses_them_in_a_line(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    for words in (
        "acrobot --seeds 2147483648",
        "acrobot --num-envs 2000000000 --num-steps 2000000000 --batch-size 2000000000",
        "--env CartPole-v1 --value-layers 1000000x1000000",
    ):
        assert main(["train", *words.split()]) == 2
        (line,) = capsys.readouterr().err.splitlines()
        assert "GiB: reduce policy_layers, value_layers, num_envs, num_steps or seeds" in line
        assert not list(tmp_path.iterdir())
