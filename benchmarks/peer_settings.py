"""Hyperparameters of the peer in `mujoco_learning.py`: Stable-Baselines3's PPO with RL Baselines3 Zoo's settings.

They are facts of its file `hyperparams/ppo.yml`, for the tasks of version 3 (Gym's), and apply to version 5 here.
"""

from typing import Any

ZOO: dict[str, dict[str, Any]] = {
    "Swimmer": {"gamma": 0.9999},
    "Ant": {},
    "HalfCheetah": {
        "batch_size": 64, "n_steps": 512, "gamma": 0.98, "learning_rate": 2.0633e-05, "ent_coef": 0.000401762,
        "clip_range": 0.1, "n_epochs": 20, "gae_lambda": 0.92, "max_grad_norm": 0.8, "vf_coef": 0.58096,
    },
    "Hopper": {
        "batch_size": 32, "n_steps": 512, "gamma": 0.999, "learning_rate": 9.80828e-05, "ent_coef": 0.00229519,
        "clip_range": 0.2, "n_epochs": 5, "gae_lambda": 0.99, "max_grad_norm": 0.7, "vf_coef": 0.835671,
    },
    "Walker2d": {
        "batch_size": 32, "n_steps": 512, "gamma": 0.99, "learning_rate": 5.05041e-05, "ent_coef": 0.000585045,
        "clip_range": 0.1, "n_epochs": 20, "gae_lambda": 0.95, "max_grad_norm": 1.0, "vf_coef": 0.871923,
    },
    "Humanoid": {
        "batch_size": 256, "n_steps": 512, "gamma": 0.95, "learning_rate": 3.56987e-05, "ent_coef": 0.00238306,
        "clip_range": 0.3, "n_epochs": 5, "gae_lambda": 0.9, "max_grad_norm": 2.0, "vf_coef": 0.431892,
    },
}  # fmt: skip
"""Arguments of PPO by the task's name without its version. All have one environment and normalise observations and
rewards; Swimmer and Ant have the defaults otherwise. Humanoid's are for 10 million frames."""

WIDE = ("HalfCheetah", "Hopper", "Humanoid")
"""Tasks whose networks are 256-256 of ReLU, not orthogonal at first, with a standard deviation of exp(-2)."""
