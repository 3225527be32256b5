"""What users of Stable-Baselines3, CleanRL and rejax write works as they expect, or one line says what to write."""

import functools
import logging

import gymnasium
import jax
import numpy as np
import pytest
from gymnasium.spaces import Box
from gymnasium.vector import AutoresetMode
from gymnasium.wrappers import FlattenObservation, RescaleAction, TimeLimit

from swingup import AREAPO
from swingup.areapo.config import hyperparameters
from swingup.cli import main
from swingup.common.errors import SwingupError
from swingup.common.other_names import OTHER_NAMES, our_name
from swingup.learner.agent import OPTIONS
from swingup.learner.environments import make_environments
from swingup.learner.habits import check_device
from swingup.learner.made_environment import copies_of, id_of, tell_changes

from .environments import Chain, Stairs

TINY = {
    "num_envs": 2, "num_steps": 16, "num_epochs": 1, "batch_size": 32, "policy_layers": (8,), "value_layers": (8,),
    "evaluate_every": 32, "evaluation_episodes": 0,
}  # fmt: skip


class Unrecorded(gymnasium.Wrapper):
    """A wrapper whose arguments Gymnasium does not record."""


def halved(env):
    return RescaleAction(env, np.float32(-0.5), np.float32(0.5))


@pytest.fixture(scope="module")
def model():
    return AREAPO(gymnasium.make("Pendulum-v1"), **TINY)


def test_a_made_environment_is_made_again_as_it_was():
    env = halved(gymnasium.make("Pendulum-v1", g=5.0, max_episode_steps=7))
    environments = make_environments(env, 2)
    copies = environments._env.envs
    assert env not in copies
    assert copies[0] is not copies[1]
    assert [copy.unwrapped.g for copy in copies] == [5.0, 5.0]
    assert str(copies[0].env) == str(env)
    np.testing.assert_array_equal(environments.actions(np.ones((2, 1))), np.full((2, 1), 0.5))
    environments.reset(0)
    ended = [environments.step(np.zeros((2, 1))).truncated.all() for _ in range(7)]
    assert ended == [False] * 6 + [True]
    environments.close()


def test_a_function_that_returns_one_environment_is_refused():
    one = gymnasium.make("Pendulum-v1")
    with pytest.raises(SwingupError, match="returns the same environment again: make a new one in each call"):
        make_environments(lambda: one, 2)


def test_a_window_is_not_copied():
    env = gymnasium.make("Pendulum-v1", render_mode="human")
    assert copies_of(env)().render_mode is None
    assert copies_of(gymnasium.make("Pendulum-v1", render_mode="rgb_array"))().render_mode == "rgb_array"


@pytest.mark.parametrize(
    ("make", "name"),
    [
        (lambda: gymnasium.make("Pendulum-v1"), "Pendulum-v1"),
        (lambda: gymnasium.make("Pendulum-v1", render_mode="human"), "Pendulum-v1"),
        (lambda: gymnasium.make("Pendulum-v1", g=5.0), None),
        (lambda: TimeLimit(gymnasium.make("Pendulum-v1"), 50), None),
        (lambda: halved(gymnasium.make("Pendulum-v1")), None),
        (Stairs, None),
    ],
)
def test_only_a_plain_environment_has_the_name_of_its_id(make, name):
    assert id_of(make()) == name


def test_the_run_of_a_made_environment_names_its_id(model):
    assert model.settings == AREAPO("Pendulum-v1", **TINY).settings
    wrapped = AREAPO(TimeLimit(gymnasium.make("Pendulum-v1"), 50), **TINY)
    assert wrapped.settings.env == "<gymnasium.wrappers.common.TimeLimit>"


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (Stairs, r"Stairs.* was not made by gymnasium.make.*as in AREAPO\(lambda: MyEnv"),
        (
            lambda: Unrecorded(gymnasium.make("Pendulum-v1")),
            r"cannot make another <Unrecorded.*RecordConstructorArgs",
        ),
    ],
)
def test_what_cannot_be_made_again(make, message):
    with pytest.raises(SwingupError, match=message):
        AREAPO(make(), **TINY)


def test_a_changed_space_is_seen():
    env = gymnasium.make("Pendulum-v1")
    env.unwrapped.action_space = Box(-1.0, 1.0, (1,))
    with pytest.raises(SwingupError, match="has another action_space: pass the function"):
        make_environments(env, 2)


