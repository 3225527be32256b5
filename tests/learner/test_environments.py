"""What the learner is shown of Gymnasium's environments: spaces, autoreset modes, and what is refused."""

import functools
import time

import gymnasium
import numpy as np
import pytest
from gymnasium.spaces import Box, Dict, Discrete, MultiBinary, MultiDiscrete
from gymnasium.vector import AsyncVectorEnv, AutoresetMode, SyncVectorEnv, VectorEnv
from gymnasium.wrappers import NormalizeObservation, NormalizeReward, TimeLimit

from refusals import refusal
from swingup.learner.environments import Environments, make_environments
from swingup.tasks.space_actions import space_actions

from .environments import Chain, Noisy, Stairs

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
    if isinstance(env, VectorEnv):
        env.close()  # its owner's
    return rows


@pytest.mark.parametrize("terminates", [False, True])
def test_same_step_and_disabled_show_both_observations(terminates):
    make = functools.partial(Stairs, terminates)
    end = "T" if terminates else "t"
    # 0 → 1 → 2 → 3, which ends and is followed by a new start.
    episode = [(1, 1, 1, "-", True), (2, 2, 2, "-", True), (0, 3, 3, end, True)]
    expected = [0.0, *episode, *episode, episode[0]]
    assert shown(make) == shown([make, make]) == expected
    for mode in (AutoresetMode.SAME_STEP, AutoresetMode.DISABLED):
        assert shown(SyncVectorEnv([make] * 2, autoreset_mode=mode)) == expected
    if terminates:  # processes take a second to start
        assert shown(Spawned([make] * 2, autoreset_mode=AutoresetMode.SAME_STEP)) == expected


@pytest.mark.parametrize(
    "kind", [SyncVectorEnv, pytest.param(Spawned, marks=pytest.mark.slow)], ids=["sync", "async"]
)
def test_next_step_spends_a_row_on_the_reset(kind):
    episode = [(1, 1, 1, "-", True), (2, 2, 2, "-", True), (0, 3, 3, "t", True)]
    reset = (0, 0, 0, "-", False)
    assert shown(kind([Stairs] * 2, autoreset_mode=AutoresetMode.NEXT_STEP)) == [0.0, *episode, reset, *episode]


def test_actions_are_scaled_to_the_bounds():
    actions = space_actions(Box(np.array([-2.0, 0.0], np.float32), np.array([2.0, 1.0], np.float32)))
    np.testing.assert_allclose(
        actions(np.array([[-1.0, -1.0], [0.0, 0.0], [1.0, 1.0], [0.5, 0.5]])),
        [[-2.0, 0.0], [0.0, 0.5], [2.0, 1.0], [1.0, 0.75]],
    )
    assert (actions.size, actions.choices) == (2, ())
    grid = space_actions(Box(-1.0, 1.0, (2, 3), np.float64))
    assert grid.size == 6
    assert grid(np.zeros((4, 6))).shape == (4, 2, 3)


def test_discrete_actions_count_from_their_start():
    one = space_actions(Discrete(3, start=5))
    np.testing.assert_array_equal(one(np.array([[0], [2]])), [5, 7])
    assert (one.size, one.choices) == (1, (3,))
    several = space_actions(MultiDiscrete([3, 2], start=[1, 5]))
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
    """An environment with other spaces."""

    def __init__(self, observations=None, actions=None):
        super().__init__()
        self.observation_space = observations or self.observation_space
        self.action_space = actions or self.action_space


ONE = Stairs()
WIDE = [Box(-most, most, (1,)) for most in (np.inf, np.finfo(np.float32).max)]
UNTRAINABLE = {
    "use a Gymnasium id": ["NoSuchTask-v0", 3],
    "num_envs = 2, but env holds": [ONE, TimeLimit(ONE, 9), [Stairs] * 3],
    "cannot be trained on": [[3, 4]],
    "NormalizeObservation normalises observations by": [
        lambda: NormalizeObservation(Stairs()),
        gymnasium.wrappers.vector.NormalizeObservation(SyncVectorEnv([Stairs] * 2)),
    ],
    "NormalizeReward normalises rewards": [
        lambda: TimeLimit(NormalizeReward(Stairs()), 9), SyncVectorEnv([lambda: NormalizeReward(Stairs())] * 2),
    ],
    "returned the same environment again": [lambda: ONE],
    "must make a gymnasium.Env": [lambda: 3],
    "are not a Box": [functools.partial(Odd, Dict({"a": Discrete(2)}))],
    "are empty": [functools.partial(Odd, Box(-1, 1, (0,))), functools.partial(Odd, None, Box(-1, 1, (0,)))],
    "are images": [functools.partial(Odd, Box(0, 255, (8, 8, 3), np.uint8))],
    "have no bounds to scale to": [functools.partial(Odd, None, box) for box in WIDE],
    "are whole numbers in a Box": [functools.partial(Odd, None, Box(0, 9, (1,), np.int64))],
    "use a bounded Box, Discrete or": [functools.partial(Odd, None, MultiBinary(3))],
    "autoreset_mode = None": [Chain(2, "cycle", None)],
}  # fmt: skip


def test_what_cannot_be_trained_on():
    for named, cases in UNTRAINABLE.items():
        for env in cases:
            assert named in refusal(make_environments, env, 2)


def test_an_environment_that_was_passed_in_is_stepped_and_stays_open():
    class Closing(Stairs):
        closed = False

        def close(self):
            self.closed = True

    own, fixed = Closing(), NormalizeObservation(Stairs())
    fixed.update_running_mean = False  # the same in every copy
    for env in (own, gymnasium.Wrapper(gymnasium.make("Pendulum-v1")), fixed):
        environments = make_environments(env, 1)
        begin_and_step(environments, np.zeros((1, environments.spaces.action_size), np.float32))
        environments.close()
    assert (own.steps, own.closed) == (1, False)


