"""Environments with envelope's interface as tasks, and the learner on them."""

import re
from collections.abc import Callable

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from swingup import AREAPO
from swingup.common.errors import SwingupError
from swingup.tasks.adapters import as_task
from swingup.tasks.envelope_task import EnvelopeTask

from .contract import Ending, check_contract
from .halls import BatchedSpace, Continuous, Crossing, Discrete, Hall, PyTreeSpace, State

TINY = {
    "num_envs": 2, "num_steps": 16, "num_epochs": 1, "batch_size": 32, "policy_layers": (8,), "value_layers": (8,),
    "evaluate_every": 64, "evaluation_episodes": 2,
}  # fmt: skip


def moved_by(place, time):
    """The last observation as a function of the first one."""
    return lambda start: start + np.array([place, time])


@pytest.mark.parametrize(
    ("env", "endings"),
    [
        pytest.param(
            # Scaled to [-1, 3]: 1 walks 1.5 a step, beyond the door in the second; -0.5 stands still to the limit.
            Hall(), [Ending(1.0, 2, True, moved_by(3.0, 1.0)), Ending(-0.5, 6, False, moved_by(0.0, 3.0))],
            id="continuous",
        ),
        # 1 walks 0.5 a step, beyond a door at 2.25 in the fifth, wherever it starts.
        pytest.param(Crossing(door=2.25), [Ending((1, 1), 5, True, moved_by(2.5, 2.5))], id="choices"),
    ],
)  # fmt: skip
def test_adapter_keeps_the_contract(env, endings):
    check_contract(EnvelopeTask(env), endings)


def test_numbers_of_an_environment_are_arguments():
    compilations = []

    @jax.jit
    def ends(task):
        compilations.append(task)
        return task.step(task.reset(jax.random.key(0)), jnp.ones(1), jax.random.key(1)).terminated

    # The first step goes 1.5 far.
    assert [bool(ends(EnvelopeTask(Hall(door=door)))) for door in (1.0, 2.0)] == [True, False]
    assert len(compilations) == 1


def test_what_is_taken_for_an_envelope_environment():
    task = as_task(Hall())
    assert isinstance(task, EnvelopeTask)
    assert (task.observation_size, task.action_size, task.choices) == (2, 1, ())
    assert EnvelopeTask(Crossing()).choices == (3, 2)
    for other in (Hall, task, "Pendulum-v1", jnp):
        assert as_task(other) is other


class Changed(Hall):
    """A hall that returns other information, or another state after a step."""

    start: Callable = eqx.field(static=True, default=dict)
    later: Callable = eqx.field(static=True, default=dict)

    def init(self, key):
        state, info = Hall.init(self, key)
        return state, changed(info, self.start())

    def step(self, state, action):
        after, info = Hall.step(self, state, action)
        return State(**{**after._asdict(), **self.later()}), changed(info, self.start())


def changed(info, entries):
    """Information with other entries; None takes one out."""
    given = {**info._asdict(), **entries}
    return Bag({name: value for name, value in given.items() if value is not None})


@jax.tree_util.register_pytree_node_class
class Bag:
    def __init__(self, entries):
        self.__dict__ = entries

    def tree_flatten(self):
        return list(self.__dict__.values()), tuple(self.__dict__)

    @classmethod
    def tree_unflatten(cls, names, values):
        return cls(dict(zip(names, values, strict=True)))


class Broken(Hall):
    def step(self, state, action):
        raise RuntimeError("no floor")


class Alone(Hall):
    def init(self, key):
        return Hall.init(self, key)[0].place


BOX = Continuous(-1.0, 1.0, (1, 1))


@pytest.mark.parametrize(
    ("env", "message"),
    [
        (Hall(action_space=BatchedSpace(BOX, 8)), "Hall is several environments in one: pass one alone"),
        (
            Hall(action_space=PyTreeSpace((BOX, BOX))),
            "actions .* several arrays: wrap it in envelope.FlattenActionWrapper",
        ),
        (
            Hall(observation_space=PyTreeSpace((BOX, Discrete(2)))),
            "observations .* are several arrays: wrap it in envelope.ContinuousObservationWrapper and Flatten",
        ),
        (Hall(action_space=Continuous(-np.inf, 1.0, (1,))), "have no bounds to scale to"),
        (Hall(action_space=Discrete((2, 0))), "are empty: give them a choice"),
        (Hall(door="shut"), "parameters of Hall have a leaf 'shut'"),
        (Changed(start=lambda: {"final_valid": True}), "Changed resets itself: leave AutoResetWrapper out"),
        (Changed(start=lambda: {"unnormalized_obs": 0.0}), "leave ObservationNormalizationWrapper out"),
        (Changed(start=lambda: {"truncated": None}), "the information of Changed has no truncated"),
        (Changed(start=lambda: {"reward": np.zeros(3)}), "Changed pays 3 rewards at a time"),
        (Changed(start=lambda: {"obs": np.zeros((4, 4, 3), np.uint8)}), "images, which these networks cannot see"),
        (Changed(start=lambda: {"obs": {}}), "make it one array with an entry"),
        (Changed(later=lambda: {"time": 1.5}), "changes an entry of the state from .*int32.* to .*float32"),
        (Alone(), "Alone.init returns .*: it must return state and information"),
        (Broken(), r"Broken.step\(state, action\) raised RuntimeError \(no floor\)"),
    ],
)
def test_refusals_name_what_cannot_be_done(env, message):
    with pytest.raises(SwingupError, match=message) as caught:
        EnvelopeTask(env)
    assert re.search("\n", str(caught.value)) is None


