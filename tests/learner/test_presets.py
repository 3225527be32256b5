"""Presets: the pendulum's sizes and those of other tasks."""

import dataclasses

import pytest

from swingup.areapo.config import Config
from swingup.cli.training import default_options
from swingup.learner.presets import PRESETS, get_preset, is_pendulum
from swingup.learner.run_settings import ENV_INTERVALS, RunSettings
from swingup.plant.robots import ROBOTS
from swingup.sweep.plan import plan_jobs
from swingup.tasks.presets import smooth_task

PPO = {
    "num_envs": 1, "num_steps": 2048, "batch_size": 64, "num_epochs": 10, "learning_rate": 3e-4, "discount": 0.99,
    "gae_lambda": 0.95, "clip_range": 0.2, "max_grad_norm": 0.5, "value_coefficient": 0.5, "temperature": 0.0,
    "policy_layers": (64, 64), "value_layers": (64, 64), "adam_epsilon": 1e-5, "log_std_init": 0.0,
    "activation": "tanh", "state_dependent_std": False,
}  # fmt: skip
"""The arguments' defaults of Stable-Baselines3's PPO, by our names."""


def test_ppo_has_the_sizes_that_its_users_expect():
    config = get_preset("ppo", pendulum=False).config
    assert {name: getattr(config, name) for name in PPO} == PPO
    assert (config.average_reward, config.ending) == (False, "end")


def test_on_the_pendulum_the_family_keeps_the_sizes_of_the_paper():
    """The recorded comparisons have them: only the objective differs from Table I."""
    discounted = {"average_reward": False, "discount": 0.99, "entropy_discount": 0.99, "gae_lambda": 0.95}
    objectives = {
        "ppo": discounted | {"temperature": 0.0, "clip_range": 0.2},
        "eapo": discounted | {"clip_range": 0.2, "popart": True},
        "apo": {"temperature": 0.0, "centre_values": True},
    }
    for name, changes in objectives.items():
        assert get_preset(name).config == Config(**changes)
        assert get_preset(name).frames == 12_000_000
        assert get_preset(name).task == "smooth"


@pytest.mark.parametrize("name", PRESETS)
def test_elsewhere_only_the_family_differs(name):
    here, elsewhere = get_preset(name), get_preset(name, pendulum=False)
    assert (here is elsewhere) == (name not in ("ppo", "eapo", "apo"))
    # The objective is the preset's meaning and stays.
    for each in ("average_reward", "discount", "entropy_discount", "popart"):
        assert getattr(here.config, each) == getattr(elsewhere.config, each)
    assert (here.config.temperature == 0.0) == (elsewhere.config.temperature == 0.0)


def test_each_way_to_a_run_chooses_by_the_task(tmp_path):
    assert is_pendulum("acrobot")
    assert is_pendulum(smooth_task(ROBOTS["acrobot"]))
    assert not is_pendulum("Pendulum-v1")
    sizes = {}
    for robot, env in ((None, "Pendulum-v1"), ("acrobot", None)):
        base = default_options({"robot": robot, "env": env, "preset": "ppo"})
        (job,) = plan_jobs(base, {}, (0,), tmp_path)
        sizes[env or robot] = (job.settings["config"]["num_envs"], job.frames)
    assert sizes == {"Pendulum-v1": (1, 1_000_000), "acrobot": (64, 12_000_000)}


def test_the_command_names_what_the_task_at_hand_does_not_give():
    elsewhere = get_preset("ppo", pendulum=False).config
    settings = RunSettings(None, "ppo", 0, 1, **ENV_INTERVALS, config=elsewhere, env="Pendulum-v1")
    assert settings.command(64) == "swingup train --env Pendulum-v1 --preset ppo --frames 64 --seed 0"
    # A task that was passed in may be a pendulum's: the sizes of either kind are named.
    for config in (elsewhere, get_preset("ppo").config):
        call = dataclasses.replace(settings, env="<mine.Task>", config=config).command(64)
        assert f"num_envs={config.num_envs}, num_steps={config.num_steps}" in call
        assert "gae_lambda" not in call
