"""Every public entry of the learner, the tasks and the pictures refuses nonsense in a line that names it."""

import functools
import math

import numpy as np
import pytest

from learner.contract import TINY
from learner.environments import Noisy
from policies import lone_policy
from refusals import refusal
from swingup import AREAPO
from swingup.areapo.config import Config
from swingup.benchmark.rollout import Trajectory
from swingup.common.text import quoted
from swingup.gym import PendulumEnv, PendulumVectorEnv
from swingup.learner.run_settings import RunSettings
from swingup.plant.plant import load_plant
from swingup.plant.robots import ROBOTS
from swingup.refine.episodes import EpisodeSettings
from swingup.refine.recipe import RECIPES, run_recipe
from swingup.report.film import animate
from swingup.tasks.presets import get_task

STILL = Trajectory(np.arange(3.0), np.zeros((3, 4)), np.zeros((3, 2)))
HOLE = Trajectory(np.arange(3.0), np.full((3, 4), math.nan), np.zeros((3, 2)))


def learner(**given):
    return AREAPO(**({"env": Noisy} | TINY | given))


def settings(**given):
    usual = {"robot": "acrobot", "preset": "default", "seed": 0, "seeds": 1, "evaluate_every": 64}
    return RunSettings(**(usual | {"checkpoint_every": 64, "config": Config()} | given))


def film(**given):
    return animate(**({"motions": [(STILL, "acrobot")], "path": "film.gif"} | given))


ENTRIES = {
    learner: {
        "preset": ["best"], "learning_rat": [0.1], "sed": [1], "batch_size": [1000], "seed": [-1, "3"],
        "env": ["NoSuchTask-v0", "no_such_mod:Task-v0"], "evaluation_episodes": [-1], "evaluate_every": [0],
        "checkpoint_every": [0], "policy_layers": [64, ("8",), (), (0,)], "num_envs": [2.0, 0, True],
        "learning_rate": ["3e-4", math.nan], "centre_values": [1], "gae_lambda": [0.9, (0.9, 1.1)],
        "gain": ["none", "trace"], "terminations": ["end"], "activation": ["Tanh"], "schedule": ["cosine"],
    },
    settings: {
        "robot": ["cartpole", ["acrobot"]], "preset": ["best"], "seeds": [0], "seed": [-1], "evaluate_every": [0],
    },
    film: {
        "fps": [0, 60, math.nan, "fast\n"], "size": [8, 100_000], "speed": [0.0, -1.0, math.inf, 1e-5, 1e-320],
        "path": ["film", "film.png", "gif", "missing/film.gif"],
    },
    EpisodeSettings: {"nominal": [-1], "speed": [math.nan]},
    functools.partial(PendulumEnv, "acrobot"): {"task": ["easy"], "render_mode": ["ansi"], "plant": ["C.2"]},
    functools.partial(PendulumVectorEnv, "acrobot"): {"num_envs": [0], "task": ["easy"], "plant": ["C.2"]},
}  # fmt: skip
"""By entry and argument."""


ON_PLANT = {"robot": None, "env": "Swimmer-v5", "preset": "mujoco", "plant": load_plant("B.0")}
ACROBOT, PENDUBOTS = ROBOTS["acrobot"], get_task("paper", ROBOTS["pendubot"])
POLICIES = [lone_policy(name, "acrobot")[0] for name in ("adaptive", "ar-eapo")]
TOGETHER = {
    "a plant goes with a robot, not with Swimmer-v5": lambda: settings(**ON_PLANT),
    "unknown robot 'cartpole'": lambda: film(motions=[(STILL, "cartpole")]),
    "the trajectory holds values that are not finite": lambda: film(motions=[(HOLE, "acrobot")]),
    # 2 s / 0.01 * 25 = 5000 frames of 2048 * 2048 = 4.2 million pixels.
    "5000 frames of 4194304 pixels": lambda: film(speed=0.01, size=2048),
    "no episodes": lambda: EpisodeSettings(nominal=0, anywhere=0, thrown=0),
    "for the pendubot, not for the acrobot": lambda: PendulumEnv("acrobot", PENDUBOTS),
    "has a plant of its own": lambda: PendulumVectorEnv("pendubot", task=PENDUBOTS, plant="A.0"),
    "unknown task 'hover'": lambda: get_task("hover", ACROBOT),
    "the policy sees its plant": lambda: run_recipe(POLICIES[0], ROBOTS["acrobot"], RECIPES["recover"]),
    "give a domain, not a plant": lambda: run_recipe(POLICIES[1], ROBOTS["acrobot"], RECIPES["adapt"], plant="C.0"),
}
"""Arguments of which each alone is good."""


@pytest.mark.parametrize("entry", ENTRIES, ids=lambda entry: getattr(entry, "__name__", str(entry)))
def test_nonsense_is_named(entry, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    for name, values in ENTRIES[entry].items():
        for value in values:
            told = refusal(entry, **{name: value})
            assert name in told or (value if isinstance(value, str) else quoted(value)) in told, (value, told)
    assert list(tmp_path.iterdir()) == []


def test_what_does_not_go_together_is_named():
    for words, call in TOGETHER.items():
        assert words in refusal(call)
