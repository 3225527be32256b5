"""Options of networks, rewards, reset costs and schedules on both back ends: bits after a resume, policies."""

import dataclasses

import jax
import numpy as np
import pytest

from policies import load_any_policy
from swingup.areapo.config import Config
from swingup.learner.run_settings import RunSettings
from swingup.learner.start import resume_run, start_run

from .corridors import Corridor
from .environments import Noisy
from .test_run import assert_same_files, measured

TINY = Config(
    num_envs=2, num_steps=16, num_epochs=1, batch_size=16, policy_layers=(8, 8), value_layers=(8,),
    centre_values=True,
)  # fmt: skip
FRAMES = 32
"""Frames of one iteration."""
OPTIONS = {
    "activation": {"activation": "tanh"},
    "normalise_rewards": {"normalise_rewards": True},
    "one deviation": {"deviation": "action"},
    "adaptive": {"terminations": "adaptive_cost", "reset_cost": 2.0},
    "schedule": {"schedule": "anneal_entropy", "schedule_frames": 160},
}
ON = {
    "host": lambda config: (RunSettings(None, "mujoco", 3, 1, 64, 128, config, "<noisy>", 2), Noisy),
    "compiled": lambda config: (RunSettings(None, "mujoco", 3, 1, 64, 128, config, "<corridor>", 2), Corridor()),
}


@pytest.mark.slow
@pytest.mark.parametrize("back_end", ON)
@pytest.mark.parametrize("option", OPTIONS)
def test_killed_and_resumed_equals_uninterrupted(tmp_path, option, back_end):
    settings, env = ON[back_end](dataclasses.replace(TINY, **OPTIONS[option]))
    list(start_run(settings, tmp_path / "whole", 8 * FRAMES, env).advance())
    run = start_run(settings, tmp_path / "part", 8 * FRAMES, env)
    for report in run.advance():
        if report.frames == 6 * FRAMES:  # past the checkpoint at 4: what came since is lost
            break
    run = resume_run(tmp_path / "part", env=env)
    assert run.frames == 4 * FRAMES
    list(run.advance())
    assert_same_files(tmp_path / "whole", tmp_path / "part")
    assert measured(tmp_path / "whole") == measured(tmp_path / "part")
    costs = {row["reset_cost"] for row in measured(tmp_path / "part")}
    assert (len(costs) > 1) == (option == "adaptive")
    loaded, _ = load_any_policy(tmp_path / "whole" / "last.safetensors")
    kept = run.policy().actor
    assert loaded.actor.activation == kept.activation
    # A file does not say that the deviation's weights were not to learn: they are 0.
    for found, expected in zip(jax.tree.leaves(loaded.actor), jax.tree.leaves(kept), strict=True):
        np.testing.assert_array_equal(found, expected)