def test_a_vector_environment_keeps_its_number():
    sizes = {name: value for name, value in TINY.items() if name not in ("num_envs", "evaluation_episodes")}
    assert AREAPO(Chain(4, "cycle", AutoresetMode.SAME_STEP), **sizes).config.num_envs == 4
    with pytest.raises(SwingupError, match="num_envs = 2, but the vector environment has 4"):
        AREAPO(Chain(4, "cycle", AutoresetMode.SAME_STEP), **TINY)


def test_a_changed_attribute_is_named_in_the_log(caplog):
    env = gymnasium.make("Pendulum-v1")
    env.reset(seed=5)
    env.step(np.ones(1))
    tell_changes(env)
    assert caplog.records == []
    env.unwrapped.max_torque = 5.0
    tell_changes(env)
    (line,) = [record.getMessage() for record in caplog.records]
    assert line.startswith("max_torque = 5.0 of <")
    assert "is 2.0 in the environments to train on: pass the function" in line


class Camera(Stairs):
    """It shows pictures."""

    def __init__(self, shape=(8, 8, 3), dtype=np.uint8):
        super().__init__()
        self.observation_space = Box(0, 255, shape, dtype)


def test_pictures_are_refused_unless_they_are_flattened_in_words():
    for shape in ((8, 8, 3), (8, 8)):
        with pytest.raises(SwingupError, match=r"observations Box\(0, 255.* are images.*TransformObservation"):
            make_environments(functools.partial(Camera, shape), 2)
    for make in (lambda: FlattenObservation(Camera()), functools.partial(Camera, (8, 3), np.float32)):
        assert make_environments(make, 2).spaces.observation_size in (192, 24)


@pytest.mark.parametrize(
    ("arguments", "keywords", "message"),
    [
        (
            ("MlpPolicy", "Pendulum-v1"),
            {},
            r"'MlpPolicy' is no environment.*AREAPO\(env, policy_layers=\(64, 64\)\)",
        ),
        (("CnnPolicy", Stairs), {}, "'CnnPolicy' is no environment"),
        ((), {}, "env is missing"),
        ((), {"policy": "MlpPolicy", "env": Stairs}, "policy = 'MlpPolicy': leave it out"),
        (
            (Stairs,),
            {"policy_kwargs": {"net_arch": [64, 32]}},
            r"write policy_layers=\(64, 32\), value_layers=\(64, 32\)",
        ),
        (
            (Stairs,),
            {"policy_kwargs": {"net_arch": {"pi": [32], "vf": [64, 64]}}},
            r"write policy_layers=\(32,\), value_layers=\(64, 64\)",
        ),
        (
            (Stairs,),
            {"policy_kwargs": {"log_std_init": -2}},
            "'policy_kwargs': here it is policy_layers and value_l",
        ),
        ((Stairs,), {"policy_kwargs": {"net_arch": []}}, "'policy_kwargs': here it is policy_layers and value_l"),
        (
            (Stairs,),
            {"n_steps": 2048},
            r"'n_steps': here it is num_steps \(steps of each environment in a rollout\)",
        ),
        ((Stairs,), {"ent_coef": 0.01}, "'ent_coef': here it is temperature .*not a bonus in the loss"),
        ((Stairs,), {"gamma": 0.99}, "'gamma': here it is discount .*presets ppo and eapo"),
        ((Stairs,), {"anneal_lr": True}, "here it is learning_rate_schedule and schedule_frames"),
        ((Stairs,), {"total_timesteps": 5}, r"total_timesteps = 5: give it to learn, as in AREAPO\(env\).learn"),
        ((Stairs,), {"num_step": 5}, "'num_step'; did you mean num_steps"),
        ((Stairs,), {"tensorbord_log": "a"}, "'tensorbord_log'; did you mean tensorboard_log"),
        (
            (Stairs,),
            {"learning_rate": lambda left: 3e-4 * left},
            "use a number, and learning_rate_schedule to chan",
        ),
        ((Stairs,), {"verbose": 3}, "verbose = 3: use a whole number from 0 to 2"),
        ((Stairs,), {"device": "gpu:1"}, "device = 'gpu:1': choose one by CUDA_VISIBLE_DEVICES=1"),
        ((Stairs,), {"device": "mps"}, "unknown device 'mps': use one of auto, cpu, cuda"),
        ((Stairs,), {"folder": "a", "tensorboard_log": "b"}, "folder = 'a' has TensorBoard's events as well"),
    ],
)
def test_the_constructor_says_what_to_write(arguments, keywords, message):
    with pytest.raises(SwingupError, match=message) as caught:
        AREAPO(*arguments, **keywords)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({}, r"the frames to learn are missing: write learn\(100_000\)"),
        ({"frames": 32, "total_timesteps": 32}, "are given twice"),
        ({"total_timesteps": 0}, "frames = 0: use a whole number of at least 1"),
        ({"frames": 32, "log_interval": 4}, "no argument 'log_interval': reports come every evaluate_every frames"),
        ({"frames": 32, "reset_num_timesteps": False}, "learn always goes on"),
        ({"total_timestep": 32}, "no argument 'total_timestep'; did you mean total_timesteps"),
        ({"frames": 32, "callback": object()}, "callback = <object.*: pass a function of the learner and a report"),
    ],
)
def test_learn_says_what_to_write(model, arguments, message):
    with pytest.raises(SwingupError, match=message):
        model.learn(**arguments)
    assert model.frames == 0


