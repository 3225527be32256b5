"""What the learner is shown of Gymnasium's environments: spaces, autoreset modes, and what is refused."""

import functools
import itertools
import time

import gymnasium
import numpy as np
import pytest
from gymnasium.spaces import Box, Dict, Discrete, MultiBinary, MultiDiscrete
from gymnasium.vector import AsyncVectorEnv, AutoresetMode, SyncVectorEnv, VectorEnv
from gymnasium.wrappers import NormalizeObservation, NormalizeReward, TimeLimit
from gymnasium.wrappers.vector import RescaleAction

from refusals import refusal
from swingup.learner.environments import Environments, make_environments
from swingup.tasks.task import space_actions

from .environments import Noisy, Stairs, chains

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


@pytest.mark.parametrize("kind", [SyncVectorEnv, pytest.param(Spawned, marks=pytest.mark.slow, id="async")])
def test_next_step_spends_a_row_on_the_reset(kind):
    episode = [(1, 1, 1, "-", True), (2, 2, 2, "-", True), (0, 3, 3, "t", True)]
    reset = (0, 0, 0, "-", False)
    assert shown(kind([Stairs] * 2, autoreset_mode=AutoresetMode.NEXT_STEP)) == [0.0, *episode, reset, *episode]


class Reached(Stairs):
    """Of two of these, one calls its end a success."""

    made = 0

    def __init__(self):
        super().__init__()
        kind = type(self)
        kind.made, self.reaches = kind.made + 1, kind.made % 2 == 0

    def step(self, action):
        return *super().step(action)[:4], {"is_success": self.reaches and self.steps == 3, "unread": object()}


class Told(Reached):
    """Says nothing where it has not succeeded."""

    made = 0

    def step(self, action):
        *step, info = super().step(action)
        return *step, info if info["is_success"] else {}


class Exact(Reached):
    """Says it as NumPy does, which workers' infos keep as objects."""

    made = 0

    def step(self, action):
        *step, info = super().step(action)
        return *step, {"is_success": np.bool_(info["is_success"])}


def test_successes_of_numpy_come_through_infos_of_objects(monkeypatch):
    several = SyncVectorEnv([Exact] * 2, autoreset_mode=AutoresetMode.SAME_STEP)
    monkeypatch.setattr("swingup.learner.environments.CheckedEnvironment", lambda env, stream=False: env)
    environments = make_environments(several, 2)
    environments.reset(0)
    assert [environments.step(ZEROS).goals.tolist() for _ in range(3)][-1] == [True, False]


@pytest.mark.parametrize("kind", [Reached, Told])
@pytest.mark.parametrize("mode", AutoresetMode)
def test_successes_are_those_of_the_ends(mode, kind):
    environments = make_environments(SyncVectorEnv([kind] * 2, autoreset_mode=mode), 2)
    environments.reset(0)
    steps = [environments.step(ZEROS).goals.tolist() for _ in range(4)]
    assert steps == [[False, False], [False, False], [True, False], [False, False]]
    assert (environments.successes, environments.names_goals) == ([True, False], True)


def test_actions_are_those_of_the_space():
    actions = space_actions(Box(np.array([-2.0, 0.0], np.float32), np.array([2.0, 1.0], np.float32)))
    found = actions(np.array([[-1.0, -1.0], [0.0, 0.0], [1.0, 1.0], [0.5, 0.5]]))
    np.testing.assert_allclose(found, [[-2.0, 0.0], [0.0, 0.5], [2.0, 1.0], [1.0, 0.75]])
    assert (actions.size, actions.choices) == (2, ())
    grid = space_actions(Box(-1.0, 1.0, (2, 3), np.float64))
    assert grid(np.zeros((4, grid.size))).shape == (4, 2, 3)
    one, several = space_actions(Discrete(3, start=5)), space_actions(MultiDiscrete([3, 2], start=[1, 5]))
    np.testing.assert_array_equal(one(np.array([[0], [2]])), [5, 7])
    np.testing.assert_array_equal(several(np.array([[0, 1], [2, 0]])), [[1, 6], [3, 5]])
    assert (one.size, one.choices, several.size, several.choices) == (1, (3,), 2, (3, 2))


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


ONE = Stairs()
WIDE = [Box(-most, most, (1,)) for most in (np.inf, np.finfo(np.float32).max)]
MODELESS = chains(2, "cycle")
MODELESS.metadata = {"autoreset_mode": None}
UNTRAINABLE = {
    "use a Gymnasium id": ["NoSuchTask-v0", 3],
    "num_envs = 2, but env holds": [ONE, TimeLimit(ONE, 9), [Stairs] * 3],
    "cannot be trained on": [[3, 4]],
    "NormalizeObservation normalises observations by": [
        lambda: NormalizeObservation(Stairs()),
        gymnasium.wrappers.vector.NormalizeObservation(SyncVectorEnv([Stairs] * 2)),
        RescaleAction(SyncVectorEnv([lambda: NormalizeObservation(Stairs())] * 2), -1.0, 1.0),
    ],
    "NormalizeReward normalises rewards": [
        lambda: TimeLimit(NormalizeReward(Stairs()), 9), SyncVectorEnv([lambda: NormalizeReward(Stairs())] * 2),
    ],
    "returned the same environment again": [lambda: ONE],
    "must make a gymnasium.Env": [lambda: 3],
    "are not a Box": [functools.partial(Stairs, observations=Dict({"a": Discrete(2)}))],
    "are empty": [functools.partial(Stairs, **{name: Box(-1, 1, (0,))}) for name in ("observations", "actions")],
    "are images": [functools.partial(Stairs, observations=Box(0, 255, (8, 8, 3), np.uint8))],
    "have no bounds to scale to": [functools.partial(Stairs, actions=box) for box in WIDE],
    "low[1] = -inf and high[1] = 20.0": [
        functools.partial(Stairs, actions=Box(np.float32([0, -np.inf]), np.float32([5, 20]))),
    ],
    "are whole numbers in a Box": [functools.partial(Stairs, actions=Box(0, 9, (1,), np.int64))],
    "use a bounded Box, Discrete or": [functools.partial(Stairs, actions=MultiBinary(3))],
    "autoreset_mode = None": [MODELESS],
}  # fmt: skip


