"""Foreign environments that answer with something else than they should: one line with name and answer."""

import numpy as np
import pytest
from gymnasium.spaces import Box
from gymnasium.vector import AutoresetMode, VectorEnv
from gymnasium.vector.utils import batch_space

from swingup.common.errors import SwingupError
from swingup.learner.environments import Environments, make_environments

from .environments import Stairs

ENVS = 4
ACTIONS = np.zeros((ENVS, 1), np.float32)


class Foreign(VectorEnv):
    """Shows 0, pays 0 and never ends, but for what it is made to answer."""

    metadata = {"autoreset_mode": AutoresetMode.SAME_STEP}  # noqa: RUF012 - as Gymnasium has it

    def __init__(self, **answers):
        self.num_envs = ENVS
        self.single_observation_space = Box(-1, 1, (3,), np.float32)
        self.single_action_space = Box(-1, 1, (1,), np.float32)
        self.observation_space = batch_space(self.single_observation_space, ENVS)
        self.action_space = batch_space(self.single_action_space, ENVS)
        self.answers = answers

    def reset(self, *, seed=None, options=None):
        return self.answers.get("reset", (self.answers.get("start", np.zeros((ENVS, 3))), {}))

    def step(self, actions):
        names = ("observations", "rewards", "terminated", "truncated", "infos")
        usual = (np.zeros((ENVS, 3), np.float32), np.zeros(ENVS), np.zeros(ENVS, bool), np.zeros(ENVS, bool), {})
        parts = dict(zip(names, usual, strict=True)) | self.answers
        return self.answers.get("step", tuple(parts[name] for name in names))


ENDED = np.ones(ENVS, bool)


def begin_and_step(environments, steps=1):
    environments.reset(0)
    for _ in range(steps):
        environments.step(np.zeros((environments.num_envs, environments.actions.size), np.float32))


@pytest.mark.parametrize(
    ("answers", "message"),
    [
        ({"start": np.zeros((2, 3))}, r"gave observations of shape \(2, 3\) in a reset\(\): return shape \(4, 3\)"),
        ({"start": np.full((ENVS, 3), np.nan)}, r"gave observations that are not finite in a reset\(\), nan"),
        ({"start": None}, r"gave observations None of kind object in a reset\(\): return numbers"),
        ({"reset": np.zeros((ENVS, 3))}, r"gave array.* in a reset\(\): return \(observations, infos\)"),
        ({"reset": None}, r"gave None in a reset\(\)"),
        (
            {"observations": np.zeros((ENVS, 5))},
            r"observations of shape \(4, 5\) in a step\(\): return",
        ),
        ({"observations": np.zeros((3, ENVS))}, r"observations of shape \(3, 4\)"),
        ({"observations": np.array([["a"] * 3] * ENVS)}, "of kind <U1 .*: return numbers"),
        (
            {"observations": np.full((ENVS, 3), 1e300)},
            r"observations that are not finite in a step\(\), 1e\+300",
        ),
        ({"observations": [[0, 1], [2]]}, r"gave observations \[\[0, 1\], \[2\]\] in a step\(\)"),
        ({"rewards": np.zeros(3)}, r"gave rewards of shape \(3,\) in a step\(\): return shape \(4,\)"),
        ({"rewards": 0.0}, r"gave rewards of shape \(\)"),
        ({"rewards": np.zeros((ENVS, 1))}, r"gave rewards of shape \(4, 1\)"),
        ({"rewards": np.array(["1"] * ENVS)}, "gave rewards .* of kind <U1"),
        ({"rewards": [None] * ENVS}, "gave rewards .* of kind object"),
        ({"rewards": np.array([0, 0, 1j, 0])}, "gave rewards .* of kind complex128"),
        ({"rewards": np.array([0, 0, np.inf, 0])}, r"gave rewards that are not finite in a step\(\), inf"),
        ({"rewards": np.array([0, 0, -1e300, 0])}, r"gave rewards that are not finite in a step\(\), -1e\+300"),
        ({"terminated": np.zeros(ENVS)}, "gave terminated .* of kind float64 .*: return booleans"),
        ({"terminated": np.zeros(3, bool)}, r"gave terminated of shape \(3,\)"),
        ({"truncated": False}, r"gave truncated of shape \(\)"),
        ({"truncated": "no"}, "gave truncated 'no' of kind <U2"),
        ({"infos": None}, r"gave infos None in a step\(\): return a dict"),
        ({"step": (0, 0, 0, {})}, r"gave \(0, 0, 0, {}\) in a step\(\): return \(observations, rewards, "),
        ({"step": None}, r"gave None in a step\(\)"),
        ({"terminated": ENDED}, r"gives no final_obs\[0\] in its infos: add it"),
        ({"terminated": ENDED, "infos": {"final_obs": 5}}, r"gives no final_obs\[0\]"),
        ({"terminated": ENDED, "infos": {"final_obs": [np.zeros(3)]}}, r"gives no final_obs\[1\]"),
        ({"terminated": ENDED, "infos": {"final_obs": [None] * ENVS}}, "gave final_obs None of kind object"),
        ({"terminated": ENDED, "infos": {"final_obs": [np.zeros(7)] * ENVS}}, r"gave final_obs of shape \(7,\)"),
    ],
    ids=lambda value: next(iter(value)) if isinstance(value, dict) else "",
)
def test_answers_that_no_environment_should_give(answers, message):
    environments = Environments(Foreign(**answers))
    with pytest.raises(SwingupError, match=f"environment Foreign .*{message}") as error:
        begin_and_step(environments)
    assert len(str(error.value)) < 400
    assert str(error.value).isprintable()


