"""Presets: what each promises, how a run chooses one, and real trainings from scratch."""

import gymnasium
import pytest
from gymnasium.spaces import Box
from gymnasium.vector import SyncVectorEnv
from gymnasium.wrappers import TimeLimit

from refusals import refusal
from swingup import AREAPO
from swingup.learner.problem import make_problem
from swingup.learner.run import start_run
from swingup.learner.run_settings import make_run_settings
from swingup.plant.files import load_plant


class Endless(gymnasium.Env):
    """An environment that resets itself."""

    observation_space = action_space = Box(-1.0, 1.0, (1,))
    own_resets = 0


def test_a_run_chooses_by_the_task():
    chosen = {
        "acrobot": "pendulum", "Pendulum-v1": "episodes", "swingup/AcrobotSwingup-v0": "dm-acrobot",
        "swingup/ContinuingHopper-v0": "continuing",
    }  # fmt: skip
    assert {env: make_problem(env).choose_preset(None) for env in chosen} == chosen
    assert make_problem("Pendulum-v1", resets="never").choose_preset(None) == "continuing"
    # An object shows by its counter of resets that it never ends.
    for env, preset in ((Endless(), "continuing"), (TimeLimit(Endless(), 9), "continuing"), (Endless, "episodes")):
        assert make_problem(env).choose_preset(None) == preset
    assert make_problem(SyncVectorEnv([Endless])).choose_preset(None) == "continuing"
    for env, preset, only in (
        ("acrobot", "dm-acrobot", "dm_control's acrobot"), ("CartPole-v1", "small", "pendulums"),
        ("swingup/AcrobotSwingup-v0", "pendulum", "pendulums"),
    ):  # fmt: skip
        message = f"preset '{preset}' is for {only}, not for {env}: use one of "
        assert message in refusal(make_problem(env).choose_preset, preset)


WORDS = {
    "verbose": (1, "progress_bar=True"),
    "device": ("cuda", "JAX takes a GPU"),
    "tensorboard_log": ("logs", "folder='runs/mine'"),
    "policy": ("MlpPolicy", "policy_layers"),
}
"""Arguments of Stable-Baselines3 that have no counterpart, and what is said of each."""
WITHOUT_EFFECT = {
    "reset_cost": {"preset": "ppo"},
    "gain_step_size": {},
    "schedule_frames": {"schedule": "constant"},
    "excess_coefficient": {"deviation": "state"},
}


def test_what_would_be_ignored_is_refused():
    for name, (value, told) in WORDS.items():
        assert told in refusal(AREAPO, "CartPole-v1", **{name: value})
    assert "pass the environment first" in refusal(AREAPO, "MlpPolicy", "CartPole-v1")
    for name, others in WITHOUT_EFFECT.items():
        assert f"{name} has no effect with" in refusal(AREAPO, "CartPole-v1", **{name: 1}, **others)
    # A preset's own value, and a word that uses it, are right.
    changes = {"terminations": "reset_cost", "reset_cost": 3.0}
    assert make_run_settings("CartPole-v1", changes=changes).config.reset_cost == 3.0
    assert "needs a run's folder" in refusal(AREAPO.load, "policy.safetensors", which="best")


@pytest.mark.slow
def test_the_default_preset_learns_to_swing_up(tmp_path):
    """With narrow networks, whose frames take a tenth of the time: 7 million, about a minute of one idle core.

    This seed scored 0.59 after 5.2 million.
    """
    narrow = {"policy_layers": (64, 64), "value_layers": (128, 128)}
    settings = make_run_settings("pendubot", "pendulum", narrow, seed=1)
    run = start_run(settings, tmp_path / "run", 7_000_000)
    rewards = [report.best.reward for report in run.advance()]
    # Hanging costs 0.4935 a step; the swing-ups of the optimal-control baselines score 0.35 to 0.54.
    assert rewards[-1] > -0.35
    assert run.best_score > 0.5


@pytest.mark.slow
def test_the_small_preset_learns_on_a_pendulum_of_another_size(tmp_path):
    """A million frames, about ten seconds of one core; on this plant seed 0 held after 0.6 million."""
    settings = make_run_settings("pendubot", "small", plant=load_plant("cloudpendulum").frictionless())
    run = start_run(settings, tmp_path / "run", 1_500_000)
    times = [report.best.evaluation.criteria.swingup_time for report in run.advance()]
    # Up by then, and to the end after 10 s: it does not just spin.
    assert any(time is not None and time < 8 for time in times)