def test_an_environment_that_gymnasium_made_is_made_again_with_its_arguments():
    made = TimeLimit(gymnasium.make("Pendulum-v1", g=3.0, render_mode="rgb_array"), 7)
    several = make_environments(made, 2)._env.envs
    assert [each.unwrapped.g for each in several] == [3.0, 3.0]
    assert made.unwrapped not in [each.unwrapped for each in several]


ENVS = 4
ENDED = np.ones(ENVS, bool)


def begin_and_step(environments, actions, steps=1):
    environments.reset(0)
    for _ in range(steps):
        environments.step(actions)


class Foreign(VectorEnv):
    """Shows 0, pays 0 and never ends, but for what it is made to return."""

    metadata = {"autoreset_mode": AutoresetMode.SAME_STEP}  # noqa: RUF012 - as Gymnasium has it

    def __init__(self, **returned):
        self.num_envs = ENVS
        self.single_observation_space = Box(-1, 1, (3,), np.float32)
        self.single_action_space = Box(-1, 1, (1,), np.float32)
        self.returned = returned

    def reset(self, *, seed=None, options=None):
        return self.returned.get("reset", (self.returned.get("start", np.zeros((ENVS, 3))), {}))

    def step(self, actions):
        names = ("observations", "rewards", "terminated", "truncated", "infos")
        usual = (np.zeros((ENVS, 3), np.float32), np.zeros(ENVS), np.zeros(ENVS, bool), np.zeros(ENVS, bool), {})
        parts = dict(zip(names, usual, strict=True)) | self.returned
        return self.returned.get("step", tuple(parts[name] for name in names))


WRONG = {
    "observations": [
        {"start": np.zeros((2, 3))}, {"start": np.full((ENVS, 3), np.nan)}, {"reset": np.zeros((ENVS, 3))},
        {"observations": np.array([["a"] * 3] * ENVS)}, {"observations": [[0, 1], [2]]},
    ],
    "rewards": [{"rewards": 0.0}, {"rewards": np.array([0, 0, np.inf, 0])}, {"step": (0, 0, 0, {})}],
    "terminated": [{"terminated": np.full(ENVS, np.nan)}],  # any number that is not 0 would count as an end
    "truncated": [{"truncated": "no"}],
    "final_obs": [{"terminated": ENDED}, {"terminated": ENDED, "infos": {"final_obs": [np.zeros(7)] * ENVS}}],
}  # fmt: skip


def test_what_no_environment_should_return():
    for named, cases in WRONG.items():
        for returned in cases:
            environments = Environments(Foreign(**returned))
            text = refusal(begin_and_step, environments, np.zeros((ENVS, 1), np.float32))
            assert "Foreign" in text
            assert named in text
            assert len(text) < 400


def test_lists_are_as_good_as_arrays_and_buffers_are_copied():
    buffer = np.zeros((ENVS, 3), np.float32)
    environments = Environments(Foreign(start=buffer, observations=buffer, rewards=[1, 2, 3, 4]))
    first = environments.reset(0)
    step = environments.step(np.zeros((ENVS, 1), np.float32))
    buffer += 1
    assert not first.any()
    assert not step.following.any()
    assert step.rewards.tolist() == [1, 2, 3, 4]
    assert (step.rewards.dtype, step.true_next.dtype) == (np.float32, np.float32)


class Returning(Stairs):
    """Returns other things than Gymnasium's interface has: ``changed`` is a function of what is right."""

    def __init__(self, method, changed):
        super().__init__()
        self.method, self.changed, self.resets = method, changed, 0

    def reset(self, *, seed=None, options=None):
        answer = super().reset(seed=seed)
        self.resets += 1
        change = self.method == "reset" or (self.method == "late" and self.resets > 1)
        return self.changed(*answer) if change else answer

    def step(self, action):
        answer = super().step(action)
        return self.changed(*answer) if self.method == "step" else answer


def exits(*_):
    raise SystemExit(3)


FAULTS = {
    "step": [
        lambda o, r, e, t, i: (o, r, e, i), lambda *_: None, lambda o, r, *e: (o, np.ones(1), *e),
        lambda o, r, *e: (o, "1.5", *e), lambda o, r, e, *t: (o, r, np.nan, *t),
        lambda o, r, e, t, i: (o, r, e, "no", i), lambda o, *r: (np.zeros(4), *r), exits,
    ],
    "reset": [lambda o, i: o],
    "late": [lambda o, i: (o * np.nan, i)],
}  # fmt: skip
"""Changes of what a method returns; a late reset is any but the first one."""


@pytest.mark.parametrize("method", FAULTS)
def test_environments_that_fail(method):
    for changed in FAULTS[method]:
        make = functools.partial(Returning, method, changed)
        for env in (make, SyncVectorEnv([make] * 2, autoreset_mode=AutoresetMode.SAME_STEP)):
            environments = make_environments(env, 2)
            told = refusal(begin_and_step, environments, ZEROS, steps=4)
            assert "Returning" in told or "SyncVectorEnv" in told


class Hanging(Stairs):
    def step(self, action):
        time.sleep(1000)


@pytest.mark.slow  # processes start
def test_a_worker_that_hangs_is_not_waited_for(monkeypatch):
    env = Spawned([Stairs, Hanging], autoreset_mode=AutoresetMode.SAME_STEP)
    environments = make_environments(env, 2)
    environments.reset(0)
    monkeypatch.setattr("swingup.learner.checked_environment.PATIENCE", 0.2)
    assert "a worker of AsyncVectorEnv did not answer" in refusal(environments.step, ZEROS)
    assert not any(process.is_alive() for process in env.processes)
