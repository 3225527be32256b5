"""Policies of any task by NumPy: against JAX, in another process without JAX, spaces, samples and damaged files."""

import dataclasses
import functools
import subprocess
import sys

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from array_files import change_file
from refusals import refusal
from swingup import SwingupError, load_policy
from swingup.areapo.initial import init_actor, init_categorical_actor
from swingup.controllers.stack.policy import Policy, network_of, save_policy
from swingup.policy.network import NormaliseStage
from swingup.policy.policy import TaskPolicy, task_metadata
from swingup.policy.spaces import box, discrete, read_space

VALVE_AND_HEATER = box((2,), [0.0, -0.1], [5.0, 20.0])
TASKS = {
    "unequal bounds": (box((3,)), VALVE_AND_HEATER, "tanh", "clip", 1.0, 0.0),
    "squashed": (box((2, 2)), box((1, 2), -3.0, 1.0), "relu", "tanh", 1.0, 0.0),
    "discrete": (box((4,)), discrete(3, -1), "elu", "tanh", 1.0, 0.0),
    "several choices": (box((2,)), discrete([3, 2], [1, 5]), "silu", "tanh", 1.0, 0.0),
    "tiny observations": (box((3,)), box((1,), -1.0, 1.0, "float64"), "gelu", "tanh", 1e-6, 0.0),
    "far observations": (box((3,)), box((2,), -2.0, 2.0), "silu", "clip", 1.0, 1e6),
}
"""Spaces of observations and actions, activation, bounds, and the observations' deviation and mean."""


@functools.cache
def untrained(name):
    """A policy in JAX with weights of an ordinary size, and 10,000 observations."""
    observations, actions, activation, bounds, scale, mean = TASKS[name]
    key, layers = jax.random.key(3), (32, 32)
    actor = (
        init_categorical_actor(key, observations.size, actions.choices, layers, activation)
        if actions.choices
        else init_actor(key, observations.size, actions.size, layers, -1.0, activation, bounds)
    )
    # An untrained head hardly acts.
    head = "logits_head" if actions.choices else "mean_head"
    larger = jax.tree.map(lambda leaf: 100.0 * leaf, getattr(actor, head))
    actor = dataclasses.replace(actor, **{head: larger})
    rows = np.float32(mean + scale * np.random.default_rng(0).normal(size=(10_000, observations.size)))
    statistics = (np.float64(np.float32(each(rows, axis=0, dtype=np.float64))) for each in (np.mean, np.var))
    return Policy((NormaliseStage(*statistics, 10.0, 1e-18),), actor), rows.reshape(-1, *observations.shape)


@pytest.fixture(scope="module")
def files(tmp_path_factory):
    """A policy file of each task, by its name."""
    folder = tmp_path_factory.mktemp("policies")
    for name, (seen, actions, *_) in TASKS.items():
        metadata = task_metadata(name, seen, actions, 0.05) | {"score": 7}
        save_policy(folder / f"{name}.safetensors", untrained(name)[0], metadata)
    return {name: folder / f"{name}.safetensors" for name in TASKS}


@pytest.fixture(params=TASKS)
def case(request, files):
    policy, observations = untrained(request.param)
    return policy, observations, TASKS[request.param][1], load_policy(files[request.param])


def test_numpy_acts_as_jax_does(case):
    policy, observations, actions, found = case
    got, state = found.predict(observations)
    assert (state, got.dtype, got.shape) == (None, actions.dtype, (10_000, *actions.shape))
    with jax.enable_x64(True):
        rows = jnp.asarray(observations.reshape(10_000, -1), jnp.float64)
        chosen = np.asarray(jax.jit(jax.vmap(policy))(rows))
    expected = actions(chosen)
    if actions.choices:
        np.testing.assert_array_equal(got, expected)
        assert len(np.unique(got, axis=0)) > 2
    else:
        assert np.max(np.abs(got - expected) / (actions.high - actions.low)) < 1e-6
        assert np.ptp(chosen) > 1.0
    single, _ = found.predict(observations[0].tolist())
    np.testing.assert_allclose(single, got[0], rtol=1e-6)
    assert (found.period, found.metadata["score"]) == (0.05, 7)


def test_samples_have_the_learners_distribution(case):
    policy, observations, actions, found = case
    seen = np.repeat(observations[:1], 20_000, axis=0)
    found.seed(1)
    drawn, _ = found.predict(seen, deterministic=False)
    found.seed(1)
    np.testing.assert_array_equal(drawn, found.predict(seen, deterministic=False)[0])
    noise = policy.actor.noise(jax.random.key(0), (20_000,))
    latents = jax.jit(
        lambda noise: policy.actor(jax.vmap(policy.observe)(seen.reshape(20_000, -1)).T).sample(noise)
    )(noise)
    expected = actions(np.asarray(policy.actor(jnp.zeros((len(policy.stages[0].mean),))).action(latents)).T)
    # Five standard errors of a mean of 20,000 samples, twice.
    scale = np.std(expected, axis=0) + 1e-6
    assert np.all(np.abs(drawn.mean(axis=0) - expected.mean(axis=0)) < 0.05 * scale)
    assert np.all(np.abs(drawn.std(axis=0) - expected.std(axis=0)) < 0.05 * scale)


