"""The world of Gymnasium: the host steps the environments, what learns is compiled."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import jax
import numpy as np
from gymnasium.vector import VectorEnv
from jaxtyping import Float, Shaped

from ..areapo import train
from ..areapo.config import Config
from ..areapo.networks import CategoricalActor
from ..areapo.state import LearnerState, Metrics
from ..errors import SwingupError
from ..policy.jax_backend.policy import Policy, act, save_policy
from ..tasks.task import Spaces
from .backend import AbstractBackend, batched, portable_policy
from .environments import Environments, make_environments
from .evaluators import summary
from .host_collection import iterate, new_episodes

MAX_EPISODE_STEPS = 10_000
"""Where an evaluation cuts an episode that does not end (steps)."""


class HostBackend(AbstractBackend):
    """Environments of Gymnasium; policies are judged by their mean return."""

    measure = "episodes"

    def __init__(self, env: Any, name: str, config: Config, seed: int, episodes: int) -> None:
        """Make the environments.

        Args:
            env: an id, a function that makes an environment, or a vector environment.
            name: what policy files call it.
            config: the hyperparameters.
            seed: from which, and the iteration, the environments' seeds follow.
            episodes: of an evaluation; 0 for none, which leaves the mean return of training's episodes.

        Raises:
            SwingupError: there is no such environment, or its spaces are not supported.
        """
        self.name = name
        self.environments = make_environments(env, config.num_envs)
        self._env, self._config, self._seed, self._count = env, config, seed, episodes
        self._running = new_episodes(config.num_envs)
        self._recent: dict[str, Any] = {}  # how training went since the last report
        self._judges: dict[int, Environments] = {}

    def init(self) -> LearnerState:
        """The state before the first iteration: the environments were not reset yet."""
        return _init(jax.random.key(self._seed), self.environments, self._config)

    def begin(self, state: LearnerState, iterations: int) -> LearnerState:
        """Reset the environments, with seeds that follow from the run's seed and the iterations."""
        seed = int(np.random.SeedSequence([self._seed, iterations]).generate_state(1)[0] >> 1)
        self._running = new_episodes(self._config.num_envs)
        return _restarted(state, self.environments.reset(seed), self._config)

    def train(self, state: LearnerState, iterations: int) -> tuple[LearnerState, Metrics, dict[str, Any]]:
        """Run some iterations; reports the mean return and length of the episodes that ended."""
        self._running.returns.clear()
        self._running.finished.clear()
        rows = []
        for _ in range(iterations):
            state, metrics = iterate(state, self.environments, self._running, self._config)
            rows.append(jax.device_get(metrics))
        mean = jax.tree.map(lambda *leaves: np.mean(leaves, dtype=np.float32), *rows)
        ended, reward = self._running, float(mean.reward)
        if ended.returns:
            self._recent = summary(ended.returns, ended.finished)
        else:
            self._recent = {"score": reward, "mean_length": None, "mean_reward": reward}
        extras = {"episode_return": self._recent["score"] if ended.returns else None}
        return state, mean, extras | {"episode_length": self._recent["mean_length"]}

    def policy(self, member: LearnerState) -> Policy[Any]:
        """The policy of an observation, flattened."""
        return portable_policy((), member, self._config)

    def evaluate(self, policy: Policy[Any], episodes: int | None = None) -> dict[str, Any]:
        """Returns of episodes of other environments, the same ones each time.

        A vector environment that was passed in has no others: the score is the mean return of the episodes that
        ended in training since the last report, or, where none did, the mean reward of a step.

        Raises:
            SwingupError: episodes were asked for and there are no other environments.
        """
        own = isinstance(self._env, VectorEnv)
        if own and episodes is not None:
            raise SwingupError("a vector environment trains and cannot evaluate: pass evaluate another as env")
        if own or not (episodes or self._count):
            # The score of no step at all is as low as scores get.
            return self._recent or {"score": -np.inf, "mean_length": None, "mean_reward": None}
        count = episodes or self._count
        if count not in self._judges:
            self._judges[count] = make_environments(self._env, count)
        return play(policy, self._judges[count], self._seed)

    def save(self, path: Path, policy: Policy[Any], provenance: Mapping[str, Any]) -> None:
        """Write a policy file that names the environment and the bounds of its actions."""
        head = {"env": self.name, **self.environments.actions.describe()}
        save_policy(path, policy, {**head, **provenance})

    def flatten(self, observation: Any) -> tuple[Float[np.ndarray, "b n"], bool]:
        """Observations of the environment's space as a batch of vectors."""
        return batched(observation, self.environments.observation_space.shape or ())

    def to_actions(self, actions: Shaped[np.ndarray, "b m"]) -> Shaped[np.ndarray, "b ..."]:
        """Actions of the environment's space."""
        return self.environments.actions(actions)

    def close(self) -> None:
        """Close the environments, but for a vector environment that was passed in."""
        for environments in self._judges.values():
            environments.close()
        self._judges = {}
        if not isinstance(self._env, VectorEnv):
            self.environments.close()


def play_once(policy: Policy[Any], env: Any, episodes: int, seed: int) -> dict[str, Any]:
    """Episodes in environments that are made for them.

    Raises:
        SwingupError: the environments cannot be made, or the policy is for other spaces.
    """
    environments = make_environments(env, env.num_envs if isinstance(env, VectorEnv) else episodes)
    try:
        _check_spaces(policy, environments.spaces)
        return play(policy, environments, seed)
    finally:
        if not isinstance(env, VectorEnv):
            environments.close()


def _check_spaces(policy: Policy[Any], spaces: Spaces) -> None:
    """Refuse an environment whose observations or actions are not the policy's."""
    actor = policy.actor
    seen, discrete = actor.trunk[0].weight.shape[1], isinstance(actor, CategoricalActor)
    if seen != spaces.observation_size:
        raise SwingupError(f"the policy sees {seen} numbers, the environment shows {spaces.observation_size}")
    choices = actor.choices if discrete else ()
    size = len(choices) if discrete else actor.mean_head.weight.shape[0]
    if (size, choices) != (spaces.action_size, spaces.choices):
        mine, its = _actions(size, choices), _actions(spaces.action_size, spaces.choices)
        raise SwingupError(f"the policy's actions are {mine}, the environment's are {its}")


def _actions(size: int, choices: tuple[int, ...]) -> str:
    return f"{size} choices of {', '.join(map(str, choices))}" if choices else f"{size} numbers"


def play(policy: Policy[Any], environments: Environments, seed: int) -> dict[str, Any]:
    """The first episode of each environment under the deterministic policy, as means."""
    seen = environments.reset(seed)
    running = np.ones(environments.num_envs, np.bool_)
    returns, lengths = np.zeros(running.size), np.zeros(running.size, np.int64)
    for _ in range(MAX_EPISODE_STEPS):
        step = environments.step(act(policy, seen))
        returns += running * step.rewards
        lengths += running
        running &= ~step.ended
        seen = step.following
        if not running.any():
            break
    return summary(returns.tolist(), lengths.tolist())


_restarted = jax.jit(train.restarted)
_init_learner = jax.jit(train.init_learner, static_argnums=1)


def _init(key: jax.Array, environments: Environments, config: Config) -> LearnerState:
    return _init_learner(key, environments.spaces, config)
