"""Hand-made environments whose every number is known, and a small learner."""

import functools

import gymnasium
import jax.numpy as jnp
import numpy as np
from gymnasium.spaces import Box, Discrete, MultiDiscrete
from gymnasium.vector import AutoresetMode, SyncVectorEnv

from swingup.tasks.task import AbstractTask, Step

TINY = {
    "num_envs": 2, "num_steps": 16, "num_epochs": 1, "batch_size": 32, "policy_layers": (8,), "value_layers": (8,),
    "evaluate_every": 64, "checkpoint_every": 128, "evaluation_episodes": 2,
}  # fmt: skip
"""Of trainings that only have to run."""
LENT = TINY | {"evaluation_episodes": 0}
"""Of those in environments that are passed in, or that are scored by training."""


class Stairs(gymnasium.Env):
    """Observation: the steps so far, reward: the same, unless each pays the same; ends after three of them."""

    ends, pays = 3, None

    def __init__(self, terminates=False, observations=None, actions=None):
        self.observation_space = observations or Box(-np.inf, np.inf, (1,), np.float64)
        self.action_space = actions or Box(np.array([-2.0, 0.0]), np.array([2.0, 1.0]), dtype=np.float64)
        self.terminates = terminates

    def reset(self, *, seed=None, options=None):
        super().reset(seed=seed)
        self.steps = 0
        return np.zeros(1), {}

    def step(self, action):
        assert self.action_space.contains(action)
        self.steps += 1
        ended, reward = self.steps == self.ends, float(self.steps if self.pays is None else self.pays)
        return np.array([float(self.steps)]), reward, ended and self.terminates, ended and not self.terminates, {}


class Noisy(gymnasium.Env):
    """A random walk that starts anywhere: what it shows follows from its seed alone."""

    def __init__(self):
        self.observation_space = Box(-10.0, 10.0, (2, 1), np.float32)
        self.action_space = MultiDiscrete([3, 2], start=[1, 5])

    def reset(self, *, seed=None, options=None):
        super().reset(seed=seed)
        self.position = self.np_random.normal(size=(2, 1))
        return self.position.astype(np.float32), {}

    def step(self, action):
        assert self.action_space.contains(action), action
        self.position = 0.9 * self.position + 0.3 * self.np_random.normal(size=(2, 1))
        reward = -abs(self.position[0, 0] - (action[0] - 2)) - 0.1 * (action[1] - 5)
        return self.position.astype(np.float32), float(reward), False, bool(self.np_random.random() < 0.02), {}


def stairs(**changes):
    """A class of them with another end, pay or duration of a step."""
    return type("Stairs", (Stairs,), changes)


class Failing(Noisy):
    """Fails in one step, counted over all of them; ``raises`` is what it raises, or None once it is mended."""

    steps, fails_at, raises = 0, 70, None

    def step(self, action):
        Failing.steps += 1
        if Failing.raises is not None and Failing.steps == Failing.fails_at:
            raise Failing.raises
        return super().step(action)


class Chain(gymnasium.Env):
    """Of two kinds.

    ``cycle``: states 0 and 1 in turn, which pay 0 and 2; after 9 steps a time limit. ``walk``: states 0, 1, 2, 3
    pay 1 each, and then it ends itself. A choice of three pays 0, 1 or 2 on top.
    """

    def __init__(self, kind):
        self.cycles = kind == "cycle"
        self.observation_space, self.action_space = Box(-1.0, 9.0, (1,), np.float32), Discrete(3)

    def reset(self, *, seed=None, options=None):
        self.state, self.steps = 0.0, 0
        return np.zeros(1, np.float32), {}

    def step(self, action):
        reward = (2.0 * self.state if self.cycles else 1.0) + action
        self.state = 1.0 - self.state if self.cycles else self.state + 1.0
        self.steps += 1
        ended = self.steps >= (9 if self.cycles else 4)
        return np.float32([self.state]), reward, ended and not self.cycles, ended and self.cycles, {}


def chains(count, kind, mode=AutoresetMode.SAME_STEP):
    return SyncVectorEnv([functools.partial(Chain, kind)] * count, autoreset_mode=mode)


class Lever(AbstractTask):
    """In JAX: ten choices of three, which pay ``first`` and 0, 1 or 2 more; each step is seen as ``shown``."""

    ends: float = 10.0
    shown: float = 0.0
    first: float = 1.0

    observation_size = 1
    action_size = 1
    choices = (3,)

    def reset(self, key):
        return jnp.zeros(())

    def observe(self, state):
        return state[None] * self.shown

    def step(self, state, action, key):
        after = state + 1.0
        return Step(after, self.observe(after), self.first + action[0], jnp.array(False), after >= self.ends)
