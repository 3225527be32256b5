"""One small environment in the styles of Gymnasium, gymnax, envelope and brax; of these only Gymnasium is needed.

In all of them one walks from near 0: beyond a door they end, and going there pays.
"""

import functools
from collections import namedtuple
from typing import Any

import equinox as eqx
import gymnasium
import jax
import jax.numpy as jnp
import numpy as np

Box = namedtuple("Box", "low high shape dtype", defaults=(jnp.float32,))
Discrete = namedtuple("Discrete", "n")
PyTreeSpace = namedtuple("PyTreeSpace", "tree")
BatchedSpace = namedtuple("BatchedSpace", "space batch_size")
PACES, PLACES = Box(-1.0, 3.0, (1, 1)), Box(-9.0, 9.0, (1, 2))

Params = namedtuple("Params", "pace door max_steps_in_episode", defaults=(0.5, 2.0, 6))
State = namedtuple("State", "place time")
Info = namedtuple("Info", "obs reward terminated truncated", defaults=(False,))


def begin(key):
    return State(jax.random.uniform(key, (), minval=-0.1, maxval=0.1), 0)


def seen(state):
    return jnp.array([[state.place, 0.5 * state.time]])


def walk(state, action, pace, door):
    """The next state, the reward, and whether the door was passed."""
    action = jnp.asarray(action, float).ravel()[0]
    after = State(state.place + pace * action, state.time + 1)
    # The corridor ends at the door: a learner that goes on without a reset sees NaN.
    return after, jnp.where(state.place > door, jnp.nan, action), after.place > door


class Corridor:
    """Gymnax's style, with what its base class does."""

    default_params = Params()

    def __init__(self, actions=PACES, observations=PLACES):
        self.action_space, self.observation_space = (lambda params: actions), (lambda params: observations)

    @functools.partial(jax.jit, static_argnames=("self",))
    def step(self, key, state, action, params):
        step_key, reset_key = jax.random.split(key)
        last, after, reward, terminated, info = self.step_env(step_key, state, action, params)
        truncated = self.is_truncated(after, params)
        fresh = self.reset(reset_key, params)
        ended = terminated | truncated
        seen, state = jax.tree.map(lambda new, old: jnp.where(ended, new, old), fresh, (last, after))
        return seen, state, reward, terminated, truncated, {**info, "final_observation": last}

    def is_truncated(self, state, params):
        return state.time >= params.max_steps_in_episode

    def reset(self, key, params):
        return seen(begin(key)), begin(key)

    def step_env(self, key, state, action, params):
        after, reward, terminated = walk(state, action, params.pace, params.door)
        return seen(after), after, reward, terminated, {}


class Logged:
    """A wrapper as gymnax has them: a state of its own, everything else from what it wraps."""

    def __init__(self, env):
        self._env = env

    def __getattr__(self, name):
        return getattr(self._env, name)

    def reset(self, key, params):
        seen, state = self._env.reset(key, params)
        return seen, (state, jnp.zeros(()))

    def step(self, key, state, action, params):
        seen, inner, reward, terminated, truncated, info = self._env.step(key, state[0], action, params)
        return seen, (inner, state[1] + reward), reward, terminated, truncated, info


class Hall(eqx.Module):
    """Envelope's style."""

    door: float = 2.0
    max_steps: int = 6
    action_space: Any = eqx.field(static=True, default=PACES)
    observation_space: Any = eqx.field(static=True, default=PLACES)

    def init(self, key):
        # Python's numbers, as envelope's own adapters return them.
        return begin(key), Info(seen(begin(key)), 0.0, False)

    def step(self, state, action):
        after, reward, terminated = walk(state, action, 0.5, self.door)
        return after, Info(seen(after), reward, terminated, after.time >= self.max_steps)


class Passage(gymnasium.Env):
    """Gymnasium's style."""

    observation_space = gymnasium.spaces.Box(-9.0, 9.0, (1, 2), np.float32)

    def __init__(self, door=2.0, max_steps=6, actions=None):
        self.action_space = gymnasium.spaces.Box(-1.0, 3.0, (1, 1)) if actions is None else actions
        self.door, self.max_steps = door, max_steps

    def reset(self, *, seed=None, options=None):
        super().reset(seed=seed)
        self.state = State(self.np_random.uniform(-0.1, 0.1), 0)
        return np.float32([[self.state.place, 0.0]]), {}

    def step(self, action):
        assert self.action_space.contains(action), action
        pace = float(np.ravel(action)[0])
        self.state = State(self.state.place + 0.5 * pace, self.state.time + 1)
        ended, (place, time) = self.state.place > self.door, self.state
        return np.float32([[place, 0.5 * time]]), pace, ended, time >= self.max_steps, {}


class Room:
    """Brax's style."""

    action_size = 1

    def reset(self, key):
        raise NotImplementedError

    def step(self, state, action):
        raise NotImplementedError
