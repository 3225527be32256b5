"""Options of networks, rewards, reset costs and schedules on both back ends: bits after a resume, policies."""

import dataclasses

import jax
import numpy as np
import pytest

from policies import load_any_policy
from swingup.areapo.config import Config
from swingup.learner.run_settings import RunSettings
from swingup.learner.start import start_run

from .corridors import Corridor
from .environments import Noisy
from .test_run import assert_same_runs, measured, resumed_after

TINY = Config(
    num_envs=2, num_steps=16, num_epochs=1, batch_size=16, policy_layers=(8, 8), value_layers=(8,),
    centre_values=True,
)  # fmt: skip
FRAMES = 32
"""Frames of one iteration."""
OPTIONS = {
    "none": {},
    "activation": {"activation": "tanh"},
    "normalise_rewards": {"normalise_rewards": True},
    "one deviation": {"deviation": "action"},
    "adaptive": {"terminations": "adaptive_cost", "reset_cost": 2.0},
    "schedule": {"schedule": "anneal_entropy", "schedule_frames": 160},
}
ENVS = {"host": Noisy, "compiled": Corridor()}
CASES = [
    pytest.param(
        option, env, marks=[pytest.mark.slow] * (name != "host" or option != "none"), id=f"{option}-{name}"
    )
    for option in OPTIONS
    for name, env in ENVS.items()
]


@pytest.mark.parametrize(("option", "env"), CASES)
def test_killed_and_resumed_equals_uninterrupted(tmp_path, option, env):
    """Environments that the host steps start anew at each checkpoint, also where nobody stopped."""
    config = dataclasses.replace(TINY, **OPTIONS[option])
    settings = RunSettings(None, "mujoco", 3, 1, 64, 128, config, "<passed in>", 2)
    list(start_run(settings, tmp_path / "whole", 8 * FRAMES, env).advance())
    run = resumed_after(6 * FRAMES, tmp_path / "part", 8 * FRAMES, settings, env)  # past the checkpoint at 4
    assert run.frames == 4 * FRAMES
    list(run.advance())
    assert_same_runs(tmp_path / "whole", tmp_path / "part")
    costs = {row["reset_cost"] for row in measured(tmp_path / "part")}
    assert (len(costs) > 1) == (option == "adaptive")
    loaded, _ = load_any_policy(tmp_path / "whole" / "last.safetensors")
    kept = run.policies()[0].actor
    assert loaded.actor.activation == kept.activation
    # A file does not say that the deviation's weights were not to learn: they are 0.
    for found, expected in zip(jax.tree.leaves(loaded.actor), jax.tree.leaves(kept), strict=True):
        np.testing.assert_array_equal(found, expected)
