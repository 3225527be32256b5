"""Environments with the methods of brax and MuJoCo Playground as tasks."""

import dataclasses
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from swingup import AREAPO
from swingup.common.errors import SwingupError
from swingup.tasks.adapters import as_task
from swingup.tasks.brax_task import BraxTask

from .contract import TINY, Ending, check_contract, moved_by


@jax.tree_util.register_dataclass
@dataclasses.dataclass
class State:
    """As both packages have it: flags are numbers."""

    data: Any
    obs: Any
    reward: Any
    done: Any
    metrics: dict
    info: dict


class Hall:
    """Walk from near 0: beyond 2.25 it is done, and after 6 steps; ``info`` may have a word for the limit."""

    action_size = 1
    dt = 0.5

    def __init__(self, limit="time_out", observe=lambda seen: seen, **first):
        self.limit, self.observe, self.first = limit, observe, first

    def reset(self, key):
        return self.state(jax.random.uniform(key, (), minval=-0.1, maxval=0.1), 0)

    def state(self, place, time):
        left, late = place > 2.25, jnp.asarray(time) >= 6
        info = {} if self.limit is None else {self.limit: late.astype(float)}
        seen = jnp.stack([place, 0.5 * time])[None]
        done = jnp.asarray(left | late, jnp.float32)
        return State((place, time), self.observe(seen), place, done, {"place": place}, info | self.first)

    def step(self, state, action):
        place, time = state.data
        return self.state(place + 0.5 * action[0], time + 1)


ENDINGS = [Ending(1.0, 5, True, moved_by(2.5, 2.5)), Ending(0.0, 6, False, moved_by(0.0, 3.0))]


@pytest.mark.parametrize("limit", ["time_out", "truncation"])
def test_adapter_keeps_the_contract(limit):
    check_contract(BraxTask(Hall(limit)), ENDINGS)


def test_an_end_without_a_word_terminates_and_the_actor_sees_its_own_part():
    several = Hall(None, lambda seen: {"privileged_state": jnp.zeros(9), "state": seen})
    check_contract(BraxTask(several), [dataclasses.replace(each, terminated=True) for each in ENDINGS])


@pytest.mark.slow
def test_a_learner_takes_it_as_it_is():
    hall = Hall()
    task = as_task(hall)
    assert isinstance(task, BraxTask)
    assert (task.observation_size, task.action_size, task.timed) == (2, 1, (hall, hall))
    model = AREAPO(hall, **TINY).learn(32)
    assert np.abs(model.predict([[0.0, 0.0]])).max() <= 1.0
    assert model.evaluate(2)["mean_length"] <= 6


@pytest.mark.parametrize(
    ("env", "message"),
    [
        (Hall(first_obs=0.0), "Hall resets itself: leave AutoResetWrapper out"),
        (Hall(observe=lambda seen: {"pixels": seen}), r"observations \['pixels'\] have no entry 'state'"),
        (Hall(observe=lambda seen: {}["state"]), r"Hall.reset\(key\) raised KeyError"),
        (Hall(observe=lambda seen: seen[:, :0]), "make it one array with an entry"),
        (type("None0", (Hall,), {"action_size": 0})(), "action_size of None0 = 0"),
        (type("Bare", (Hall,), {"reset": lambda self, key: jnp.zeros(2)})(), "the state of Bare has no obs"),
    ],
)
def test_what_is_refused(env, message):
    with pytest.raises(SwingupError, match=message):
        as_task(env)
