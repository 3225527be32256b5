"""Environments with envelope's interface as tasks, and the learner on them."""

from collections import namedtuple
from collections.abc import Callable

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from swingup.common.errors import SwingupError
from swingup.tasks.adapters import as_task
from swingup.tasks.envelope_task import EnvelopeTask

from .contract import Ending, check_contract, moved_by
from .halls import BatchedSpace, Continuous, Crossing, Discrete, Hall, PyTreeSpace, State


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
        return state, self.changed(info)

    def step(self, state, action):
        after, info = Hall.step(self, state, action)
        return State(**{**after._asdict(), **self.later()}), self.changed(info)

    def changed(self, info):
        """Information with other entries; None takes one out."""
        given = {name: value for name, value in {**info._asdict(), **self.start()}.items() if value is not None}
        return namedtuple("Bag", given)(**given)


class Broken(Hall):
    def step(self, state, action):
        raise RuntimeError("no floor")


class Alone(Hall):
    def init(self, key):
        return Hall.init(self, key)[0].place


BOX = Continuous(-1.0, 1.0, (1, 1))
REFUSED = {
    "several environments in one": Hall(action_space=BatchedSpace(BOX, 8)),
    r"wrap it in envelope\.FlattenActionWrapper": Hall(action_space=PyTreeSpace((BOX, BOX))),
    r"wrap it in envelope\.ContinuousObservationWrapper": Hall(observation_space=PyTreeSpace((BOX, Discrete(2)))),
    "have no bounds to scale to": Hall(action_space=Continuous(-np.inf, 1.0, (1,))),
    "are empty: give them a choice": Hall(action_space=Discrete((2, 0))),
    "leaf 'shut'": Hall(door="shut"),
    "leave AutoResetWrapper out": Changed(start=lambda: {"final_valid": True}),
    "leave ObservationNormalizationWrapper out": Changed(start=lambda: {"unnormalized_obs": 0.0}),
    "has no truncated": Changed(start=lambda: {"truncated": None}),
    "pays 3 rewards": Changed(start=lambda: {"reward": np.zeros(3)}),
    "images": Changed(start=lambda: {"obs": np.zeros((4, 4, 3), np.uint8)}),
    "one array with an entry": Changed(start=lambda: {"obs": {}}),
    "from .*int32.* to .*float32": Changed(later=lambda: {"time": 1.5}),
    r"Alone\.init returns": Alone(),
    r"raised RuntimeError \(no floor\)": Broken(),
}


@pytest.mark.parametrize("message", REFUSED)
def test_refusals_name_what_cannot_be_done(message):
    with pytest.raises(SwingupError, match=message) as caught:
        EnvelopeTask(REFUSED[message])
    assert "\n" not in str(caught.value)


@pytest.mark.slow  # the packages are not installed with the tests
@pytest.mark.filterwarnings("default")  # theirs
def test_a_terminating_environment_of_the_package():
    """In jumanji's Snake the head runs into a wall."""
    pytest.importorskip("jumanji", reason="jumanji is not installed: see docs/learner.md")
    envelope = pytest.importorskip(
        "envelope", reason="jax-envelope is not installed: pip install 'swingup[envelope]'"
    )
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
