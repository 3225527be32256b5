"""Small environments in envelope's style, which need no envelope."""

from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp

from .corridors import Box as Continuous
from .corridors import Discrete, State


class PyTreeSpace(NamedTuple):
    tree: Any


class BatchedSpace(NamedTuple):
    space: Any
    batch_size: int


class Info(NamedTuple):
    obs: Any
    reward: Any
    terminated: Any
    truncated: Any = False


class Hall(eqx.Module):
    """Walk from near 0: beyond ``door`` it terminates; going there pays."""

    door: float = 2.0
    max_steps: int = 6
    action_space: Any = eqx.field(static=True, default=Continuous(-1.0, 3.0, (1, 1)))
    observation_space: Any = eqx.field(static=True, default=Continuous(-9.0, 9.0, (1, 2)))

    def observe(self, state):
        return jnp.array([[state.place, 0.5 * state.time]])

    def init(self, key):
        # Python's numbers, as envelope's own adapters return them.
        state = State(jax.random.uniform(key, (), minval=-0.1, maxval=0.1), 0)
        return state, Info(self.observe(state), 0.0, False)

    def step(self, state, action):
        pace = self.pace(action)
        after = State(state.place + 0.5 * pace, state.time + 1)
        # The hall ends at the door: a learner that goes on without a reset sees NaN.
        reward = jnp.where(state.place > self.door, jnp.nan, pace)
        return after, Info(self.observe(after), reward, after.place > self.door, after.time >= self.max_steps)

    def pace(self, action):
        return jnp.asarray(action, float).reshape(())


class Crossing(Hall):
    """The hall with three directions along it and two across, which do not matter."""

    action_space: Any = eqx.field(static=True, default=Discrete((3, 2)))

    def pace(self, action):
        return action[0].astype(float)
