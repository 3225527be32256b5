"""Absurd sizes are refused before anything is allocated."""

import pytest

from swingup import AREAPO
from swingup.areapo.config import Config
from swingup.cli import main
from swingup.common.errors import SwingupError
from swingup.learner import memory
from swingup.learner.memory import check_memory, training_bytes
from swingup.tasks.task import Spaces


def test_weights_by_hand():
    # Actor 3-4-2·1 outputs: 4·4 + 5·2 = 26; critic 3-5-2: 4·5 + 6·2 = 32; 8 copies of 4 bytes.
    config = Config(num_envs=2, num_steps=4, batch_size=8, num_epochs=1, policy_layers=(4,), value_layers=(5,))
    weights, rollouts = training_bytes(config, Spaces(3, 1))
    assert weights == 8 * 4 * (26 + 32)
    # A frame: two observations, an action, the widest hidden layer twice, 24 numbers and twice an epoch's order.
    assert rollouts == 4 * 8 * (2 * 3 + 1 + 2 * 5 + 24 + 2)


@pytest.mark.parametrize("preset_size", [Config(), Config(num_envs=8, num_steps=256, batch_size=128)])
def test_usual_sizes_are_no_matter(preset_size):
    weights, rollouts = training_bytes(preset_size, Spaces(6, 1))
    assert weights + rollouts < 200e6
    check_memory(preset_size, Spaces(6, 1), seeds=5)


def test_where_nobody_tells_the_memory_nothing_is_refused(monkeypatch):
    monkeypatch.setattr(memory, "available_bytes", lambda: None)
    check_memory(Config(policy_layers=(10**6, 10**6)), Spaces(6, 1))


@pytest.mark.parametrize(
    "words",
    [
        "acrobot --seeds 2147483648",
        "acrobot --policy-layers 400000 400000",
        "acrobot --num-envs 2000000000 --num-steps 2000000000 --batch-size 2000000000",
        "--env CartPole-v1 --num-envs 2000000000 --num-steps 1000 --batch-size 2000000000",
        "--env CartPole-v1 --value-layers 1000000x1000000",
    ],
)
def test_the_command_refuses_them_in_a_line(words, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    assert main(["train", *words.split()]) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert "this training needs about" in line
    assert "GiB: reduce policy_layers, value_layers, num_envs, num_steps or seeds" in line
    assert not list(tmp_path.iterdir())


def test_beyond_indices():
    with pytest.raises(SwingupError, match="num_envs = 4294967296: use a whole number from 1 to 2147483647"):
        AREAPO("acrobot", num_envs=2**32)