@pytest.mark.slow  # compiles a training program
def test_an_environment_trains_saves_and_goes_on(tmp_path):
    model = AREAPO(Hall(max_steps=5), seed=3, **TINY).learn(64)
    assert model.settings.env == "<learner.halls.Hall>"
    actions = model.predict(np.zeros((7, 1, 2)))
    assert actions.shape == (7, 1, 1)
    assert np.all((actions > -1.0) & (actions < 3.0))
    model.save(tmp_path / "model.safetensors")
    other = AREAPO.load(tmp_path / "model.safetensors", env=Hall(max_steps=5))
    start = np.ones((1, 2))
    np.testing.assert_array_equal(model.learn(64).predict(start), other.learn(64).predict(start))
    # The first step of at most 1.5 ends it.
    assert model.evaluate(2, env=Hall(door=-0.7))["mean_length"] == 1.0


def package(suite):
    """The package, where it and one of its suites are installed."""
    pytest.importorskip(suite, reason=f"{suite} is not installed: see docs/learner.md")
    return pytest.importorskip("envelope", reason="jax-envelope is not installed: pip install 'swingup[envelope]'")


@pytest.mark.slow  # the packages are not installed with the tests
@pytest.mark.filterwarnings("default")  # theirs
def test_a_terminating_environment_of_the_package():
    """In jumanji's Snake the head runs into a wall."""
    envelope = package("jumanji")
    inner = envelope.create("jumanji::Snake-v1", {"num_rows": 4, "num_cols": 4}, max_episode_steps=9)
    env = envelope.FlattenObservationWrapper(envelope.ContinuousObservationWrapper(inner))
    with pytest.raises(SwingupError, match=r"several arrays: wrap it in envelope\.ContinuousObservationWrapper"):
        EnvelopeTask(inner)
    task = EnvelopeTask(env)
    assert task.choices == (4,)
    # Always up, 0, from the contract's first start: stepped here by the package alone.
    step = jax.jit(inner.step)
    state, info = jax.jit(inner.init)(jax.random.split(jax.random.key(5))[0])
    steps = 0
    while not info.terminated:
        state, info = step(state, jnp.array(0))
        steps += 1
    last = np.concatenate([np.ravel(leaf) for leaf in jax.tree.leaves(info.obs)])
    assert 1 <= steps <= 4
    check_contract(task, [Ending(0, steps, True, lambda start: last)])


@pytest.mark.slow  # the packages are not installed with the tests
@pytest.mark.filterwarnings("default")  # theirs
def test_an_environment_of_the_package_trains():
    """brax's simplest one: its speed grows while the action is positive, and every episode starts alike."""
    env = package("brax").create("brax::fast", max_episode_steps=4)
    task = EnvelopeTask(env)
    key = jax.random.key(0)

    @jax.jit
    def run():
        return jax.lax.scan(
            lambda state, key: ((after := task.step(state, jnp.ones(1), key)).state, after),
            task.reset(key), jax.random.split(key, 4),
        )[1]  # fmt: skip

    steps = run()
    assert steps.truncated.tolist() == [False, False, False, True]
    assert not np.any(steps.terminated)
    # With steps of 0.02 s, speeds of 0.02, 0.04, ...: places of 0.0004 times 1, 3, 6, 10.
    np.testing.assert_allclose(steps.observation[-1], [0.004, 0.08], rtol=1e-5)
    np.testing.assert_allclose(steps.reward, np.array([1, 3, 6, 10]) * 4e-4, rtol=1e-5)
    model = AREAPO(env, **TINY).learn(64)
    assert model.settings.env == "<envelope.adapters.brax_envelope.BraxEnvelope>"
    assert model.evaluate(2)["mean_length"] == 4.0
