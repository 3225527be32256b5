"""Episodes of policy files elsewhere: what they gave, by commands and by Stable-Baselines3's name, and films."""

import json
from typing import ClassVar

import gymnasium
import numpy as np
import pytest
from gymnasium.spaces import Box, Discrete
from PIL import Image

from refusals import refusal
from swingup import AREAPO, evaluate_policy, load_policy, play, watch
from swingup.cli.commands import run_command
from swingup.learner.play import Episodes
from swingup.policy.file import write_network
from swingup.policy.network import Layer, Network
from swingup.policy.policy import TaskPolicy, task_metadata
from swingup.policy.shipped import ZOO
from swingup.policy.spaces import box, discrete

from .environments import TINY, Stairs


class Walk(gymnasium.Env):
    """Right earns 1 and left nothing; it starts at the seed's number of steps from its goal, which ends it."""

    metadata: ClassVar = {"render_modes": ["rgb_array"], "render_fps": 10}

    def __init__(self, render_mode=None):
        self.observation_space, self.action_space, self.render_mode = Box(-9.0, 9.0, (1,)), Discrete(2), render_mode

    def reset(self, *, seed=None, options=None):
        super().reset(seed=seed)
        self.left = 3 + int(self.np_random.integers(2))
        return np.array([self.left], np.float32), {}

    def step(self, action):
        self.left -= int(action)
        done = self.left == 0
        return np.array([self.left], np.float32), float(action), done, False, {"is_success": done}

    def render(self):
        return np.full((20, 30 + self.left, 3), 40 * self.left, np.uint8)[:, :30]


class Passing(Walk):
    """Calls the step before its goal a success, and the end none."""

    def step(self, action):
        *step, _ = super().step(action)
        return *step, {"is_success": self.left == 1}


class Blind(Walk):
    """Draws nothing."""

    def render(self):
        return None


gymnasium.register(id="test/Walk-v0", entry_point=Walk, max_episode_steps=7)


def walker(action, task="test/Walk-v0"):
    """A policy that always takes one action."""
    logits = Layer(np.zeros((2, 1), np.float32), np.float32([1 - action, action]))
    network = Network((), (), logits, choices=(2,))
    return TaskPolicy(network, task_metadata(task, box((1,)), discrete(2), None))


def saved(path, policy):
    write_network(path, policy.network, policy.metadata)
    return path


def test_episodes_are_counted(tmp_path):
    start = Walk()
    lengths = [int(start.reset(seed=seed)[0][0]) for seed in (0, None, None, None)]
    found = play(walker(1), episodes=4)
    assert (found.returns, found.lengths) == (tuple(lengths), tuple(lengths))
    assert (found.terminations, found.successes, found.task) == (4, 4, "test/Walk-v0")
    values = found.as_dict()
    assert (values["return"], values["reward_rate"]) == (np.mean(lengths), 1.0)
    assert values["resets_per_1000_steps"] == pytest.approx(4000 / sum(lengths))
    assert values["success_interval"][0] == pytest.approx(0.51, abs=0.01)  # Wilson's: 4 / (4 + 1.96²)
    assert evaluate_policy(walker(1), Walk, 4) == (np.mean(lengths), np.std(lengths))
    assert play(walker(1), Passing, 4).successes == 0  # the last info decides, as in training
    # To the left nothing is reached, and the limit of 7 steps is not a reset of the task.
    lost = play(walker(0), Walk(), episodes=1).as_dict()
    assert (lost["success_rate"], lost["resets_per_1000_steps"], lost["return_interval"]) == (0.0, 0.0, None)
    assert lost["mean_length"] == 2000
    assert "return_deviation" in Episodes("t", (1.0, 3.0), (1, 1), 0).as_dict()


def test_what_cannot_be_played_is_refused():
    assert "shape (1,), the environment shows (3,)" in refusal(play, walker(1), "Pendulum-v1")
    assert "with actions discrete, n = 2, start = 0, dtype = int64, the env" in refusal(play, walker(1), Stairs)
    assert "takes states: swingup evaluate acrobot" in refusal(play, load_policy("ar-eapo", "acrobot"), Walk)
    assert "has no id: pass it as env" in refusal(play, walker(1, "<my.Walk>"))
    assert "making Nothing-v0 raised" in refusal(play, walker(1), "Nothing-v0")
    assert "episodes = 0" in refusal(play, walker(1), Walk, 0)


def test_a_learner_is_evaluated_like_a_file():
    model = AREAPO("CartPole-v1", **TINY).learn(64)
    assert play(model, "CartPole-v1", 3) == play(model.policy, episodes=3)


def test_commands_play_and_film(tmp_path, capsys):
    file = str(saved(tmp_path / "best.safetensors", walker(1)))
    saved(tmp_path / "first.safetensors", walker(0))
    assert run_command(["evaluate", "--controller", file, "--episodes", "3", "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["success_rate"] == 1.0
    assert run_command(["evaluate", "--env", "test/Walk-v0", "--controller", file]) == 0
    assert "20 episodes\n  Return" in capsys.readouterr().out
    words = ["evaluate", "--controller", file, "--board", "uptime"]
    assert "--board goes with a robot" in refusal(run_command, words)
    assert "--episodes goes with other tasks" in refusal(run_command, ["evaluate", "acrobot", "--episodes", "3"])
    assert "name acrobot or pendubot" in refusal(run_command, ["evaluate"])
    assert run_command(["watch", str(tmp_path), "--out", str(tmp_path / "f.gif")]) == 0
    output = capsys.readouterr().out
    assert "first.safetensors: return 0 in 7 steps\nbest.safetensors: return" in output
    with Image.open(tmp_path / "f.gif") as film:
        # Both side by side, as long as the longer episode; equal frames in a row are one in a GIF.
        assert (film.size, film.n_frames) == ((60, 20), 5)


def test_films_that_cannot_be_are_refused(tmp_path):
    file = saved(tmp_path / "p.safetensors", walker(1))
    assert "holds no policy" in refusal(watch, tmp_path / "..", tmp_path / "f.gif")
    assert "draws no picture" in refusal(watch, file, tmp_path / "f.gif", Blind)
    assert ".gif" in refusal(watch, file, tmp_path / "f.avi")
    pendulum = ZOO / "acrobot-ar-eapo.safetensors"
    assert "leave seed, frames and options out" in refusal(watch, pendulum, tmp_path / "f.gif", frames=9)
    assert not (tmp_path / "f.gif").exists()


@pytest.mark.slow  # compiles the judge's loop
def test_a_robots_film_is_its_swing_up(tmp_path):
    lines = watch(ZOO / "acrobot-ar-eapo.safetensors", tmp_path / "f.webp")
    assert lines[0].startswith("acrobot-ar-eapo.safetensors: score 0.6")
