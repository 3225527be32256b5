"""Small environments in gymnax's style, which need no gymnax and compile in no time."""

import functools
from typing import NamedTuple

import jax
import jax.numpy as jnp


class Box(NamedTuple):
    low: object
    high: object
    shape: tuple
    dtype: object = jnp.float32


class Discrete(NamedTuple):
    n: int


class Params(NamedTuple):
    pace: float = 0.5
    door: float = 2.0
    max_steps_in_episode: int = 6


class State(NamedTuple):
    place: jax.Array
    time: int


class Base:
    """What gymnax's base class does."""

    @functools.partial(jax.jit, static_argnames=("self",))
    def step(self, key, state, action, params):
        step_key, reset_key = jax.random.split(key)
        last, after, reward, terminated, info = self.step_env(step_key, state, action, params)
        truncated = self.is_truncated(after, params)
        fresh = self.reset_env(reset_key, params)
        ended = terminated | truncated
        seen, state = jax.tree.map(lambda new, old: jnp.where(ended, new, old), fresh, (last, after))
        return seen, state, reward, terminated, truncated, {**info, "final_observation": last}

    def reset(self, key, params):
        return self.reset_env(key, params)

    def is_truncated(self, state, params):
        return state.time >= params.max_steps_in_episode


class Corridor(Base):
    """Walk from near 0: beyond ``door`` it terminates; going there pays."""

    default_params = Params()

    def __init__(self, actions=None, observations=None):
        self.actions = actions or Box(-1.0, 3.0, (1, 1))
        self.observations = observations or Box(-9.0, 9.0, (1, 2))

    def action_space(self, params):
        return self.actions

    def observation_space(self, params):
        return self.observations

    def observe(self, state):
        return jnp.array([[state.place, 0.5 * state.time]])

    def reset_env(self, key, params):
        state = State(jax.random.uniform(key, (), minval=-0.1, maxval=0.1), 0)
        return self.observe(state), state

    def step_env(self, key, state, action, params):
        pace = jnp.asarray(action, float).reshape(())
        after = State(state.place + params.pace * pace, state.time + 1)
        # The corridor ends at the door: a learner that goes on without a reset sees NaN.
        reward = jnp.where(state.place > params.door, jnp.nan, pace)
        return self.observe(after), after, reward, after.place > params.door, {}


class Turns(Corridor):
    """The corridor with three choices: stay, walk, run."""

    def __init__(self):
        super().__init__(Discrete(3))


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