def test_lists_are_as_good_as_arrays():
    answers = {"rewards": [1, 2, 3, 4], "terminated": [False] * ENVS, "observations": [[0.5, 0, 0]] * ENVS}
    environments = Environments(Foreign(**answers))
    environments.reset(0)
    step = environments.step(ACTIONS)
    assert step.rewards.tolist() == [1, 2, 3, 4]
    assert (step.rewards.dtype, step.true_next.dtype) == (np.float32, np.float32)
    assert step.true_next[:, 0].tolist() == [0.5] * ENVS


def test_buffers_that_an_environment_keeps_using_are_copied():
    buffer = np.zeros((ENVS, 3), np.float32)
    environments = Environments(Foreign(start=buffer, observations=buffer))
    first = environments.reset(0)
    following = environments.step(ACTIONS).following
    buffer += 1
    assert not first.any()
    assert not following.any()


class Once(Stairs):
    """A single environment that answers well only the first time."""

    resets = 0

    def reset(self, *, seed=None, options=None):
        observation, infos = super().reset(seed=seed)
        Once.resets += 1
        return (observation if Once.resets < 4 else observation * np.nan), infos


def test_a_nan_of_a_later_reset_is_the_environments_and_no_divergence():
    environments = make_environments(Once, 2)
    with pytest.raises(SwingupError, match="Once'> gave observations that are not finite"):
        begin_and_step(environments, steps=6)


class Raising(Foreign):
    """Its attributes raise, when they are looked at."""

    def __init__(self, name):
        super().__init__()
        self._name = name

    def __getattribute__(self, name):
        if name == object.__getattribute__(self, "__dict__").get("_name"):
            raise ValueError("not\ntoday")
        return object.__getattribute__(self, name)


@pytest.mark.parametrize("name", ["single_observation_space", "single_action_space", "metadata", "num_envs"])
def test_attributes_that_raise(name):
    with pytest.raises(SwingupError, match=rf"its attribute {name} raised ValueError \(not today\)"):
        Environments(Raising(name))


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"single_observation_space": None}, "observations None of Foreign are not a Box"),
        ({"single_observation_space": Box(-1, 1, (0,))}, "observations .* of Foreign are empty"),
        ({"single_action_space": Box(-1, 1, (0,))}, "actions .* are empty"),
        ({"single_action_space": None}, "actions None are not supported"),
        ({"metadata": {}}, "Foreign says autoreset_mode = None"),
        ({"metadata": None}, "Foreign says autoreset_mode = None"),
        ({"metadata": {"autoreset_mode": "SameStep"}}, "Foreign says autoreset_mode = 'SameStep'"),
        ({"num_envs": 2.5}, r"num_envs of Foreign = 2\.5: use a whole number"),
    ],
)
def test_attributes_that_make_no_environment(changes, message):
    env = Foreign()
    vars(env).update(changes)
    with pytest.raises(SwingupError, match=message):
        Environments(env)


class Exiting(Stairs):
    def step(self, action):
        raise SystemExit(3)


def test_an_environment_that_ends_the_process_does_not():
    environments = make_environments(Exiting, 2)
    environments.reset(0)
    with pytest.raises(SwingupError, match="failed in a step: SystemExit: 3; correct it and go on"):
        environments.step(np.zeros((2, 2), np.float32))