def test_what_cannot_be_trained_on():
    for named, cases in UNTRAINABLE.items():
        for env in cases:
            assert named in refusal(make_environments, env, 2)


def test_an_environment_that_was_passed_in_is_stepped_and_stays_open():
    own, fixed, closed = Stairs(), NormalizeObservation(Stairs()), []
    own.close = lambda: closed.append(own)
    fixed.update_running_mean = False  # the same in every copy
    for env in (own, gymnasium.Wrapper(gymnasium.make("Pendulum-v1")), fixed):
        environments = make_environments(env, 1)
        begin_and_step(environments, np.zeros((1, environments.spaces.action_size), np.float32))
        environments.close()
    assert (own.steps, closed) == (1, [])


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


def spoilt(env, method, changed, after=0):
    """An environment of whose method the answers are changed after some calls."""
    original, calls = getattr(env, method), itertools.count()

    def answer(*given, **options):
        right = original(*given, **options)
        return right if next(calls) < after else changed(*right)

    setattr(env, method, answer)
    return env


WRONG = {
    "observations": {
        "reset": [lambda o, i: (o[:2], i), lambda o, i: (o * np.nan, i), lambda o, i: o],
        "step": [lambda o, *rest: (o.astype(str), *rest), lambda o, *rest: ([[0, 1], [2]], *rest)],
    },
    "rewards": {"step": [
        lambda o, r, *rest: (o, 0.0, *rest), lambda o, r, *rest: (o, np.array([0, 0, np.inf, 0]), *rest),
        lambda o, r, e, t, i: (o, r, e, i),
    ]},
    # Any number that is not 0 would count as an end.
    "terminated": {"step": [lambda o, r, e, t, i: (o, r, e * np.nan, t, i)]},
    "truncated": {"step": [lambda o, r, e, t, i: (o, r, e, "no", i)]},
    "final_obs": {"step": [
        lambda o, r, e, t, i: (o, r, ENDED, t, {}),
        lambda o, r, e, t, i: (o, r, ENDED, t, {"final_obs": [np.zeros(7)] * ENVS}),
    ]},
}  # fmt: skip
"""Changes of what a method of a vector environment returns, by what is named."""


@pytest.mark.parametrize("named", WRONG)
def test_what_no_vector_environment_should_return(named):
    for method, cases in WRONG[named].items():
        for changed in cases:
            environments = Environments(spoilt(chains(ENVS, "cycle"), method, changed))
            text = refusal(begin_and_step, environments, np.zeros((ENVS, 1), int))
            assert "SyncVectorEnv" in text
            assert named in text
            assert len(text) < 400


def test_lists_are_as_good_as_arrays_and_buffers_are_copied():
    buffer = np.zeros((ENVS, 1), np.float32)
    env = spoilt(chains(ENVS, "cycle"), "reset", lambda o, i: (buffer, i))
    environments = Environments(spoilt(env, "step", lambda o, r, *rest: (buffer, [1, 2, 3, 4], *rest)))
    first = environments.reset(0)
    step = environments.step(np.zeros((ENVS, 1), int))
    buffer += 1
    assert not first.any()
    assert not step.following.any()
    assert step.rewards.tolist() == [1, 2, 3, 4]
    assert (step.rewards.dtype, step.true_next.dtype) == (np.float32, np.float32)


class Reusing(Stairs):
    """Writes every observation into one array."""

    seen = np.zeros(1)

    def reset(self, *, seed=None, options=None):
        self.seen[:], info = super().reset(seed=seed)
        return self.seen, info

    def step(self, action):
        self.seen[:], *rest = super().step(action)
        return self.seen, *rest


def test_the_last_observation_is_not_that_of_the_reset():
    environments = make_environments(Reusing, 1)
    environments.reset(0)
    steps = [environments.step(np.zeros((1, 2), np.float32)) for _ in range(4)]
    assert [float(step.true_next[0, 0]) for step in steps] == [1, 2, 3, 1]
    assert [float(step.following[0, 0]) for step in steps] == [1, 2, 0, 1]


class Hanging(Stairs):
    def step(self, action):
        time.sleep(1000)


@pytest.mark.slow  # processes start
def test_a_worker_that_hangs_is_not_waited_for(monkeypatch):
    env = Spawned([Stairs, Hanging], autoreset_mode=AutoresetMode.SAME_STEP)
    environments = make_environments(env, 2)
    environments.reset(0)
    monkeypatch.setattr("swingup.learner.environments.PATIENCE", 0.2)
    assert "a worker of AsyncVectorEnv did not answer" in refusal(environments.step, ZEROS)
    assert not any(process.is_alive() for process in env.processes)


def spoilt_stairs(*given):
    return spoilt(Stairs(), *given)


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


@pytest.mark.parametrize("method", FAULTS)
def test_environments_that_fail(method):
    for changed in FAULTS[method]:
        given = ("reset", changed, 1) if method == "late" else (method, changed)
        make = functools.partial(spoilt_stairs, *given)
        for env in (make, SyncVectorEnv([make] * 2, autoreset_mode=AutoresetMode.SAME_STEP)):
            told = refusal(begin_and_step, make_environments(env, 2), ZEROS, steps=4)
            assert "stairs" in told.lower() or "SyncVectorEnv" in told