ELSEWHERE = """
import sys
sys.modules["jax"] = sys.modules["gymnasium"] = None
import numpy as np
from swingup.runtime import load_policy
for path in sys.argv[1:]:
    policy = load_policy(path)
    print(policy.predict(np.ones(policy.observation_space.shape))[0].tolist())
"""


def test_files_act_the_same_in_another_process_without_jax(files):
    result = subprocess.run(
        [sys.executable, "-c", ELSEWHERE, *map(str, files.values())], capture_output=True, text=True, check=True
    )
    mine = map(load_policy, files.values())
    actions = [policy.predict(np.ones(policy.observation_space.shape))[0].tolist() for policy in mine]
    assert result.stdout.splitlines() == list(map(str, actions))


def test_a_pendulums_policy_is_one_too():
    policy = load_policy("adaptive", "acrobot")
    states = np.random.default_rng(0).normal(size=(5, 4))
    shares, _ = policy.predict(states)
    assert (shares.shape, policy.task, policy.action_space.kind) == ((5, 1), "acrobot", "box")
    np.testing.assert_allclose(policy.predict(states[2])[0], shares[2], atol=1e-12)
    assert np.all(np.abs(shares) <= 1.0)


def test_whole_numbers_are_not_rounded():
    pixels = box((2,), 0, 255, "uint8")
    np.testing.assert_array_equal(pixels.batch([3.0, 255])[0], [[3, 255]])
    for value in (0.73, -1, 300):
        with pytest.raises(SwingupError, match=rf"holds {value}, which is no uint8"):
            pixels.batch([value, 0])


def test_what_predict_refuses(tmp_path):
    observations, actions, *_ = TASKS["unequal bounds"]
    policy, seen = untrained("unequal bounds")
    known = TaskPolicy(network_of(policy), task_metadata("t", observations, actions, None))
    assert "holds nan" in refusal(known.predict, [0.0, np.nan, 0.0])
    assert "shape (2,): pass (3,)" in refusal(known.predict, [0.0, 0.0])
    assert "array of numbers" in refusal(known.predict, ["a", "b", "c"])
    assert "no memory" in refusal(known.predict, seen, 0)
    path = tmp_path / "p.safetensors"
    save_policy(path, policy, known.metadata)
    assert "is of 't', not of a pendulum" in refusal(load_policy, path, "acrobot")
    for entry in ("observation_space", "action_space"):
        for change in (3, {"type": "text"}, {"shape": [2, 2]}, {"shape": "2"}, {"shape": [0]}, {"dtype": "object"}):
            spoilt = known.metadata[entry] | change if isinstance(change, dict) else change
            change_file(path, known.metadata | {entry: spoilt})
            assert "p.safetensors" in refusal(load_policy, path)
    for change in ({"low": None}, {"low": [0.0]}, {"high": ["a", "b"]}, {"high": [[1], 2]}):
        change_file(path, known.metadata | {"action_space": known.metadata["action_space"] | change})
        assert "p.safetensors" in refusal(load_policy, path)


@pytest.mark.parametrize("space", [VALVE_AND_HEATER, discrete(3, 2), discrete([[3, 2], [1, 4]]), box((2, 3))])
def test_a_space_survives_its_file(space):
    again = read_space("action_space", space.describe())
    assert again.describe() == space.describe()
    assert (again.shape, again.dtype, again.choices) == (space.shape, space.dtype, space.choices)


def test_bounds_whose_difference_half_precision_cannot_hold():
    wide = box((1,), -40000.0, 40000.0, "float16")
    assert wide(np.float32([[-1.0], [0.0], [1.0]])).ravel().tolist() == [-40000.0, 0.0, 40000.0]


def test_spaces_without_numbers_are_refused():
    one, several = {"type": "discrete"}, {"type": "multi_discrete"}
    for entry in (
        one,
        one | {"n": [3]},
        one | {"n": 0},
        one | {"n": 300, "dtype": "uint8"},
        one | {"n": 3, "start": -5, "dtype": "uint8"},
        {"type": "box", "shape": [1], "low": [1.0], "high": [-1.0]},
        several | {"nvec": 2},
        several | {"nvec": [2], "start": [1, 2]},
    ):
        with pytest.raises(SwingupError, match="action_space"):
            read_space("action_space", entry)
