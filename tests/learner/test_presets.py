"""Presets: what each promises, and how a run chooses one."""

from swingup.learner.presets import PRESETS, choose_preset, get_preset, is_pendulum
from swingup.plant.robots import ROBOTS
from swingup.tasks.presets import smooth_task

PPO = {
    "num_envs": 1, "num_steps": 2048, "batch_size": 64, "num_epochs": 10, "learning_rate": 3e-4,
    "discount": (0.99, 0.99), "gae_lambda": (0.95, 0.95), "clip_range": 0.2, "max_grad_norm": 0.5,
    "value_coefficient": (0.5, 0.0), "temperature": 0.0, "policy_layers": (64, 64), "value_layers": (64, 64),
    "log_std_init": 0.0, "activation": "tanh", "deviation": "action", "gain": "none", "terminations": "end",
}  # fmt: skip
"""The arguments' defaults of Stable-Baselines3's PPO, by our names."""


def test_ppo_has_the_sizes_that_its_users_expect():
    config = get_preset("ppo").config
    assert {name: getattr(config, name) for name in PPO} == PPO


def test_only_the_papers_preset_moves_its_gains_as_the_authors():
    rules = {name: preset.config.gain for name, preset in PRESETS.items()}
    assert rules.pop("paper") == "advantage"
    assert (rules.pop("ppo"), rules.pop("acrobot")) == ("none", "none")
    assert set(rules.values()) == {"td"}


def test_a_run_chooses_by_the_task():
    assert is_pendulum("acrobot")
    assert is_pendulum(smooth_task(ROBOTS["acrobot"]))
    assert not is_pendulum("Pendulum-v1")
    assert (choose_preset(None, "acrobot"), choose_preset(None, "Pendulum-v1")) == ("default", "mujoco")
    assert choose_preset(None, "swingup/AcrobotSwingup-v0") == "acrobot"