def test_progress_is_shown_when_it_is_asked_for(tmp_path, capsys):
    env = Chain(2, "cycle", AutoresetMode.SAME_STEP)
    sizes = {name: value for name, value in TINY.items() if name != "evaluation_episodes"}
    for _ in range(2):
        model = AREAPO(env, verbose=1, tensorboard_log=tmp_path / "logs", device="auto", **sizes)
    assert sorted(path.name for path in (tmp_path / "logs").iterdir()) == ["AREAPO_1", "AREAPO_2"]
    assert capsys.readouterr().err == ""
    assert model.learn(total_timesteps=40, callback=None).frames == 64
    lines = capsys.readouterr().err.splitlines()
    assert [line.partition(" frames, ")[0] for line in lines] == ["32", "64"]
    assert all(" reward " in line and " score " in line for line in lines)
    assert list((tmp_path / "logs" / "AREAPO_2" / "tensorboard").rglob("events.out.tfevents.*"))

    # A bar in their place, from where the learner stands to the goal of this call; the last iteration goes beyond.
    model.learn(total_timesteps=40, progress_bar=True)
    text = capsys.readouterr().err
    assert [drawn.partition("]")[2].split(" frames")[0].split() for drawn in text.split("\r")[1:]] == [
        ["0%", "64"], ["80%", "96"], ["100%", "128"],
    ]  # fmt: skip
    assert text.count("\n") == 1


def test_nothing_is_shown_twice(model, capsys, caplog):
    with caplog.at_level(logging.INFO, "swingup"):
        AREAPO(Chain(2, "cycle", AutoresetMode.SAME_STEP), verbose=1, **TINY).learn(32)
    assert len([each for each in caplog.records if " frames, " in each.getMessage()]) == 1
    assert capsys.readouterr().err == ""


def test_a_device_is_where_jax_runs_or_refused():
    here = jax.default_backend()
    check_device("auto")
    check_device(here)
    check_device(f"{here}:0")
    other = "cpu" if here != "cpu" else "cuda"
    cure = "JAX_PLATFORMS=cpu" if other == "cpu" else r"'swingup\[cuda\]'"
    with pytest.raises(
        SwingupError, match=f"device = '{other}', but JAX runs on {here}: .*{cure}.* or leave it out"
    ):
        check_device(other)


def test_other_names_are_of_nobody_here_and_lead_to_names_that_are():
    ours = {*hyperparameters(), *OPTIONS, "frames"}
    assert ours.isdisjoint(OTHER_NAMES)
    assert {name for names, _ in OTHER_NAMES.values() for name in names} <= ours
    assert all(names or note.endswith("leave it out") for names, note in OTHER_NAMES.values())
    assert (our_name("nothing"), our_name(3)) == ("", "")


@pytest.mark.parametrize(
    ("line", "message"),
    [
        ("train acrobot --total-timesteps 5", "has no option --total-timesteps: here it is --frames"),
        (
            "train acrobot --n_steps 5",
            "no option --n-steps: here it is --num-steps (steps of each environment in a",
        ),
        ("train acrobot --gamma 0.9", "no option --gamma: here it is --discount (1 with average reward;"),
        ("train acrobot --num-step 5", "no option --num-step; did you mean --num-steps?"),
        ("evaluate acrobot --gamma 5", "no option --gamma; see swingup evaluate --help"),
        ("sweep acrobot --set gamma=0.9,0.99", "unknown hyperparameter 'gamma': here it is discount"),
    ],
)
def test_the_command_line_says_what_to_write(line, message, capsys, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert main(line.split()) != 0
    assert message in capsys.readouterr().err
