"""What the learner is shown of Gymnasium's environments: spaces, autoreset modes, and what is refused."""

import functools

import gymnasium
import numpy as np
import pytest
from gymnasium.spaces import Box, Dict, Discrete, MultiDiscrete
from gymnasium.vector import AsyncVectorEnv, AutoresetMode, SyncVectorEnv

from swingup.common.errors import SwingupError
from swingup.learner.environments import Actions, Environments, make_environments

from .environments import Chain, Noisy, Stairs

LARGEST = np.finfo(np.float32).max
ZEROS = np.zeros((2, 2), np.float32)


Spawned = functools.partial(AsyncVectorEnv, context="spawn")
"""Fresh processes: JAX warns of forks."""


def shown(env, steps=7, actions=ZEROS):
    """(following, true next, reward, ended, counted) of the first environment at each step."""
    environments = make_environments(env, 2)
    rows = [environments.reset(0)[0, 0]]
    for _ in range(steps):
        step = environments.step(actions)
        ended = "T" if step.terminated[0] else "t" if step.truncated[0] else "-"
        rows.append((step.following[0, 0], step.true_next[0, 0], step.rewards[0], ended, bool(step.counted[0])))
    environments.close()
    return rows


@pytest.mark.parametrize("terminates", [False, True])
def test_same_step_and_disabled_show_both_observations(terminates):
    make = functools.partial(Stairs, terminates)
    end = "T" if terminates else "t"
    # 0 → 1 → 2 → 3, which ends and is followed by a new start.
    episode = [(1, 1, 1, "-", True), (2, 2, 2, "-", True), (0, 3, 3, end, True)]
    expected = [0.0, *episode, *episode, episode[0]]
    assert shown(make) == expected
    for mode in (AutoresetMode.SAME_STEP, AutoresetMode.DISABLED):
        assert shown(SyncVectorEnv([make] * 2, autoreset_mode=mode)) == expected
    assert shown(Spawned([make] * 2, autoreset_mode=AutoresetMode.SAME_STEP)) == expected


@pytest.mark.parametrize("kind", [SyncVectorEnv, Spawned], ids=["sync", "async"])
def test_next_step_spends_a_row_on_the_reset(kind):
    episode = [(1, 1, 1, "-", True), (2, 2, 2, "-", True), (0, 3, 3, "t", True)]
    reset = (0, 0, 0, "-", False)
    assert shown(kind([Stairs] * 2, autoreset_mode=AutoresetMode.NEXT_STEP)) == [0.0, *episode, reset, *episode]


def test_actions_are_scaled_to_the_bounds():
    actions = Actions(Box(np.array([-2.0, 0.0], np.float32), np.array([2.0, 1.0], np.float32)))
    np.testing.assert_allclose(
        actions(np.array([[-1.0, -1.0], [0.0, 0.0], [1.0, 1.0], [0.5, 0.5]])),
        [[-2.0, 0.0], [0.0, 0.5], [2.0, 1.0], [1.0, 0.75]],
    )
    assert (actions.size, actions.choices) == (2, ())
    grid = Actions(Box(-1.0, 1.0, (2, 3), np.float64))
    assert grid.size == 6
    assert grid(np.zeros((4, 6))).shape == (4, 2, 3)


def test_discrete_actions_count_from_their_start():
    one = Actions(Discrete(3, start=5))
    np.testing.assert_array_equal(one(np.array([[0], [2]])), [5, 7])
    assert (one.size, one.choices) == (1, (3,))
    several = Actions(MultiDiscrete([3, 2], start=[1, 5]))
    np.testing.assert_array_equal(several(np.array([[0, 1], [2, 0]])), [[1, 6], [3, 5]])
    assert (several.size, several.choices) == (2, (3, 2))


def test_observations_are_flat_and_in_single_precision():
    environments = make_environments(Noisy, 3)
    assert environments.spaces.observation_size == 2
    first = environments.reset(7)
    assert (first.shape, first.dtype) == ((3, 2), np.float32)
    step = environments.step(np.zeros((3, 2), np.int32))
    # The same seed, the same numbers.
    np.testing.assert_array_equal(environments.reset(7), first)
    again = environments.step(np.zeros((3, 2), np.int32))
    np.testing.assert_array_equal(again.true_next, step.true_next)
    assert not np.array_equal(environments.reset(8), first)


class Odd(Stairs):
    """An environment with other spaces, or with rewards that are no numbers."""

    def __init__(self, observations=None, actions=None, reward=0.0):
        super().__init__()
        self.observation_space = observations or self.observation_space
        self.action_space = actions or self.action_space
        self.reward = reward

    def step(self, action):
        observation, _, *rest = super().step(action)
        return observation, self.reward, *rest


@pytest.mark.parametrize(
    ("env", "message"),
    [
        ("NoSuchTask-v0", "cannot make 'NoSuchTask-v0'.*use a Gymnasium id"),
        (3, "int 3 cannot be trained on: use a Gymnasium id"),
        (Stairs(), "pass the function that makes it"),
        (lambda: 3, "made a int: it must make a gymnasium.Env"),
        (
            functools.partial(Odd, Dict({"a": Discrete(2)})),
            "is not supported: wrap it in .*FlattenObservation|not a Box",
        ),
        (functools.partial(Odd, Discrete(2)), "observations .* are not a Box"),
        (functools.partial(Odd, None, Box(-np.inf, np.inf, (1,))), "have no bounds to scale to"),
        (functools.partial(Odd, None, Box(-LARGEST, LARGEST, (1,))), "have no bounds to scale to"),
        (functools.partial(Odd, None, Box(0, 9, (1,), np.int64)), "are whole numbers in a Box: make them a Multi"),
        (
            functools.partial(Odd, None, Dict({"a": Discrete(2)})),
            "are not supported: use a bounded Box, Discrete or",
        ),
        (Chain(3, "cycle", AutoresetMode.SAME_STEP), "num_envs = 2, but the vector environment has 3"),
        (Chain(2, "cycle", None), "autoreset_mode = None"),
    ],
)
def test_what_cannot_be_trained_on(env, message):
    with pytest.raises(SwingupError, match=message):
        make_environments(env, 2)


def test_an_environment_that_returns_no_number():
    environments = make_environments(functools.partial(Odd, reward=float("nan")), 2)
    environments.reset(0)
    with pytest.raises(SwingupError, match="not finite"):
        environments.step(ZEROS)


def test_vector_environments_of_gymnasium_keep_their_mode():
    env = gymnasium.make_vec("CartPole-v1", num_envs=2, vectorization_mode="sync")
    environments = Environments(env)
    assert not environments.all_count
    assert environments.spaces.choices == (2,)
