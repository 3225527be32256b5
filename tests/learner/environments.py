"""Hand-made Gymnasium environments whose every number is known."""

import gymnasium
import numpy as np
from gymnasium.spaces import Box, Discrete, MultiDiscrete
from gymnasium.vector import AutoresetMode, VectorEnv
from gymnasium.vector.utils import batch_space


class Stairs(gymnasium.Env):
    """Observation: the steps so far, reward: the same, unless each pays the same; ends after three of them."""

    ends, pays = 3, None

    def __init__(self, terminates=False):
        self.observation_space = Box(-np.inf, np.inf, (1,), np.float64)
        self.action_space = Box(np.array([-2.0, 0.0]), np.array([2.0, 1.0]), dtype=np.float64)
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


class Endless(Stairs):
    ends, pays = None, 2.0


class Failing(Noisy):
    """Fails in one step, counted over all of them; ``raises`` is what it raises, or None once it is mended."""

    steps, fails_at, raises = 0, 70, None

    def step(self, action):
        Failing.steps += 1
        if Failing.raises is not None and Failing.steps == Failing.fails_at:
            raise Failing.raises
        return super().step(action)


class Chain(VectorEnv):
    """Hand-made, vectorised, in any autoreset mode; two kinds.

    ``cycle``: states 0 and 1 in turn, which pay 0 and 2; after 9 steps a time limit. ``walk``: states 0, 1, 2, 3
    pay 1 each, and then it ends itself. A choice of three pays 0, 1 or 2 on top.
    """

    def __init__(self, num_envs, kind, mode):
        self.num_envs, self.kind = num_envs, kind
        self.metadata = {"autoreset_mode": mode}
        self.single_observation_space, self.single_action_space = Box(-1.0, 9.0, (1,), np.float32), Discrete(3)
        self.observation_space = batch_space(self.single_observation_space, num_envs)
        self.action_space = batch_space(self.single_action_space, num_envs)

    def reset(self, *, seed=None, options=None):
        mask = (options or {}).get("reset_mask", np.ones(self.num_envs, bool))
        if mask.all():
            self.state, self.steps = np.zeros(self.num_envs), np.zeros(self.num_envs, int)
            self.ended = np.zeros(self.num_envs, bool)
        self._restart(mask)
        return self._observe(), {}

    def _restart(self, mask):
        self.state[mask], self.steps[mask], self.ended[mask] = 0.0, 0, False

    def _observe(self):
        return self.state[:, None].astype(np.float32)

    def step(self, actions):
        mode = self.metadata["autoreset_mode"]
        resetting = self.ended.copy()
        assert mode is AutoresetMode.NEXT_STEP or not resetting.any()
        cycle = self.kind == "cycle"
        rewards = (2.0 * self.state if cycle else 1.0) + actions
        self.state = 1.0 - self.state if cycle else self.state + 1.0
        self.steps += 1
        self.ended = self.steps >= (9 if cycle else 4)
        self._restart(resetting)
        rewards = np.where(resetting, 0.0, rewards)
        ended, seen, infos = self.ended.copy(), self._observe(), {}
        if mode is AutoresetMode.SAME_STEP and ended.any():
            infos = {"final_obs": seen.copy(), "_final_obs": ended}
            self._restart(ended)
            seen = self._observe()
        never = np.zeros(self.num_envs, bool)
        return seen, rewards, never if cycle else ended, ended if cycle else never, infos
